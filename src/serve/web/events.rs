//! `/api/events`: what happens to the jobs, as it happens (server-sent events).
//! First the present state, then every change of a job (`event: job`, as the API
//! shows it) and how far the running ones are (`event: progress`), at most twice
//! a second. An `id` is the number of the latest line in the jobs' histories, so
//! whoever comes back with `Last-Event-ID` is told only what it missed.

use std::collections::HashMap;
use std::fmt::Write;
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::{Extension, Path, State as Extract};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use tokio::io::{AsyncWriteExt, DuplexStream};
use tokio_util::io::ReaderStream;

use super::api;
use super::refusal::ApiError;
use super::server::Peer;
use super::shared::AppState;
use super::streams::StreamPlace;
use crate::serve::job::{Job, JobId};
use crate::serve::queue::progress::ProgressReading;

const BEAT: Duration = Duration::from_millis(500);
/// Proxies cut connections that are silent for a minute, and only writing tells
/// that the other side is gone.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// A reader that takes nothing for so long has gone to sleep.
const SLOW: Duration = Duration::from_secs(20);
const BUFFER: usize = 64 * 1024;
/// Jobs told of at first.
const FIRST: i64 = 200;
/// And in one beat.
const AT_ONCE: i64 = 1000;

pub(super) async fn all(
    Extract(shared): Extract<AppState>,
    peer: Option<Extension<Peer>>,
    headers: HeaderMap,
) -> Response {
    open(shared, None, peer, &headers)
}

pub(super) async fn one(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
    peer: Option<Extension<Peer>>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    // One that is not there is said so at once.
    shared.store.job(id).await?;
    Ok(open(shared, Some(id), peer, &headers))
}

fn open(
    shared: AppState,
    only: Option<JobId>,
    peer: Option<Extension<Peer>>,
    headers: &HeaderMap,
) -> Response {
    let peer = peer.map(|Extension(Peer(address))| address);
    let Some(place) = shared.streams.open(peer, Instant::now()) else {
        let retry = [(header::RETRY_AFTER, "30")];
        let text = "all places for event streams are taken; poll /api/jobs instead";
        return (retry, ApiError::new(StatusCode::SERVICE_UNAVAILABLE, text)).into_response();
    };
    let last = headers.get("last-event-id").and_then(|id| id.to_str().ok()).and_then(|id| id.parse().ok());
    let (writer, reader) = tokio::io::duplex(BUFFER);
    tokio::spawn(feed(shared, only, last, writer, place));
    let kind = [
        (header::CONTENT_TYPE, "text/event-stream"),
        (header::CACHE_CONTROL, "no-store"),
        // For nginx, which would collect the events.
        (header::HeaderName::from_static("x-accel-buffering"), "no"),
    ];
    (kind, Body::from_stream(ReaderStream::new(reader))).into_response()
}

/// Writes until the reader is gone, or the daemon stops.
async fn feed(
    shared: AppState,
    only: Option<JobId>,
    last: Option<i64>,
    mut to: DuplexStream,
    place: StreamPlace,
) {
    let mut stream = EventStream { only, seen: last, told: HashMap::new() };
    let mut text = "retry: 2000\n\n".to_string();
    let mut silent = Duration::ZERO;
    loop {
        if let Err(error) = stream.beat(&shared, &mut text).await {
            // The reader comes back by itself.
            tracing::warn!(%error, "an event stream ends");
            return;
        }
        silent += BEAT;
        if text.is_empty() && silent >= KEEP_ALIVE {
            text.push_str(": still here\n\n");
        }
        if !text.is_empty() {
            let written = tokio::time::timeout(SLOW, to.write_all(text.as_bytes())).await;
            if !matches!(written, Ok(Ok(()))) {
                return;
            }
            text.clear();
            silent = Duration::ZERO;
        }
        tokio::select! {
            () = shared.stop.cancelled() => return,
            // Its reader comes back by itself, if there is one.
            () = place.must_go() => return,
            () = tokio::time::sleep(BEAT) => {}
        }
    }
}

struct EventStream {
    only: Option<JobId>,
    /// The latest line of history that the reader knows of; nothing at first.
    seen: Option<i64>,
    /// What it was told of the running jobs.
    told: HashMap<JobId, (&'static str, u64)>,
}

#[derive(Serialize)]
struct ProgressView {
    id: JobId,
    #[serde(flatten)]
    progress: ProgressReading,
}

impl EventStream {
    /// Adds what is new.
    async fn beat(&mut self, shared: &AppState, text: &mut String) -> crate::serve::queue::Result<()> {
        // Before the jobs are read: what happens in between is told once more.
        let latest = shared.store.latest_event().await?;
        let jobs = match self.seen {
            Some(seen) if seen == latest => vec![],
            Some(seen) if seen < latest => shared.store.jobs_since(seen, AT_ONCE).await?,
            // At first; or the history was cut, and its numbers begin anew.
            _ => self.present(shared).await?,
        };
        let jobs: Vec<Job> = jobs.into_iter().filter(|job| self.wants(job.id)).collect();
        let views = api::views(shared, jobs).await?;
        let count = views.len();
        for (at, view) in views.iter().enumerate() {
            // With the last of a batch, for all of it.
            let id = (at + 1 == count).then_some(latest);
            push(text, "job", id, view);
        }
        self.seen = Some(latest);
        self.progress(shared, text);
        Ok(())
    }

    async fn present(&self, shared: &AppState) -> crate::serve::queue::Result<Vec<Job>> {
        match self.only {
            Some(id) => Ok(vec![shared.store.job(id).await?]),
            None => {
                let mut jobs = shared.store.jobs(None, None, FIRST).await?;
                jobs.reverse();
                Ok(jobs)
            }
        }
    }

    fn progress(&mut self, shared: &AppState, text: &mut String) {
        let readings = shared.board.readings(shared.clock.now());
        self.told.retain(|id, _| readings.iter().any(|(running, _)| running == id));
        for (id, progress) in readings {
            let now = (progress.stage, progress.points_done);
            if self.wants(id) && self.told.insert(id, now) != Some(now) {
                push(text, "progress", None, &ProgressView { id, progress });
            }
        }
    }

    fn wants(&self, job: JobId) -> bool {
        self.only.is_none_or(|only| only == job)
    }
}

/// One event. JSON has no line break outside of its own escapes, so that nothing
/// in a file's name ends the event early.
fn push(text: &mut String, kind: &str, id: Option<i64>, data: &impl Serialize) {
    let Ok(data) = serde_json::to_string(data) else { return };
    let _ = writeln!(text, "event: {kind}");
    if let Some(id) = id {
        let _ = writeln!(text, "id: {id}");
    }
    let _ = write!(text, "data: {data}\n\n");
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_name_with_line_breaks_stays_within_its_event() {
        let mut text = String::new();
        super::push(&mut text, "job", Some(7), &"a\n\nevent: fake\r\ndata: {}");
        assert_eq!(text, "event: job\nid: 7\ndata: \"a\\n\\nevent: fake\\r\\ndata: {}\"\n\n");
    }
}
