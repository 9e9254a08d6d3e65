//! Why there is no picture.

use std::path::PathBuf;

use crate::format::copc::CopcError;
use crate::format::potree::PotreeError;

pub type Result<T> = std::result::Result<T, RenderError>;

#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    #[error(transparent)]
    Copc(#[from] CopcError),
    #[error("{}: {source}", folder.display())]
    Octree {
        folder: PathBuf,
        #[source]
        source: PotreeError,
    },
    #[error("could not read {}: {source}", path.display())]
    Read {
        path: PathBuf,
        #[source]
        source: std::io::Error,
    },
    #[error("could not write {}: {source} (is there room, and may this user write there?)", path.display())]
    Write {
        path: PathBuf,
        #[source]
        source: std::io::Error,
    },
    #[error("there is nothing to show in {}: it holds no points", folder.display())]
    Nothing { folder: PathBuf },
    #[error("there is nothing to show in {}: none of the points looked at has a finite position", folder.display())]
    NotFinite { folder: PathBuf },
    #[error("no point of {} has '{attribute}', by which it was to be coloured; use --color auto", folder.display())]
    NoAttribute { folder: PathBuf, attribute: &'static str },
    #[error("could not encode {what}: {reason}")]
    Encode { what: &'static str, reason: String },
    #[error(
        "no picture by the GPU: {0} (use --renderer cpu, or auto, which takes the GPU only where it works)"
    )]
    Gpu(String),
    #[error("stopped on request")]
    Cancelled,
}
