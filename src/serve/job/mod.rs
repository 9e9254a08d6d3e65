//! A job: one data set at one content, on its way to one octree.
//!
//! Pure values and decisions: what a job is, which changes of state are legal
//! ([`machine`]), and what follows from the way an attempt ended ([`verdict`]).
//! Nothing here knows SQLite, files, threads or the time of day.

pub mod facts;
pub mod retry_policy;
pub mod state_machine;
pub mod time;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

pub use state_machine::{Event, State};

/// A job's number in the queue.
pub type JobId = i64;

/// One input file as it was when it was taken into the queue.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct QueuedFile {
    pub path: PathBuf,
    /// Bytes.
    pub size: u64,
    /// Nanoseconds since 1970, as the file system tells them.
    pub mtime_ns: i64,
    /// BLAKE3 of the content, in hex; empty where it could not be read.
    pub hash: String,
    /// The file's number on its file system; zero where it is not known.
    #[serde(default)]
    pub inode: u64,
    /// When anything of it changed last, in nanoseconds since 1970; zero where it
    /// is not known.
    #[serde(default)]
    pub ctime_ns: i64,
}

impl QueuedFile {
    /// Whether a file of this size, with these times and this number, is the one
    /// that was taken in, as far as can be told without reading it.
    pub fn is(&self, size: u64, mtime_ns: i64, inode: u64, ctime_ns: i64) -> bool {
        self.size == size
            && self.mtime_ns == mtime_ns
            && (self.inode == 0 || self.inode == inode)
            && (self.ctime_ns == 0 || self.ctime_ns == ctime_ns)
    }
}

/// What an operator wants of a running job; the engine's next tick reads it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ControlRequest {
    Cancel,
    Pause,
}

impl ControlRequest {
    pub fn name(self) -> &'static str {
        match self {
            ControlRequest::Cancel => "cancel",
            ControlRequest::Pause => "pause",
        }
    }

    pub fn parse(name: &str) -> Option<ControlRequest> {
        [ControlRequest::Cancel, ControlRequest::Pause].into_iter().find(|wish| wish.name() == name)
    }

    /// The event that fulfils it.
    pub fn event(self) -> Event {
        match self {
            ControlRequest::Cancel => Event::Cancel,
            ControlRequest::Pause => Event::Pause,
        }
    }
}

/// A job as the queue knows it. Times are milliseconds since 1970.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Job {
    pub id: JobId,
    /// The octree's folder under `octrees/`.
    pub name: String,
    /// The file or folder that was dropped.
    pub source: PathBuf,
    /// Counts the contents that have been seen under this source, from 1.
    pub revision: i64,
    pub state: State,
    /// Why a queued job does not start yet, where something holds it.
    pub hold: Option<String>,
    /// Why the last attempt did not succeed.
    pub error: Option<String>,
    /// What was asked of the job while it runs.
    pub wish: Option<ControlRequest>,
    /// Higher goes first.
    pub priority: i64,
    /// Attempts that were begun; counted before the work starts.
    pub attempts: u32,
    /// Crashes and failures that trying again cannot help.
    pub strikes: u32,
    /// Failures that may pass, since the last success or order to retry.
    pub postponements: u32,
    /// Not to be started before this time.
    pub not_before: i64,
    /// Points that were read, once the job is done; before that, what the headers
    /// claim, and zero where no header could be read.
    pub points: u64,
    /// Bytes of all input files.
    pub bytes: u64,
    pub created_at: i64,
    pub started_at: Option<i64>,
    pub updated_at: i64,
    pub finished_at: Option<i64>,
    /// The inode of its converted octree, while that waits to be published.
    #[serde(skip)]
    pub staged: Option<u64>,
    /// What tells its octree from anything else under its name.
    #[serde(skip)]
    pub octree: Option<String>,
    /// Why its sources are never put away, where there is doubt about them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub doubt: Option<String>,
    /// Why it cannot be converted as it was meant to be.
    #[serde(skip)]
    pub refusal: Option<String>,
    /// The job of newer content of the same source: it called this one off, or its
    /// octree took the place of this one's.
    pub superseded_by: Option<JobId>,
    /// What the last conversion that came to an octree reported, as the converter wrote
    /// it; none while the job runs.
    pub result: Option<serde_json::Value>,
    /// Names the content, the options and the format: equal keys, equal octrees.
    pub content_key: String,
    /// Conversion options, as they were given; null in lists, which would otherwise
    /// carry whatever somebody wrote into a marker.
    #[serde(skip_serializing_if = "serde_json::Value::is_null")]
    pub options: serde_json::Value,
}
