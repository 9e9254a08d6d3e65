//! How a conversion went.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::context::Stage;
use super::copc::CopcOutput;
use super::options::LodColor;
use super::values::record_range::SetAsideReason;

/// How a conversion went.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ConversionOutcome {
    pub files: u64,
    pub points_in: u64,
    pub points_out: u64,
    pub points_set_aside: u64,
    /// Those of them that are in no file, as was asked for.
    pub points_dropped: u64,
    /// Points that the inputs promise and that are not in them, where what can be
    /// read of damaged files was asked for.
    pub points_missing: u64,
    /// By reason; what was dropped on request too.
    pub set_aside: BTreeMap<SetAsideReason, u64>,
    /// Files in the octree's folder that hold them.
    pub files_aside: Vec<String>,
    pub nodes: u64,
    /// Level of the deepest node. Of nodes and levels, the octree's, or where there is
    /// none, those of the COPC file.
    pub depth: u32,
    pub chunks: u64,
    /// Bytes of the files that were asked for: an octree's three, the COPC file.
    pub output_bytes: u64,
    /// The COPC file, where one was asked for.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub copc: Option<CopcOutput>,
    /// Bytes of intermediate files.
    pub scratch_bytes: u64,
    /// Whether every position is exactly where the input has it.
    pub exact: bool,
    /// Most that a position can have moved along an axis, in units of the finest
    /// input's scale there.
    pub max_error_units: f64,
    /// The same by axis, as a length in the cloud's own unit.
    pub max_error: [f64; 3],
    /// Units of work that an earlier run had done.
    pub units_resumed: u64,
    /// Wall time by stage, in seconds.
    pub seconds_by_stage: BTreeMap<Stage, f64>,
    /// Most memory that the process had had by the end of each stage since the
    /// conversion began, in bytes. The process's: conversions at the same time share
    /// it, and the latest to begin starts it anew for all.
    pub peak_bytes_by_stage: BTreeMap<Stage, u64>,
    /// What colours coarse levels have; their own where there are none to average.
    pub lod_color: LodColor,
    /// Attributes that were left out because they are zero in every point.
    pub unused_attributes: Vec<String>,
    /// What the inputs say that is not so, where the points decided instead.
    pub repairs: Vec<String>,
    /// What else was odd about the inputs, and what it came to.
    pub notes: Vec<String>,
}
