//! The frame of a plot: grid, tick labels and the titles of its axes, which say
//! which end is the good one.

use super::canvas::{Anchor, Canvas};
use super::data::{Axis, Better};
use super::rect::Rect;
use super::ruler::Ruler;
use super::text;

/// Sizes of text, as in `style::CSS`.
pub(super) const LABEL: f64 = 13.0;
pub(super) const TICK: f64 = 12.0;
/// Height of a line of labels.
pub(super) const LINE: f64 = 16.0;

pub(super) struct Frame {
    pub x: Ruler,
    pub y: Ruler,
    pub rect: Rect,
}

impl Frame {
    /// Rulers that keep marks so far from the frame's edges.
    pub fn new(x: Ruler, y: Ruler, rect: Rect, inset: f64) -> Frame {
        let x = x.between(rect.left + inset, rect.right - inset);
        let y = y.between(rect.bottom - inset, rect.top + inset);
        Frame { x, y, rect }
    }

    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        [self.x.at(x), self.y.at(y)]
    }

    pub fn grid(&self, canvas: &mut Canvas) {
        let Rect { left, top, right, bottom } = self.rect;
        canvas.rect("frame", [left, top], [self.rect.width(), self.rect.height()]);
        let minor = |class, values: &mut dyn Iterator<Item = f64>, canvas: &mut Canvas, upright: bool| {
            for place in values {
                let ends =
                    if upright { ([place, top], [place, bottom]) } else { ([left, place], [right, place]) };
                canvas.line(class, ends.0, ends.1);
            }
        };
        for (ruler, upright) in [(&self.x, true), (&self.y, false)] {
            minor("minor", &mut ruler.ticks.minor.iter().map(|v| ruler.at(*v)), canvas, upright);
            minor("grid", &mut ruler.ticks.major.iter().map(|(v, _)| ruler.at(*v)), canvas, upright);
        }
    }

    pub fn x_labels(&self, canvas: &mut Canvas) {
        let mut taken = f64::NEG_INFINITY;
        for (value, label) in &self.x.ticks.major {
            let half = text::width(label, TICK) / 2.0;
            // Inside of the frame or nearly so, for there may be another beside it.
            let (least, most) = (self.rect.left - 8.0 + half, self.rect.right + 8.0 - half);
            let place = self.x.at(*value).min(most).max(least);
            if place - half < taken + 4.0 {
                continue;
            }
            taken = place + half;
            canvas.text("tick", [place, self.rect.bottom + LINE], Anchor::Middle, label);
        }
    }

    pub fn y_labels(&self, canvas: &mut Canvas) {
        for (value, label) in &self.y.ticks.major {
            let place = self.y.at(*value) + TICK * 0.36;
            canvas.text("tick", [self.rect.left - 7.0, place], Anchor::End, label);
        }
    }
}

/// The title of an upright axis, in a line above everything.
pub(super) fn y_title(canvas: &mut Canvas, axis: &Axis, at: [f64; 2], width: f64) {
    let hint = match axis.better {
        Better::Lower => "↓ better",
        Better::Higher => "↑ better",
        Better::Neither => "",
    };
    let room = text::width(hint, LABEL) + 14.0;
    let title = text::fitted(&axis.words(), LABEL * BOLD, width - room);
    canvas.title(at, &title, hint);
}

/// The title of a level axis, in its middle, and the hint at its good end.
pub(super) fn x_title(canvas: &mut Canvas, axis: &Axis, left: f64, right: f64, baseline: f64) {
    let (hint, place, anchor) = match axis.better {
        Better::Lower => ("← better", left, Anchor::Start),
        Better::Higher => ("better →", right, Anchor::End),
        Better::Neither => ("", left, Anchor::Start),
    };
    let room = 2.0 * (text::width(hint, LABEL) + 14.0);
    let title = text::fitted(&axis.words(), LABEL * BOLD, right - left - room);
    canvas.text("title", [(left + right) / 2.0, baseline], Anchor::Middle, &title);
    if !hint.is_empty() {
        canvas.text("better", [place, baseline], anchor, hint);
    }
}

/// So much wider is bold text.
pub(super) const BOLD: f64 = 1.12;
