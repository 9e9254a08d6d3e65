//! The watched folders: what lies there, whether it is whole, and what it is.
//!
//! Events are hints, scans are the truth: an event only says "look soon", and a
//! scan at start, after lost events and every so often finds what no event told.
//! A scan compares what it sees with what it saw ([`settle`] decides when that is
//! quiet and whole) and hands over [`Found`] data sets. It never changes the
//! folders, and it forgets nothing because something is missing: a mount that is
//! gone is not "everything deleted".
//!
//! A file directly in a watched folder is a data set; so is a folder, with all
//! the tiles below it. Nothing here knows the queue.

pub mod events;
pub mod fingerprint;
pub mod marker;
pub mod names;
mod scan;
pub mod settle;
mod whole;
mod writers;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use serde::{Serialize, Serializer};

use crate::clock::Millis;
use marker::Marker;
use settle::{Decision, Limits, Sight, Wholeness};

/// What a file looked like, without opening it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileStamp {
    pub path: PathBuf,
    /// Bytes.
    pub size: u64,
    /// Nanoseconds since 1970.
    pub mtime_ns: i64,
}

/// A data set that is quiet and whole (or will not get whole any more).
#[derive(Debug, Clone)]
pub struct Found {
    /// The file or folder in the watched folder.
    pub path: PathBuf,
    pub is_folder: bool,
    /// The name that its octree should have.
    pub name: String,
    pub files: Vec<FileStamp>,
    /// All sizes and times in one word, to know the data set again.
    pub stamp: String,
    pub marker: Option<Marker>,
    /// Points that the headers claim.
    pub points: u64,
}

/// Something in a watched folder that is not taken, and why.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Waiting {
    #[serde(serialize_with = "as_text")]
    pub path: PathBuf,
    pub why: String,
}

/// A path as text; names that are not UTF-8 are shown as well as can be.
fn as_text<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&path.to_string_lossy())
}

/// What a scan saw.
#[derive(Debug, Default)]
pub struct Report {
    pub found: Vec<Found>,
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
    sights: HashMap<PathBuf, Sight>,
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

    /// Looks at every watched folder once.
    pub fn scan(&mut self, now: Millis) -> Report {
        let mut report = Report::default();
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
        report: &mut Report,
    ) {
        self.steps.fetch_add(1, Ordering::Relaxed);
        let stamp = candidate.stamp();
        if self.known.get(&candidate.path) == Some(&stamp) {
            return;
        }
        let sight = self.sights.entry(candidate.path.clone()).or_insert_with(|| Sight::new(&stamp, now));
        sight.see(&stamp, now);
        match settle::is_quiet(sight, candidate.marker.is_some(), now, &self.limits) {
            Ok(()) => quiet.push(candidate),
            Err(why) => {
                report.unsettled = true;
                report.waiting.push(Waiting { path: candidate.path, why });
            }
        }
    }

    /// Step two, for what is quiet: is it whole, does someone still write? That
    /// opens files, so it is remembered as long as nothing changes.
    fn decide(&mut self, quiet: Vec<scan::Candidate>, now: Millis, report: &mut Report) {
        let written = if quiet.is_empty() { Default::default() } else { writers::open_for_writing() };
        for candidate in quiet {
            self.steps.fetch_add(1, Ordering::Relaxed);
            let Some(sight) = self.sights.get_mut(&candidate.path) else { continue };
            let whole = match &sight.whole {
                // Permissions change without the file changing.
                Some(Wholeness::Unreadable(_)) | None => sight.whole.insert(whole_of(&candidate)).clone(),
                Some(whole) => whole.clone(),
            };
            let writer = candidate.files.iter().any(|file| written.contains(&file.path));
            match settle::decide(sight, &whole, writer, now, &self.limits) {
                Decision::Take { points } => report.found.push(candidate.into_found(points)),
                Decision::Wait(why) => {
                    report.unsettled = true;
                    report.waiting.push(Waiting { path: candidate.path, why });
                }
            }
        }
    }
}

/// Whether all files of a data set are whole.
fn whole_of(candidate: &scan::Candidate) -> Wholeness {
    if let Some(why) = &candidate.not_yet {
        return Wholeness::NotYet(why.clone());
    }
    let mut points = 0u64;
    let mut broken = None;
    for file in &candidate.files {
        match whole::judge(&file.path) {
            Wholeness::Whole { points: more } => points = points.saturating_add(more),
            not_now @ (Wholeness::NotYet(_) | Wholeness::Unreadable(_)) => return not_now,
            never @ Wholeness::Never(_) => broken = Some(never),
        }
    }
    broken.unwrap_or(Wholeness::Whole { points })
}
