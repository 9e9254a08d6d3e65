//! Small multiples: panels of one size in rows, with shared axes.

use super::canvas::{Anchor, Canvas};
use super::frame::{BOLD, Frame, LABEL, LINE};
use super::rect::Rect;
use super::text;

pub(super) struct Grid {
    pub panels: usize,
    pub left: f64,
    pub right: f64,
    pub top: f64,
    /// Above each panel, for its name.
    pub head: f64,
}

/// Between panels of a row: tick labels stand out a little on both sides.
const GAP: f64 = 22.0;

impl Grid {
    pub fn columns(panels: usize) -> usize {
        match panels {
            0 | 1 => 1,
            2 | 4 => 2,
            _ => 3,
        }
    }

    fn height(&self) -> f64 {
        [340.0, 220.0, 170.0][Grid::columns(self.panels) - 1]
    }

    /// Most labels that the axes of a panel have room for.
    pub fn ticks(panels: usize) -> [usize; 2] {
        [[11, 9], [6, 6], [5, 5]][Grid::columns(panels) - 1]
    }

    pub fn rect(&self, number: usize) -> Rect {
        let columns = Grid::columns(self.panels);
        let width = (self.right - self.left - GAP * (columns - 1) as f64) / columns as f64;
        let (row, column) = (number / columns, number % columns);
        let left = self.left + (width + GAP) * column as f64;
        let top = self.top + (self.head + self.height() + 14.0) * row as f64 + self.head;
        Rect::new([left, top], [width, self.height()])
    }

    pub fn bottom(&self) -> f64 {
        self.rect(self.panels.saturating_sub(1)).bottom
    }

    /// A panel's frame and name; labels only where no neighbour has them.
    pub fn frame(&self, canvas: &mut Canvas, number: usize, frame: &Frame, name: &str) {
        let columns = Grid::columns(self.panels);
        frame.grid(canvas);
        if number.is_multiple_of(columns) {
            frame.y_labels(canvas);
        }
        if number + columns >= self.panels {
            frame.x_labels(canvas);
        }
        if !name.is_empty() {
            let name = text::fitted(name, LABEL * BOLD, frame.rect.width());
            let baseline = frame.rect.top - self.head + LINE;
            canvas.text("title", [frame.rect.left, baseline], Anchor::Start, &name);
        }
    }
}
