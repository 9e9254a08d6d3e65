//! Marks in their places: what scatter and lines draw alike.

use super::canvas::{Anchor, Canvas};
use super::data::{Axis, Mark, Quantity, Series};
use super::frame::{BOLD, Frame, LABEL, LINE};
use super::label::{self, Wish};
use super::rect::{Rect, Segment};
use super::{number, shape, text};

/// A mark that has a place.
pub(super) struct Spot<'a> {
    pub series: usize,
    pub name: &'a str,
    pub mark: &'a Mark,
    pub look: usize,
    pub at: [f64; 2],
    pub radius: f64,
    /// Where it was, and how large.
    pub before: Option<([f64; 2], f64)>,
    /// Who beats it, if it is beaten and that matters.
    pub beaten: Option<String>,
}

/// What a measurement is called.
pub(super) fn called(series: &Series, mark: &Mark) -> String {
    let parts = [series.name.as_str(), mark.label.as_str()];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" · ")
}

pub(super) fn look(series: &Series, place: usize) -> usize {
    series.look.unwrap_or(place)
}

/// Why a mark has no place, if so.
fn missing(mark: &Mark, x: &Axis, y: &Axis) -> Option<String> {
    [(x, mark.x), (y, mark.y)].into_iter().find_map(|(axis, value)| match value {
        _ if axis.takes(value) => None,
        _ if value.is_nan() => Some(format!("no {}", axis.title)),
        _ if value.is_infinite() || value.abs() >= 1e300 => Some(format!("{} without bounds", axis.title)),
        _ => Some(format!("{} is {}", axis.title, number::figure(value))),
    })
}

/// What cannot be drawn, in a sentence.
pub(super) fn left_out<'a>(series: impl Iterator<Item = &'a Series>, x: &Axis, y: &Axis) -> Option<String> {
    told("not shown", series.flat_map(|series| lost(series, x, y)).collect())
}

/// The marks of a series that have no place, one by one where they are few.
fn lost(series: &Series, x: &Axis, y: &Axis) -> Vec<String> {
    let lost = series.marks.iter().filter_map(|mark| Some((mark, missing(mark, x, y)?)));
    let lost: Vec<(&Mark, String)> = lost.collect();
    match &lost[..] {
        [(_, first), _, _, ..] => vec![format!("{} marks of {} (first: {first})", lost.len(), series.name)],
        few => few.iter().map(|(mark, why)| format!("{} ({why})", called(series, mark))).collect(),
    }
}

/// "not shown: a, b and 3 more"
pub(super) fn told(what: &str, names: Vec<String>) -> Option<String> {
    const SAID: usize = 8;
    let more = names.len().saturating_sub(SAID);
    let said = names.iter().take(SAID).map(String::as_str).collect::<Vec<_>>().join(", ");
    match (names.is_empty(), more) {
        (true, _) => None,
        (_, 0) => Some(format!("{what}: {said}")),
        _ => Some(format!("{what}: {said} and {more} more")),
    }
}

/// All marks that have a place in a frame.
pub(super) fn spots<'a>(
    all: &'a [Series],
    frame: &Frame,
    radius: impl Fn(Option<f64>) -> f64,
) -> Vec<Spot<'a>> {
    let (x, y) = (&frame.x.axis, &frame.y.axis);
    let spot = |number: usize, series: &'a Series, mark: &'a Mark| Spot {
        series: number,
        name: &series.name,
        mark,
        look: look(series, number),
        at: frame.at(mark.x, mark.y),
        radius: radius(mark.size),
        before: mark
            .before
            .filter(|before| x.takes(before.x) && y.takes(before.y))
            .map(|before| (frame.at(before.x, before.y), radius(before.size))),
        beaten: None,
    };
    let series = all.iter().enumerate();
    series
        .flat_map(|(number, series)| series.marks.iter().map(move |mark| (number, series, mark)))
        .filter(|(_, _, mark)| missing(mark, x, y).is_none())
        .map(|(number, series, mark)| spot(number, series, mark))
        .collect()
}

/// An arrow between two places, as the `d` of a path.
pub(super) fn arrow(from: [f64; 2], to: [f64; 2]) -> String {
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    let length = dx.hypot(dy).max(1e-9);
    let [ux, uy] = [dx / length, dy / length];
    let head = 5.0_f64.min(length);
    let side =
        |way: f64| [to[0] - head * ux - way * head * 0.5 * uy, to[1] - head * uy + way * head * 0.5 * ux];
    super::canvas::through(&[from, to]) + &super::canvas::through(&[side(1.0), to, side(-1.0)])
}

impl Spot<'_> {
    /// The way from where it was, edge to edge; none where it did not move so far.
    pub fn way(&self) -> Option<Segment> {
        let (was, radius) = self.before?;
        let [dx, dy] = [self.at[0] - was[0], self.at[1] - was[1]];
        let length = dx.hypot(dy);
        let along = |share: f64| [was[0] + dx * share, was[1] + dy * share];
        (length > radius + self.radius + 5.0)
            .then(|| Segment { from: along(radius / length), to: along(1.0 - (self.radius + 1.5) / length) })
    }

    pub fn draw(&self, canvas: &mut Canvas, tooltip: &str) {
        let class = shape::class(self.look);
        canvas.open(&class, tooltip);
        if let Some((was, radius)) = self.before {
            canvas.path("was", &shape::path(self.look, was, radius));
        }
        if let Some(way) = self.way() {
            canvas.path("arrow", &arrow(way.from, way.to));
        }
        if self.mark.default {
            canvas.circle("ring", self.at, self.reach() - 1.0);
        }
        let shape = shape::path(self.look, self.at, self.radius);
        if self.beaten.is_some() {
            canvas.path("under", &shape);
        }
        let mark = if self.beaten.is_some() { "mark off" } else { "mark" };
        canvas.path(mark, &shape);
        canvas.close();
    }

    /// What the pointer is told.
    pub fn tooltip(&self, x: &Axis, y: &Axis, size: Option<&Quantity>) -> String {
        let Spot { mark, .. } = self;
        let title = [self.name, &mark.label].into_iter().filter(|part| !part.is_empty());
        let mut lines = vec![title.collect::<Vec<_>>().join(" · ")];
        if mark.default {
            lines[0].push_str(" (default)");
        }
        let mut say = |title: &str, unit: &str, now: f64, before: Option<f64>| {
            let was = before.map(|before| {
                format!(", before {} ({})", number::with_unit(before, unit), number::change(now, before))
            });
            lines.push(format!("{title}: {}{}", number::with_unit(now, unit), was.unwrap_or_default()));
        };
        say(&x.title, &x.unit, mark.x, mark.before.map(|before| before.x));
        say(&y.title, &y.unit, mark.y, mark.before.map(|before| before.y));
        if let (Some(size), Some(now)) = (size, mark.size) {
            say(&size.title, &size.unit, now, mark.before.and_then(|before| before.size));
        }
        lines.extend(self.beaten.iter().map(|by| format!("off the front: {by} is at least as good in both")));
        lines.extend((!mark.note.is_empty()).then(|| mark.note.clone()));
        lines.retain(|line| !line.is_empty());
        lines.join("\n")
    }

    /// As far as it reaches, ring included.
    pub fn reach(&self) -> f64 {
        shape::reach(self.look, self.radius) + if self.mark.default { RING + 1.0 } else { 1.0 }
    }
}

/// From a mark's edge to the ring around it.
pub(super) const RING: f64 = 3.5;

/// A text for each mark that wants one: the last of a series bears its name.
fn words(spots: &[Spot]) -> Vec<Option<(String, String)>> {
    let last = |at: usize| spots.get(at + 1).is_none_or(|next| next.series != spots[at].series);
    let text = |(at, spot): (usize, &Spot)| {
        let name = if last(at) { spot.name } else { "" };
        let default = if spot.mark.default { "default" } else { "" };
        let rest: Vec<_> =
            [spot.mark.label.as_str(), default].into_iter().filter(|part| !part.is_empty()).collect();
        let rest = rest.join(" · ");
        let between = if name.is_empty() || rest.is_empty() { "" } else { " · " };
        (!name.is_empty() || !rest.is_empty()).then(|| (name.to_string(), format!("{between}{rest}")))
    };
    spots.iter().enumerate().map(text).collect()
}

/// Draws the labels of marks, and names those for which there was no room.
pub(super) fn labels(canvas: &mut Canvas, spots: &[Spot], within: Rect, lines: &[Segment]) -> Vec<String> {
    let mut blocks: Vec<Rect> = spots.iter().map(|spot| Rect::around(spot.at, spot.reach())).collect();
    let were = spots.iter().filter_map(|spot| Some((spot.look, spot.before?)));
    blocks.extend(were.map(|(look, (at, radius))| Rect::around(at, shape::reach(look, radius))));
    let mut lines = lines.to_vec();
    lines.extend(spots.iter().filter_map(Spot::way));
    let most = within.width() * 0.6;
    let mut wishes = Vec::new();
    let mut texts = Vec::new();
    for (spot, words) in spots.iter().zip(words(spots)) {
        let Some((name, rest)) = words else { continue };
        let name = text::fitted(&name, LABEL * BOLD, most);
        let rest = text::fitted(&rest, LABEL, most - text::width(&name, LABEL * BOLD));
        let width = text::width(&name, LABEL * BOLD) + text::width(&rest, LABEL);
        wishes.push(Wish { at: spot.at, radius: spot.reach(), width, height: LINE });
        texts.push((name, rest, spot));
    }
    let mut without = Vec::new();
    for (place, (name, rest, spot)) in label::place(&wishes, within, &blocks, &lines).into_iter().zip(texts) {
        let Some(place) = place else {
            without.push(format!("{name}{rest}"));
            continue;
        };
        if let Some(leader) = place.leader {
            canvas.line("leader", leader.from, leader.to);
        }
        // Beside a mark the text begins or ends at it, whatever its real width.
        let (x, anchor) = match place.rect {
            rect if rect.left >= spot.at[0] => (rect.left, Anchor::Start),
            rect if rect.right <= spot.at[0] => (rect.right, Anchor::End),
            rect => (rect.middle()[0], Anchor::Middle),
        };
        canvas.label([x, place.rect.top + 12.5], anchor, &name, &rest);
    }
    without
}
