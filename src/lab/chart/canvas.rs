//! Markup of a drawing, piece by piece, and the measures that all charts share. maud
//! escapes what is written into it.

use maud::{Markup, PreEscaped, Render, html};

use super::axis::{Axis, Better, Ruler};

/// All charts are as wide, so that on a page their frames and texts match.
pub(super) const WIDTH: f64 = 720.0;
/// Left and right of everything.
pub(super) const MARGIN: f64 = 4.0;
/// Sizes of text, as in `style`, and how much wider bold text is.
pub(super) const LABEL: f64 = 13.0;
pub(super) const TICK: f64 = 12.0;
pub(super) const BOLD: f64 = 1.12;
/// What all charts look like.
pub(super) const CSS: &str = include_str!("chart.css");
/// Height of a line of text.
pub(super) const LINE: f64 = 16.0;

#[derive(Debug, Default)]
pub(super) struct Canvas(String);

/// A finished chart.
pub(super) struct ChartDrawing {
    pub canvas: Canvas,
    pub bottom: f64,
}

/// The frame of a plot; y points down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rect {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

/// A length to a tenth of a pixel.
pub(super) fn n(value: f64) -> String {
    let text = format!("{value:.1}");
    let text = text.strip_suffix(".0").unwrap_or(&text);
    if text == "-0" { "0".to_string() } else { text.to_string() }
}

/// The `d` of a path through points.
pub(super) fn through(points: &[[f64; 2]]) -> String {
    let point =
        |(at, [x, y]): (usize, &[f64; 2])| format!("{}{} {}", if at == 0 { 'M' } else { 'L' }, n(*x), n(*y));
    points.iter().enumerate().map(point).collect()
}

impl Canvas {
    pub fn path(&mut self, class: &str, d: &str) {
        self.put(html! { path class=(class) d=(d) {} });
    }

    pub fn line(&mut self, class: &str, from: [f64; 2], to: [f64; 2]) {
        self.path(class, &through(&[from, to]));
    }

    pub fn arrow(&mut self, from: [f64; 2], to: [f64; 2]) {
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
        let length = dx.hypot(dy).max(1e-9);
        let ([ux, uy], head) = ([dx / length, dy / length], length.min(5.0));
        let side = |way: f64| [to[0] - head * (ux + way * uy), to[1] - head * (uy - way * ux)];
        self.path("arrow", &(through(&[from, to]) + &through(&[side(0.5), to, side(-0.5)])));
    }

    pub fn frame(&mut self, Rect { left, top, right, bottom }: Rect) {
        self.path("frame", &(through(&[[left, top], [right, top], [right, bottom], [left, bottom]]) + "z"));
    }

    /// A text at its `start`, `middle` or `end`, some of it in bold before the rest.
    pub fn text(&mut self, class: &str, [x, y]: [f64; 2], anchor: &str, bold: &str, rest: &str) {
        self.put(html! {
            text class=(class) x=(n(x)) y=(n(y)) text-anchor=[(anchor != "start").then_some(anchor)] {
                @if !bold.is_empty() { tspan.name { (bold) } }
                (rest)
            }
        });
    }

    /// Parts that belong together, moved, and what the pointer is told of them.
    pub fn group(&mut self, class: &str, tooltip: &str, by: [f64; 2], parts: Canvas) {
        let moved = (by != [0.0, 0.0]).then(|| format!("translate({} {})", n(by[0]), n(by[1])));
        self.put(html! {
            g class=(class) transform=[moved] {
                @if !tooltip.is_empty() { title { (tooltip) } }
                (PreEscaped(parts.0))
            }
            "\n"
        });
    }

    pub fn put(&mut self, what: Markup) {
        what.render_to(&mut self.0);
    }

    /// Grid lines and labels of a level axis; labels stay within the frame or nearly so.
    pub fn level_axis(&mut self, ruler: &Ruler, rect: Rect, labels: bool) {
        for (class, values) in lines(ruler) {
            values
                .iter()
                .for_each(|v| self.line(class, [ruler.at(*v), rect.top], [ruler.at(*v), rect.bottom]));
        }
        let mut taken = f64::NEG_INFINITY;
        for (value, label) in ruler.major.iter().filter(|_| labels) {
            let half = width(label, TICK) / 2.0;
            let place = ruler.at(*value).min(rect.right + 8.0 - half).max(rect.left - 8.0 + half);
            if place - half >= taken + 4.0 {
                taken = place + half;
                self.text("tick", [place, rect.bottom + LINE], "middle", "", label);
            }
        }
    }

    pub fn upright_axis(&mut self, ruler: &Ruler, rect: Rect, labels: bool) {
        for (class, values) in lines(ruler) {
            values
                .iter()
                .for_each(|v| self.line(class, [rect.left, ruler.at(*v)], [rect.right, ruler.at(*v)]));
        }
        for (value, label) in ruler.major.iter().filter(|_| labels) {
            self.text("tick", [rect.left - 7.0, ruler.at(*value) + TICK * 0.36], "end", "", label);
        }
    }

    /// The title of a level axis in its middle, and a hint at its good end.
    pub fn level_title(&mut self, axis: &Axis, [left, right]: [f64; 2], y: f64) {
        let (hint, x, anchor) = match axis.better {
            Better::Lower => ("← better", left, "start"),
            Better::Higher => ("better →", right, "end"),
            Better::Neither => ("", left, "start"),
        };
        let title = fitted(&axis.words(), LABEL * BOLD, right - left - 2.0 * (width(hint, LABEL) + 14.0));
        self.text("title", [(left + right) / 2.0, y], "middle", "", &title);
        if !hint.is_empty() {
            self.text("better", [x, y], anchor, "", hint);
        }
    }

    /// How to read a chart, as signs so wide with words in rows, and what could not be
    /// drawn. Says where it ends.
    pub fn key(&mut self, entries: Vec<(Canvas, f64, String)>, notes: &[String], left: f64, top: f64) -> f64 {
        let (most, mut x, mut y) = (WIDTH - MARGIN - left, left, top + LINE / 2.0);
        let mut bottom = if entries.is_empty() { top } else { top + LINE + 4.0 };
        for (sign, wide, words) in entries {
            let words = fitted(&words, TICK, most - wide);
            let own = wide + width(&words, TICK);
            if x > left && x + own > left + most {
                (x, y, bottom) = (left, y + LINE + 4.0, bottom + LINE + 4.0);
            }
            self.group("sign", "", [x, y], sign);
            self.text("key", [x + wide, y + TICK * 0.36], "start", "", &words);
            x += own + 18.0;
        }
        for line in notes.iter().flat_map(|note| wrapped(note, TICK, most)) {
            bottom += LINE;
            self.text("note", [left, bottom], "start", "", &line);
        }
        bottom
    }
}

fn lines(ruler: &Ruler) -> [(&'static str, Vec<f64>); 2] {
    [("minor", ruler.minor.clone()), ("grid", ruler.major.iter().map(|(value, _)| *value).collect())]
}

impl ChartDrawing {
    /// Where there is nothing to draw, and why.
    pub fn empty(notes: &[String]) -> ChartDrawing {
        let mut canvas = Canvas::default();
        canvas.frame(Rect { left: MARGIN, top: 4.0, right: WIDTH - MARGIN, bottom: 76.0 });
        canvas.text("label", [WIDTH / 2.0, 45.0], "middle", "", "Nothing was measured.");
        let bottom = canvas.key(Vec::new(), notes, MARGIN, 80.0);
        ChartDrawing { canvas, bottom }
    }

    pub fn svg(self, title: &str) -> String {
        let (w, h) = (n(WIDTH), n(self.bottom + 8.0));
        cleaned(&html! {
            svg class="chart" viewBox=(format!("0 0 {w} {h}")) role="img" aria-label=(title) { (PreEscaped(self.canvas.0)) }
        }.0)
    }

    pub fn svg_standalone(self, title: &str) -> String {
        let (padding, mut canvas) = (12.0, Canvas::default());
        let heading = fitted(title, 15.0 * BOLD, WIDTH - 2.0 * MARGIN);
        let top = if heading.is_empty() { padding } else { padding + 28.0 };
        canvas.text("heading", [padding + MARGIN, padding + 16.0], "start", "", &heading);
        canvas.group("", "", [padding, top], self.canvas);
        let (w, h) = (n(WIDTH + 2.0 * padding), n(self.bottom + 8.0 + top));
        cleaned(&html! {
            svg xmlns="http://www.w3.org/2000/svg" width=(w) height=(h) class="chart" viewBox=(format!("0 0 {w} {h}"))
                role="img" aria-label=(title) {
                style { (PreEscaped(CSS)) }
                rect.paper width=(w) height=(h) rx="6" {}
                (PreEscaped(canvas.0))
            }
        }.0)
    }
}

/// Without the characters that no markup may have: XML knows no control characters but
/// line breaks and tabs, and two that are no characters.
pub(super) fn cleaned(markup: &str) -> String {
    let bad = |c: char| (c.is_control() && c != '\n' && c != '\t') || matches!(c, '\u{fffe}' | '\u{ffff}');
    markup.replace(bad, "\u{fffd}")
}

/// How wide a line of text is, in pixels: as in DejaVu Sans, which is wider than what
/// most systems show, so what keeps apart by this does so everywhere.
pub(super) fn width(text: &str, size: f64) -> f64 {
    text.chars().map(em).sum::<f64>() * size
}

fn em(c: char) -> f64 {
    match c {
        'i' | 'j' | 'l' | '\'' | '|' | ' ' | '.' | ',' | ':' | ';' | '\u{202f}' | '·' | 'I' => 0.35,
        'f' | 't' | 'r' | '(' | ')' | '[' | ']' | '-' | '/' | '!' => 0.44,
        'm' | 'M' | 'w' | 'W' | '%' | '@' | '—' | '…' => 1.03,
        'a'..='z' | '0'..='9' | '?' | '_' | '–' => 0.645,
        '\u{300}'..='\u{36f}' => 0.0,
        '\u{0}'..='\u{24ff}' => 0.86,
        _ => 1.2,
    }
}

/// Cut with an ellipsis where it is wider than that.
pub(super) fn fitted(text: &str, size: f64, most: f64) -> String {
    // Who asks for as much as the text is wide must not lose it to the last bit.
    if width(text, size) <= most + 0.01 {
        return text.to_string();
    }
    let mut left = most - width("…", size);
    let fits = |c: &char| {
        left -= em(*c) * size;
        left >= 0.0
    };
    format!("{}…", text.chars().take_while(fits).collect::<String>().trim_end())
}

/// Broken between words into lines no wider than that; a longer word is cut.
fn wrapped(text: &str, size: f64, most: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(line, size) + width(" ", size) + width(word, size) <= most => {
                *line = format!("{line} {word}");
            }
            _ => lines.push(fitted(word, size, most)),
        }
    }
    lines
}

/// "not shown: a, b and 3 more"
pub(super) fn told(what: &str, names: &[String]) -> Option<String> {
    const SAID: usize = 8;
    let said = names.iter().take(SAID).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len() {
        0 => None,
        1..=SAID => Some(format!("{what}: {said}")),
        all => Some(format!("{what}: {said} and {} more", all - SAID)),
    }
}
