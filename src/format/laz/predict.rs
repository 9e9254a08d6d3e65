//! What a point is predicted by: contexts of its returns, and medians of differences.

/// The median of the last differences: five values in order, of which a new one pushes
/// out the greatest or the least.
#[derive(Debug, Clone, Copy, Default)]
pub struct Median {
    values: [i32; 5],
    /// Whether a new value pushes out the least.
    least_goes: bool,
}

impl Median {
    #[inline(always)]
    pub fn get(&self) -> i32 {
        self.values[2]
    }

    /// No turn by turn: a value on the far side of the median changes which end goes
    /// next. Written without branches, which would be mispredicted.
    #[inline(always)]
    pub fn add(&mut self, value: i32) {
        let from = usize::from(self.least_goes);
        let [p, q, r, s] = [0, 1, 2, 3].map(|place| self.values[from + place]);
        let median = self.values[2];
        self.least_goes = (value > median) | ((value == median) & !self.least_goes);
        self.values =
            [p.min(value), p.max(q.min(value)), q.max(r.min(value)), r.max(s.min(value)), s.max(value)];
    }
}

/// The context of a point of the formats 0 to 5 by number of returns and return.
pub const RETURNS_OF_3_BITS: [[u8; 8]; 8] = [
    [15, 14, 13, 12, 11, 10, 9, 8],
    [14, 0, 1, 3, 6, 10, 10, 9],
    [13, 1, 2, 4, 7, 11, 11, 10],
    [12, 3, 4, 5, 8, 12, 12, 11],
    [11, 6, 7, 8, 9, 13, 13, 12],
    [10, 10, 11, 12, 13, 14, 14, 13],
    [9, 10, 11, 12, 13, 14, 15, 14],
    [8, 9, 10, 11, 12, 13, 14, 15],
];

/// The same of the formats 6 to 10.
pub const RETURNS_OF_4_BITS: [[u8; 16]; 16] = [
    [0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5],
    [1, 0, 1, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3],
    [2, 1, 2, 4, 4, 4, 4, 4, 4, 4, 4, 3, 3, 3, 3, 3],
    [3, 3, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [3, 3, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5],
];

/// The context of y by the bits of the difference in x.
#[inline(always)]
pub fn y_context(single: bool, x_bits: usize) -> usize {
    usize::from(single) + (x_bits & !1).min(20)
}

/// The context of z by the bits of both.
#[inline(always)]
pub fn z_context(single: bool, x_bits: usize, y_bits: usize) -> usize {
    usize::from(single) + (((x_bits + y_bits) / 2) & !1).min(18)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Word for word as LASzip describes it.
    fn add(values: &mut Vec<i32>, greatest_goes: &mut bool, value: i32) {
        let median = values[2];
        if *greatest_goes {
            values.pop();
            *greatest_goes = value < median;
        } else {
            values.remove(0);
            *greatest_goes = value <= median;
        }
        let place = values.partition_point(|v| *v <= value);
        values.insert(place, value);
    }

    proptest! {
        #[test]
        fn the_median_is_that_of_laszip(added in prop::collection::vec(-5i32..6, 0..60)) {
            let (mut values, mut greatest_goes) = (vec![0; 5], true);
            let mut median = Median::default();
            for value in added {
                median.add(value);
                add(&mut values, &mut greatest_goes, value);
                prop_assert_eq!(&median.values[..], &values[..]);
                prop_assert_eq!(median.least_goes, !greatest_goes);
            }
        }
    }
}
