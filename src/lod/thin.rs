//! Keeps nodes within a bound where a cloud fills space. On a surface a node's
//! sample is some tens of thousands of points at most, for the spacing is a
//! 128th of the node's side. A dense volume has room for a million samples at
//! that spacing, and a viewer that must load a million points for one node
//! stalls. Then an even part of the sample is enough: the rest stays below,
//! where it would have been had the spacing been wider.
//!
//! The part is a prefix of the sample's coarse-to-fine order, so each octree
//! cell inside the node keeps its share (see [`super::order`]), and what a
//! sampler promises of pairs holds for every part of its sample.

use super::order::Orderer;
use super::sampler::Item;
use crate::cloud::cube::Frame;

/// Most points that a node takes from its children.
pub const NODE_LIMIT: usize = 1 << 17;
/// Beyond so many, a node takes no more than half of what lies below it. A dense
/// volume would give all of its points to the nodes above its leaves, which would
/// be left empty, and as many points as the cloud has would rise at once. No
/// surface comes near: its samples are some 128² points.
const HALVED_BEYOND: usize = 1 << 15;

/// Reusable memory for thinning.
pub struct Thinner {
    limit: usize,
    orderer: Orderer,
    accepted: Vec<Item>,
}

impl Default for Thinner {
    fn default() -> Thinner {
        Thinner::to(NODE_LIMIT)
    }
}

impl Thinner {
    /// One that leaves at most `limit` points.
    pub fn to(limit: usize) -> Thinner {
        Thinner { limit, orderer: Orderer::default(), accepted: Vec::new() }
    }

    /// Takes back flags (one a candidate, in the order given) until at most
    /// `limit` are left.
    pub fn thin(&mut self, frame: Frame, candidates: &[&[Item]], taken: &mut [bool]) {
        let limit = self.limit.min(HALVED_BEYOND.max(taken.len() / 2));
        if taken.len() <= limit || taken.iter().filter(|t| **t).count() <= limit {
            return;
        }
        let all = candidates.iter().flat_map(|c| c.iter()).zip(0..);
        self.accepted.clear();
        self.accepted.extend(
            all.filter(|(_, flag)| taken[*flag as usize])
                .map(|(item, flag)| Item { at: item.at, index: flag }),
        );
        taken.fill(false);
        for flag in self.orderer.coarse_to_fine(frame, &self.accepted).take(limit) {
            taken[flag as usize] = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::node::NodeKey;
    use proptest::prelude::*;

    fn grid(side: u32) -> Vec<Item> {
        let points = (0..side * side * side).map(|i| [i % side, i / side % side, i / side / side]);
        points.zip(0..).map(|(at, index)| Item { at, index }).collect()
    }

    proptest! {
        #[test]
        fn the_limit_holds_the_rest_is_untouched_and_every_octant_keeps_its_share(
            limit in 1usize..3000, split in 0usize..4096, gone in any::<u64>(),
        ) {
            let items = grid(16);
            let frame = Frame::of(4, NodeKey::ROOT);
            let candidates = [&items[..split], &items[split..]];
            let mut taken: Vec<bool> = (0..4096u64).map(|i| (gone.rotate_left(i as u32) ^ i) % 5 != 0).collect();
            let before = taken.clone();
            Thinner::to(limit).thin(frame, &candidates, &mut taken);
            let count = taken.iter().filter(|t| **t).count();
            let all = before.iter().filter(|t| **t).count();
            prop_assert_eq!(count, all.min(limit));
            prop_assert!(taken.iter().zip(&before).all(|(now, then)| *then || !now), "only flags that were set");
            for octant in 0..8u32 {
                let inside = |i: usize| items[i].at.iter().enumerate().all(|(a, c)| c >> 3 == octant >> a & 1);
                let share = |flags: &[bool]| (0..4096).filter(|i| flags[*i] && inside(*i)).count() as f64;
                let expected = share(&before) * count as f64 / all as f64;
                prop_assert!((share(&taken) - expected).abs() <= 2.0 + (limit as f64).log2());
            }
        }
    }
}
