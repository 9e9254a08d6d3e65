//! One point a cell of the node's 128³ grid: what the samplers in a grid share.

use super::sampler::IndexedPoint;
use crate::octree::cube::NodeCube;

/// Takes of each cell the candidate of the lowest rank, the first of them where
/// several have it.
///
/// Candidates come in Morton order, so those of a cell come one behind the
/// other: a single pass that remembers one cell, and no grid.
pub fn take_lowest(
    frame: NodeCube,
    candidates: &[&[IndexedPoint]],
    taken: &mut Vec<bool>,
    rank: impl Fn([u32; 3]) -> u64,
) {
    taken.clear();
    taken.resize(candidates.iter().map(|set| set.len()).sum(), false);
    let shift = frame.spacing_shift();
    // The best of the cell so far.
    let (mut cell, mut best, mut lowest) = ([u32::MAX; 3], 0, u64::MAX);
    let mut ordinal = 0;
    for set in candidates {
        for item in *set {
            // Nothing here can be foreseen, so nothing branches: each flag is
            // set as if the last one before it had to give way.
            let own = item.at.map(|c| c >> shift);
            let rank = rank(item.at);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::node_order;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        /// The same as by a table of cells: of each, the first of the lowest rank.
        #[test]
        fn one_a_cell_is_taken_that_of_the_lowest_rank(
            points in proptest::collection::vec((0u32..1024, 0u32..40, 0u32..512), 1..500), ranks in 1u64..40,
        ) {
            let rank = |at: [u32; 3]| (u64::from(at[0]) * 7 + u64::from(at[1]) * 13 + u64::from(at[2])) % ranks;
            let items = points.iter().zip(0..).map(|((x, y, z), index)| IndexedPoint { at: [*x, *y, *z], index });
            let (mut left, mut right): (Vec<IndexedPoint>, Vec<IndexedPoint>) = items.partition(|item| item.at[0] < 512);
            for (x, items) in [(0, &mut left), (512, &mut right)] {
                let mut spare = items.clone();
                node_order::sort(NodeCube { origin: [x, 0, 0], side_bits: 9 }, items, &mut spare);
            }
            let items = [left.as_slice(), &right].concat();
            let mut best: HashMap<[u32; 3], (u64, usize)> = HashMap::new();
            for (place, item) in items.iter().enumerate() {
                let own = (rank(item.at), place);
                let entry = best.entry(item.at.map(|c| c >> 3)).or_insert(own);
                *entry = own.min(*entry);
            }
            let mut taken = Vec::new();
            take_lowest(NodeCube { origin: [0; 3], side_bits: 10 }, &[&left, &right], &mut taken, rank);
            for (place, item) in items.iter().enumerate() {
                prop_assert_eq!(best[&item.at.map(|c| c >> 3)].1 == place, taken[place]);
            }
        }
    }
}
