//! Speed against accuracy: a mark a measurement, and the front of those that none
//! beats on both axes.

use super::canvas::Canvas;
use super::data::{Axis, Before, Better, Mark, Quantity, Series};
use super::drawing::{Drawing, MARGIN, WIDTH};
use super::frame::{self, Frame, LINE, TICK};
use super::key::{Key, Sign};
use super::rect::{Rect, Segment};
use super::ruler::Ruler;
use super::spots::{self, Spot};
use super::{front, number, ticks};

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scatter {
    /// For those who hear the chart instead of seeing it, and for the table.
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    /// What the area of a mark stands for; all are alike where nothing is said.
    pub size: Option<Quantity>,
    pub series: Vec<Series>,
    /// Draw the front, and what is beaten lighter. Needs a better end on both axes.
    pub front: bool,
}

/// Of a mark whose area says nothing.
const RADIUS: f64 = 5.5;
const LARGEST: f64 = 17.0;
const SMALLEST: f64 = 3.0;
const HEIGHT: f64 = 380.0;
/// From the marks to the frame's edge.
const INSET: f64 = 22.0;

impl Scatter {
    pub(super) fn drawing(&self) -> Drawing {
        let values = |of: fn(&Mark) -> f64, earlier: fn(Before) -> f64| {
            let marks = self.series.iter().flat_map(|series| &series.marks);
            // A mark that lacks one value must not stretch the axis of the other.
            let marks = marks.filter(|mark| self.x.takes(mark.x) && self.y.takes(mark.y));
            let before = |mark: &Mark| mark.before.filter(|was| self.x.takes(was.x) && self.y.takes(was.y));
            marks.flat_map(move |mark| [of(mark)].into_iter().chain(before(mark).map(earlier)))
        };
        let x = values(|mark| mark.x, |before| before.x);
        let y = values(|mark| mark.y, |before| before.y);
        let rulers = (Ruler::new(&self.x, x, 11), Ruler::new(&self.y, y, 9));
        let left_out = spots::left_out(self.series.iter(), &self.x, &self.y);
        let (Some(x), Some(y)) = rulers else { return Drawing::empty(&self.title, left_out) };

        let left = MARGIN + y.widest_label(TICK) + 8.0;
        let rect = Rect::new([left, 28.0], [WIDTH - MARGIN - 8.0 - left, HEIGHT]);
        let frame = Frame::new(x, y, rect, INSET);
        let mut spots = spots::spots(&self.series, &frame, |size| self.radius(size));
        let front = self.front && front::defined(&self.x, &self.y);
        if front {
            let points: Vec<[f64; 2]> = spots.iter().map(|spot| [spot.mark.x, spot.mark.y]).collect();
            let by = front::beaten(&points, &self.x, &self.y);
            let names: Vec<_> = by.iter().map(|by| by.map(|by| self.called(&spots[by]))).collect();
            spots.iter_mut().zip(names).for_each(|(spot, name)| spot.beaten = name);
        }

        let mut canvas = Canvas::default();
        frame.grid(&mut canvas);
        frame.x_labels(&mut canvas);
        frame.y_labels(&mut canvas);
        frame::y_title(&mut canvas, &self.y, [MARGIN, 16.0], WIDTH - 2.0 * MARGIN);
        frame::x_title(&mut canvas, &self.x, rect.left, rect.right, rect.bottom + 2.0 * LINE + 5.0);
        let mut lines = Vec::new();
        if front {
            lines.extend(self.draw_front(&mut canvas, &frame, &spots));
        }
        for number in 0..self.series.len() {
            let joined: Vec<[f64; 2]> =
                spots.iter().filter(|spot| spot.series == number).map(|spot| spot.at).collect();
            if joined.len() > 1 {
                canvas.open(&super::shape::class(spots::look(&self.series[number], number)), "");
                canvas.path("join", &super::canvas::through(&joined));
                canvas.close();
            }
            lines.extend(joined.windows(2).map(|ends| Segment { from: ends[0], to: ends[1] }));
        }
        // The large ones first, or they would hide the small ones.
        let mut order: Vec<&Spot> = spots.iter().collect();
        order.sort_by(|a, b| b.radius.total_cmp(&a.radius));
        for spot in order {
            spot.draw(&mut canvas, &spot.tooltip(&self.x, &self.y, self.size.as_ref()));
        }
        let without = spots::labels(&mut canvas, &spots, rect.grown(-3.0), &lines);
        let mut key = self.key(&spots, front);
        key.notes.extend(left_out);
        key.notes.extend(spots::told("no room for the labels of", without));
        let bottom = key.draw(&mut canvas, [rect.left, rect.bottom + 3.0 * LINE + 2.0], rect.width());
        Drawing::new(&self.title, canvas, bottom)
    }

    fn called(&self, spot: &Spot) -> String {
        spots::called(&self.series[spot.series], spot.mark)
    }

    fn largest(&self) -> f64 {
        let marks = self.series.iter().flat_map(|series| &series.marks);
        let sizes = marks.flat_map(|mark| [mark.size, mark.before.and_then(|before| before.size)]);
        sizes.flatten().filter(|size| size.is_finite()).fold(0.0, f64::max)
    }

    fn radius(&self, size: Option<f64>) -> f64 {
        let largest = self.largest();
        match (&self.size, size) {
            (Some(_), Some(size)) if largest > 0.0 && size.is_finite() => {
                (LARGEST * (size.max(0.0) / largest).sqrt()).max(SMALLEST)
            }
            _ => RADIUS,
        }
    }

    fn draw_front(&self, canvas: &mut Canvas, frame: &Frame, spots: &[Spot]) -> Vec<Segment> {
        let worst = |axis: &Axis, low: f64, high: f64| if axis.better == Better::Higher { low } else { high };
        let Rect { left, top, right, bottom } = frame.rect;
        let ends = [worst(&self.x, left, right), worst(&self.y, bottom, top)];
        let steps = front::steps(spots, ends);
        let closed = super::canvas::through(&[&steps[..], &[ends]].concat()) + "z";
        canvas.path("behind", &closed);
        canvas.path("front", &super::canvas::through(&steps));
        steps.windows(2).map(|ends| Segment { from: ends[0], to: ends[1] }).collect()
    }

    fn key(&self, spots: &[Spot], front: bool) -> Key {
        let mut entries = Vec::new();
        if front {
            entries.push((Sign::Line("front"), "front: nothing beats it in both".to_string()));
        }
        if spots.iter().any(|spot| spot.beaten.is_some()) {
            entries.push((Sign::Off, "lighter: beaten".to_string()));
        }
        if spots.iter().any(|spot| spot.before.is_some()) {
            entries.push((Sign::Before, "from the earlier run".to_string()));
        }
        if let Some(size) = self.size.as_ref().filter(|_| spots.iter().any(|spot| spot.mark.size.is_some())) {
            entries.push((Sign::None, format!("area: {}", size.words())));
            let largest = self.largest();
            let round = [1.0, 0.25, 0.05].map(|share| ticks::below(largest * share));
            let mut shown: Vec<f64> = round.into_iter().flatten().collect();
            shown.dedup();
            shown.retain(|size| self.radius(Some(*size)) > SMALLEST);
            entries.extend(
                shown.iter().map(|size| (Sign::Circle(self.radius(Some(*size))), number::round(*size))),
            );
        }
        Key { entries, notes: Vec::new() }
    }
}
