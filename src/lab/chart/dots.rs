//! A few numbers, each as a dot on one axis, with what it ranged over: a bar's length
//! would mean nothing on a logarithmic axis.

use super::axis::{Axis, Ruler, Scale};
use super::canvas::{
    BOLD, Canvas, ChartDrawing, LABEL, LINE, MARGIN, Rect, TICK, WIDTH, fitted, told, width,
};
use super::table::{Table, TableCell, TableColumn};
use super::{legend, number, shape};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bars {
    pub title: String,
    pub axis: Axis,
    pub groups: Vec<BarGroup>,
}

/// What belongs together, with a heading, which may be empty if it is the only one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BarGroup {
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
}

impl Bar {
    pub fn new(name: &str, value: f64) -> Bar {
        Bar { name: name.to_string(), value, ..Bar::default() }
    }

    fn called(&self) -> String {
        format!("{}{}", self.name, if self.default { " · default" } else { "" })
    }
}

const ROW: f64 = 24.0;
const DOT: f64 = 5.0;

impl Bars {
    pub(super) fn draw(&self) -> ChartDrawing {
        let all = || self.groups.iter().flat_map(|group| &group.bars);
        let shown = |bar: &&Bar| self.axis.takes(bar.value);
        let lost = all()
            .filter(|bar| !shown(bar))
            .map(|bar| format!("{} ({})", bar.name, number::figure(bar.value)));
        let notes = Vec::from_iter(told("not shown", &lost.collect::<Vec<_>>()));
        let values = all().filter(shown).flat_map(|bar| {
            let zero = (self.axis.scale == Scale::Linear).then_some(0.0);
            [bar.value].into_iter().chain(bar.spread.into_iter().flatten()).chain(bar.before).chain(zero)
        });
        let Some(ruler) = Ruler::new(&self.axis, values, 7) else { return ChartDrawing::empty(&notes) };
        let widest = |of: &dyn Fn(&Bar) -> String, size| {
            all().filter(shown).map(|bar| width(&of(bar), size)).fold(0.0, f64::max).min(WIDTH * 0.35)
        };
        let left = MARGIN + widest(&Bar::called, LABEL) + 10.0;
        let right = WIDTH - MARGIN - widest(&|bar| self.said(bar), TICK) - 12.0;
        let groups: Vec<&BarGroup> =
            self.groups.iter().filter(|group| group.bars.iter().any(|bar| shown(&bar))).collect();
        let heads = groups.iter().filter(|group| !group.name.is_empty()).count();
        let rows = heads + groups.iter().flat_map(|group| &group.bars).filter(shown).count();
        let rect = Rect { left, top: 4.0, right: right.max(left + 120.0), bottom: 10.0 + rows as f64 * ROW };
        let ruler = ruler.between(rect.left + DOT + 3.0, rect.right - DOT - 3.0).without_minor();
        let mut canvas = Canvas::default();
        canvas.level_axis(&ruler, rect, true);
        let mut y = rect.top + 3.0;
        for group in groups {
            if !group.name.is_empty() {
                let name = fitted(&group.name, LABEL * BOLD, WIDTH - 2.0 * MARGIN);
                canvas.text("label name", [MARGIN, y + LINE + 1.0], "start", "", &name);
                y += ROW;
            }
            for (look, bar) in group.bars.iter().enumerate().filter(|(_, bar)| shown(bar)) {
                self.draw_bar(&mut canvas, &ruler, bar, look, [left, y + ROW / 2.0]);
                y += ROW;
            }
        }
        let bottom = rect.bottom + 2.0 * LINE + 5.0;
        canvas.level_title(&self.axis, [left, WIDTH - MARGIN], bottom);
        let before = all().filter(shown).any(|bar| bar.before.is_some_and(|was| self.axis.takes(was)));
        let (sign, wide) = legend::earlier_sign();
        let entries =
            if before { vec![(sign, wide, "from the earlier run".to_string())] } else { Vec::new() };
        let bottom = canvas.key(entries, &notes, MARGIN, bottom + LINE - 3.0);
        ChartDrawing { canvas, bottom }
    }

    fn said(&self, bar: &Bar) -> String {
        let before = bar.before.filter(|was| self.axis.takes(*was));
        let change = before.map(|was| format!(" · {}", number::change(bar.value, was)));
        number::with_unit(&number::figure(bar.value), &self.axis.unit, false) + &change.unwrap_or_default()
    }

    fn draw_bar(&self, canvas: &mut Canvas, ruler: &Ruler, bar: &Bar, look: usize, [left, y]: [f64; 2]) {
        let tip = ruler.at(bar.value);
        let mut parts = Canvas::default();
        parts.line("leader", [left, y], [tip, y]);
        let spread = bar.spread.filter(|ends| ends.iter().all(|end| self.axis.takes(*end)));
        let spread = spread.map(|ends| ends.map(|end| ruler.at(end)));
        if let Some([low, high]) = spread {
            parts.line("spread", [low, y], [high, y]);
            for end in [low, high] {
                parts.line("spread", [end, y - 3.0], [end, y + 3.0]);
            }
        }
        let before = bar.before.filter(|was| self.axis.takes(*was)).map(|was| ruler.at(was));
        if let Some(was) = before {
            parts.path("was", &shape::path(look, [was, y], DOT - 1.0));
            if (tip - was).abs() > 2.0 * DOT + 8.0 {
                let way = DOT * (tip - was).signum();
                parts.arrow([was + way, y], [tip - way, y]);
            }
        }
        parts.path("mark", &shape::path(look, [tip, y], DOT));
        let ranged = bar
            .spread
            .map(|[low, high]| format!("\nfrom {} to {}", number::figure(low), number::figure(high)));
        let tooltip = format!("{}\n{}", bar.called(), self.axis.said(bar.value, bar.before));
        canvas.group(&shape::class(look), &(tooltip + &ranged.unwrap_or_default()), [0.0, 0.0], parts);
        let name = fitted(&bar.called(), LABEL, left - MARGIN - 10.0);
        canvas.text("label", [MARGIN, y + TICK * 0.36], "start", "", &name);
        let reached = [tip + shape::reach(look, DOT), before.unwrap_or(tip) + DOT];
        let end = reached.into_iter().chain(spread.into_iter().flatten()).fold(left, f64::max) + 6.0;
        let said = fitted(&self.said(bar), TICK, WIDTH - MARGIN - end);
        canvas.text("value", [end, y + TICK * 0.36], "start", "", &said);
    }

    pub(super) fn table(&self) -> Table {
        let mut columns = ["group", "method"].map(|title| TableColumn::new(title, "")).to_vec();
        columns.extend(TableColumn::with_before(&self.axis.title, &self.axis.unit));
        columns.extend(["lowest", "highest"].map(|title| TableColumn::new(title, &self.axis.unit)));
        columns.push(TableColumn::new("remarks", ""));
        let bars = self.groups.iter().flat_map(|group| group.bars.iter().map(move |bar| (group, bar)));
        let rows = bars.map(|(group, bar)| {
            let mut row = vec![TableCell::text(&group.name), TableCell::text(&bar.name)];
            row.extend(TableCell::with_before(Some(bar.value), bar.before));
            row.extend([0, 1].map(|end| TableCell::maybe(bar.spread.map(|spread| spread[end]))));
            row.push(TableCell::text(if bar.default { "default" } else { "" }));
            row
        });
        Table { caption: self.title.clone(), columns, rows: rows.collect() }.without_empty_columns()
    }
}
