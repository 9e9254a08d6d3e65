//! What becomes of the sources of a published octree: they are moved to
//! `done/<name>/` or removed, where the configuration or the data set's marker
//! says so.
//!
//! These are somebody's only copies, perhaps. So nothing is touched unless it is,
//! to the byte count and time, what was converted; unless it lies in a watched
//! folder, and without a symbolic link anywhere in it; and unless nothing came to
//! it meanwhile. What does not pass stays where it is, with the reason in the
//! job's history. Every step may be cut off by a crash and begun again.

mod carry;
mod look;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use crate::config::Config;
use crate::config::sources::OnDone;
use crate::disk::Disk;
use crate::job::{Input, Job};
use crate::stage::context::Cancel;
use crate::watch::marker::{self, Marker};
use look::{Entry, Kind, Looked};

/// What is to be done with which sources.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub source: PathBuf,
    /// The octree's name.
    pub name: String,
    pub revision: i64,
    pub inputs: Vec<Input>,
    pub what: OnDone,
    /// The watched folders, and where sources are moved to.
    pub roots: Vec<PathBuf>,
    pub done: PathBuf,
    /// Bytes that stay free on the disk that they are copied to.
    pub reserve: u64,
}

/// What was done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum PutAway {
    Moved(PathBuf),
    Removed,
    /// There is nothing any more: done before a crash, or by somebody else.
    Gone,
}

/// Why nothing was done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Left {
    /// It stays for good.
    ForGood(String),
    /// It is worth another try.
    ForNow(String),
}

/// What the data set's own marker says, or else the configuration. A marker that
/// cannot be understood keeps all.
pub(super) fn wish(config: &Config, source: &Path) -> OnDone {
    let path = source.join(marker::NAME);
    if path.symlink_metadata().is_err() {
        return config.on_done;
    }
    Marker::read(&path).map_or(OnDone::Keep, |marker| marker.on_done.unwrap_or(config.on_done))
}

impl Plan {
    pub fn new(config: &Config, job: &Job, what: OnDone, inputs: Vec<Input>) -> Plan {
        let roots = std::iter::once(config.inbox()).chain(config.watch.iter().cloned());
        Plan {
            source: job.source.clone(),
            name: job.name.clone(),
            revision: job.revision,
            inputs,
            what,
            roots: roots.collect(),
            done: config.done(),
            reserve: config.disk_reserve,
        }
    }
}

/// Puts the sources away. Takes as long as copying takes, where they go to
/// another file system.
pub(super) fn put_away(plan: &Plan, disk: &Disk, cancel: &Cancel) -> Result<PutAway, Left> {
    let stay = |why: &str| Left::ForGood(format!("{} {why}", plan.source.display()));
    let (Some(root), Some(name)) = (plan.source.parent(), plan.source.file_name()) else {
        return Err(stay("lies in no folder"));
    };
    let watched = plan.roots.iter().any(|r| r == root || r.canonicalize().is_ok_and(|r| r == root));
    if !watched {
        return Err(stay("does not lie in a watched folder"));
    }
    let Some(looked) = look::look(root, name)? else { return Ok(PutAway::Gone) };
    let ours = ours(plan)?;
    let missing = check(plan, &looked, &ours)?;
    if plan.what == OnDone::Delete {
        carry::remove(plan, &looked, |entry| ours.contains(entry.path.as_path()), cancel)?;
        return Ok(PutAway::Removed);
    }
    carry::carry(plan, &looked, &missing, disk, cancel).map(PutAway::Moved)
}

/// What was converted, and the marker, by their paths within the source.
fn ours(plan: &Plan) -> Result<HashSet<&Path>, Left> {
    let mut ours = HashSet::from([Path::new(marker::NAME)]);
    for input in &plan.inputs {
        let outside = |_| Left::ForGood(format!("{} lies outside of its data set", input.path.display()));
        ours.insert(input.path.strip_prefix(&plan.source).map_err(outside)?);
    }
    Ok(ours)
}

/// Holds what lies there against what was converted. What is missing is no
/// change yet: an earlier try may have got so far.
fn check(plan: &Plan, looked: &Looked, ours: &HashSet<&Path>) -> Result<Vec<Input>, Left> {
    let stay = |path: &Path, why: &str| Left::ForGood(format!("{} {why}", path.display()));
    let there: HashMap<PathBuf, &Entry> =
        looked.entries.iter().map(|entry| (full(&plan.source, &entry.path), entry)).collect();
    let mut missing = Vec::new();
    for input in &plan.inputs {
        match there.get(&input.path) {
            None => missing.push(input.clone()),
            Some(entry) if entry.kind == Kind::File && entry.is(input) => {}
            Some(_) => return Err(stay(&input.path, "has changed since it was converted")),
        }
    }
    for (path, entry) in &there {
        if entry.kind == Kind::Other {
            return Err(stay(path, "is a link, or no plain file; nothing is done through such"));
        }
        let known = ours.contains(entry.path.as_path());
        if entry.kind == Kind::File && entry.looks_like_a_cloud(path) && !known {
            return Err(stay(path, "came after the others and is not in the octree"));
        }
    }
    Ok(missing)
}

/// A path within a folder; joining an empty one would add a slash.
fn full(folder: &Path, within: &Path) -> PathBuf {
    if within.as_os_str().is_empty() { folder.to_path_buf() } else { folder.join(within) }
}

#[cfg(test)]
mod tests;
