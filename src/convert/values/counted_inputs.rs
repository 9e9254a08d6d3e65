//! What the survey hands to all later steps.

use super::copc_plan::CopcPlan;
use super::inlier_region::Region;
use super::input_slice::{Input, InputSlice};
use crate::format::las::GpsTime;
use crate::octree::chunk_plan::Plan;
use crate::octree::cube::Cube;
use crate::octree::lattice::Lattice;
use crate::octree::record::Unified;

/// What the later stages go by.
pub struct Survey {
    pub inputs: Vec<Input>,
    pub units: Vec<InputSlice>,
    /// All of the inputs' points.
    pub points: u64,
    /// Points that the inputs promise beyond those.
    pub missing: u64,
    /// Which of them go into the octree, but for crowds.
    pub region: Region,
    pub lattice: Lattice,
    pub cube: Cube,
    pub unified: Unified,
    pub plan: Plan,
    /// For viewers: a proj4 string, or empty.
    pub projection: String,
    /// The coordinate reference system in words, or empty.
    pub crs: String,
    /// What the octree's GPS times count from, where the inputs say so.
    pub gps_time: Option<GpsTime>,
    /// How the COPC file is made, where one is asked for.
    pub copc: Option<CopcPlan>,
    /// Whether all records are in memory.
    pub in_core: bool,
    /// What the files were found to say that is not so; the points decided.
    pub repairs: Vec<String>,
    /// What else is odd about them.
    pub notes: Vec<String>,
}
