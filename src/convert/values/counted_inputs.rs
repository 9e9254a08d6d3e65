//! What the survey hands to all later steps.

use super::copc_plan::CopcPlan;
use super::inlier_region::InlierRegion;
use super::input_slice::{ConversionInput, InputSlice};
use crate::format::las::GpsEpoch;
use crate::octree::chunk_plan::ChunkPlan;
use crate::octree::cube::Cube;
use crate::octree::lattice::Lattice;
use crate::octree::record::UnifiedSchema;

/// What the later stages go by.
pub struct Survey {
    pub inputs: Vec<ConversionInput>,
    pub units: Vec<InputSlice>,
    /// All of the inputs' points.
    pub points: u64,
    /// Points that the inputs promise beyond those.
    pub missing: u64,
    /// Which of them go into the octree, but for crowds.
    pub region: InlierRegion,
    pub lattice: Lattice,
    pub cube: Cube,
    pub unified: UnifiedSchema,
    pub plan: ChunkPlan,
    /// For viewers: a proj4 string, or empty.
    pub projection: String,
    /// The coordinate reference system in words, or empty.
    pub crs: String,
    /// What the octree's GPS times count from, where the inputs say so.
    pub gps_time: Option<GpsEpoch>,
    /// How the COPC file is made, where one is asked for.
    pub copc: Option<CopcPlan>,
    /// Whether all records are in memory.
    pub in_core: bool,
    /// What the files were found to say that is not so; the points decided.
    pub repairs: Vec<String>,
    /// What else is odd about them.
    pub notes: Vec<String>,
}
