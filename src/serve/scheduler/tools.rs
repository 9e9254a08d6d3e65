//! What the scheduler works with.

use std::sync::Arc;

use tokio::sync::Notify;

use super::converter::Converter;
use crate::platform::clock::Clock;
use crate::platform::disk::Disk;
use crate::serve::config::Config;
use crate::serve::metrics::Metrics;
use crate::serve::queue::Store;
use crate::serve::queue::progress::ProgressRegistry;

/// What the engine works with.
#[derive(Clone)]
pub struct EngineContext {
    pub config: Arc<Config>,
    pub store: Store,
    pub board: ProgressRegistry,
    pub metrics: Metrics,
    pub clock: Clock,
    pub disk: Disk,
    pub converter: Arc<dyn Converter>,
    /// Rung when there may be something to do.
    pub bell: Arc<Notify>,
}
