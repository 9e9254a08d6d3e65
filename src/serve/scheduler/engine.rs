//! The engine: the runs that are at work, and what it knows of them.

use std::collections::{HashMap, HashSet, VecDeque};

use tokio::sync::mpsc;

use super::follow_ups::FollowUps;
use super::preflight::SizeClass;
use super::standstill::StallTimer;
use super::stop::StopReason;
use super::tools::EngineContext;
use super::worker::FinishedRun;
use crate::convert::context::Cancel;
use crate::platform::clock::Millis;
use crate::serve::job::{Job, JobId};

/// A run that is at work.
pub(super) struct RunningJob {
    pub(super) job: Job,
    pub(super) lane: SizeClass,
    pub(super) cancel: Cancel,
    pub(super) stop: Option<StopReason>,
    pub(super) beat_at: Millis,
    pub(super) pulse: StallTimer,
    /// It may have brought the daemon down: nothing else runs meanwhile.
    pub(super) alone: bool,
}

/// What a tick did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TickSummary {
    pub ended: usize,
    pub started: usize,
    pub held: usize,
    pub running: usize,
    /// When something is due at the latest, without any bell.
    pub due: Option<Millis>,
}

/// See the module [`super`].
pub struct Engine {
    pub(super) tools: EngineContext,
    /// Names this run of the daemon on its leases.
    pub(super) owner: String,
    pub(super) running: HashMap<JobId, RunningJob>,
    pub(super) results: mpsc::UnboundedReceiver<FinishedRun>,
    pub(super) sender: mpsc::UnboundedSender<FinishedRun>,
    /// Ended runs that the queue could not record yet.
    pub(super) unrecorded: VecDeque<FinishedRun>,
    /// Jobs whose run was given up, but whose thread has not ended.
    pub(super) abandoned: HashSet<JobId>,
    pub(super) aftermath: FollowUps,
    pub(super) swept_at: Millis,
    /// A suspect waits until all else has ended.
    pub(super) makes_room: bool,
    pub(super) stopping: bool,
}

impl Engine {
    /// An engine with no runs; `owner` names this run of the daemon on its leases.
    pub fn new(tools: EngineContext, owner: String) -> Engine {
        let (sender, results) = mpsc::unbounded_channel();
        Engine {
            tools,
            owner,
            running: HashMap::new(),
            results,
            sender,
            unrecorded: VecDeque::new(),
            abandoned: HashSet::new(),
            aftermath: FollowUps::default(),
            swept_at: 0,
            makes_room: false,
            stopping: false,
        }
    }
}
