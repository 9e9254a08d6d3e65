//! The COPC file of a conversion: planned once the inputs are surveyed, filled with a
//! chunk for each node as the octree is built, and completed before it is published.

mod plan;
mod writer;

use serde::{Deserialize, Serialize};

pub use plan::{complete, file_name};
pub use writer::CopcWriter;

use super::options::{GuardMode, Options};
use crate::octree::collapse;
use crate::octree::node_limit::NODE_LIMIT;

/// What there is to say of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CopcOutput {
    /// Its name in the folder of the octree.
    pub file: String,
    pub bytes: u64,
    /// Whether no octree was made beside it.
    pub alone: bool,
    pub nodes: u64,
    /// Level of the deepest node.
    pub depth: u32,
    /// LAS point format, 6 to 8.
    pub point_format: u8,
    /// Bytes of a record before it is compressed.
    pub record_length: u64,
}

/// Memory beyond an octree's that a chunk of so many points takes, in bytes, for records
/// of `record` bytes.
pub fn memory(points: u64, record: u64, options: &Options) -> u64 {
    // Two copies of a node while it is put in order and encoded, and what sorts it.
    let most = match options.duplicates {
        GuardMode::Keep => points,
        GuardMode::SetAside | GuardMode::Drop => points.min((NODE_LIMIT + collapse::MAX_POINTS) as u64),
    };
    // Indices of subtrees that wait for their parents, and the chunk's compressed points.
    points * (4 + record / 2) + most * (2 * record + 64) + ENCODER
}

/// Bytes of an encoder's models.
const ENCODER: u64 = 8 << 20;
