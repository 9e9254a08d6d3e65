//! What the handlers work with, and what the daemon knows of itself.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;
use tokio::sync::{Notify, Semaphore};
use tokio_util::sync::CancellationToken;

use super::pages::figures::Figures;
use super::pages::subscribers::Live;
use super::streams::Streams;
use crate::platform::clock::{Clock, Millis};
use crate::platform::disk::Disk;
use crate::serve::config::Config;
use crate::serve::metrics::Metrics;
use crate::serve::queue::Store;
use crate::serve::queue::progress::ProgressRegistry;
use crate::serve::viewer::Viewer;
use crate::serve::watch::events::NotifyMode;
use crate::serve::watch::waiting::Waiting;

/// What the daemon knows of itself besides the queue; written by its loops.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Health {
    /// The start is over: recovery done, the folders scanned once.
    pub started: bool,
    pub stopping: bool,
    /// When the engine last turned.
    pub last_tick: Millis,
    /// Why the queue did not answer, where it does not.
    pub queue_error: Option<String>,
    pub last_scan: Millis,
    /// Whether a scan is under way.
    pub scanning: bool,
    /// For how many seconds it has not got on.
    pub watcher_stands: u64,
    pub watched: Vec<(PathBuf, NotifyMode)>,
    pub missing: Vec<PathBuf>,
    pub waiting: Vec<Waiting>,
}

/// What the handlers work with. Cheap to clone.
#[derive(Clone)]
pub struct AppState {
    pub config: Arc<Config>,
    pub store: Store,
    pub board: ProgressRegistry,
    pub metrics: Metrics,
    pub clock: Clock,
    pub disk: Disk,
    pub health: Arc<Mutex<Health>>,
    /// Wakes the engine after an order.
    pub bell: Arc<Notify>,
    /// Ends the event streams.
    pub stop: CancellationToken,
    /// Places for event streams.
    pub streams: Streams,
    /// Tells open pages what is new.
    pub live: Live,
    /// Places for uploads.
    pub uploads: Arc<Semaphore>,
    /// Of all jobs, for pages.
    pub figures: Figures,
    /// Octrees that are looked at.
    pub viewer: Viewer,
}

impl AppState {
    pub fn health(&self) -> Health {
        self.health.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn update_health(&self, change: impl FnOnce(&mut Health)) {
        change(&mut self.health.lock().unwrap_or_else(PoisonError::into_inner));
    }
}
