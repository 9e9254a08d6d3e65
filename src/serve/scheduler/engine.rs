//! The engine: the runs that are at work, and what it knows of them.

use std::collections::{HashMap, HashSet, VecDeque};

use tokio::sync::mpsc;

use super::follow_ups::Aftermath;
use super::preflight::Lane;
use super::standstill::Pulse;
use super::stop::Stop;
use super::tools::Tools;
use super::worker::Finished;
use crate::convert::context::Cancel;
use crate::platform::clock::Millis;
use crate::serve::job::{Job, JobId};

/// A run that is at work.
pub(super) struct Running {
    pub(super) job: Job,
    pub(super) lane: Lane,
    pub(super) cancel: Cancel,
    pub(super) stop: Option<Stop>,
    pub(super) beat_at: Millis,
    pub(super) pulse: Pulse,
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
    pub(super) tools: Tools,
    /// Names this run of the daemon on its leases.
    pub(super) owner: String,
    pub(super) running: HashMap<JobId, Running>,
    pub(super) results: mpsc::UnboundedReceiver<Finished>,
    pub(super) sender: mpsc::UnboundedSender<Finished>,
    /// Ended runs that the queue could not record yet.
    pub(super) unrecorded: VecDeque<Finished>,
    /// Jobs whose run was given up, but whose thread has not ended.
    pub(super) abandoned: HashSet<JobId>,
    pub(super) aftermath: Aftermath,
    pub(super) swept_at: Millis,
    /// A suspect waits until all else has ended.
    pub(super) makes_room: bool,
    pub(super) stopping: bool,
}

impl Engine {
    /// An engine with no runs; `owner` names this run of the daemon on its leases.
    pub fn new(tools: Tools, owner: String) -> Engine {
        let (sender, results) = mpsc::unbounded_channel();
        Engine {
            tools,
            owner,
            running: HashMap::new(),
            results,
            sender,
            unrecorded: VecDeque::new(),
            abandoned: HashSet::new(),
            aftermath: Aftermath::default(),
            swept_at: 0,
            makes_room: false,
            stopping: false,
        }
    }
}
