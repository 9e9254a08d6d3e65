//! What lies in a watched folder and is not taken, or not yet: in words for
//! people, by a kind for programs.

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

use crate::platform::clock::Millis;
use crate::serve::config::size::Size;
use crate::serve::job::JobId;

/// Why something is not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WaitingKind {
    /// It changed a moment ago.
    Settling,
    /// By its own headers there is more to come.
    Incomplete,
    /// A file beside it has the name of one that is still being written.
    Partial,
    /// A part of it is a hole or nothing but zeros, as of a copy that goes on.
    Zeros,
    /// A program holds it open for writing.
    Writing,
    /// We may not read it.
    Unreadable,
    /// Its `lodestone.json` is wrong.
    Marker,
    /// A link, or a name that cannot be handled.
    Refused,
    /// No LAS or LAZ file; nothing will be done with it.
    NotTaken,
    /// Its content is known, and a job stands for it.
    Copy,
}

impl WaitingKind {
    /// Whether somebody expects an octree of it that is not there yet.
    pub fn is_awaited(self) -> bool {
        !matches!(self, WaitingKind::NotTaken | WaitingKind::Copy)
    }

    /// Whether time alone may bring it into the queue; what else is listed stays
    /// as it is until somebody does something about it.
    pub fn may_pass(self) -> bool {
        matches!(
            self,
            WaitingKind::Settling
                | WaitingKind::Incomplete
                | WaitingKind::Partial
                | WaitingKind::Zeros
                | WaitingKind::Writing
        )
    }
}

/// Something in a watched folder that is not taken, and why.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Waiting {
    #[serde(serialize_with = "lossy")]
    pub path: PathBuf,
    pub kind: WaitingKind,
    pub why: String,
    /// Bytes that are there, of all its files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Bytes that it is to have, where its headers tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_bytes: Option<u64>,
    /// Since when it is as it is, in milliseconds since 1970.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub since: Option<Millis>,
    /// The job that stands for its content.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub job: Option<JobId>,
}

impl Waiting {
    pub fn new(path: &Path, kind: WaitingKind, why: impl Into<String>) -> Waiting {
        let (path, why) = (path.to_path_buf(), why.into());
        Waiting { path, kind, why, bytes: None, expected_bytes: None, since: None, job: None }
    }

    pub fn since(self, since: Millis) -> Waiting {
        Waiting { since: Some(since), ..self }
    }
}

/// Names come from others, and need not be UTF-8.
fn lossy<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&path.to_string_lossy())
}

/// "41.0 MB of 120 MB have arrived".
pub(super) fn arrived(bytes: u64, expected: u64) -> String {
    format!("{} of {} have arrived", Size(bytes), Size(expected))
}
