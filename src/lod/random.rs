//! Random in grid, after Kang et al. ("Fast Out-of-Core Octree Generation",
//! section 5): one point a cell of a 128³ grid, "random" by a hash of its
//! position and level, so that the same cloud always gives the same octree.

use super::sampler::{Item, Sampler};
use crate::cloud::cube::Frame;
use crate::cloud::node::NodeKey;

/// Candidates come in Morton order, so those of a cell come one behind the
/// other: a single pass that remembers one cell, and no grid.
#[derive(Default)]
pub struct RandomInGrid;

/// A well mixed number from a position; seeded by the level, because a hash
/// that is reused from level to level would prefer the same points again.
fn rank(at: [u32; 3], level: u8) -> u64 {
    let mut h = u64::from(level).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    for c in at {
        h = (h ^ u64::from(c)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        h ^= h >> 29;
    }
    h.wrapping_mul(0x94D0_49BB_1331_11EB) ^ h >> 32
}

impl Sampler for RandomInGrid {
    fn sample(&mut self, node: NodeKey, frame: Frame, candidates: &[&[Item]], taken: &mut Vec<bool>) {
        taken.clear();
        taken.resize(candidates.iter().map(|set| set.len()).sum(), false);
        let shift = frame.spacing_shift();
        // The best of the cell so far.
        let (mut cell, mut best, mut lowest) = ([u32::MAX; 3], 0, u64::MAX);
        let mut ordinal = 0;
        for set in candidates {
            for item in *set {
                // Nothing here can be foreseen, so nothing branches: each flag
                // is set as if the last one before it had to give way.
                let own = item.at.map(|c| c >> shift);
                let rank = rank(item.at, node.level);
                let is_new = own != cell;
                let wins = is_new | (rank < lowest);
                taken[best] &= is_new | !wins;
                taken[ordinal] = wins;
                best = if wins { ordinal } else { best };
                lowest = if wins { rank } else { lowest };
                cell = own;
                ordinal += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::order;
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        /// The same as by a table of cells: of each, the first of the lowest rank.
        #[test]
        fn one_a_cell_is_taken_that_of_the_lowest_rank(
            points in proptest::collection::vec((0u32..1024, 0u32..40, 0u32..512), 1..500), level in 0u8..3,
        ) {
            let items = points.iter().zip(0..).map(|((x, y, z), index)| Item { at: [*x, *y, *z], index });
            let (mut left, mut right): (Vec<Item>, Vec<Item>) = items.partition(|item| item.at[0] < 512);
            for (x, items) in [(0, &mut left), (512, &mut right)] {
                let mut spare = items.clone();
                order::sort(Frame { origin: [x, 0, 0], side_bits: 9 }, items, &mut spare);
            }
            let items = [left.as_slice(), &right].concat();
            let mut lowest: HashMap<[u32; 3], (u64, u32)> = HashMap::new();
            for item in &items {
                let own = (rank(item.at, level), item.index);
                let entry = lowest.entry(item.at.map(|c| c >> 3)).or_insert(own);
                if own.0 < entry.0 {
                    *entry = own;
                }
            }
            let mut taken = Vec::new();
            let (node, frame) = (NodeKey { level, at: [0; 3] }, Frame { origin: [0; 3], side_bits: 10 });
            RandomInGrid.sample(node, frame, &[&left, &right], &mut taken);
            for (item, taken) in items.iter().zip(taken) {
                prop_assert_eq!(lowest[&item.at.map(|c| c >> 3)].1 == item.index, taken);
            }
        }
    }
}
