//! Coarse to fine inside a node: any prefix of a node's points is an even
//! subsample of it (the memory-optimised sequential point tree, living inside a
//! node; DESIGN.md, decision 7).
//!
//! The points are put into Morton order and then taken in the order of their
//! bit-reversed rank. The first m = 2^j points are then one from each of m
//! equal runs of the Morton curve, so for every octree cell inside the node, the
//! prefix holds the cell's share of m to within two points (and within
//! 2 + log2 m for any m).

use super::sampler::Item;
use crate::cloud::cube::Frame;

/// Bits an axis that decide the Morton order: 128 cells, the node's spacing.
const BITS: u32 = 7;
const DIGIT: u32 = 11;
const BUCKETS: usize = 1 << DIGIT;

/// Reusable memory for ordering nodes.
#[derive(Default)]
pub struct Orderer {
    keys: Vec<(u32, u32)>,
    other: Vec<(u32, u32)>,
}

/// Spreads seven bits to every third.
fn spread(v: u32) -> u32 {
    let v = (v | v << 8) & 0x0300_F00F;
    let v = (v | v << 4) & 0x030C_30C3;
    (v | v << 2) & 0x0924_9249
}

/// Morton code of coordinates within a node, at the node's spacing.
pub fn morton(frame: Frame, at: [u32; 3]) -> u32 {
    let down = frame.side_bits.saturating_sub(BITS);
    let [x, y, z] = frame.local(at).map(|c| c >> down);
    spread(x) << 2 | spread(y) << 1 | spread(z)
}

impl Orderer {
    /// The indices of a node's items in the order in which they are stored.
    pub fn coarse_to_fine<'a>(
        &'a mut self,
        frame: Frame,
        items: &'a [Item],
    ) -> impl Iterator<Item = u32> + 'a {
        self.sort(frame, items);
        let sorted = &self.keys;
        reversed_ranks(sorted.len()).map(move |rank| sorted[rank].1)
    }

    /// Sorts by Morton code, stable, in two counting passes of eleven bits.
    fn sort(&mut self, frame: Frame, items: &[Item]) {
        self.keys.clear();
        self.keys.extend(items.iter().map(|i| (morton(frame, i.at), i.index)));
        self.other.resize(self.keys.len(), (0, 0));
        for pass in 0..2 {
            let mut starts = [0u32; BUCKETS + 1];
            let digit = |key: u32| (key >> (pass * DIGIT)) as usize & (BUCKETS - 1);
            for (key, _) in &self.keys {
                starts[digit(*key) + 1] += 1;
            }
            for bucket in 0..BUCKETS {
                starts[bucket + 1] += starts[bucket];
            }
            for entry in &self.keys {
                let slot = &mut starts[digit(entry.0)];
                self.other[*slot as usize] = *entry;
                *slot += 1;
            }
            std::mem::swap(&mut self.keys, &mut self.other);
        }
    }
}

/// 0..n in bit-reversed order.
fn reversed_ranks(n: usize) -> impl Iterator<Item = usize> {
    let bits = n.next_power_of_two().trailing_zeros();
    (0..1usize << bits)
        .map(move |i| if bits == 0 { 0 } else { i.reverse_bits() >> (usize::BITS - bits) })
        .filter(move |rank| *rank < n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ranks_are_a_permutation() {
        for n in [0, 1, 2, 3, 7, 8, 9, 1000] {
            let mut ranks: Vec<usize> = reversed_ranks(n).collect();
            ranks.sort_unstable();
            assert!(ranks.into_iter().eq(0..n), "{n}");
        }
        assert!(reversed_ranks(8).eq([0, 4, 2, 6, 1, 5, 3, 7]));
    }

    proptest! {
        /// Every prefix of m points holds, of every octree cell inside the
        /// node, the cell's share of m to within 2 + log2 m points.
        #[test]
        fn prefixes_are_even(
            points in proptest::collection::vec((0u32..256, 0u32..256, 0u32..256), 1..500),
            levels in 1u32..4,
        ) {
            let frame = Frame { origin: [0; 3], side_bits: 8 };
            let items: Vec<Item> = points.iter().enumerate()
                .map(|(i, (x, y, z))| Item { at: [*x, *y, *z], index: i as u32 }).collect();
            let mut orderer = Orderer::default();
            let order: Vec<u32> = orderer.coarse_to_fine(frame, &items).collect();
            let mut all = order.clone();
            all.sort_unstable();
            prop_assert!(all.into_iter().eq(0..items.len() as u32));

            let cell = |i: u32| morton(frame, items[i as usize].at) >> (3 * (BITS - levels));
            let mut total = std::collections::HashMap::new();
            items.iter().for_each(|i| *total.entry(cell(i.index)).or_insert(0.0) += 1.0);
            let mut seen = std::collections::HashMap::new();
            let n = items.len() as f64;
            // Ranks live in the next power of two: so does a prefix's share.
            let padded = items.len().next_power_of_two();
            for (rank, i) in order.iter().enumerate() {
                *seen.entry(cell(*i)).or_insert(0.0) += 1.0;
                let m = (rank + 1) as f64;
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
