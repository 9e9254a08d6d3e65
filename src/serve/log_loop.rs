//! Keeps the log's lines about jobs with them, once a second.

use std::time::Duration;

use tokio_util::sync::CancellationToken;

use crate::serve::log::take_lines;
use crate::serve::queue::Store;

const PAUSE: Duration = Duration::from_secs(1);

/// Runs until the daemon stops.
pub(super) async fn run(store: Store, stop: CancellationToken) {
    while !stop.is_cancelled() {
        tokio::select! {
            () = tokio::time::sleep(PAUSE) => {}
            () = stop.cancelled() => {}
        }
        keep(&store).await;
    }
}

/// Keeps what has been written so far.
pub(super) async fn keep(store: &Store) {
    let lines = take_lines();
    // About no job on purpose: this must not make more of what it failed to keep.
    if !lines.is_empty()
        && let Err(error) = store.keep_lines(&lines).await
    {
        tracing::debug!(%error, lines = lines.len(), "lines of the log were not kept with their jobs");
    }
}
