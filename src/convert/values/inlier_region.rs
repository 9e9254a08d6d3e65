//! The region: which part of the cloud goes into the octree when its outliers do
//! not. A point is inside if it lies in the kept cells of every census on which
//! outliers were found; integers decide, and each census could reach all points
//! that it was asked about.

use serde::{Deserialize, Serialize};

use super::coordinate_frame::CoordinateFrame;
use crate::octree::record;

/// Everywhere, until it is restricted.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct InlierRegion {
    /// One for each scale on which outliers were found.
    pub(in crate::convert) restrictions: Vec<Restriction>,
    /// Points outside.
    pub outliers: u64,
    /// The longest sides of the box with and without them, as world lengths.
    pub(in crate::convert) sides: Option<(f64, f64)>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(in crate::convert) struct Restriction {
    pub(in crate::convert) base: CoordinateFrame,
    /// From tree coordinates to the cells of the bounds, inclusive.
    pub(in crate::convert) shift: u32,
    pub(in crate::convert) low: [u32; 3],
    pub(in crate::convert) high: [u32; 3],
}

impl Restriction {
    #[inline]
    fn holds(&self, input: usize, raw: [i32; 3]) -> bool {
        let tree = self.base.cube.tree(self.base.requantise[input].stored(raw));
        (0..3).all(|a| {
            let cell = tree[a] >> self.shift;
            self.low[a] <= cell && cell <= self.high[a]
        })
    }
}

impl InlierRegion {
    pub fn is_everywhere(&self) -> bool {
        self.restrictions.is_empty()
    }

    /// Whether a raw position of an input is inside.
    #[inline]
    pub fn holds(&self, input: usize, raw: [i32; 3]) -> bool {
        self.restrictions.iter().all(|restriction| restriction.holds(input, raw))
    }

    /// The records of a block that are inside; where some are not, the others are
    /// copied to `buffer`.
    pub fn of<'b>(&self, input: usize, block: &'b [u8], length: usize, buffer: &'b mut Vec<u8>) -> &'b [u8] {
        let inside = |r: &&[u8]| self.holds(input, record::raw_position(r));
        if self.is_everywhere() || block.chunks_exact(length).all(|r| inside(&r)) {
            return block;
        }
        buffer.clear();
        block.chunks_exact(length).filter(inside).for_each(|r| buffer.extend_from_slice(r));
        buffer
    }
}
