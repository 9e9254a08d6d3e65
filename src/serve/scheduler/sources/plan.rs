//! What is to be done with which sources, and what became of it.

use std::path::{Path, PathBuf};

use crate::serve::config::Config;
use crate::serve::config::sources::OnDone;
use crate::serve::job::{Job, QueuedFile};

/// What is to be done with which sources.
#[derive(Debug, Clone)]
pub struct SourceActionPlan {
    pub source: PathBuf,
    /// The octree's name.
    pub name: String,
    pub revision: i64,
    pub inputs: Vec<QueuedFile>,
    pub what: OnDone,
    /// The watched folders, and where sources are moved to.
    pub roots: Vec<PathBuf>,
    pub done: PathBuf,
    /// Bytes that stay free on the disk that they are copied to.
    pub reserve: u64,
    /// Where the octree is to be, and what tells it from others.
    pub octree: PathBuf,
    pub seal: Option<String>,
}

/// What was done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SourceActionOutcome {
    Moved(PathBuf),
    Removed,
    /// There is nothing any more: done before a crash, or by somebody else.
    Gone,
}

/// Why nothing was done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NotMoved {
    /// It stays for good.
    ForGood(String),
    /// It is worth another try.
    ForNow(String),
}

impl SourceActionPlan {
    pub fn new(config: &Config, job: &Job, what: OnDone, inputs: Vec<QueuedFile>) -> SourceActionPlan {
        let roots = std::iter::once(config.inbox()).chain(config.watch.iter().cloned());
        SourceActionPlan {
            source: job.source.clone(),
            name: job.name.clone(),
            revision: job.revision,
            inputs,
            what,
            roots: roots.collect(),
            done: config.done(),
            reserve: config.disk_reserve,
            octree: config.octrees().join(&job.name),
            seal: job.octree.clone(),
        }
    }
}

/// A path within a folder; joining an empty one would add a slash.
pub(super) fn full(folder: &Path, within: &Path) -> PathBuf {
    if within.as_os_str().is_empty() { folder.to_path_buf() } else { folder.join(within) }
}
