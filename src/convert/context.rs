//! What every stage is handed: disk, scratch, threads, memory, a way to stop it
//! and a way to watch it.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};

use serde::{Deserialize, Serialize};

use crate::platform::disk::Disk;

/// Set once to stop the work; polled a block.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    pub fn cancel(&self) {
        self.0.store(true, Ordering::SeqCst);
    }
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// The steps of a conversion, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum Stage {
    Queued = 0,
    Survey = 1,
    Distribute = 2,
    Index = 3,
    Merge = 4,
    Publish = 5,
    Done = 6,
}

impl Stage {
    pub const ALL: [Stage; 7] = [
        Stage::Queued,
        Stage::Survey,
        Stage::Distribute,
        Stage::Index,
        Stage::Merge,
        Stage::Publish,
        Stage::Done,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Stage::Queued => "queued",
            Stage::Survey => "survey",
            Stage::Distribute => "distribute",
            Stage::Index => "index",
            Stage::Merge => "merge",
            Stage::Publish => "publish",
            Stage::Done => "done",
        }
    }
}

/// How far a job is. Written by the stages, read by progress bars, the API and
/// the metrics; every figure only grows within a stage.
#[derive(Debug, Default)]
pub struct Progress {
    stage: AtomicU8,
    done: AtomicU64,
    total: AtomicU64,
}

/// One look at a [`Progress`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Snapshot {
    pub stage: Stage,
    /// Points of this stage that are done, and how many there are in all.
    pub done: u64,
    pub total: u64,
}

impl Progress {
    /// Starts a stage that handles `total` points.
    pub fn begin(&self, stage: Stage, total: u64) {
        self.done.store(0, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
        self.stage.store(stage as u8, Ordering::Release);
    }

    pub fn advance(&self, points: u64) {
        self.done.fetch_add(points, Ordering::Relaxed);
    }

    pub fn snapshot(&self) -> Snapshot {
        let stage = Stage::ALL[self.stage.load(Ordering::Acquire) as usize % Stage::ALL.len()];
        let total = self.total.load(Ordering::Relaxed);
        Snapshot { stage, done: self.done.load(Ordering::Relaxed).min(total), total }
    }
}

/// What a conversion may use. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Context {
    pub disk: Disk,
    /// A folder of this job's own for intermediate files. It is made when
    /// something is first written to it; a small cloud never does.
    pub scratch: PathBuf,
    pub threads: usize,
    /// Bytes of memory the conversion may hold.
    pub memory_limit: u64,
    pub cancel: Cancel,
    pub progress: Arc<Progress>,
}
