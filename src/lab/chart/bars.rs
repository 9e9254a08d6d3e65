//! A few numbers, as bars on a linear axis and as dots on a logarithmic one, where a
//! bar's length would mean nothing.

use super::canvas::{Anchor, Canvas};
use super::data::{Axis, Scale};
use super::drawing::{Drawing, MARGIN, WIDTH};
use super::frame::{self, BOLD, Frame, LABEL, LINE, TICK};
use super::key::{Key, Sign};
use super::rect::Rect;
use super::ruler::Ruler;
use super::{number, shape, spots, text};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bars {
    /// For those who hear the chart instead of seeing it, and for the table.
    pub title: String,
    pub axis: Axis,
    pub groups: Vec<Group>,
}

/// Bars that belong together, with a heading: a scene, say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Group {
    /// May be empty if it is the only one.
    pub name: String,
    pub bars: Vec<Bar>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bar {
    pub name: String,
    pub value: f64,
    /// Lowest and highest of what was measured.
    pub spread: Option<[f64; 2]>,
    /// The same in an earlier run.
    pub before: Option<f64>,
    /// What one gets without asking.
    pub default: bool,
    /// More for the tooltip, in a line of its own.
    pub note: String,
    /// Colour by number, as in `Series::look`; its place in the group where none is given.
    pub look: Option<usize>,
}

impl Bar {
    pub fn new(name: &str, value: f64) -> Bar {
        Bar { name: name.to_string(), value, ..Bar::default() }
    }

    /// All that must have a place on the axis.
    fn values(&self) -> impl Iterator<Item = f64> {
        [self.value].into_iter().chain(self.spread.into_iter().flatten()).chain(self.before)
    }

    fn said(&self, axis: &Axis) -> String {
        let before = self.before.filter(|before| axis.takes(*before));
        let change = before.map(|before| format!(" · {}", number::change(self.value, before)));
        format!("{}{}", number::with_unit(self.value, &axis.unit), change.unwrap_or_default())
    }
}

const ROW: f64 = 24.0;
const THICK: f64 = 13.0;
const DOT: f64 = 5.0;

impl Bars {
    pub(super) fn drawing(&self) -> Drawing {
        let all = || self.groups.iter().flat_map(|group| &group.bars);
        let left_out = all().filter(|bar| !self.axis.takes(bar.value));
        let left_out = left_out.map(|bar| format!("{} ({})", bar.name, number::figure(bar.value))).collect();
        let left_out = spots::told("not shown", left_out);
        let shown = || all().filter(|bar| self.axis.takes(bar.value));
        // A bar begins at zero.
        let zero = (self.axis.scale == Scale::Linear && shown().next().is_some()).then_some(0.0);
        let Some(ruler) = Ruler::new(&self.axis, shown().flat_map(Bar::values).chain(zero), 7) else {
            return Drawing::empty(&self.title, left_out);
        };

        let names = shown().map(name_width).fold(0.0, f64::max).min(WIDTH * 0.35);
        let values = shown().map(|bar| text::width(&bar.said(&self.axis), TICK)).fold(0.0, f64::max);
        let values = values.min(WIDTH * 0.35);
        let left = MARGIN + names + 10.0;
        let height = self.groups.iter().map(|group| self.height(group)).sum::<f64>() + 6.0;
        let right = (WIDTH - MARGIN - values - 12.0).max(left + 120.0);
        let rect = Rect::new([left, 4.0], [right - left, height]);
        let inset = if self.axis.scale == Scale::Log { DOT + 3.0 } else { 0.0 };
        let frame = Frame::new(ruler.clone(), ruler, rect, inset);
        let mut canvas = Canvas::default();
        self.draw_axis(&mut canvas, &frame);
        let mut y = rect.top + 3.0;
        for group in self.groups.iter().filter(|group| self.height(group) > 0.0) {
            if !group.name.is_empty() {
                let name = text::fitted(&group.name, LABEL * BOLD, WIDTH - 2.0 * MARGIN);
                canvas.text("label name", [MARGIN, y + LINE + 1.0], Anchor::Start, &name);
                y += ROW;
            }
            for (number, bar) in group.bars.iter().enumerate().filter(|(_, bar)| self.axis.takes(bar.value)) {
                self.draw_bar(&mut canvas, &frame, bar, bar.look.unwrap_or(number), y + ROW / 2.0);
                y += ROW;
            }
        }
        let mut bottom = rect.bottom + 2.0 * LINE + 5.0;
        frame::x_title(&mut canvas, &self.axis, rect.left, WIDTH - MARGIN, bottom);
        let mut key = Key { entries: Vec::new(), notes: left_out.into_iter().collect() };
        if shown().any(|bar| bar.before.is_some_and(|before| self.axis.takes(before))) {
            let sign = if self.axis.scale == Scale::Linear { Sign::Hollow } else { Sign::Before };
            key.entries.push((sign, "the earlier run".to_string()));
        }
        bottom = key.draw(&mut canvas, [MARGIN, bottom + LINE - 3.0], WIDTH - 2.0 * MARGIN);
        Drawing::new(&self.title, canvas, bottom)
    }

    /// Of a group, heading included.
    fn height(&self, group: &Group) -> f64 {
        let bars = group.bars.iter().filter(|bar| self.axis.takes(bar.value)).count();
        let head = usize::from(bars > 0 && !group.name.is_empty());
        (bars + head) as f64 * ROW
    }

    fn draw_axis(&self, canvas: &mut Canvas, frame: &Frame) {
        let Rect { top, bottom, .. } = frame.rect;
        for (value, _) in &frame.x.ticks.major {
            let x = frame.x.at(*value);
            canvas.line("grid", [x, top], [x, bottom]);
        }
        frame.x_labels(canvas);
    }

    fn draw_bar(&self, canvas: &mut Canvas, frame: &Frame, bar: &Bar, look: usize, y: f64) {
        let at = |value: f64| frame.x.at(value);
        let tip = at(bar.value);
        let middle = y + TICK * 0.36;
        let room = frame.rect.left - MARGIN - 10.0;
        let own = text::fitted(&bar.name, LABEL, room - default_width(bar));
        canvas.text("label", [MARGIN, middle], Anchor::Start, &format!("{own}{}", default_words(bar)));
        canvas.open(&shape::class(look), &self.tooltip(bar));
        let before = bar.before.filter(|before| self.axis.takes(*before)).map(at);
        let spread =
            bar.spread.filter(|ends| ends.iter().all(|end| self.axis.takes(*end))).map(|ends| ends.map(at));
        match self.axis.scale {
            Scale::Linear => {
                let zero = at(0.0);
                let span = |tip: f64| (tip.min(zero), (tip - zero).abs().max(1.0));
                let (left, width) = span(tip);
                canvas.rect("bar", [left, y - THICK / 2.0], [width, THICK]);
                if let Some((left, width)) = before.map(span) {
                    canvas.rect("hollow", [left, y - THICK / 2.0 - 2.5], [width, THICK + 5.0]);
                }
                whiskers(canvas, "halo", spread, y);
                whiskers(canvas, "spread", spread, y);
            }
            Scale::Log => {
                canvas.line("leader", [frame.rect.left, y], [tip, y]);
                whiskers(canvas, "spread", spread, y);
                if let Some(before) = before {
                    canvas.path("was", &shape::path(look, [before, y], DOT - 1.0));
                    if (tip - before).abs() > 2.0 * DOT + 8.0 {
                        let way = DOT * (tip - before).signum();
                        canvas.path("arrow", &spots::arrow([before + way, y], [tip - way, y]));
                    }
                }
                canvas.path("mark", &shape::path(look, [tip, y], DOT));
            }
        }
        let reach = if self.axis.scale == Scale::Log { shape::reach(look, DOT) } else { 0.0 };
        let ends = [tip, before.unwrap_or(tip)]
            .map(|end| end + reach)
            .into_iter()
            .chain(spread.into_iter().flatten());
        let end = ends.fold(frame.rect.left, f64::max);
        canvas.close();
        let said = text::fitted(&bar.said(&self.axis), TICK, WIDTH - MARGIN - end - 6.0);
        canvas.text("value", [end + 6.0, middle], Anchor::Start, &said);
    }

    fn tooltip(&self, bar: &Bar) -> String {
        let unit = |value: f64| number::with_unit(value, &self.axis.unit);
        let mut lines = vec![format!("{}{}", bar.name, default_words(bar))];
        lines.push(format!("{}: {}", self.axis.title, unit(bar.value)));
        lines.extend(bar.spread.map(|[low, high]| format!("from {} to {}", unit(low), unit(high))));
        lines.extend(
            bar.before
                .map(|before| format!("before: {} ({})", unit(before), number::change(bar.value, before))),
        );
        lines.extend((!bar.note.is_empty()).then(|| bar.note.clone()));
        lines.join("\n")
    }
}

/// From the lowest to the highest.
fn whiskers(canvas: &mut Canvas, class: &str, ends: Option<[f64; 2]>, y: f64) {
    let Some([low, high]) = ends else { return };
    canvas.line(class, [low, y], [high, y]);
    for end in [low, high] {
        canvas.line(class, [end, y - 3.0], [end, y + 3.0]);
    }
}

fn default_words(bar: &Bar) -> &'static str {
    if bar.default { " · default" } else { "" }
}

fn default_width(bar: &Bar) -> f64 {
    text::width(default_words(bar), LABEL)
}

fn name_width(bar: &Bar) -> f64 {
    text::width(&bar.name, LABEL) + default_width(bar)
}
