//! What sample patterns look like: dots in squares, side by side.

use super::canvas::{BOLD, Canvas, ChartDrawing, LABEL, LINE, MARGIN, Rect, TICK, WIDTH, fitted, n, told};
use super::table::{Table, TableCell, TableColumn};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Patterns {
    pub title: String,
    pub patterns: Vec<Pattern>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pattern {
    pub name: String,
    /// A few words below the name: "0.9 % too close".
    pub note: String,
    /// From 0 to 1 on both axes; y points up.
    pub dots: Vec<[f64; 2]>,
}

impl Patterns {
    pub(super) fn draw(&self) -> ChartDrawing {
        let outside = self.patterns.iter().filter_map(|pattern| {
            let lost = pattern.dots.len() - pattern.inside().count();
            (lost > 0).then(|| format!("{lost} dots of {} (outside of the square)", pattern.name))
        });
        let notes = Vec::from_iter(told("not shown", &outside.collect::<Vec<_>>()));
        if self.patterns.iter().all(|pattern| pattern.inside().next().is_none()) {
            return ChartDrawing::empty(&notes);
        }
        let (columns, gap) = (self.patterns.len().min(4), 16.0);
        let side = ((WIDTH - 2.0 * MARGIN - gap * (columns - 1) as f64) / columns as f64).min(340.0);
        let high = side + 2.0 * LINE + 6.0 + gap;
        let mut canvas = Canvas::default();
        for (number, pattern) in self.patterns.iter().enumerate() {
            let corner = [(side + gap) * (number % columns) as f64, high * (number / columns) as f64];
            pattern.draw(&mut canvas, [MARGIN + corner[0], 4.0 + corner[1]], side);
        }
        let bottom = 4.0 + high * self.patterns.len().div_ceil(columns) as f64 - gap;
        let bottom = canvas.key(Vec::new(), &notes, MARGIN, bottom);
        ChartDrawing { canvas, bottom }
    }

    pub(super) fn table(&self) -> Table {
        let rows = self.patterns.iter().map(|pattern| {
            vec![
                TableCell::text(&pattern.name),
                TableCell::Number(pattern.dots.len() as f64),
                TableCell::text(&pattern.note),
            ]
        });
        let columns = ["pattern", "dots", "remarks"].map(|title| TableColumn::new(title, "")).to_vec();
        Table { caption: self.title.clone(), columns, rows: rows.collect() }
    }
}

impl Pattern {
    fn inside(&self) -> impl Iterator<Item = &[f64; 2]> {
        self.dots.iter().filter(|dot| dot.iter().all(|at| (0.0..=1.0).contains(at)))
    }

    fn draw(&self, canvas: &mut Canvas, [x, y]: [f64; 2], side: f64) {
        // A share of the mean distance between dots, in thousandths of the side.
        let size =
            (420.0 / (self.inside().count() as f64).sqrt().max(1.0)).clamp(1200.0 / side, 6000.0 / side);
        let thousandths = |part: f64| (part * 1000.0).round();
        let d: String =
            self.inside().map(|[x, y]| format!("M{} {}h0", thousandths(*x), thousandths(1.0 - y))).collect();
        let mut parts = Canvas::default();
        let scaled = format!("scale({:.4})", side / 1000.0);
        parts.put(maud::html! { path.dots transform=(scaled) stroke-width=(n(size)) d=(d) {} });
        canvas.frame(Rect { left: x, top: y, right: x + side, bottom: y + side });
        if !d.is_empty() {
            canvas.group("", &format!("{}: {} dots", self.name, self.dots.len()), [x, y], parts);
        }
        let (name, note) = (fitted(&self.name, LABEL * BOLD, side), fitted(&self.note, TICK, side));
        for (class, words, line) in [("label name", name, LINE + 1.0), ("note", note, 2.0 * LINE)] {
            if !words.is_empty() {
                canvas.text(class, [x, y + side + line], "start", "", &words);
            }
        }
    }
}
