//! Keeps nodes within a bound where a cloud fills space. On a surface a node's
//! sample is some tens of thousands of points at most, for the spacing is a
//! 128th of the node's side. A dense volume has room for a million samples at
//! that spacing, and a viewer that must load a million points for one node
//! stalls. Then an even part of the sample is enough: the rest stays below,
//! where it would have been had the spacing been wider.
//!
//! The part is a prefix of the sample's coarse-to-fine order, so each octree
//! cell inside the node keeps its share (see [`super::node_order`]), and what a
//! sampler promises of pairs holds for every part of its sample.

use super::node_order;

/// Most points that a node takes from its children.
pub const NODE_LIMIT: usize = 1 << 17;
/// Beyond so many, a node takes no more than half of what lies below it. A dense
/// volume would give all of its points to the nodes above its leaves, which would
/// be left empty, and as many points as the cloud has would rise at once. No
/// surface comes near: its samples are some 128² points.
const HALVED_BEYOND: usize = 1 << 15;

/// Takes back flags (one a candidate, in Morton order) until at most `limit` are
/// left.
pub fn thin(limit: usize, taken: &mut [bool]) {
    let limit = limit.min(HALVED_BEYOND.max(taken.len() / 2));
    if taken.len() <= limit || taken.iter().filter(|t| **t).count() <= limit {
        return;
    }
    let accepted: Vec<usize> = (0..taken.len()).filter(|i| taken[*i]).collect();
    taken.fill(false);
    for rank in node_order::coarse_to_fine(accepted.len()).take(limit) {
        taken[accepted[rank]] = true;
    }
}

#[cfg(test)]
mod tests {
    use super::super::sampling::sampler::IndexedPoint;
    use super::*;
    use crate::octree::cube::NodeCube;
    use crate::octree::node::NodeKey;
    use proptest::prelude::*;

    fn grid(side: u32) -> Vec<IndexedPoint> {
        let points = (0..side * side * side).map(|i| [i % side, i / side % side, i / side / side]);
        points.zip(0..).map(|(at, index)| IndexedPoint { at, index }).collect()
    }

    proptest! {
        #[test]
        fn the_limit_holds_the_rest_is_untouched_and_every_octant_keeps_its_share(
            limit in 1usize..3000, gone in any::<u64>(),
        ) {
            let mut items = grid(16);
            let mut spare = items.clone();
            node_order::sort(NodeCube::of(4, NodeKey::ROOT), &mut items, &mut spare);
            let mut taken: Vec<bool> = (0..4096u64).map(|i| (gone.rotate_left(i as u32) ^ i) % 5 != 0).collect();
            let before = taken.clone();
            thin(limit, &mut taken);
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
