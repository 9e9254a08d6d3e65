//! One panel of a plot: the front, lines, marks in their places and their labels.

use super::axis::{Axis, Better, Ruler};
use super::canvas::{BOLD, Canvas, LABEL, LINE, Rect, fitted, through, width};
use super::label::{self, LabelRequest};
use super::series::{Before, Mark, Panel, Plot, PlotStyle, Quantity, Series, joined};
use super::shape;

/// A mark in its place.
struct MarkSpot<'a> {
    series: &'a Series,
    mark: &'a Mark,
    look: usize,
    at: [f64; 2],
    radius: f64,
    /// Where it was, and how large.
    before: Option<([f64; 2], f64)>,
    beaten: Option<String>,
}

/// A panel's frame and rulers.
pub(super) struct PanelFrame {
    pub x: Ruler,
    pub y: Ruler,
    pub rect: Rect,
}

impl Plot {
    fn spots<'a>(&'a self, frame: &PanelFrame, panel: &'a Panel) -> Vec<MarkSpot<'a>> {
        let at = |x, y| [frame.x.at(x), frame.y.at(y)];
        let pairs =
            panel.series.iter().flat_map(|series| series.marks.iter().map(move |mark| (series, mark)));
        let shown = pairs.filter(|(_, mark)| self.takes(mark.x, mark.y));
        let mut spots: Vec<MarkSpot> = shown
            .map(|(series, mark)| {
                let before = mark.before.filter(|was| self.takes(was.x, was.y));
                MarkSpot {
                    series,
                    mark,
                    look: self.look(&series.name),
                    at: at(mark.x, mark.y),
                    radius: self.radius(mark.size),
                    before: before.map(|was| (at(was.x, was.y), self.radius(was.size))),
                    beaten: None,
                }
            })
            .collect();
        if self.has_front() {
            let points: Vec<[f64; 2]> = spots.iter().map(|spot| self.cost(spot.mark)).collect();
            let by = beaten(&points);
            let names: Vec<_> =
                by.iter().map(|by| by.map(|by| spots[by].series.called(spots[by].mark))).collect();
            spots.iter_mut().zip(names).for_each(|(spot, name)| spot.beaten = name);
        }
        spots
    }

    /// Draws what was measured, and names those for whose label there is no room.
    pub(super) fn draw_panel(&self, canvas: &mut Canvas, frame: &PanelFrame, panel: &Panel) -> Vec<String> {
        let spots = self.spots(frame, panel);
        let mut lines: Vec<[f64; 2]> = Vec::new();
        if self.has_front() && !spots.is_empty() {
            let Rect { left, top, right, bottom } = frame.rect;
            let worst = |axis: &Axis, low, high| if axis.better == Better::Higher { low } else { high };
            let end = [worst(&self.x, left, right), worst(&self.y, bottom, top)];
            let steps = front(spots.iter().filter(|spot| spot.beaten.is_none()).map(|spot| spot.at), end);
            canvas.path("behind", &(through(&[&steps[..], &[end]].concat()) + "z"));
            canvas.path("front", &through(&steps));
            lines.extend(steps.windows(2).flat_map(|ends| label::along(ends[0], ends[1])));
        }
        let class = if self.style == PlotStyle::Front { "join" } else { "line" };
        for series in &panel.series {
            let mut parts = Canvas::default();
            let place = |x, y| self.takes(x, y).then(|| [frame.x.at(x), frame.y.at(y)]);
            let mut draw = |class: &str, places: Vec<Option<[f64; 2]>>| {
                for run in places.split(Option::is_none).filter(|run| run.len() > 1) {
                    let run: Vec<[f64; 2]> = run.iter().flatten().copied().collect();
                    parts.path(class, &through(&run));
                    lines.extend(run.windows(2).flat_map(|ends| label::along(ends[0], ends[1])));
                }
            };
            if self.style == PlotStyle::Curves {
                draw(
                    "was",
                    series.marks.iter().map(|mark| mark.before.and_then(|b| place(b.x, b.y))).collect(),
                );
            }
            draw(class, series.marks.iter().map(|mark| place(mark.x, mark.y)).collect());
            canvas.group(&shape::class(self.look(&series.name)), &series.name, [0.0, 0.0], parts);
        }
        if self.style == PlotStyle::Curves {
            return Vec::new();
        }
        // The large ones first, or they would hide the small ones.
        let mut order: Vec<&MarkSpot> = spots.iter().collect();
        order.sort_by(|a, b| b.radius.total_cmp(&a.radius));
        order.iter().for_each(|spot| spot.draw(canvas, &self.tooltip(spot)));
        if self.style == PlotStyle::Front {
            labels(canvas, &spots, frame.rect.grown(-3.0), lines)
        } else {
            Vec::new()
        }
    }

    /// What the pointer is told.
    fn tooltip(&self, MarkSpot { series, mark, beaten, .. }: &MarkSpot) -> String {
        let before = |of: fn(Before) -> Option<f64>| mark.before.and_then(of);
        let default = if mark.default { " (default)" } else { "" };
        let mut lines = vec![series.called(mark) + default];
        lines.push(self.x.said(mark.x, before(|was| Some(was.x))));
        lines.push(self.y.said(mark.y, before(|was| Some(was.y))));
        if let (Some(Quantity { title, unit }), Some(size)) = (&self.size, mark.size) {
            lines.push(Axis::linear(title, unit).said(size, before(|was| was.size)));
        }
        lines.extend(beaten.iter().map(|by| format!("off the front: {by} is at least as good in both")));
        lines.push(mark.note.clone());
        joined(&lines.iter().map(String::as_str).collect::<Vec<_>>(), "\n")
    }
}

impl MarkSpot<'_> {
    fn draw(&self, canvas: &mut Canvas, tooltip: &str) {
        let mut parts = Canvas::default();
        if let Some((was, radius)) = self.before {
            parts.path("was", &shape::path(self.look, was, radius));
            let [dx, dy] = [self.at[0] - was[0], self.at[1] - was[1]];
            let length = dx.hypot(dy);
            if length > radius + self.radius + 5.0 {
                let along = |share: f64| [was[0] + dx * share, was[1] + dy * share];
                parts.arrow(along(radius / length), along(1.0 - (self.radius + 1.5) / length));
            }
        }
        if self.mark.default {
            parts.path("ring", &shape::path(0, self.at, self.reach() - 1.0));
        }
        let shape = shape::path(self.look, self.at, self.radius);
        if self.beaten.is_some() {
            parts.path("under", &shape);
        }
        parts.path(if self.beaten.is_some() { "mark off" } else { "mark" }, &shape);
        canvas.group(&shape::class(self.look), tooltip, [0.0, 0.0], parts);
    }

    /// As far as it reaches, ring included.
    fn reach(&self) -> f64 {
        shape::reach(self.look, self.radius) + if self.mark.default { 4.5 } else { 1.0 }
    }
}

/// Draws the labels of marks, and names those for which there was no room. The last of
/// a series bears its name.
fn labels(canvas: &mut Canvas, spots: &[MarkSpot], within: Rect, mut lines: Vec<[f64; 2]>) -> Vec<String> {
    let mut blocks: Vec<Rect> = spots.iter().map(|spot| Rect::around(spot.at, spot.reach())).collect();
    for (spot, (was, radius)) in spots.iter().filter_map(|spot| Some((spot, spot.before?))) {
        blocks.push(Rect::around(was, shape::reach(spot.look, radius)));
        lines.extend(label::along(was, spot.at));
    }
    let (mut wanted, mut texts) = (Vec::new(), Vec::new());
    for (at, spot) in spots.iter().enumerate() {
        let last = spots.get(at + 1).is_none_or(|next| !std::ptr::eq(next.series, spot.series));
        let name = fitted(
            if last { &spot.series.name } else { "" },
            LABEL * BOLD,
            (within.right - within.left) * 0.6,
        );
        let default = if spot.mark.default { "default" } else { "" };
        let mut rest = joined(&[&spot.mark.label, default], " · ");
        if !name.is_empty() && !rest.is_empty() {
            rest.insert_str(0, " · ");
        }
        let bold = width(&name, LABEL * BOLD);
        let rest = fitted(&rest, LABEL, (within.right - within.left) * 0.6 - bold);
        if !(name.is_empty() && rest.is_empty()) {
            wanted.push(LabelRequest {
                at: spot.at,
                reach: spot.reach(),
                size: [bold + width(&rest, LABEL), LINE],
            });
            texts.push((name, rest));
        }
    }
    let mut unnamed = Vec::new();
    for ((place, wanted), (name, rest)) in
        label::place(&wanted, within, &blocks, &lines).iter().zip(&wanted).zip(texts)
    {
        let Some((rect, far)) = place else {
            unnamed.push(name + &rest);
            continue;
        };
        if *far {
            let to = rect.nearest(wanted.at);
            let share = wanted.reach / (to[0] - wanted.at[0]).hypot(to[1] - wanted.at[1]).max(1e-9);
            let from = [0, 1].map(|axis| wanted.at[axis] + (to[axis] - wanted.at[axis]) * share.min(1.0));
            canvas.line("leader", from, to);
        }
        // Beside a mark the text begins or ends at it, whatever its real width.
        let (x, anchor) = match rect {
            _ if rect.left >= wanted.at[0] => (rect.left, "start"),
            _ if rect.right <= wanted.at[0] => (rect.right, "end"),
            _ => (rect.middle()[0], "middle"),
        };
        canvas.text("label", [x, rect.top + 12.5], anchor, &name, &rest);
    }
    unnamed
}

/// For each point, of which less is better, who beats it: is no worse in both and better
/// in one, and is beaten by none.
fn beaten(points: &[[f64; 2]]) -> Vec<Option<usize>> {
    let beats = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
    let free: Vec<bool> = points.iter().map(|own| !points.iter().any(|other| beats(other, own))).collect();
    let by = |own: &[f64; 2]| (0..points.len()).find(|other| free[*other] && beats(&points[*other], own));
    points.iter().map(by).collect()
}

/// The border of what is beaten, as steps from the worst of one axis to that of the other.
fn front(corners: impl Iterator<Item = [f64; 2]>, end: [f64; 2]) -> Vec<[f64; 2]> {
    let mut corners: Vec<[f64; 2]> = corners.collect();
    corners.sort_by(|a, b| (b[0] - end[0]).abs().total_cmp(&(a[0] - end[0]).abs()));
    let mut steps: Vec<[f64; 2]> = Vec::new();
    for corner in corners {
        let height = steps.last().map_or(end[1], |last| last[1]);
        steps.extend([[corner[0], height], corner]);
    }
    steps.extend(steps.last().map(|last| [end[0], last[1]]));
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = [[1.0, 4.0], [2.0, 2.0], [2.0, 2.0], [3.0, 3.0], [2.0, 5.0], [4.0, 1.0]];
        assert_eq!(beaten(&points), [None, None, None, Some(1), Some(0), None]);
        assert_eq!(front([[3.0, 5.0]].into_iter(), [9.0, 0.0]), [[3.0, 0.0], [3.0, 5.0], [9.0, 5.0]]);
    }
}
