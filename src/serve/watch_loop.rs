//! The watching loop: scan, take in what was found, wait for an event or the time
//! of the next scan.

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use crate::platform::clock::Millis;
use crate::serve::queue::StoreError;
use crate::serve::scheduler::enqueue::{self, EnqueueOutcome};
use crate::serve::watch::events::{Events, NotifyMode};
use crate::serve::watch::settle::Limits;
use crate::serve::watch::waiting::{Waiting, WaitingKind};
use crate::serve::watch::{ScanResult, Watcher};
use crate::serve::web::AppState;

/// Data sets whose bytes are read for their fingerprint at the same time: with
/// two, a small file passes a huge one.
const READERS: usize = 2;
/// Copies of known content that are named; more nobody reads.
const MOST_NAMED: i64 = 500;
/// The pause between scans where no events come, in milliseconds.
const POLL: Millis = 2_000;
/// Events come in swarms; one scan answers all of them.
const SWARM: Duration = Duration::from_millis(50);

type Take = (PathBuf, Result<EnqueueOutcome, StoreError>);

struct Watching {
    shared: AppState,
    watcher: Watcher,
    events: Events,
    readers: Arc<Semaphore>,
    /// Finds on their way into the queue, by path.
    in_hand: HashSet<PathBuf>,
    takes: JoinSet<Take>,
    missing: Vec<PathBuf>,
    /// What the log has named as not taken.
    named: HashSet<PathBuf>,
    overflows: u64,
    heard: u64,
}

pub(super) async fn run(shared: AppState, stop: CancellationToken) {
    let config = shared.config.clone();
    let mut roots = vec![config.inbox()];
    roots.extend(config.watch.iter().cloned());
    let known: HashMap<PathBuf, String> = match shared.store.stamps().await {
        Ok(stamps) => stamps.into_iter().collect(),
        Err(error) => {
            // All is looked at anew then; known content is not queued twice.
            tracing::error!(%error, "what is in the queue could not be read");
            HashMap::new()
        }
    };
    let limits = Limits { settle: config.settle, patience: config.patience };
    let watcher = Watcher::new(roots.clone(), vec![config.root.clone(), config.done()], limits, known);
    tokio::spawn(feel_pulse(shared.clone(), watcher.steps(), stop.clone()));
    let Ok(events) = tokio::task::spawn_blocking(move || Events::start(&roots)).await else { return };
    let mut watching = Watching {
        shared,
        watcher,
        events,
        readers: Arc::new(Semaphore::new(READERS)),
        in_hand: HashSet::new(),
        takes: JoinSet::new(),
        missing: vec![],
        named: HashSet::new(),
        overflows: 0,
        heard: 0,
    };
    while !stop.is_cancelled() {
        let Some(pause) = watching.turn().await else { return };
        watching.wait(pause, &stop).await;
    }
}

/// How often it is looked whether a scan gets on.
const PULSE: Duration = Duration::from_secs(1);

/// Notes when the watcher last moved: a scan may hang in a file system that does
/// not answer, and cannot say so itself. Counted in looks, so that no jump of the
/// clock is taken for a standstill.
async fn feel_pulse(shared: AppState, steps: Arc<AtomicU64>, stop: CancellationToken) {
    let mut last = 0;
    while !stop.is_cancelled() {
        let now = steps.load(Ordering::Relaxed);
        shared.update_health(|health| {
            let moves = !health.scanning || now != last;
            health.watcher_stands = if moves { 0 } else { health.watcher_stands + PULSE.as_secs() };
        });
        last = now;
        tokio::select! {
            () = tokio::time::sleep(PULSE) => {}
            () = stop.cancelled() => {}
        }
    }
}

impl Watching {
    /// One scan and what follows from it. Returns the time to the next, or
    /// nothing where the scan itself failed for good.
    async fn turn(&mut self) -> Option<Duration> {
        if self.events.hints.take_lost() {
            tracing::warn!("file events were lost; the scan finds what they would have told");
        }
        match self.shared.store.to_look_at_again().await {
            Ok(paths) => paths.iter().for_each(|path| self.watcher.forget(path)),
            Err(error) => tracing::warn!(%error, "what to look at again could not be read"),
        }
        let now = self.shared.clock.now();
        let watcher = &mut self.watcher;
        self.shared.update_health(|health| health.scanning = true);
        // A scan of tens of thousands of files takes some tens of milliseconds.
        let mut report = tokio::task::block_in_place(|| watcher.scan(now));
        self.name_copies(&mut report).await;
        self.revive(&report).await;
        self.publish(&report, now);
        let unsettled = report.unsettled || !self.in_hand.is_empty();
        for found in report.found {
            if self.in_hand.insert(found.path.clone()) {
                self.take(found);
            }
        }
        Some(self.pause(unsettled))
    }

    fn take(&mut self, found: crate::serve::watch::FoundDataSet) {
        let (shared, readers, path) = (self.shared.clone(), self.readers.clone(), found.path.clone());
        self.takes.spawn(async move {
            // The semaphore is never closed.
            let _place = readers.acquire_owned().await;
            let now = shared.clock.now();
            let taken = enqueue::take_in(&shared.store, found, &shared.config, now).await;
            shared.bell.notify_one();
            (path, taken)
        });
    }

    fn pause(&self, unsettled: bool) -> Duration {
        let config = &self.shared.config;
        let mut pause = config.rescan;
        if unsettled {
            pause = pause.min((config.settle / 4).clamp(50, 1000));
        }
        if self.events.any_polling() || !self.missing.is_empty() {
            pause = pause.min(POLL);
        }
        Duration::from_millis(pause.max(10) as u64)
    }

    /// Waits for the pause to end, an event, or a find that is in the queue.
    async fn wait(&mut self, pause: Duration, stop: &CancellationToken) {
        let end = tokio::time::Instant::now() + pause;
        loop {
            tokio::select! {
                () = tokio::time::sleep_until(end) => return,
                () = stop.cancelled() => return,
                () = self.events.hints.bell.notified() => {
                    tokio::time::sleep(SWARM).await;
                    return;
                }
                Some(take) = self.takes.join_next() => self.taken(take),
            }
        }
    }

    fn taken(&mut self, take: Result<Take, tokio::task::JoinError>) {
        match take {
            Ok((path, Ok(EnqueueOutcome::In { stamp, .. }))) => {
                self.in_hand.remove(&path);
                self.watcher.taken(&path, stamp);
            }
            Ok((path, Ok(EnqueueOutcome::Moving))) => {
                self.in_hand.remove(&path);
            }
            Ok((path, Ok(EnqueueOutcome::Hollow { stamp, not_yet, .. }))) => {
                tracing::info!(path = %path.display(), why = not_yet.why, "not whole yet");
                self.in_hand.remove(&path);
                self.watcher.doubt(&path, &stamp, not_yet);
            }
            Ok((path, Err(error))) => {
                tracing::error!(path = %path.display(), %error, "could not be queued; trying again");
                self.shared.metrics.queue_errors.inc();
                self.in_hand.remove(&path);
            }
            Err(error) => {
                // Which one it was is not told; all are looked at again, and
                // those that are known are known.
                tracing::error!(%error, "a take failed");
                self.in_hand.clear();
            }
        }
    }

    /// A folder that came back is watched anew.
    async fn revive(&mut self, report: &ScanResult) {
        let back: Vec<PathBuf> =
            self.missing.iter().filter(|root| !report.missing.contains(root)).cloned().collect();
        for root in &report.missing {
            if !self.missing.contains(root) {
                tracing::warn!(root = %root.display(), "is not there; nothing is done about its data sets until it is back");
            }
        }
        for root in back {
            tracing::info!(root = %root.display(), "is back");
            tokio::task::block_in_place(|| self.events.revive(&root));
        }
        self.missing = report.missing.clone();
    }

    /// Copies of known content are in the queue, by another's name: whoever waits
    /// for them is told where.
    async fn name_copies(&self, report: &mut ScanResult) {
        let copies = match self.shared.store.copies(MOST_NAMED).await {
            Ok(copies) => copies,
            Err(error) => return tracing::warn!(%error, "copies of known content could not be read"),
        };
        for copy in copies {
            if copy.path.symlink_metadata().is_ok() {
                let why = format!(
                    "holds the same as {}, which job {} stands for; it is not converted twice, and stays until \
                     you remove it",
                    copy.name, copy.job
                );
                let waiting = Waiting::new(&copy.path, WaitingKind::Copy, why).since(copy.since);
                report.waiting.push(Waiting { job: Some(copy.job), ..waiting });
            }
        }
    }

    /// Says once in the log what is not taken, and what to do about it.
    fn name_refused(&mut self, report: &ScanResult) {
        let refused =
            report.waiting.iter().filter(|w| matches!(w.kind, WaitingKind::NotTaken | WaitingKind::Refused));
        let mut named = HashSet::new();
        for Waiting { path, why, .. } in refused {
            if !self.named.contains(path) {
                tracing::info!(path = %path.display(), why, "left alone");
            }
            named.insert(path.clone());
        }
        self.named = named;
    }

    /// Tells the API and the metrics.
    fn publish(&mut self, report: &ScanResult, now: Millis) {
        let metrics = &self.shared.metrics;
        metrics.scans.inc();
        metrics.last_scan_timestamp.set(now as f64 / 1000.0);
        let (heard, overflows) = (self.events.hints.events(), self.events.hints.overflows());
        metrics.watch_events.inc_by(heard - self.heard);
        metrics.watch_overflows.inc_by(overflows - self.overflows);
        (self.heard, self.overflows) = (heard, overflows);
        for (mode, name) in [(NotifyMode::Events, "events"), (NotifyMode::Polling, "polling")] {
            let folders = self.events.modes.iter().filter(|(_, m)| *m == mode).count();
            metrics.watched_folders.with_label_values(&[name]).set(folders as i64);
        }
        self.name_refused(report);
        let mut refused = report.waiting.clone();
        // What moves comes first, should there be too many.
        refused.sort_by_key(|waiting| !waiting.kind.may_pass());
        refused.truncate(1000);
        self.shared.update_health(|health| {
            health.started = true;
            health.scanning = false;
            health.last_scan = now;
            health.watched = self.events.modes.clone();
            health.missing = report.missing.clone();
            health.waiting = refused;
        });
    }
}
