//! What the counting passes find.

use serde::{Deserialize, Serialize};

use super::inlier_region::InlierRegion;
use crate::octree::counting_grid::CountingGrid;
use crate::octree::lattice::SourceGrid;

/// What the passes over the points find: enough to go on without them.
#[derive(Debug, Serialize, Deserialize)]
pub struct CountingResult {
    /// For every input.
    pub found: Vec<FileStatistics>,
    pub census: CountingGrid,
    /// The part of the cloud that goes into the octree.
    pub region: InlierRegion,
    /// Where headers were not believed.
    pub repairs: Vec<String>,
    pub notes: Vec<String>,
}

/// What the first pass finds in one file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FileStatistics {
    pub grid: SourceGrid,
    /// All records ORed: which bytes are ever used.
    pub ored: Vec<u8>,
    /// All of its points, outliers too, by return.
    pub returns: [u64; 16],
    /// Of those, points with a coordinate at a limit of 32-bit integers.
    pub saturated: u64,
}
