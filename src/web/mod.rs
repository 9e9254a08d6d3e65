//! The HTTP API: what the queue holds, how far the jobs are, whether the daemon
//! is well, and the octrees themselves for viewers.
//!
//! Nothing here works the queue: an order is written into it as a wish, which the
//! engine's next tick reads. Loopback by default; see [`crate::config`] for what
//! another address needs. Bodies, times and connections are bounded.

mod api;
mod guard;
mod listener;
mod octrees;
mod page;
mod previews;
mod probes;
mod stream;

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::http::StatusCode;
use axum::routing::{get, post};
use serde::Serialize;
use tokio::sync::{Notify, Semaphore};
use tokio_util::sync::CancellationToken;
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;

use crate::clock::{Clock, Millis};
use crate::config::Config;
use crate::disk::Disk;
use crate::metrics::Metrics;
use crate::store::Store;
use crate::store::board::Board;
use crate::watch::events::Mode;
use crate::watch::waiting::Waiting;

pub use listener::Bounded;

/// No request here needs a body of more than a few words.
const LONGEST_BODY: usize = 64 * 1024;
const LONGEST_REQUEST: Duration = Duration::from_secs(30);

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
    pub watched: Vec<(PathBuf, Mode)>,
    pub missing: Vec<PathBuf>,
    pub waiting: Vec<Waiting>,
}

/// What the handlers work with. Cheap to clone.
#[derive(Clone)]
pub struct Shared {
    pub config: Arc<Config>,
    pub store: Store,
    pub board: Board,
    pub metrics: Metrics,
    pub clock: Clock,
    pub disk: Disk,
    pub health: Arc<Mutex<Health>>,
    /// Wakes the engine after an order.
    pub bell: Arc<Notify>,
    /// Ends the event streams.
    pub stop: CancellationToken,
    /// Places for event streams.
    pub streams: Arc<Semaphore>,
}

impl Shared {
    pub fn streams() -> Arc<Semaphore> {
        Arc::new(Semaphore::new(stream::MOST))
    }

    pub fn health(&self) -> Health {
        self.health.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn update_health(&self, change: impl FnOnce(&mut Health)) {
        change(&mut self.health.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

/// All routes.
pub fn router(shared: Shared) -> Router {
    let jobs = Router::new()
        .route("/", get(page::page))
        .route("/page.js", get(page::script))
        .route("/metrics", get(probes::metrics))
        .route("/api/jobs", get(api::list))
        .route("/api/jobs/purge", post(api::purge))
        .route("/api/jobs/{id}", get(api::show))
        .route("/api/jobs/{id}/retry", post(api::retry))
        .route("/api/jobs/{id}/cancel", post(api::cancel))
        .route("/api/jobs/{id}/pause", post(api::pause))
        .route("/api/jobs/{id}/resume", post(api::resume))
        .route("/api/jobs/{id}/priority", post(api::priority))
        .route("/api/jobs/{id}/preview", post(api::preview))
        .route("/api/watch", get(api::watch))
        .layer(TimeoutLayer::with_status_code(StatusCode::REQUEST_TIMEOUT, LONGEST_REQUEST))
        // Streams last as long as they are listened to.
        .route("/api/events", get(stream::all))
        .route("/api/jobs/{id}/events", get(stream::one))
        .merge(octrees::router(&shared.config))
        .layer(axum::middleware::from_fn_with_state(shared.clone(), guard::guard));
    // Whoever asks whether the daemon lives need not know a secret.
    Router::new()
        .route("/healthz", get(probes::healthz))
        .route("/readyz", get(probes::readyz))
        .merge(jobs)
        .layer(RequestBodyLimitLayer::new(LONGEST_BODY))
        .with_state(shared)
}
