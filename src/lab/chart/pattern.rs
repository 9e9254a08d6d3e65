//! What sample patterns look like: dots in squares, side by side.

use super::canvas::{Anchor, Canvas};
use super::drawing::{Drawing, MARGIN, WIDTH};
use super::frame::{BOLD, LABEL, LINE, TICK};
use super::key::Key;
use super::{spots, text};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Patterns {
    /// For those who hear the chart instead of seeing it.
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
    /// Dots to point at, drawn over the others in another colour: pairs that are too
    /// close, say.
    pub marked: Vec<[f64; 2]>,
}

const GAP: f64 = 16.0;
const LARGEST: f64 = 340.0;
/// Of a dot, as a share of the mean distance between dots.
const DOT: f64 = 0.42;

impl Patterns {
    pub(super) fn drawing(&self) -> Drawing {
        if self.patterns.iter().all(|pattern| places(&pattern.dots).is_empty()) {
            return Drawing::empty(&self.title, None);
        }
        let count = self.patterns.len();
        let columns =
            if count > 4 && count.is_multiple_of(3) && !count.is_multiple_of(4) { 3 } else { count.min(4) };
        let gaps = GAP * (columns - 1) as f64;
        let side = ((WIDTH - 2.0 * MARGIN - gaps) / columns as f64).min(LARGEST);
        let noted = self.patterns.iter().any(|pattern| !pattern.note.is_empty());
        let words = if noted { 2.0 * LINE } else { LINE } + 6.0;
        let mut canvas = Canvas::default();
        for (number, pattern) in self.patterns.iter().enumerate() {
            let (row, column) = (number / columns, number % columns);
            let corner = [MARGIN + (side + GAP) * column as f64, 4.0 + (side + words + GAP) * row as f64];
            pattern.draw(&mut canvas, corner, side);
        }
        let rows = count.div_ceil(columns) as f64;
        let outside = self.patterns.iter().filter_map(|pattern| {
            let outside = pattern.dots.len() - places(&pattern.dots).len();
            (outside > 0).then(|| format!("{outside} dots of {} (outside of the square)", pattern.name))
        });
        let notes = spots::told("not shown", outside.collect()).into_iter().collect();
        let bottom = 4.0 + (side + words + GAP) * rows - GAP;
        let bottom =
            Key { entries: Vec::new(), notes }.draw(&mut canvas, [MARGIN, bottom], WIDTH - 2.0 * MARGIN);
        Drawing::new(&self.title, canvas, bottom)
    }
}

impl Pattern {
    fn draw(&self, canvas: &mut Canvas, [x, y]: [f64; 2], side: f64) {
        let dots = places(&self.dots);
        let size = (DOT * side / (dots.len() as f64).sqrt().max(1.0)).clamp(1.2, 6.0);
        canvas.open("pattern", &format!("{}: {} dots", self.name, self.dots.len()));
        canvas.rect("frame", [x, y], [side, side]);
        canvas.dots("dots", [x, y], side, size, &dots);
        canvas.dots("dots marked", [x, y], side, size * 1.6, &places(&self.marked));
        canvas.close();
        let name = text::fitted(&self.name, LABEL * BOLD, side);
        canvas.text("label name", [x, y + side + LINE + 1.0], Anchor::Start, &name);
        let note = text::fitted(&self.note, TICK, side);
        if !note.is_empty() {
            canvas.text("note", [x, y + side + 2.0 * LINE], Anchor::Start, &note);
        }
    }
}

/// In thousandths of the side, y pointing down; only what lies inside.
fn places(dots: &[[f64; 2]]) -> Vec<[u16; 2]> {
    let inside = dots.iter().filter(|dot| dot.iter().all(|at| (0.0..=1.0).contains(at)));
    inside.map(|[x, y]| [(x * 1000.0).round() as u16, ((1.0 - y) * 1000.0).round() as u16]).collect()
}
