//! Where labels stand: at their marks, and neither on each other nor on a mark.
//!
//! Each label tries places around its mark, the near ones first, and takes the
//! cheapest that is free; then each is asked once more while all others stay, since
//! the first to come did not know of the last. A label that had to go far is joined
//! to its mark by a line. One that finds no place is not drawn, and the caller says so.

use super::rect::{Rect, Segment};

#[derive(Debug, Clone)]
pub(super) struct Wish {
    pub at: [f64; 2],
    /// Of the mark.
    pub radius: f64,
    pub width: f64,
    pub height: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Place {
    pub rect: Rect,
    /// From the mark's edge to the label.
    pub leader: Option<Segment>,
}

/// Between a label and anything else.
const ROOM: f64 = 2.0;
/// From the mark; beyond the first three a line leads there.
const RINGS: [f64; 10] = [3.0, 6.0, 10.0, 18.0, 28.0, 40.0, 55.0, 75.0, 100.0, 130.0];
const NEAR: f64 = 10.0;
/// What a place costs, in pixels of distance.
const ON_LINE: f64 = 12.0;
const LEADER: f64 = 10.0;
const LEADER_OVER_MARK: f64 = 60.0;
const LEADER_OVER_LINE: f64 = 6.0;
/// Nearer to another mark than to its own, it would be read as that one's.
const STRANGE: f64 = 15.0;
const ROUNDS: usize = 3;

/// A place for each wish within a frame, apart from blocks, and rather not on lines.
pub(super) fn place(wishes: &[Wish], within: Rect, blocks: &[Rect], lines: &[Segment]) -> Vec<Option<Place>> {
    let mut places: Vec<Option<Place>> = vec![None; wishes.len()];
    for _ in 0..ROUNDS {
        for (at, wish) in wishes.iter().enumerate() {
            places[at] = None;
            let site = Site { within, blocks, lines, others: &places };
            let near = candidates(wish).filter_map(|place| Some((site.cost(wish, &place)?, place)));
            let best = near.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, place)| place);
            places[at] = best.or_else(|| site.anywhere(wish));
        }
    }
    places
}

/// Directions, the best first: beside the mark, then above and below.
const AROUND: [[f64; 2]; 16] = [
    [1.0, 0.0],
    [-1.0, 0.0],
    [0.707, -0.707],
    [0.707, 0.707],
    [0.0, -1.0],
    [0.0, 1.0],
    [-0.707, -0.707],
    [-0.707, 0.707],
    [0.924, -0.383],
    [0.924, 0.383],
    [-0.924, -0.383],
    [-0.924, 0.383],
    [0.383, -0.924],
    [0.383, 0.924],
    [-0.383, -0.924],
    [-0.383, 0.924],
];

fn candidates(wish: &Wish) -> impl Iterator<Item = Place> {
    RINGS.into_iter().flat_map(move |ring| AROUND.into_iter().map(move |way| beside(wish, way, ring)))
}

fn beside(wish: &Wish, way: [f64; 2], ring: f64) -> Place {
    let reach = wish.radius + ring;
    let [x, y] = [wish.at[0] + way[0] * reach, wish.at[1] + way[1] * reach];
    let shift = |way: f64, size: f64| match way {
        _ if way > 0.3 => 0.0,
        _ if way < -0.3 => -size,
        _ => -size / 2.0,
    };
    let corner = [x + shift(way[0], wish.width), y + shift(way[1], wish.height)];
    let rect = Rect::new(corner, [wish.width, wish.height]);
    Place { leader: (ring > NEAR).then(|| leader(wish, &rect)), rect }
}

/// From the mark's edge to the nearest point of the label.
fn leader(wish: &Wish, rect: &Rect) -> Segment {
    let to = rect.nearest(wish.at);
    let [dx, dy] = [to[0] - wish.at[0], to[1] - wish.at[1]];
    let share = wish.radius / dx.hypot(dy).max(wish.radius).max(1e-9);
    Segment { from: [wish.at[0] + dx * share, wish.at[1] + dy * share], to }
}

struct Site<'a> {
    within: Rect,
    blocks: &'a [Rect],
    lines: &'a [Segment],
    others: &'a [Option<Place>],
}

impl Site<'_> {
    /// What a place costs; nothing where it is taken.
    fn cost(&self, wish: &Wish, place: &Place) -> Option<f64> {
        let roomy = place.rect.grown(ROOM);
        let others = || self.others.iter().flatten();
        let free = self.within.holds(&place.rect)
            && !self.blocks.iter().any(|block| block.meets(&roomy))
            && !others().any(|other| other.rect.meets(&roomy))
            && !others().filter_map(|other| other.leader).any(|line| line.meets(&roomy));
        if !free {
            return None;
        }
        let crossed = self.lines.iter().filter(|line| line.meets(&roomy)).count() as f64;
        let [x, y] = place.rect.nearest(wish.at);
        let distance = (x - wish.at[0]).hypot(y - wish.at[1]) - wish.radius;
        // Beside a mark a label is read with it; above and below it may be another's.
        let aside = (place.rect.middle()[1] - wish.at[1]).abs() * 0.25;
        let left = if place.rect.middle()[0] < wish.at[0] { 1.5 } else { 0.0 };
        let far = |at: [f64; 2]| {
            let [x, y] = place.rect.nearest(at);
            (x - at[0]).hypot(y - at[1])
        };
        let own = (x - wish.at[0]).hypot(y - wish.at[1]);
        let near = |block: &&Rect| !block.contains(wish.at) && far(block.middle()) < own + 4.0;
        let strange = if place.leader.is_none() && self.blocks.iter().any(|block| near(&block)) {
            STRANGE
        } else {
            0.0
        };
        Some(distance + aside + left + strange + crossed.min(4.0) * ON_LINE + self.leader_cost(wish, place)?)
    }

    fn leader_cost(&self, wish: &Wish, place: &Place) -> Option<f64> {
        let Some(leader) = place.leader else { return Some(0.0) };
        if self.others.iter().flatten().any(|other| leader.meets(&other.rect)) {
            return None;
        }
        let own = |block: &&Rect| block.contains(wish.at);
        let marks = self.blocks.iter().filter(|block| !own(block) && leader.meets(block)).count();
        let leaders = self.others.iter().flatten().filter_map(|other| other.leader);
        let lines = self.lines.iter().copied().chain(leaders).filter(|line| line.crosses(&leader)).count();
        Some(LEADER + marks as f64 * LEADER_OVER_MARK + lines.min(4) as f64 * LEADER_OVER_LINE)
    }

    /// The cheapest place in the whole frame, for a mark in a crowd.
    fn anywhere(&self, wish: &Wish) -> Option<Place> {
        let steps = |from: f64, to: f64, step: f64| {
            (0..=((to - from).max(0.0) / step) as usize).map(move |k| from + k as f64 * step)
        };
        let rows = steps(self.within.top, self.within.bottom - wish.height, wish.height / 2.0);
        let places = rows
            .flat_map(|y| steps(self.within.left, self.within.right - wish.width, 12.0).map(move |x| [x, y]));
        let places = places.filter_map(|corner| {
            let rect = Rect::new(corner, [wish.width, wish.height]);
            let place = Place { leader: Some(leader(wish, &rect)), rect };
            Some((self.cost(wish, &place)?, place))
        });
        places.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, place)| place)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wish(x: f64, y: f64, width: f64) -> Wish {
        Wish { at: [x, y], radius: 5.0, width, height: 16.0 }
    }

    fn blocks(wishes: &[Wish]) -> Vec<Rect> {
        wishes.iter().map(|wish| Rect::around(wish.at, wish.radius)).collect()
    }

    const FRAME: Rect = Rect { left: 0.0, top: 0.0, right: 600.0, bottom: 400.0 };

    #[test]
    fn a_label_stands_beside_its_mark() {
        for (x, left) in [(300.0, false), (590.0, true)] {
            let wishes = [wish(x, 200.0, 80.0)];
            let places = place(&wishes, FRAME, &blocks(&wishes), &[]);
            let place = places[0].as_ref().unwrap();
            assert_eq!(place.rect.right < x, left);
            assert_eq!(place.rect.middle()[1], 200.0);
            assert_eq!(place.leader, None);
        }
    }

    #[test]
    fn a_label_rather_stands_beside_a_line_than_on_it() {
        let wishes = [wish(300.0, 200.0, 80.0)];
        let line = Segment { from: [300.0, 200.0], to: [600.0, 200.0] };
        let places = place(&wishes, FRAME, &blocks(&wishes), &[line]);
        assert!(!line.meets(&places[0].as_ref().unwrap().rect));
    }

    #[test]
    fn what_has_no_room_is_left_out() {
        let wishes = [wish(20.0, 10.0, 900.0), wish(20.0, 10.0, 40.0)];
        let places = place(&wishes, FRAME, &blocks(&wishes), &[]);
        assert!(places[0].is_none() && places[1].is_some());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn labels_keep_apart(
            marks in prop::collection::vec((5.0..595.0, 5.0..395.0, 10.0..160.0), 0..30),
            crowded: bool,
        ) {
            let shrink = if crowded { 0.1 } else { 1.0 };
            let wishes: Vec<Wish> =
                marks.iter().map(|(x, y, width)| wish(300.0 + (x - 300.0) * shrink, 200.0 + (y - 200.0) * shrink, *width)).collect();
            let blocks = blocks(&wishes);
            let places = place(&wishes, FRAME, &blocks, &[]);
            prop_assert!(wishes.len() > 10 || places.iter().all(Option::is_some), "ten have room");
            let rects: Vec<Rect> = places.into_iter().flatten().map(|place| place.rect).collect();
            for (at, rect) in rects.iter().enumerate() {
                prop_assert!(FRAME.holds(rect));
                prop_assert!(!blocks.iter().any(|block| block.meets(rect)));
                prop_assert!(!rects[at + 1..].iter().any(|other| other.meets(rect)));
            }
        }
    }
}
