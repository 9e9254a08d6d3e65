//! What can go wrong with a LAS or LAZ file, told so that its owner can act.

use std::io;
use std::path::{Path, PathBuf};

use crate::platform::disk::DiskError;

/// Every way in which reading or writing a LAS or LAZ file fails.
#[derive(Debug, thiserror::Error)]
pub enum LasError {
    #[error("could not {action} {}: {source}", path.display())]
    Io {
        action: &'static str,
        path: PathBuf,
        #[source]
        source: io::Error,
    },
    #[error("{} is not a LAS or LAZ file: {reason}", path.display())]
    NotLas { path: PathBuf, reason: String },
    #[error("the header of {} cannot be right: {reason}; repair the file or export it again", path.display())]
    Header { path: PathBuf, reason: String },
    #[error("{} cannot be read: {reason}", path.display())]
    Unsupported { path: PathBuf, reason: String },
    #[error("{} is cut or incomplete: {readable} of its {points} points could be read ({reason}); copy it again from where it came", path.display())]
    Cut { path: PathBuf, readable: u64, points: u64, reason: String },
    #[error("the header of {} says {said} points, but {there} whole records are there ({reason}); nobody can say which is right: repair the header or export the file again", path.display())]
    Contradiction { path: PathBuf, said: u64, there: u64, reason: String },
    #[error("{} is damaged: {place} cannot be decoded ({reason}); copy it again from where it came", path.display())]
    Damaged { path: PathBuf, place: String, reason: String },
    #[error("{} changed while it was being read: {reason}; start again once nobody writes to it", path.display())]
    Changed { path: PathBuf, reason: String },
    #[error("points {first} to {last} are not a slice of {}; ask for what `slices` returned", path.display())]
    NotASlice { path: PathBuf, first: u64, last: u64 },
    #[error("could not write {}: {reason}", path.display())]
    Write { path: PathBuf, reason: String },
    #[error(transparent)]
    Disk(#[from] DiskError),
}

impl LasError {
    pub(super) fn io(action: &'static str, path: &Path, source: io::Error) -> LasError {
        LasError::Io { action, path: path.to_path_buf(), source }
    }

    pub(super) fn header(path: &Path, reason: impl Into<String>) -> LasError {
        LasError::Header { path: path.to_path_buf(), reason: reason.into() }
    }

    pub(super) fn not_las(path: &Path, reason: impl Into<String>) -> LasError {
        LasError::NotLas { path: path.to_path_buf(), reason: reason.into() }
    }

    pub(super) fn unsupported(path: &Path, reason: impl Into<String>) -> LasError {
        LasError::Unsupported { path: path.to_path_buf(), reason: reason.into() }
    }

    pub(super) fn write(path: &Path, reason: impl Into<String>) -> LasError {
        LasError::Write { path: path.to_path_buf(), reason: reason.into() }
    }

    /// Whether trying again later, with the file as it is, can help.
    pub fn may_pass(&self) -> bool {
        match self {
            LasError::Io { source, .. } => {
                !matches!(source.kind(), io::ErrorKind::NotFound | io::ErrorKind::PermissionDenied)
            }
            LasError::Changed { .. } => true,
            LasError::Disk(error) => error.may_pass(),
            LasError::NotLas { .. }
            | LasError::Header { .. }
            | LasError::Unsupported { .. }
            | LasError::Cut { .. }
            | LasError::Contradiction { .. }
            | LasError::Damaged { .. }
            | LasError::NotASlice { .. }
            | LasError::Write { .. } => false,
        }
    }
}
