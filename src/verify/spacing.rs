//! The rules of sampling, checked on one inner node at a time.
//!
//! Poisson-disk: no two points closer than the node's spacing. Points are
//! sorted by cells of that size, so that only neighbouring cells are compared;
//! the cells of five rows (the rest is their mirror image) are found by cursors
//! that only move forward. In-grid: at most one point in each cell of the node's
//! 128³ grid.

/// Cells of a node's grid on an axis, as an exponent.
const GRID: i32 = 7;

/// More points than this cannot keep the spacing of side / 128: the densest
/// packing has √2 points in a cube of the spacing, and balls around the points
/// fit into 129³ such cubes.
pub const MOST_POINTS: u32 = 3_050_000;

/// Comparisons a point, on average, after which pairs are no longer counted.
const MOST_NEIGHBORS: u64 = 200;

/// When two points are too close.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limit {
    /// Squared distance in units, equal on all axes, below this: exact.
    Units(u128),
    /// Squared distance in world units below this.
    World { scale: [f64; 3], squared: f64 },
}

impl Limit {
    /// The limit of a node whose spacing is 2^`exponent` units. Below one unit
    /// only points at the same place are too close.
    pub fn of_exponent(exponent: i32) -> Limit {
        Limit::Units(1u128 << (2 * exponent.clamp(0, 40)))
    }

    pub fn of_world(scale: [f64; 3], spacing: f64) -> Limit {
        // Room for the rounding of floats, not more.
        Limit::World { scale, squared: spacing * spacing * (1.0 - 1e-9) }
    }

    /// The side of a cell in units of an axis: no smaller than the spacing.
    fn cell(self, axis: usize) -> i64 {
        match self {
            Limit::Units(squared) => squared.isqrt().max(1) as i64,
            Limit::World { scale, squared } => {
                ((squared.sqrt() / scale[axis]).ceil() as i64).saturating_add(1).max(1)
            }
        }
    }

    /// The distance in units (in world units where the axes differ), where it is
    /// too small.
    fn violation(self, a: [i32; 3], b: [i32; 3]) -> Option<f64> {
        let difference: [i64; 3] = std::array::from_fn(|i| i64::from(a[i]) - i64::from(b[i]));
        match self {
            Limit::Units(limit) => {
                let squared: u128 = difference.iter().map(|&d| u128::from(d.unsigned_abs()).pow(2)).sum();
                (squared < limit).then(|| (squared as f64).sqrt())
            }
            Limit::World { scale, squared: limit } => {
                let squared: f64 = (0..3).map(|i| (difference[i] as f64 * scale[i]).powi(2)).sum();
                (squared < limit).then(|| squared.sqrt())
            }
        }
    }
}

/// Pairs of points that are too close, and the closest of them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TooClose {
    pub pairs: u64,
    /// Whether there may be more of them: in a crowd not all are counted.
    pub more: bool,
    /// As [`Limit`] measures it.
    pub closest: f64,
    pub example: [[i32; 3]; 2],
}

/// The offsets of the rows to look through: (dy, dz) forward of a cell's own.
const ROWS: [(i64, i64); 4] = [(1, 0), (-1, 1), (0, 1), (1, 1)];

/// Finds all pairs closer than the limit. `corner` is not above any position.
pub fn too_close(positions: &[[i32; 3]], corner: [i64; 3], limit: Limit) -> TooClose {
    let cells: [i64; 3] = std::array::from_fn(|axis| limit.cell(axis));
    let key = |p: &[i32; 3]| {
        // One cell of margin keeps the neighbours' keys from running over into
        // another row.
        let c: [u128; 3] = std::array::from_fn(|i| ((i64::from(p[i]) - corner[i]) / cells[i] + 1) as u128);
        c[2] << 80 | c[1] << 40 | c[0]
    };
    let mut sorted: Vec<(u128, [i32; 3])> = positions.iter().map(|p| (key(p), *p)).collect();
    sorted.sort_unstable();
    let mut found = TooClose { closest: f64::INFINITY, ..TooClose::default() };
    let mut cursors = [0usize; ROWS.len()];
    // Points that keep the spacing have few neighbors; to count all pairs of a crowd
    // takes the square of its size.
    let mut left = (sorted.len() as u64).saturating_mul(MOST_NEIGHBORS).saturating_add(1_000_000);
    for (index, &(key, position)) in sorted.iter().enumerate() {
        let mut compare = |others: &[(u128, [i32; 3])], last: u128| {
            for (_, other) in others.iter().take_while(|(key, _)| *key <= last) {
                if left == 0 {
                    found.more = true;
                    return;
                }
                left -= 1;
                let Some(distance) = limit.violation(position, *other) else { continue };
                found.pairs += 1;
                if distance < found.closest {
                    (found.closest, found.example) = (distance, [position, *other]);
                }
            }
        };
        compare(&sorted[index + 1..], key + 1);
        for ((dy, dz), cursor) in ROWS.iter().zip(&mut cursors) {
            let middle = (key as i128 + (i128::from(*dz) << 80) + (i128::from(*dy) << 40)) as u128;
            while *cursor < sorted.len() && sorted[*cursor].0 < middle - 1 {
                *cursor += 1;
            }
            compare(&sorted[*cursor..], middle + 1);
        }
    }
    found
}

/// How many points share a cell of the node's 128³ grid with another that came
/// before. `exponent` is that of the node's side in units; a cell is never
/// smaller than a unit.
pub fn crowded_cells(positions: &[[i32; 3]], corner: [i64; 3], exponent: i32) -> u64 {
    let shift = (exponent - GRID).max(0) as u32;
    let cell = |p: &[i32; 3]| -> [i64; 3] { std::array::from_fn(|i| (i64::from(p[i]) - corner[i]) >> shift) };
    let mut cells: Vec<[i64; 3]> = positions.iter().map(cell).collect();
    cells.sort_unstable();
    let before = cells.len();
    cells.dedup();
    (before - cells.len()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all_pairs(positions: &[[i32; 3]], limit: Limit) -> u64 {
        let pairs = (0..positions.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        pairs.filter(|&(i, j)| limit.violation(positions[i], positions[j]).is_some()).count() as u64
    }

    proptest! {
        /// Cells and cursors find what comparing all with all finds.
        #[test]
        fn finds_every_pair(
            positions in proptest::collection::vec([-40i32..40, -40..40, -40..40], 0..120),
            exponent in -2i32..5,
            spacing in 0.3f64..30.0,
        ) {
            let corner = [-40; 3];
            let exact = Limit::of_exponent(exponent);
            prop_assert_eq!(too_close(&positions, corner, exact).pairs, all_pairs(&positions, exact));
            let loose = Limit::of_world([1.0, 0.5, 2.0], spacing);
            prop_assert_eq!(too_close(&positions, corner, loose).pairs, all_pairs(&positions, loose));
        }
    }

    #[test]
    fn at_the_spacing_is_not_too_close() {
        let limit = Limit::of_exponent(3);
        assert_eq!(too_close(&[[0, 0, 0], [8, 0, 0], [0, 8, 8]], [0; 3], limit).pairs, 0);
        let found = too_close(&[[0, 0, 0], [7, 0, 0], [0, 5, 5]], [0; 3], limit);
        assert_eq!((found.pairs, found.closest), (2, 7.0));
    }

    #[test]
    fn duplicates_are_too_close_at_any_spacing() {
        assert_eq!(too_close(&[[3, 3, 3], [3, 3, 3]], [0; 3], Limit::of_exponent(-4)).pairs, 1);
        assert_eq!(too_close(&[[3, 3, 3], [3, 3, 4]], [0; 3], Limit::of_exponent(-4)).pairs, 0);
    }

    #[test]
    fn crowds_are_counted_once_a_point() {
        // A node of 1024 units: cells of 8.
        let positions = [[0, 0, 0], [7, 7, 7], [8, 0, 0], [1, 1, 1]];
        assert_eq!(crowded_cells(&positions, [0; 3], 10), 2);
    }
}
