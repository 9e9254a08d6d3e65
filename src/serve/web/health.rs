//! `/healthz`, `/readyz` and `/metrics`: for machines that watch the daemon.
//!
//! Liveness says whether a restart would help; readiness says whether the work
//! can go on. A full disk is no reason for a restart.

use std::os::unix::fs::MetadataExt;
use std::path::Path;

use axum::extract::State as Extract;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::shared::{AppState, Health};
use crate::platform::clock::Millis;

/// A wheel that has not turned for so long hangs, in milliseconds. The engine
/// turns every second at least.
const STUCK: Millis = 60_000;

/// A scan that has not got on for so many seconds hangs: no file that is looked at
/// takes that long, but a file system that does not answer does.
const WATCHER_STUCK: u64 = 120;

/// Which of the daemon's loops hangs, if one does.
fn stuck(health: &Health, now: Millis) -> Option<String> {
    let idle = now - health.last_tick;
    if !health.started || health.stopping {
        None
    } else if idle > STUCK {
        Some(format!("the engine has not turned for {} s", idle / 1000))
    } else if health.watcher_stands > WATCHER_STUCK {
        let seconds = health.watcher_stands;
        Some(format!("the watcher has stood still for {seconds} s, perhaps at a disk that does not answer"))
    } else {
        None
    }
}

/// Alive: the engine's wheel turns, and the watcher gets on.
pub(super) async fn healthz(Extract(shared): Extract<AppState>) -> Response {
    if let Some(why) = stuck(&shared.health(), shared.clock.now()) {
        return (StatusCode::SERVICE_UNAVAILABLE, format!("stuck: {why}\n")).into_response();
    }
    (StatusCode::OK, "ok\n").into_response()
}

/// Ready: started, not stopping, the queue answers, our own folders can be written to,
/// every watched folder is there.
pub(super) async fn readyz(Extract(shared): Extract<AppState>) -> Response {
    let health = shared.health();
    let mut reasons = Vec::new();
    if !health.started {
        reasons.push("starting".to_string());
    }
    if health.stopping {
        reasons.push("stopping".to_string());
    }
    reasons.extend(stuck(&health, shared.clock.now()));
    reasons.extend(health.queue_error);
    for folder in [shared.config.scratch(), shared.config.octrees()] {
        if let Err(errno) = rustix::fs::access(&folder, rustix::fs::Access::WRITE_OK) {
            let error = std::io::Error::from(errno);
            reasons.push(format!("{} cannot be written to: {error}", folder.display()));
        }
    }
    reasons.extend(health.missing.iter().map(|path| format!("{} is not there", path.display())));
    if reasons.is_empty() {
        return (StatusCode::OK, "ready\n").into_response();
    }
    (StatusCode::SERVICE_UNAVAILABLE, format!("not ready: {}\n", reasons.join("; "))).into_response()
}

pub(super) async fn metrics(Extract(shared): Extract<AppState>) -> Response {
    if let Err(error) = refresh(&shared).await {
        // The gauges of the queue keep their last values; the rest is true.
        tracing::error!(%error, "the queue's figures could not be read");
        shared.metrics.queue_errors.inc();
    }
    match shared.metrics.render() {
        Ok((kind, text)) => ([(header::CONTENT_TYPE, kind)], text).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

/// Gauges that are cheaper to read now and then than to keep.
async fn refresh(shared: &AppState) -> crate::serve::queue::Result<()> {
    let (metrics, now) = (&shared.metrics, shared.clock.now());
    let health = shared.health();
    progress(shared, now);
    metrics.watch_waiting.set(health.waiting.iter().filter(|w| w.kind.is_awaited()).count() as i64);
    for (folder, path) in [("scratch", shared.config.scratch()), ("octrees", shared.config.octrees())] {
        if let Ok(free) = shared.disk.free_space(&path) {
            metrics.free_bytes.with_label_values(&[folder]).set(i64::try_from(free).unwrap_or(i64::MAX));
        }
    }
    let scratch = shared.config.scratch();
    let scratch = tokio::task::spawn_blocking(move || bytes_below(&scratch, 3)).await.unwrap_or_default();
    metrics.scratch_bytes.set(i64::try_from(scratch).unwrap_or(i64::MAX));
    metrics.event_streams.set(shared.streams.count() as i64);
    metrics.runtime_tasks.set(tokio::runtime::Handle::current().metrics().num_alive_tasks() as i64);
    let counts = shared.store.counts().await?;
    for (state, jobs) in &counts.by_state {
        metrics.jobs.with_label_values(&[state.name()]).set(*jobs);
    }
    metrics.jobs_held.set(counts.held);
    if shared.config.preview {
        metrics.previews_waiting.set(shared.store.previews_waiting().await?);
    }
    let age = counts.oldest_queued.map_or(0, |oldest| (now - oldest).max(0));
    metrics.oldest_queued_seconds.set(age as f64 / 1000.0);
    Ok(())
}

/// How far the running conversions are, by stage.
fn progress(shared: &AppState, now: Millis) {
    let metrics = &shared.metrics;
    let readings = shared.board.readings(now);
    for stage in crate::serve::metrics::STAGES {
        let here =
            || readings.iter().filter(|(_, reading)| reading.stage == stage).map(|(_, reading)| reading);
        let labels = [stage];
        metrics.running_jobs.with_label_values(&labels).set(here().count() as i64);
        metrics
            .running_points
            .with_label_values(&labels)
            .set(sum(here().map(|reading| reading.points_total)));
        metrics
            .running_points_done
            .with_label_values(&labels)
            .set(sum(here().map(|reading| reading.points_done)));
    }
}

fn sum(points: impl Iterator<Item = u64>) -> i64 {
    i64::try_from(points.fold(0, u64::saturating_add)).unwrap_or(i64::MAX)
}

/// What files take of the disk. They come and go while we look; what is gone
/// takes nothing.
fn bytes_below(folder: &Path, depth: u32) -> u64 {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let bytes = entries.flatten().map(|entry| match entry.metadata() {
        Ok(meta) if meta.is_dir() && depth > 0 => bytes_below(&entry.path(), depth - 1),
        Ok(meta) if meta.is_file() => meta.blocks().saturating_mul(512),
        _ => 0,
    });
    bytes.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loop_that_hangs_is_named() {
        let well = Health { started: true, last_tick: 1_000_000, ..Health::default() };
        let now = well.last_tick + STUCK;
        assert_eq!(stuck(&well, now), None);
        assert!(stuck(&well, now + 1).is_some_and(|why| why.contains("engine")));
        let hangs = Health { scanning: true, watcher_stands: WATCHER_STUCK + 1, ..well };
        assert!(stuck(&hangs, now).is_some_and(|why| why.contains("watcher")));
        for calm in [Health { stopping: true, ..hangs.clone() }, Health { started: false, ..hangs.clone() }] {
            assert_eq!(stuck(&calm, now), None);
        }
    }
}
