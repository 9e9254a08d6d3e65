//! The files of points when all points are in them.

use std::sync::Arc;

use super::block::{Each, NodeEntry};
use super::counted_inputs::Survey;
use crate::octree::moments::Moments;
use crate::octree::statistics::Statistics;
use crate::platform::disk::DiskFile;

/// What a file came to.
#[derive(Debug)]
pub struct FinishedFile {
    pub file: Arc<DiskFile>,
    pub nodes: Vec<NodeEntry>,
    /// Where its points end.
    pub end: u64,
}

/// What the files consist of.
pub struct OctreeContents<'a> {
    pub survey: &'a Survey,
    /// The files with their points.
    pub files: &'a Each<Option<FinishedFile>>,
    pub statistics: &'a Statistics,
    /// Of the points in the COPC file.
    pub moments: &'a Moments,
    /// Points that were kept out of it.
    pub aside: u64,
}
