//! The octree's lattice and cube, with the way there from each input.

use serde::{Deserialize, Serialize};

use crate::format::potree;
use crate::octree::cube::Cube;
use crate::octree::lattice::{self, Lattice, Requantise, SourceGrid};

/// What points are counted on.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CoordinateFrame {
    pub lattice: Lattice,
    /// For every input.
    pub requantise: Vec<Requantise>,
    pub cube: Cube,
}

impl CoordinateFrame {
    /// The frame of inputs with these grids.
    pub fn new(grids: &[SourceGrid]) -> CoordinateFrame {
        let (lattice, requantise) = lattice::choose(grids, potree::morton::viewer_may_misread);
        let cube = Cube::around(&lattice);
        CoordinateFrame { lattice, requantise, cube }
    }
}
