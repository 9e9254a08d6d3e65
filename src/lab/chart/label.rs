//! Where labels stand: at their marks, and neither on each other nor on a mark. Each
//! takes the best free place around its mark; one that is far from it is joined to it by
//! a line, and one that finds no place is not drawn, and the caller says so.

use super::canvas::Rect;

/// A label of a mark at a place, whose mark reaches so far, and its size.
#[derive(Debug, Clone)]
pub(super) struct LabelRequest {
    pub at: [f64; 2],
    pub reach: f64,
    pub size: [f64; 2],
}

/// Between a label and anything else.
const ROOM: f64 = 2.0;
/// From the mark; beyond `NEAR` a line leads there.
const RINGS: [f64; 10] = [3.0, 6.0, 10.0, 18.0, 28.0, 40.0, 55.0, 75.0, 100.0, 130.0];
const NEAR: f64 = 10.0;

impl Rect {
    pub fn around([x, y]: [f64; 2], reach: f64) -> Rect {
        Rect { left: x, top: y, right: x, bottom: y }.grown(reach)
    }

    pub fn grown(self, by: f64) -> Rect {
        Rect { left: self.left - by, top: self.top - by, right: self.right + by, bottom: self.bottom + by }
    }

    pub fn holds(&self, other: &Rect) -> bool {
        self.left <= other.left
            && self.top <= other.top
            && self.right >= other.right
            && self.bottom >= other.bottom
    }

    pub fn meets(&self, other: &Rect) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    pub fn middle(&self) -> [f64; 2] {
        [(self.left + self.right) / 2.0, (self.top + self.bottom) / 2.0]
    }

    /// The point of it that is nearest to a place.
    pub fn nearest(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x.clamp(self.left, self.right), y.clamp(self.top, self.bottom)]
    }

    pub fn distance(&self, at: [f64; 2]) -> f64 {
        let [x, y] = self.nearest(at);
        (x - at[0]).hypot(y - at[1])
    }
}

/// Places along a line, near enough to each other that no label slips between.
pub(super) fn along(from: [f64; 2], to: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
    let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / 6.0).ceil().max(1.0);
    let step = move |k| [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * f64::from(k) / steps);
    (0..=steps as u32).map(step)
}

/// A place for each label within a frame, apart from blocks, and rather not on lines,
/// which are given as places along them. Whether a line must lead to it, too.
pub(super) fn place(
    labels: &[LabelRequest],
    within: Rect,
    blocks: &[Rect],
    lines: &[[f64; 2]],
) -> Vec<Option<(Rect, bool)>> {
    let mut places: Vec<Option<(Rect, bool)>> = vec![None; labels.len()];
    // Twice, for the first to come did not know of the last.
    for at in (0..labels.len()).chain(0..labels.len()) {
        places[at] = None;
        let cost = |rect: &Rect, ring: f64| {
            let (label, roomy) = (&labels[at], rect.grown(ROOM));
            let far = ring > NEAR;
            let leader = || along(label.at, rect.nearest(label.at)).filter(|_| far);
            let others = || places.iter().flatten();
            let free = within.holds(rect)
                && !blocks.iter().any(|block| block.meets(&roomy))
                && !others().any(|(other, _)| other.meets(&roomy));
            if !free {
                return None;
            }
            let crossed = lines.iter().filter(|p| roomy.distance(**p) == 0.0).count().min(12) as f64;
            // No leader under another label, unless there is no other place at all.
            let under = others().any(|(other, _)| leader().any(|p| other.distance(p) < ROOM));
            let marks = blocks.iter().filter(|block| block.distance(label.at) > 0.0);
            let over =
                leader().filter(|p| marks.clone().any(|block| block.distance(*p) == 0.0)).count() as f64;
            // Nearer to another mark than to its own, it would be read as that one's.
            let own = rect.distance(label.at);
            let strange = !far && marks.clone().any(|block| rect.distance(block.middle()) < own + 4.0);
            // Beside a mark a label is read with it; above and below it may be another's.
            let aside = (rect.middle()[1] - label.at[1]).abs() * 0.25;
            let left = if rect.right < label.at[0] { 1.5 } else { 0.0 };
            let extra = [(strange, 15.0), (far, 10.0), (under, 1e4)];
            let extra: f64 = extra.iter().filter(|(is, _)| *is).map(|(_, cost)| cost).sum();
            Some(own - label.reach + aside + left + crossed * 5.0 + over * 15.0 + extra)
        };
        let around = RINGS.into_iter().flat_map(|ring| (0..16).map(move |way| (way, ring)));
        let mut near = around.map(|(way, ring)| (beside(&labels[at], way, ring), ring));
        let cheapest = |candidates: &mut dyn Iterator<Item = (Rect, f64)>| {
            let free = candidates.filter_map(|(rect, ring)| Some((cost(&rect, ring)?, rect, ring > NEAR)));
            free.min_by(|(a, ..), (b, ..)| a.total_cmp(b)).map(|(_, rect, far)| (rect, far))
        };
        let found = cheapest(&mut near);
        places[at] =
            found.or_else(|| cheapest(&mut anywhere(labels[at].size, within).map(|rect| (rect, f64::MAX))));
    }
    places
}

/// All over the frame, for a mark in a crowd.
fn anywhere([width, height]: [f64; 2], within: Rect) -> impl Iterator<Item = Rect> {
    let steps = |room: f64, step: f64| (0..=(room.max(0.0) / step) as u32).map(move |k| f64::from(k) * step);
    let rows = steps(within.bottom - within.top - height, height / 2.0);
    let columns = move || steps(within.right - within.left - width, 12.0);
    rows.flat_map(move |y| columns().map(move |x| [within.left + x, within.top + y]))
        .map(move |[left, top]| Rect { left, top, right: left + width, bottom: top + height })
}

/// Beside a mark in one of sixteen directions, so far from its edge.
fn beside(label: &LabelRequest, way: u32, ring: f64) -> Rect {
    let (sin, cos) = (std::f64::consts::TAU * f64::from(way) / 16.0).sin_cos();
    let corner = |axis: usize, part: f64| {
        let shift = match part {
            _ if part > 0.3 => 0.0,
            _ if part < -0.3 => -label.size[axis],
            _ => -label.size[axis] / 2.0,
        };
        label.at[axis] + part * (label.reach + ring) + shift
    };
    let [left, top] = [corner(0, cos), corner(1, sin)];
    Rect { left, top, right: left + label.size[0], bottom: top + label.size[1] }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FRAME: Rect = Rect { left: 0.0, top: 0.0, right: 600.0, bottom: 400.0 };

    fn wanted(x: f64, y: f64, width: f64) -> LabelRequest {
        LabelRequest { at: [x, y], reach: 5.0, size: [width, 16.0] }
    }

    fn blocks(labels: &[LabelRequest]) -> Vec<Rect> {
        labels.iter().map(|label| Rect::around(label.at, label.reach)).collect()
    }

    #[test]
    fn a_label_stands_beside_its_mark() {
        for (x, line, left) in
            [(300.0, None, false), (590.0, None, true), (300.0, Some([600.0, 200.0]), true)]
        {
            let labels = [wanted(x, 200.0, 80.0)];
            let lines: Vec<_> = line.iter().flat_map(|end| along(labels[0].at, *end)).collect();
            let (rect, far) = place(&labels, FRAME, &blocks(&labels), &lines)[0].unwrap();
            assert!(!far && (rect.right < x) == left, "{rect:?}");
        }
        assert_eq!(place(&[wanted(20.0, 10.0, 900.0)], FRAME, &[], &[]), [None]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn labels_keep_apart(marks in prop::collection::vec((5.0..595.0, 5.0..395.0, 10.0..160.0), 0..30), near: bool) {
            let shrink = if near { 0.1 } else { 1.0 };
            let place_of = |(x, y, width): &(f64, f64, f64)| wanted(300.0 + (x - 300.0) * shrink, 200.0 + (y - 200.0) * shrink, *width);
            let labels: Vec<LabelRequest> = marks.iter().map(place_of).collect();
            let blocks = blocks(&labels);
            let places = place(&labels, FRAME, &blocks, &[]);
            prop_assert!(labels.len() > 10 || places.iter().all(Option::is_some), "ten have room");
            let rects: Vec<Rect> = places.into_iter().flatten().map(|(rect, _)| rect).collect();
            for (at, rect) in rects.iter().enumerate() {
                prop_assert!(FRAME.holds(rect) && !blocks.iter().any(|block| block.meets(rect)));
                prop_assert!(!rects[at + 1..].iter().any(|other| other.meets(rect)));
            }
        }
    }
}
