//! The order of a node's points in which they compress best: by the time at which
//! they were measured, along the flight line. Where times are equal, or there are
//! none, by their place in Morton order; then in the order of the input.

/// A point to be put in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    time: u64,
    index: u32,
}

/// A number that orders as IEEE 754's total order does: every bit pattern has its
/// place, also those of no number and of both zeros.
pub fn total_order(time: f64) -> u64 {
    let bits = time.to_bits();
    bits ^ ((bits as i64 >> 63) as u64 >> 1 | 1 << 63)
}

/// Morton code of tree coordinates, of all their bits; x comes first in each triple.
pub fn morton(at: [u32; 3]) -> u128 {
    let spread = |c: u32| {
        let mut v = u128::from(c);
        for (shift, mask) in SPREAD {
            v = (v | v << shift) & mask;
        }
        v
    };
    spread(at[0]) << 2 | spread(at[1]) << 1 | spread(at[2])
}

/// How far to move the halves of ever smaller groups of bits, and where they then
/// stand.
const SPREAD: [(u32, u128); 5] = {
    let mut steps = [(0, 0); 5];
    let mut step = 0;
    while step < 5 {
        let group = 16 >> step;
        let (mut mask, mut bit) = (0u128, 0);
        while bit < 32 {
            // A bit moves by two places for each one below it, by whole groups.
            mask |= 1 << (bit + 2 * (bit / group * group));
            bit += 1;
        }
        steps[step as usize] = (2 * group, mask);
        step += 1;
    }
    steps
};

/// Puts points in order.
#[derive(Debug, Default)]
pub struct Sorter {
    keys: Vec<Key>,
    ties: Vec<(u128, u32)>,
}

impl Sorter {
    /// Sorts points, given as numbers that rise in the order of the input.
    pub fn sort(&mut self, indices: &mut [u32], time: impl Fn(u32) -> f64, at: impl Fn(u32) -> [u32; 3]) {
        self.keys.clear();
        self.keys.extend(indices.iter().map(|index| Key { time: total_order(time(*index)), index: *index }));
        self.keys.sort_unstable();
        for (index, key) in indices.iter_mut().zip(&self.keys) {
            *index = key.index;
        }
        let mut rest = indices;
        for ties in self.keys.chunk_by(|a, b| a.time == b.time) {
            let (here, behind) = rest.split_at_mut(ties.len());
            rest = behind;
            if ties.len() > 1 {
                self.ties.clear();
                self.ties.extend(here.iter().map(|index| (morton(at(*index)), *index)));
                self.ties.sort_unstable();
                here.iter_mut().zip(&self.ties).for_each(|(index, tie)| *index = tie.1);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn slow_morton(at: [u32; 3]) -> u128 {
        (0..32).fold(0, |code, bit| {
            let [x, y, z] = at.map(|c| u128::from(c >> bit & 1));
            code | (x << 2 | y << 1 | z) << (3 * bit)
        })
    }

    #[test]
    fn each_bit_pattern_of_a_time_has_its_place() {
        let times = [f64::NEG_INFINITY, -2.0, -0.0, 0.0, 1.0, f64::INFINITY, f64::NAN];
        let keys = times.map(total_order);
        assert!(keys.is_sorted_by(|a, b| a < b), "{keys:?}");
    }

    proptest! {
        #[test]
        fn morton_codes_interleave_all_bits(at in any::<[u32; 3]>()) {
            prop_assert_eq!(morton(at), slow_morton(at));
        }

        /// By time, then place, then input; whatever order they come in.
        #[test]
        fn points_are_sorted_by_time_then_place(
            points in proptest::collection::vec((0u8..5, any::<[u8; 3]>()), 0..200),
            reversed in any::<bool>(),
        ) {
            let time = |i: u32| f64::from(points[i as usize].0) - 2.0;
            let at = |i: u32| points[i as usize].1.map(u32::from);
            let mut sorted: Vec<u32> = (0..points.len() as u32).collect();
            let mut expected = sorted.clone();
            expected.sort_by(|a, b| time(*a).total_cmp(&time(*b)).then(slow_morton(at(*a)).cmp(&slow_morton(at(*b)))));
            if reversed { sorted.reverse(); }
            Sorter::default().sort(&mut sorted, time, at);
            prop_assert_eq!(sorted, expected);
        }
    }
}
