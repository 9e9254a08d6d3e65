//! Random in grid, after Kang et al. ("Fast Out-of-Core Octree Generation",
//! section 5): one point a cell of a 128³ grid, "random" by a hash of its
//! position and level, so that the same cloud always gives the same octree.

use super::one_per_cell::take_lowest;
use super::sampler::{IndexedPoint, Sampler};
use crate::octree::cube::NodeCube;
use crate::octree::node::NodeKey;

#[derive(Default)]
pub struct RandomInGrid;

/// A well mixed number from a position; seeded by the level, because a hash
/// that is reused from level to level would prefer the same points again.
///
/// The axes are multiplied side by side and only then mixed: done one after the
/// other, each would wait for the one before.
fn rank([x, y, z]: [u32; 3], level: u8) -> u64 {
    let seed = u64::from(level).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let [x, y, z] = [x, y, z].map(|c| u64::from(c) + 1);
    let mixed = x.wrapping_mul(0xBF58_476D_1CE4_E5B9)
        ^ y.wrapping_mul(0x94D0_49BB_1331_11EB).rotate_left(21)
        ^ z.wrapping_mul(0xD6E8_FEB8_6659_FD93).rotate_left(42);
    let mixed = (mixed ^ seed ^ mixed >> 29).wrapping_mul(0xFF51_AFD7_ED55_8CCD);
    mixed ^ mixed >> 32
}

impl Sampler for RandomInGrid {
    fn sample(
        &mut self,
        node: NodeKey,
        frame: NodeCube,
        candidates: &[&[IndexedPoint]],
        taken: &mut Vec<bool>,
    ) {
        take_lowest(frame, candidates, taken, |at| rank(at, node.level));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_levels_prefer_other_points() {
        let points: Vec<IndexedPoint> =
            (0..64).map(|index| IndexedPoint { at: [index % 4, index / 4 % 4, index / 16], index }).collect();
        let chosen = |level| {
            let (mut taken, frame) = (Vec::new(), NodeCube { origin: [0; 3], side_bits: 9 });
            RandomInGrid.sample(NodeKey { level, at: [0; 3] }, frame, &[&points], &mut taken);
            assert_eq!(taken.iter().filter(|taken| **taken).count(), 1, "all are in one cell");
            taken.iter().position(|taken| *taken)
        };
        let of_levels: std::collections::HashSet<_> = (0..8).map(chosen).collect();
        assert!(of_levels.len() > 4, "{of_levels:?}");
    }
}
