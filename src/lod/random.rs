//! Random in grid, after Kang et al. ("Fast Out-of-Core Octree Generation",
//! section 5): one point a cell of a 128³ grid, "random" by a hash of its
//! position and level, so that the same cloud always gives the same octree.

use super::sampler::{Item, Sampler};
use crate::cloud::cube::{Frame, SPACING_BITS};
use crate::cloud::node::NodeKey;

const CELLS: usize = 1 << (3 * SPACING_BITS);

/// One slot a cell; only the slots that were used are cleared.
pub struct RandomInGrid {
    /// Per cell: ordinal + 1 of the best candidate so far, or 0.
    best: Vec<u32>,
    touched: Vec<u32>,
}

impl Default for RandomInGrid {
    fn default() -> RandomInGrid {
        RandomInGrid { best: vec![0; CELLS], touched: Vec::new() }
    }
}

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
        let shift = frame.spacing_shift();
        let mut starts = Vec::with_capacity(candidates.len());
        for set in candidates {
            starts.push(taken.len());
            for item in *set {
                let [x, y, z] = frame.local(item.at).map(|c| (c >> shift) as usize);
                let cell = (z << SPACING_BITS | y) << SPACING_BITS | x;
                let ordinal = taken.len();
                let slot = self.best[cell];
                if slot == 0 {
                    self.touched.push(cell as u32);
                    self.best[cell] = ordinal as u32 + 1;
                    taken.push(true);
                    continue;
                }
                let rival = find(candidates, &starts, slot as usize - 1);
                let wins = rank(item.at, node.level) < rank(rival.at, node.level);
                if wins {
                    taken[slot as usize - 1] = false;
                    self.best[cell] = ordinal as u32 + 1;
                }
                taken.push(wins);
            }
        }
        for cell in self.touched.drain(..) {
            self.best[cell as usize] = 0;
        }
    }
}

/// The candidate of an ordinal; there are at most eight sets.
fn find(candidates: &[&[Item]], starts: &[usize], ordinal: usize) -> Item {
    let set = starts.iter().rposition(|start| *start <= ordinal).unwrap_or(0);
    candidates[set][ordinal - starts[set]]
}
