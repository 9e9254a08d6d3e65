//! Coarse to fine inside a node: any prefix of a node's points is an even
//! subsample of it (the memory-optimised sequential point tree, living inside a
//! node; DESIGN.md, decision 7).
//!
//! The points are put into Morton order and then taken in the order of their
//! bit-reversed rank. The first m = 2^j points are then one from each of m
//! equal runs of the Morton curve, so for every octree cell inside the node, the
//! prefix holds the cell's share of m to within two points (and within
//! 2 + log2 m for any m).

use super::sampling::sampler::IndexedPoint;
use crate::octree::cube::{NodeCube, SPACING_BITS};

/// Bits an axis that decide the Morton order of a leaf: 64 cells, the spacing of
/// its parent. Two digits of nine bits, each few enough buckets for the core's
/// own cache.
const BITS: u32 = SPACING_BITS - 1;
const DIGIT: u32 = 9;
const BUCKETS: usize = 1 << DIGIT;
/// Items for which going through all buckets would be the dearest part.
const FEW: usize = 128;

/// Numbers of six bits with their bits spread to every third.
const SPREAD: [u32; 1 << BITS] = {
    let mut table = [0; 1 << BITS];
    let mut v = 0;
    while v < table.len() {
        let mut bit = 0;
        while bit < BITS {
            table[v] |= (v as u32 >> bit & 1) << (3 * bit);
            bit += 1;
        }
        v += 1;
    }
    table
};

/// Morton code of coordinates within a node.
#[inline]
pub fn morton(frame: NodeCube, at: [u32; 3]) -> u32 {
    let down = frame.side_bits.saturating_sub(BITS);
    let [x, y, z] = frame.local(at).map(|c| SPREAD[(c >> down) as usize & (SPREAD.len() - 1)]);
    x << 2 | y << 1 | z
}

/// Sorts a node's items by Morton code, stable, in two counting passes; `spare` is room for as many.
///
/// Only leaves are sorted: a sample taken in order from sorted children is in
/// order itself.
pub fn sort(frame: NodeCube, items: &mut [IndexedPoint], spare: &mut [IndexedPoint]) {
    if items.len() < FEW {
        return items.sort_by_key(|item| morton(frame, item.at));
    }
    let mut starts = [[0u32; BUCKETS]; 2];
    for item in &*items {
        let key = morton(frame, item.at) as usize;
        starts[0][key & (BUCKETS - 1)] += 1;
        starts[1][key >> DIGIT] += 1;
    }
    for starts in &mut starts {
        let mut before = 0;
        for start in starts {
            before += std::mem::replace(start, before);
        }
    }
    let [low, high] = &mut starts;
    for item in &*items {
        let slot = &mut low[morton(frame, item.at) as usize & (BUCKETS - 1)];
        spare[*slot as usize] = *item;
        *slot += 1;
    }
    for item in &*spare {
        let slot = &mut high[morton(frame, item.at) as usize >> DIGIT];
        items[*slot as usize] = *item;
        *slot += 1;
    }
}

/// 0..n in bit-reversed order: the order in which sorted items are stored.
pub fn coarse_to_fine(n: usize) -> impl Iterator<Item = usize> {
    let all = n.next_power_of_two();
    let mut rank = 0;
    (0..all)
        .map(move |i| {
            let now = rank;
            // Counting up by one flips the trailing ones and the zero before
            // them; reversed, these are the leading ones. Behind the last
            // number nothing is asked for.
            let flipped = i.trailing_ones() + 1;
            rank ^= all - (all >> flipped);
            now
        })
        .filter(move |rank| *rank < n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ranks_are_a_permutation() {
        for n in [0, 1, 2, 3, 7, 8, 9, 1000] {
            let mut ranks: Vec<usize> = coarse_to_fine(n).collect();
            ranks.sort_unstable();
            assert!(ranks.into_iter().eq(0..n), "{n}");
        }
        assert!(coarse_to_fine(8).eq([0, 4, 2, 6, 1, 5, 3, 7]));
    }

    proptest! {
        /// Every prefix of m points holds, of every octree cell inside the
        /// node, the cell's share of m to within 2 + log2 m points.
        #[test]
        fn prefixes_are_even(
            points in proptest::collection::vec((0u32..256, 0u32..256, 0u32..256), 1..2 * FEW),
            levels in 1u32..4,
        ) {
            let frame = NodeCube { origin: [0; 3], side_bits: 8 };
            let mut items: Vec<IndexedPoint> = points.iter().enumerate()
                .map(|(i, (x, y, z))| IndexedPoint { at: [*x, *y, *z], index: i as u32 }).collect();
            let mut plainly = items.clone();
            plainly.sort_by_key(|i| morton(frame, i.at));
            let mut spare = items.clone();
            sort(frame, &mut items, &mut spare);
            prop_assert_eq!(&items, &plainly, "sorted and stable");

            let cell = |i: usize| morton(frame, items[i].at) >> (3 * (BITS - levels));
            let mut total = std::collections::HashMap::new();
            (0..items.len()).for_each(|i| *total.entry(cell(i)).or_insert(0.0) += 1.0);
            let mut seen = std::collections::HashMap::new();
            let n = items.len() as f64;
            // Ranks live in the next power of two: so does a prefix's share.
            let padded = items.len().next_power_of_two();
            for (before, i) in coarse_to_fine(items.len()).enumerate() {
                *seen.entry(cell(i)).or_insert(0.0) += 1.0;
                let m = (before + 1) as f64;
                let slack = 2.0 + m.log2() + (padded as f64 / n - 1.0);
                for (c, t) in &total {
                    let expected = t * m / n;
                    let got: f64 = seen.get(c).copied().unwrap_or(0.0);
                    prop_assert!((got - expected).abs() <= slack, "{got} of {expected} after {m}");
                }
            }
        }
    }
}
