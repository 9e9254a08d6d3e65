//! Octrees and COPC files back to LAS or LAZ: all attributes of all points, node by node,
//! in a bounded amount of memory. `vpc` lists COPC files as one virtual point cloud,
//! `overview` makes what is shown of them from afar.

mod cloud;
pub mod overview;
mod pick;
mod points;
pub mod vpc;

use std::path::PathBuf;

use crate::format::copc::CopcError;
use crate::format::las::LasError;
use crate::format::potree::PotreeError;
use crate::platform::disk::DiskError;

pub use points::export;

/// What is to be exported.
#[derive(Debug, Clone)]
pub struct ExportRequest {
    /// An octree's folder, or a COPC file.
    pub source: PathBuf,
    /// A LAS or LAZ file, by its ending.
    pub output: PathBuf,
    /// World coordinates, the smallest and the largest corner; the faces belong to it.
    pub bounds: Option<([f64; 3], [f64; 3])>,
    /// The finest level that is wanted; the root's is 0.
    pub level: Option<u8>,
    /// 0 to 10; the one that the points had, or one that holds them, if not given.
    pub point_format: Option<u8>,
    /// Bytes of memory to work with.
    pub memory_limit: u64,
}

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exported {
    pub points: u64,
    pub point_format: u8,
}

/// Why nothing was exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error("{}: {source}", path.display())]
    Octree { path: PathBuf, source: PotreeError },
    #[error(transparent)]
    Copc(#[from] CopcError),
    #[error(transparent)]
    Las(#[from] LasError),
    #[error(transparent)]
    Disk(#[from] DiskError),
    #[error("{} is neither an octree's folder nor a COPC file; name one that `lodestone convert` wrote, or any *.copc.laz", .0.display())]
    NoCloud(PathBuf),
    #[error("the output {} must end in .las or .laz", .0.display())]
    Ending(PathBuf),
    #[error("the output {} is the source itself; name another file", .0.display())]
    Itself(PathBuf),
    #[error("{what}; ask for --point-format {instead}")]
    Misfit { what: String, instead: u8 },
    #[error("{0}")]
    Option(String),
    #[error("the overview {} could not be made: {source}", path.display())]
    Overview { path: PathBuf, source: Box<crate::convert::run::ConductError> },
    #[error("it was told to stop")]
    Cancelled,
}
