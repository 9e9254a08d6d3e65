//! COPC 1.0: one LAZ 1.4 file that is also an octree, each node a chunk (copc.io).
//!
//! All but `reader` and `source` is pure: from values to bytes and back. `layout` says
//! where each attribute of an octree's record lies in a LAS record and moves records both
//! ways, `chunk` packs the records of a node, `hierarchy` knows the pages, `file` all that
//! stands around the chunks. `docs/copc.md` has the mapping of fields as a table.

mod chunk;
mod descriptor;
pub mod file;
pub mod hierarchy;
mod layout;
mod moves;
mod reader;
pub mod source;
mod statistics;

/// How the name of a COPC file ends.
pub const ENDING: &str = ".copc.laz";

pub use chunk::{ChunkEncoder, NodeDecoder};
pub use descriptor::Described;
pub use file::{CopcCube, FileTotals, Head, Places, Record, Tail, tail};
pub use hierarchy::CopcEntry;
pub use layout::RecordLayout;
pub use reader::{CopcFile, NodeReader};
pub use source::is_copc;

/// Why something cannot be written as COPC, or cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum CopcError {
    /// What the format has no place for; known before any point is read.
    #[error("COPC cannot hold this: {0}")]
    Unholdable(String),
    /// Records that are not of their layout.
    #[error("{0}")]
    Records(String),
    #[error("a chunk of {points} points cannot be decoded: {reason}")]
    Chunk { points: u64, reason: String },
    /// A file that is no COPC, or is damaged.
    #[error("{}: not readable as COPC: {reason}", path.display())]
    Damaged { path: std::path::PathBuf, reason: String },
    #[error("cannot read {}: {source}", path.display())]
    Read { path: std::path::PathBuf, source: std::io::Error },
    #[error(transparent)]
    Las(#[from] crate::format::las::LasError),
}

#[cfg(test)]
mod tests;
