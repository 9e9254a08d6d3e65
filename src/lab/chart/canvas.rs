//! Markup of a drawing, piece by piece. Everything goes through here, so that
//! numbers are short and text is escaped.

use std::fmt::Write;

use super::style;
use super::text::escaped;

/// Where a text stands, seen from its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Anchor {
    fn attribute(self) -> &'static str {
        match self {
            Anchor::Start => "",
            Anchor::Middle => r#" text-anchor="middle""#,
            Anchor::End => r#" text-anchor="end""#,
        }
    }
}

#[derive(Debug, Clone, Default)]
pub(super) struct Canvas {
    markup: String,
}

/// A length to a tenth of a pixel.
pub(super) fn n(value: f64) -> String {
    let text = format!("{value:.1}");
    let text = text.strip_suffix(".0").unwrap_or(&text);
    if text == "-0" { "0".to_string() } else { text.to_string() }
}

impl Canvas {
    pub fn line(&mut self, class: &str, from: [f64; 2], to: [f64; 2]) {
        let [x1, y1, x2, y2] = [from[0], from[1], to[0], to[1]].map(n);
        self.put(format_args!(r#"<path class="{class}" d="M{x1} {y1}L{x2} {y2}"/>"#));
    }

    pub fn path(&mut self, class: &str, d: &str) {
        self.put(format_args!(r#"<path class="{class}" d="{d}"/>"#));
    }

    /// A line through points with a dash of its own.
    pub fn polyline(&mut self, class: &str, dash: &str, points: &[[f64; 2]]) {
        let d = through(points);
        let dash = if dash == "none" { String::new() } else { format!(r#" stroke-dasharray="{dash}""#) };
        self.put(format_args!(r#"<path class="{class}"{dash} d="{d}"/>"#));
    }

    pub fn circle(&mut self, class: &str, at: [f64; 2], radius: f64) {
        let [x, y, r] = [at[0], at[1], radius].map(n);
        self.put(format_args!(r#"<circle class="{class}" cx="{x}" cy="{y}" r="{r}"/>"#));
    }

    pub fn rect(&mut self, class: &str, [x, y]: [f64; 2], [width, height]: [f64; 2]) {
        let [x, y, w, h] = [x, y, width.max(0.0), height.max(0.0)].map(n);
        self.put(format_args!(r#"<rect class="{class}" x="{x}" y="{y}" width="{w}" height="{h}"/>"#));
    }

    pub fn text(&mut self, class: &str, at: [f64; 2], anchor: Anchor, text: &str) {
        let [x, y] = at.map(n);
        let anchor = anchor.attribute();
        self.put(format_args!(r#"<text class="{class}" x="{x}" y="{y}"{anchor}>{}</text>"#, escaped(text)));
    }

    /// A label: a name in bold, and what follows it.
    pub fn label(&mut self, at: [f64; 2], anchor: Anchor, name: &str, rest: &str) {
        let [x, y] = at.map(n);
        let name = if name.is_empty() {
            String::new()
        } else {
            format!("<tspan class=\"name\">{}</tspan>", escaped(name))
        };
        let anchor = anchor.attribute();
        self.put(format_args!(
            r#"<text class="label" x="{x}" y="{y}"{anchor}>{name}{}</text>"#,
            escaped(rest)
        ));
    }

    /// A title in bold, and a hint after it.
    pub fn title(&mut self, [x, y]: [f64; 2], title: &str, hint: &str) {
        let ([x, y], title, hint) = ([x, y].map(n), escaped(title), escaped(hint));
        self.put(format_args!(
            r#"<text class="better" x="{x}" y="{y}"><tspan class="name">{title}</tspan><tspan dx="14">{hint}</tspan></text>"#
        ));
    }

    /// What follows belongs together until `close`, and says so under the pointer.
    pub fn open(&mut self, class: &str, tooltip: &str) {
        self.put(format_args!(r#"<g class="{class}">"#));
        if !tooltip.is_empty() {
            self.put(format_args!("<title>{}</title>", escaped(tooltip)));
        }
    }

    pub fn close(&mut self) {
        self.markup.push_str("</g>");
    }

    /// Another drawing, moved.
    pub fn moved(&mut self, other: Canvas, by: [f64; 2]) {
        let [x, y] = by.map(n);
        self.put(format_args!(r#"<g transform="translate({x} {y})">{}</g>"#, other.markup));
    }

    /// Dots of one size in a square from this corner, `side` long and 1000 units wide.
    pub fn dots(&mut self, class: &str, [x, y]: [f64; 2], side: f64, size: f64, dots: &[[u16; 2]]) {
        if dots.is_empty() {
            return;
        }
        let (scale, width) = (side / 1000.0, n(size * 1000.0 / side));
        let [x, y] = [x, y].map(n);
        let d: String = dots.iter().map(|[x, y]| format!("M{x} {y}h0")).collect();
        self.put(format_args!(
            r#"<path class="{class}" transform="translate({x} {y})scale({scale:.4})" stroke-width="{width}" d="{d}"/>"#
        ));
    }

    fn put(&mut self, what: std::fmt::Arguments<'_>) {
        // Writing to a string does not fail.
        let _ = self.markup.write_fmt(what);
    }

    /// An `<svg>` of this size around it all.
    pub fn svg(self, [width, height]: [f64; 2], label: &str, setting: Setting) -> String {
        let [w, h] = [width, height].map(n);
        let (opening, before) = match setting {
            Setting::Page => (String::new(), String::new()),
            Setting::Alone => (
                format!("xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" "),
                format!(
                    "<style>{}</style><rect class=\"paper\" width=\"{w}\" height=\"{h}\" rx=\"6\"/>",
                    style::alone()
                ),
            ),
        };
        // A line a group, for whoever looks at the source.
        let markup = self.markup.replace("</g>", "</g>\n");
        let label = escaped(label);
        format!(
            "<svg {opening}class=\"chart\" viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"{label}\">{before}\n{markup}</svg>\n"
        )
    }
}

/// Where a drawing will be seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Setting {
    /// On a page that has the style.
    Page,
    /// As a file of its own.
    Alone,
}

/// The `d` of a path through points.
pub(super) fn through(points: &[[f64; 2]]) -> String {
    let mut d = String::new();
    for (at, point) in points.iter().enumerate() {
        let [x, y] = point.map(n);
        let _ = write!(d, "{}{x} {y}", if at == 0 { 'M' } else { 'L' });
    }
    d
}
