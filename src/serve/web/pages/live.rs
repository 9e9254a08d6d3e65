//! `/live`: tells open pages that something changed (they fetch themselves again)
//! and how far the running jobs are. One task looks for all of them, and only while
//! somebody listens, so that ten browsers cost little more than one.

use std::collections::hash_map::DefaultHasher;
use std::fmt::Write;
use std::hash::{Hash, Hasher};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::{Extension, State as Extract};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::json;
use tokio::io::AsyncWriteExt;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, oneshot};
use tokio_util::io::ReaderStream;

use super::super::refusal::ApiError;
use super::super::server::Peer;
use super::super::shared::AppState;
use super::super::streams::StreamPlace;
use super::parts;
use super::subscribers::Live;

const BEAT: Duration = Duration::from_millis(500);
/// Beats between two looks at what is in no history, as files that wait.
const SELDOM: u32 = 4;
/// Proxies cut connections that are silent for a minute, and only writing tells
/// that the other side is gone.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// A reader that takes nothing for so long has gone to sleep.
const SLOW: Duration = Duration::from_secs(20);
const BUFFER: usize = 64 * 1024;
/// Lines of history that are told one by one; more are just "something changed".
const MOST: i64 = 200;

impl Live {
    /// Whoever fetches a page after this has come back misses nothing: what happens from
    /// then on is told.
    async fn subscribe(&self, shared: &AppState) -> broadcast::Receiver<Arc<str>> {
        let receiver = self.sender.subscribe();
        if !self.looking.swap(true, Ordering::SeqCst) {
            let (begun, has_begun) = oneshot::channel();
            tokio::spawn(look(shared.clone(), self.clone(), begun));
            // A daemon that stops answers nobody.
            let _ = has_begun.await;
        }
        receiver
    }
}

pub(in super::super) async fn stream(
    Extract(shared): Extract<AppState>,
    peer: Option<Extension<Peer>>,
) -> Response {
    let peer = peer.map(|Extension(Peer(address))| address);
    let Some(place) = shared.streams.open(peer, Instant::now()) else {
        let retry = [(header::RETRY_AFTER, "30")];
        let text = "all places for open pages are taken; this one asks now and then instead";
        return (retry, ApiError::new(StatusCode::SERVICE_UNAVAILABLE, text)).into_response();
    };
    let news = shared.live.subscribe(&shared).await;
    let (writer, reader) = tokio::io::duplex(BUFFER);
    tokio::spawn(feed(shared, news, writer, place));
    let kind = [
        (header::CONTENT_TYPE, "text/event-stream"),
        (header::CACHE_CONTROL, "no-store"),
        // For nginx, which would collect the events.
        (header::HeaderName::from_static("x-accel-buffering"), "no"),
    ];
    (kind, Body::from_stream(ReaderStream::new(reader))).into_response()
}

/// Passes on what is told, until the reader is gone or the daemon stops.
async fn feed(
    shared: AppState,
    mut news: broadcast::Receiver<Arc<str>>,
    mut to: tokio::io::DuplexStream,
    place: StreamPlace,
) {
    let mut text: Arc<str> = "retry: 2000\n\n".into();
    loop {
        let written = tokio::time::timeout(SLOW, to.write_all(text.as_bytes())).await;
        if !matches!(written, Ok(Ok(()))) {
            return;
        }
        text = tokio::select! {
            () = shared.stop.cancelled() => return,
            // Its page comes back by itself, if it is still open.
            () = place.must_go() => return,
            told = news.recv() => match told {
                Ok(text) => text,
                Err(RecvError::Lagged(_)) => event("changed", &json!({ "jobs": null, "ended": [] })).into(),
                Err(RecvError::Closed) => return,
            },
            () = tokio::time::sleep(KEEP_ALIVE) => ": still here\n\n".into(),
        };
    }
}

/// Looks for news as long as somebody listens; has begun once it knows what is no news.
async fn look(shared: AppState, live: Live, begun: oneshot::Sender<()>) {
    let mut seen = Seen::default();
    if let Err(error) = seen.news(&shared, true).await {
        tracing::warn!(%error, "open pages are told nothing for now");
    }
    // The page that it is begun for may be gone again.
    let _ = begun.send(());
    let mut beats = 0;
    loop {
        tokio::select! {
            () = shared.stop.cancelled() => return,
            () = tokio::time::sleep(BEAT) => {}
        }
        if live.sender.receiver_count() == 0 {
            live.looking.store(false, Ordering::SeqCst);
            // Somebody may have come in this moment, and seen that one looks.
            if live.sender.receiver_count() == 0 || live.looking.swap(true, Ordering::SeqCst) {
                return;
            }
        }
        beats += 1;
        match seen.news(&shared, beats % SELDOM == 0).await {
            Ok(text) if text.is_empty() => {}
            // Without anybody left it is heard by nobody, which the next beat sees.
            Ok(text) => drop(live.sender.send(text.into())),
            Err(error) => tracing::warn!(%error, "open pages are told nothing for now"),
        }
    }
}

/// What was told.
#[derive(Default)]
struct Seen {
    event: Option<i64>,
    state: Option<u64>,
    progress: String,
}

impl Seen {
    async fn news(&mut self, shared: &AppState, all: bool) -> crate::serve::queue::Result<String> {
        let mut text = String::new();
        let latest = shared.store.latest_event().await?;
        let mut changed = false;
        match self.event.replace(latest) {
            Some(seen) if seen < latest => {
                let happened = shared.store.happened_since(seen, MOST).await?;
                let mut jobs: Vec<i64> = happened.iter().map(|(job, ..)| *job).collect();
                jobs.sort_unstable();
                jobs.dedup();
                let ends = happened.iter().filter_map(|(job, name, kind)| {
                    let end = match kind.as_str() {
                        "succeed" => "done",
                        "fail" => "failed",
                        "quarantine" => "quarantined",
                        _ => return None,
                    };
                    Some(json!({ "id": job, "name": name, "state": end }))
                });
                let ended: Vec<_> = ends.collect();
                let jobs = ((happened.len() as i64) < MOST).then_some(jobs);
                text += &event("changed", &json!({ "jobs": jobs, "ended": ended }));
                changed = true;
            }
            // The history was cut, and its numbers begin anew.
            Some(seen) if seen > latest => changed = self.changed(&mut text),
            _ => {}
        }
        if all {
            let mut hasher = DefaultHasher::new();
            shared.store.mode().await?.name().hash(&mut hasher);
            let health = shared.health();
            health.missing.hash(&mut hasher);
            health.queue_error.hash(&mut hasher);
            health
                .waiting
                .iter()
                .for_each(|waiting| (&waiting.path, waiting.kind, waiting.bytes).hash(&mut hasher));
            let state = hasher.finish();
            if self.state.replace(state).is_some_and(|seen| seen != state) && !changed {
                changed = self.changed(&mut text);
            }
        }
        if shared.figures.catch_up().await && !changed {
            self.changed(&mut text);
        }
        self.progress(shared, &mut text);
        Ok(text)
    }

    fn changed(&self, text: &mut String) -> bool {
        *text += &event("changed", &json!({ "jobs": [], "ended": [] }));
        true
    }

    fn progress(&mut self, shared: &AppState, text: &mut String) {
        let readings = shared.board.readings(shared.clock.now());
        let all: Vec<_> = readings
            .iter()
            .map(|(job, reading)| {
                json!({
                    "id": job, "stage": (10.0 * reading.percent).round() / 10.0,
                    "whole": (10.0 * reading.whole_percent).round() / 10.0, "says": parts::says(reading),
                })
            })
            .collect();
        let now = event("progress", &json!(all));
        if !all.is_empty() && now != self.progress {
            text.push_str(&now);
        }
        self.progress = now;
    }
}

/// One event. JSON has no line break outside of its own escapes, so that nothing
/// in a file's name ends the event early.
fn event(kind: &str, data: &serde_json::Value) -> String {
    let mut text = String::new();
    let _ = write!(text, "event: {kind}\ndata: {data}\n\n");
    text
}
