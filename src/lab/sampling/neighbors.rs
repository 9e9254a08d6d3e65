//! Who lies near whom: points sorted by cells, and a walk through the 27 cells
//! around each, by cursors that only move forward.

use rayon::prelude::*;

/// A point: the node that holds it, and where it lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    pub node: u64,
    pub at: [f64; 3],
}

/// Points in the order of their cells, z before y before x.
pub struct Cells {
    cells: Vec<[i64; 3]>,
    points: Vec<Placed>,
}

/// Points that one task looks around.
const TASK: usize = 1 << 14;

impl Cells {
    /// Cells so wide; what lies within that distance of a point lies in the 27
    /// cells around it.
    pub fn new(width: f64, points: &[Placed]) -> Cells {
        let cell = |at: [f64; 3]| [at[2], at[1], at[0]].map(|c| (c / width).floor() as i64);
        let mut sorted: Vec<([i64; 3], Placed)> = points.par_iter().map(|p| (cell(p.at), *p)).collect();
        // What is equal may stand in any order: only sums and extremes are taken.
        sorted.par_sort_unstable_by_key(|(cell, _)| *cell);
        let (cells, points) = sorted.into_iter().unzip();
        Cells { cells, points }
    }

    /// For each point of `others` (of the same cells) what `near` makes of the
    /// points around it, folded into one sum.
    pub fn around<S: Send>(
        &self,
        others: &Cells,
        start: impl Fn() -> S + Sync + Send,
        near: impl Fn(&mut S, &Placed, &mut dyn Iterator<Item = &Placed>) + Sync + Send,
        join: impl Fn(S, S) -> S + Sync + Send,
    ) -> S {
        (0..others.points.len().div_ceil(TASK))
            .into_par_iter()
            .map(|task| {
                let mut sum = start();
                let range = task * TASK..((task + 1) * TASK).min(others.points.len());
                let rows = |[z, y, x]: [i64; 3]| -> [[i64; 3]; 9] {
                    std::array::from_fn(|row| [z + row as i64 / 3 - 1, y + row as i64 % 3 - 1, x - 1])
                };
                let mut cursors = rows(others.cells[range.start])
                    .map(|first| self.cells.partition_point(|cell| *cell < first));
                for place in range {
                    let firsts = rows(others.cells[place]);
                    for (cursor, first) in cursors.iter_mut().zip(firsts) {
                        while self.cells.get(*cursor).is_some_and(|cell| *cell < first) {
                            *cursor += 1;
                        }
                    }
                    let row = |(cursor, [z, y, x]): (usize, [i64; 3])| {
                        let cells = self.cells[cursor..].iter().zip(&self.points[cursor..]);
                        cells.take_while(move |(cell, _)| **cell <= [z, y, x + 2]).map(|(_, point)| point)
                    };
                    let mut around = cursors.into_iter().zip(firsts).flat_map(row);
                    near(&mut sum, &others.points[place], &mut around);
                }
                sum
            })
            .reduce(&start, join)
    }
}

/// Squared distance.
pub fn squared(a: &Placed, b: &Placed) -> f64 {
    (0..3).map(|axis| (a.at[axis] - b.at[axis]).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every pair nearer than a cell is found, once from each side.
        #[test]
        fn all_that_is_near_is_found(
            points in proptest::collection::vec((0u8..40, 0u8..40, 0u8..6), 1..300),
            others in proptest::collection::vec((0u8..40, 0u8..40, 0u8..6), 1..300),
            width in 1u8..9,
        ) {
            let placed = |points: &[(u8, u8, u8)]| -> Vec<Placed> {
                let at = |&(x, y, z): &(u8, u8, u8)| [x, y, z].map(|c| f64::from(c) - 20.0);
                points.iter().zip(0..).map(|(point, node)| Placed { node, at: at(point) }).collect()
            };
            let (points, others, width) = (placed(&points), placed(&others), f64::from(width));
            let near = |a: &Placed, b: &Placed| squared(a, b) < width * width;
            let count = Cells::new(width, &points).around(
                &Cells::new(width, &others),
                || 0,
                |count, other, around| *count += around.filter(|point| near(point, other)).count(),
                |a, b| a + b,
            );
            let expected: usize =
                others.iter().map(|other| points.iter().filter(|point| near(point, other)).count()).sum();
            prop_assert_eq!(count, expected);
        }
    }
}
