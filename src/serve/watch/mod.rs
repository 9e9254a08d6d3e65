//! The watched folders: what lies there, whether it is whole, and what it is.
//!
//! Events are hints, scans are the truth: an event only says "look soon", and a
//! scan at start, after lost events and every so often finds what no event told.
//! A scan compares what it sees with what it saw ([`settle`] decides when that is
//! quiet and whole) and hands over [`FoundDataSet`] data sets. It never changes the
//! folders, and it forgets nothing because something is missing: a mount that is
//! gone is not "everything deleted".
//!
//! A file directly in a watched folder is a data set; so is a folder, with all
//! the tiles below it. Nothing here knows the queue.

mod completeness;
pub mod events;
mod file_stamp;
pub mod fingerprint;
mod foreign;
mod found;
pub mod marker;
pub mod names;
mod open_writers;
mod scan;
pub mod settle;
pub mod waiting;
mod zeros;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::platform::clock::Millis;
pub use file_stamp::FileStamp;
pub use found::FoundDataSet;
use settle::{Completeness, Decision, Limits, NotYet, Observation};
use waiting::{Waiting, WaitingKind};

/// What a scan saw.
#[derive(Debug, Default)]
pub struct ScanResult {
    pub found: Vec<FoundDataSet>,
    /// Not taken yet, or refused.
    pub waiting: Vec<Waiting>,
    /// Watched folders that are not there now.
    pub missing: Vec<PathBuf>,
    /// Whether something may get ready without any further event.
    pub unsettled: bool,
}

/// Watches by scanning; see the module's head.
#[derive(Debug)]
pub struct Watcher {
    roots: Vec<PathBuf>,
    /// Folders that are not to be entered: our own.
    excluded: Vec<PathBuf>,
    limits: Limits,
    sights: HashMap<PathBuf, Observation>,
    /// Stamps of what is in the queue already.
    known: HashMap<PathBuf, String>,
    /// Counts what it has looked at, so that others see it move.
    steps: Arc<AtomicU64>,
}

impl Watcher {
    pub fn new(
        roots: Vec<PathBuf>,
        excluded: Vec<PathBuf>,
        limits: Limits,
        known: HashMap<PathBuf, String>,
    ) -> Watcher {
        Watcher { roots, excluded, limits, sights: HashMap::new(), known, steps: Arc::default() }
    }

    /// Rises while a scan gets on; for whoever asks whether it stands still.
    pub fn steps(&self) -> Arc<AtomicU64> {
        self.steps.clone()
    }

    /// Notes that a data set is in the queue, so that it is not found again
    /// until it changes.
    pub fn taken(&mut self, path: &Path, stamp: String) {
        self.sights.remove(path);
        self.known.insert(path.to_path_buf(), stamp);
    }

    /// Looks at a data set as if it were new, should it be there.
    pub fn forget(&mut self, path: &Path) {
        self.known.remove(path);
    }

    /// Notes why a data set is not whole after all, as reading all of it showed; it
    /// gets patience then, if it is still the same.
    pub fn doubt(&mut self, path: &Path, stamp: &str, not_yet: NotYet) {
        if let Some(sight) = self.sights.get_mut(path).filter(|sight| sight.is(stamp)) {
            sight.whole = Some(Completeness::NotYet(not_yet));
        }
    }

    /// Looks at every watched folder once.
    pub fn scan(&mut self, now: Millis) -> ScanResult {
        let mut report = ScanResult::default();
        let mut seen = HashSet::new();
        let mut quiet = Vec::new();
        for root in self.roots.clone() {
            let skip: Vec<_> = self.roots.iter().chain(&self.excluded).cloned().collect();
            match scan::scan(&root, &skip) {
                Ok(scanned) => {
                    report.waiting.extend(scanned.refused);
                    for candidate in scanned.candidates {
                        seen.insert(candidate.path.clone());
                        self.observe(candidate, now, &mut quiet, &mut report);
                    }
                }
                Err(error) => {
                    tracing::debug!(root = %root.display(), %error, "a watched folder is not there");
                    report.missing.push(root);
                }
            }
        }
        if report.missing.is_empty() {
            self.sights.retain(|path, _| seen.contains(path));
        }
        self.decide(quiet, now, &mut report);
        report
    }

    /// Step one: is it known, is it quiet? That costs nothing but the stat.
    fn observe(
        &mut self,
        candidate: scan::Candidate,
        now: Millis,
        quiet: &mut Vec<scan::Candidate>,
        report: &mut ScanResult,
    ) {
        self.steps.fetch_add(1, Ordering::Relaxed);
        let stamp = candidate.stamp();
        if let Some(known) = self.known.get(&candidate.path)
            && (*known == stamp || candidate.old_stamp().as_ref() == Some(known))
        {
            return;
        }
        let sight =
            self.sights.entry(candidate.path.clone()).or_insert_with(|| Observation::new(&stamp, now));
        sight.see(&stamp, now);
        match settle::is_quiet(sight, candidate.is_closed(), now, &self.limits) {
            Ok(()) => quiet.push(candidate),
            Err(why) => {
                report.unsettled = true;
                let waiting = Waiting::new(&candidate.path, WaitingKind::Settling, why).since(sight.since());
                report.waiting.push(Waiting { bytes: Some(candidate.bytes()), ..waiting });
            }
        }
    }

    /// Step two, for what is quiet: is it whole, does someone still write? That
    /// opens files, so it is remembered as long as nothing changes.
    fn decide(&mut self, quiet: Vec<scan::Candidate>, now: Millis, report: &mut ScanResult) {
        let written = if quiet.is_empty() { Default::default() } else { open_writers::open_for_writing() };
        for candidate in quiet {
            self.steps.fetch_add(1, Ordering::Relaxed);
            let Some(sight) = self.sights.get_mut(&candidate.path) else { continue };
            let whole = match &sight.whole {
                // Permissions change without the file changing.
                Some(Completeness::Unreadable(_)) | None => sight.whole.insert(whole_of(&candidate)).clone(),
                Some(whole) => whole.clone(),
            };
            let writer = candidate.files.iter().any(|file| written.contains(&file.path));
            match settle::decide(sight, &whole, writer, now, &self.limits) {
                Decision::Take { points, doubt } => report.found.push(candidate.into_found(points, doubt)),
                Decision::Wait(NotYet { kind, why, progress }) => {
                    report.unsettled = true;
                    let (bytes, expected) = progress.unwrap_or((candidate.bytes(), None));
                    let why = match expected {
                        Some(expected) => format!("{why}; {}", waiting::arrived(bytes, expected)),
                        None => why,
                    };
                    let waiting = Waiting::new(&candidate.path, kind, why).since(sight.since());
                    report.waiting.push(Waiting { bytes: Some(bytes), expected_bytes: expected, ..waiting });
                }
            }
        }
    }
}

/// Whether a program that we may look at holds a file open for writing.
pub fn is_written(path: &Path) -> bool {
    open_writers::open_for_writing().contains(path)
}

/// Whether all files of a data set are whole.
fn whole_of(candidate: &scan::Candidate) -> Completeness {
    if let Some(why) = &candidate.unreadable {
        return Completeness::Unreadable(why.clone());
    }
    if !candidate.partials.is_empty() {
        let why = format!("beside it lies {}", scan::under_way(candidate));
        return Completeness::NotYet(NotYet::new(WaitingKind::Partial, why));
    }
    let mut points = 0u64;
    let mut broken = None;
    for file in &candidate.files {
        match completeness::judge(&file.path) {
            Completeness::Whole { points: more } => points = points.saturating_add(more),
            Completeness::NotYet(not_yet) => {
                let progress = Some(completeness::progress(&candidate.files));
                return Completeness::NotYet(NotYet { progress, ..not_yet });
            }
            unreadable @ Completeness::Unreadable(_) => return unreadable,
            never @ Completeness::Never(_) => broken = Some(never),
        }
    }
    // Its options would be lost; better to wait until it is mended.
    if let Some(Err(why)) = candidate.marker.as_ref().map(|marker| &marker.read) {
        return Completeness::NotYet(NotYet::new(WaitingKind::Marker, why.clone()));
    }
    broken.unwrap_or(Completeness::Whole { points })
}
