//! What can go wrong in a stage, in words for the person who dropped the file.

use std::path::PathBuf;

use crate::format::copc::CopcError;
use crate::format::inputs::InputsError;
use crate::format::las::{LasError, LasFile};
use crate::platform::disk::DiskError;

#[derive(Debug, thiserror::Error)]
pub enum StageError {
    #[error(transparent)]
    Las(#[from] LasError),
    #[error("{error}; {}", how_to_allow(*.readable))]
    Damaged {
        error: LasError,
        /// Points that can be read and points that are promised, where the error
        /// does not say it.
        readable: Option<(u64, u64)>,
    },
    #[error(transparent)]
    Disk(#[from] DiskError),
    #[error(transparent)]
    Inputs(#[from] InputsError),
    #[error("no input was named; name LAS or LAZ files, or a folder that holds some")]
    NoInputs,
    #[error("{0} holds no points that could be read, so there is nothing to convert")]
    NoPoints(String),
    #[error("{} changed while it was read; let the copy finish and try again", .0.display())]
    InputChanged(PathBuf),
    #[error("{} exists already; choose another folder, or have it replaced by `--overwrite`", .0.display())]
    OutputExists(PathBuf),
    #[error(
        "no attribute is called {wanted:?}; the input has: {known}. Names are compared in any letter case"
    )]
    UnknownAttribute { wanted: String, known: String },
    #[error(
        "{} has {free} bytes free, but {needed} are needed; free some room or choose another folder",
        folder.display()
    )]
    NoRoom { folder: PathBuf, needed: u64, free: u64 },
    #[error(
        "a memory limit of {limit} bytes is too small for this cloud: one of its chunks alone needs {needed}; \
         allow more memory or fewer threads"
    )]
    MemoryTooSmall { limit: u64, needed: u64 },
    #[error(
        "another conversion is at work in {}; wait until it has ended, or choose another output", .0.display()
    )]
    Busy(PathBuf),
    #[error(
        "no threads could be started: {0}; there are too many processes or threads (`ulimit -u`, `TasksMax=` of \
         the unit, `pids.max` of the container)"
    )]
    NoThreads(String),
    #[error(
        "no COPC file can be made of it: {0}; as a Potree octree it can be converted (`--format potree`, \
         `format = \"potree\"` for the daemon)"
    )]
    Copc(#[from] CopcError),
    #[error("no COPC file can be made of it: {0}")]
    NotForCopc(String),
    #[error(
        "no COPC file can be made of it: {points} points come to lie in its node {node}, more than a chunk of \
         LAZ may hold; do not keep so many points at one position (`--duplicates set-aside`), or convert to a \
         Potree octree alone"
    )]
    CopcNode { node: String, points: u64 },
    #[error("the conversion was stopped on request")]
    Cancelled,
    #[error("a check before publishing failed: {0}. Nothing was published; this is a bug, please report it")]
    Inconsistent(String),
}

pub type Result<T> = std::result::Result<T, StageError>;

/// How a person allows what is refused by default.
fn how_to_allow(readable: Option<(u64, u64)>) -> String {
    let counts = readable.map(|(there, all)| format!("{there} of its {all} points can be read; "));
    let counts = counts.unwrap_or_default();
    format!("{counts}to convert what can be read, say `--damaged keep` (`damaged = \"keep\"` for the daemon)")
}

impl StageError {
    /// Points were not found where they had been: with what became of the file,
    /// where that can be seen.
    pub fn changed(las: &LasFile) -> StageError {
        match las.check_unchanged() {
            Err(error) => error.into(),
            Ok(()) => StageError::InputChanged(las.path().to_path_buf()),
        }
    }

    /// Whether the same job, tried again with nothing changed but time, can
    /// succeed. Every variant is named, so that a new one must decide.
    pub fn retry_can_help(&self) -> bool {
        match self {
            StageError::Disk(error) => error.may_pass(),
            StageError::InputChanged(_)
            | StageError::NoRoom { .. }
            | StageError::Busy(_)
            | StageError::NoThreads(_)
            | StageError::Cancelled => true,
            StageError::Las(error) | StageError::Damaged { error, .. } => error.may_pass(),
            StageError::Inputs(_)
            | StageError::NoInputs
            | StageError::NoPoints(_)
            | StageError::OutputExists(_)
            | StageError::UnknownAttribute { .. }
            | StageError::MemoryTooSmall { .. }
            | StageError::Copc(_)
            | StageError::NotForCopc(_)
            | StageError::CopcNode { .. }
            | StageError::Inconsistent(_) => false,
        }
    }
}
