//! What can be wrong with an octree's files.

use std::path::PathBuf;

pub type Result<T> = std::result::Result<T, PotreeError>;

#[derive(Debug, thiserror::Error)]
pub enum PotreeError {
    #[error("could not read {}: {source} (is this the folder of a Potree 2.0 octree?)", path.display())]
    Read {
        path: PathBuf,
        #[source]
        source: std::io::Error,
    },
    #[error("{} is not the metadata of a Potree 2.0 octree: {source}", path.display())]
    Json {
        path: PathBuf,
        #[source]
        source: serde_json::Error,
    },
    #[error("metadata.json contradicts itself: {0} (the octree has to be made again)")]
    Metadata(String),
    #[error("hierarchy.bin is damaged: {0} (the octree has to be made again)")]
    Hierarchy(String),
    #[error("the nodes are no tree: {0}")]
    NotATree(String),
    #[error("the bytes of its points are damaged: {0} (the octree has to be made again)")]
    Points(String),
    #[error("could not compress a node: {0}")]
    Compress(std::io::Error),
}
