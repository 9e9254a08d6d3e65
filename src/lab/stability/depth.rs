//! How deep an octree a cloud asks for by itself.

use std::path::Path;

use crate::format::inputs;
use crate::format::las::LasFile;
use crate::lab::settings::Result;
use crate::octree::node::LEAF_LIMIT;

/// Levels that are looked at, bits an axis: a centimetre in ten kilometres has
/// thousands of cells.
const BITS: u32 = 32;

/// The level at which cells hold no more than a leaf's worth of different
/// positions, where the whole cloud without its outliers is the cell of level 0:
/// log2(extent / side of the leaves) of an octree that stores its points in
/// leaves and puts nothing above the cloud and nothing below a crowd.
///
/// Found from the input alone, without the octree. Outliers are known from the
/// scene: what lies farther from the middle point, axis by axis, than sixteen
/// times the distance within which nine of ten points lie.
pub fn asked(folder: &Path) -> Result<u32> {
    let mut points: Vec<[f64; 3]> = Vec::new();
    let mut records = Vec::new();
    for path in inputs::expand(&[folder.to_path_buf()])? {
        let file = LasFile::open(&path)?;
        let header = file.header();
        for slice in file.slices(1 << 20) {
            file.read(slice, &mut records)?;
            points.extend(records.chunks_exact(header.record_length).map(|record| {
                std::array::from_fn(|axis| {
                    let at = 4 * axis;
                    let bytes = [record[at], record[at + 1], record[at + 2], record[at + 3]];
                    f64::from(i32::from_le_bytes(bytes)) * header.scale[axis] + header.offset[axis]
                })
            }));
        }
    }
    Ok(level(&points))
}

fn level(points: &[[f64; 3]]) -> u32 {
    let Some((low, side)) = extent(points) else { return 0 };
    let cells = (1u64 << BITS) as f64;
    let mut codes: Vec<u128> = points
        .iter()
        .map(|point| std::array::from_fn(|axis| ((point[axis] - low[axis]) / side * cells).floor()))
        .filter(|at: &[f64; 3]| at.iter().all(|c| (0.0..cells).contains(c)))
        .map(|at| morton(at.map(|c| c as u64)))
        .collect();
    codes.sort_unstable();
    codes.dedup();
    // A run of LEAF_LIMIT + 1 codes must be parted: the levels on which it is not are
    // the bits that its first and last have in common.
    codes
        .windows(LEAF_LIMIT + 1)
        .map(|run| (run[0] ^ run[LEAF_LIMIT]).leading_zeros().saturating_sub(u128::BITS - 3 * BITS) / 3 + 1)
        .max()
        .unwrap_or(0)
}

/// Corner and side of the cube around all but the outliers.
fn extent(points: &[[f64; 3]]) -> Option<([f64; 3], f64)> {
    if points.is_empty() {
        return None;
    }
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let mut along: Vec<f64> = Vec::with_capacity(points.len());
    for axis in 0..3 {
        along.clear();
        along.extend(points.iter().map(|point| point[axis]));
        let middle = along.len() / 2;
        let (_, &mut centre, _) = along.select_nth_unstable_by(middle, f64::total_cmp);
        along.iter_mut().for_each(|c| *c = (*c - centre).abs());
        let most = along.len() * 9 / 10;
        let (_, &mut reach, _) = along.select_nth_unstable_by(most, f64::total_cmp);
        // Where nine of ten lie at one position the others are no outliers.
        let reach = if reach > 0.0 { 16.0 * reach } else { f64::INFINITY };
        for c in points.iter().map(|point| point[axis]).filter(|c| (c - centre).abs() <= reach) {
            low[axis] = low[axis].min(c);
            high[axis] = high[axis].max(c);
        }
    }
    let side = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    // A hair more, so that the greatest lies inside.
    (side > 0.0).then_some((low, side * (1.0 + 1e-9)))
}

fn morton(at: [u64; 3]) -> u128 {
    let spread = |c: u64| (0..BITS).fold(0, |code, bit| code | u128::from(c >> bit & 1) << (3 * bit));
    spread(at[0]) << 2 | spread(at[1]) << 1 | spread(at[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(side: u32) -> Vec<[f64; 3]> {
        (0..side * side).map(|i| [f64::from(i % side), f64::from(i / side), 0.5]).collect()
    }

    #[test]
    fn a_plane_is_quartered_level_by_level() {
        assert_eq!(level(&plane(100)), 0);
        assert_eq!(level(&plane(101)), 1);
        assert_eq!(level(&plane(200)), 1);
        assert_eq!(level(&plane(400)), 2);
    }

    #[test]
    fn neither_outliers_nor_crowds_ask_for_levels() {
        let mut points = plane(400);
        points.extend([[1e6, 0.0, 0.0], [0.0, -1e7, 5.0]]);
        points.extend(vec![[7.0, 7.0, 0.5]; 50_000]);
        assert_eq!(level(&points), 2);
        assert_eq!(level(&vec![[1.0; 3]; 50_000]), 0);
        assert_eq!(level(&[]), 0);
    }

    #[test]
    fn what_is_dense_in_one_place_asks_for_its_levels() {
        let mut points = plane(200);
        points.extend(plane(120).into_iter().map(|[x, y, z]| [50.0 + x / 600.0, 50.0 + y / 600.0, z]));
        // 14 400 points within a fifth of a unit, in a plane of 200.
        assert!((9..=11).contains(&level(&points)), "{}", level(&points));
    }
}
