//! All of a COPC file that is known before its points are.

use crate::format::copc::{Head, RecordLayout};

/// How the file is made.
pub struct CopcPlan {
    pub layout: RecordLayout,
    /// Where a record of the octree has its GPS time.
    pub time_at: Option<usize>,
    /// Where the points begin in the file, in bytes.
    pub points_start: u64,
    /// What stands before the points.
    pub head: Head,
}
