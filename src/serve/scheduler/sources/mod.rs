//! What becomes of the sources of a published octree: they are moved to
//! `done/<name>/` or removed, where the configuration or the data set's marker
//! says so.
//!
//! These are somebody's only copies, perhaps. So nothing is touched unless its
//! octree is there; unless it is, by its content, what was converted; unless it
//! lies in a watched folder, and without a symbolic link anywhere in it; unless
//! nobody writes to it; and unless nothing came to it meanwhile. What does not pass
//! stays where it is, with the reason in the job's history. Every step may be cut
//! off by a crash and begun again.

mod listing;
mod plan;
mod relocate;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use crate::convert::context::Cancel;
use crate::platform::disk::{Disk, seal};
use crate::serve::config::Config;
use crate::serve::config::sources::OnDone;
use crate::serve::job::{Job, QueuedFile};
use crate::serve::scheduler::converter::ConversionResult;
use crate::serve::watch::marker::{self, Marker};
use crate::serve::watch::{is_written, names};
use listing::{FileKind, ListedFile, SourceListing};
use plan::full;
pub(super) use plan::{NotMoved, SourceActionOutcome, SourceActionPlan};

/// What systems leave beside files is small, in bytes.
const MOST_JUNK: u64 = 4 << 20;

/// What the data set's own marker says, or else the configuration. A marker that
/// cannot be understood keeps all.
pub(super) fn wish(config: &Config, source: &Path) -> OnDone {
    let path = source.join(marker::NAME);
    if path.symlink_metadata().is_err() {
        return config.on_done;
    }
    Marker::read(&path).map_or(OnDone::Keep, |marker| marker.on_done.unwrap_or(config.on_done))
}

/// Why the sources of this job are not put away, whatever was asked for.
pub(super) fn doubt(job: &Job, report: &ConversionResult) -> Option<String> {
    let missing = report.points_missing;
    let damaged = (missing > 0).then(|| format!("{missing} points of it could not be read"));
    job.doubt.clone().map(|doubt| format!("it may not be whole: {doubt}")).or(damaged)
}

/// Puts the sources away. Takes as long as copying takes, where they go to
/// another file system.
pub(super) fn put_away(
    plan: &SourceActionPlan,
    disk: &Disk,
    cancel: &Cancel,
) -> Result<SourceActionOutcome, NotMoved> {
    let stay = |why: &str| NotMoved::ForGood(format!("{} {why}", plan.source.display()));
    let (Some(root), Some(name)) = (plan.source.parent(), plan.source.file_name()) else {
        return Err(stay("lies in no folder"));
    };
    let watched = plan.roots.iter().any(|r| r == root || r.canonicalize().is_ok_and(|r| r == root));
    if !watched {
        return Err(stay("does not lie in a watched folder"));
    }
    let Some(looked) = listing::look(root, name)? else { return Ok(SourceActionOutcome::Gone) };
    let ours = ours(plan)?;
    let missing = check(plan, &looked, &ours)?;
    octree_stands(plan)?;
    prove(plan, &looked, cancel)?;
    if plan.what == OnDone::Delete {
        let junk = junk(&looked, &ours);
        let goes =
            |entry: &ListedFile| ours.contains(entry.path.as_path()) || junk.contains(entry.path.as_path());
        relocate::remove(plan, &looked, goes, cancel)?;
        return Ok(SourceActionOutcome::Removed);
    }
    relocate::carry(plan, &looked, &missing, disk, cancel).map(SourceActionOutcome::Moved)
}

/// An octree that is not there holds nothing, whatever the queue says.
fn octree_stands(plan: &SourceActionPlan) -> Result<(), NotMoved> {
    let octree = plan.octree.display();
    let why = match (seal(&plan.octree).as_deref(), plan.seal.as_deref()) {
        (Some(there), Some(known)) if there == known && !there.is_empty() => return Ok(()),
        // Published by an earlier version, which noted nothing.
        (Some(there), None) if !there.is_empty() => return Ok(()),
        (None, _) => format!("{octree} is no longer there, so {} stays", plan.source.display()),
        _ => format!("{octree} is not the octree that was made of it, so {} stays", plan.source.display()),
    };
    Err(NotMoved::ForGood(why))
}

/// Reads what is there once more: it must be, to the byte, what was converted, and
/// nobody may be writing to it.
fn prove(plan: &SourceActionPlan, looked: &SourceListing, cancel: &Cancel) -> Result<(), NotMoved> {
    for input in &plan.inputs {
        let within = input.path.strip_prefix(&plan.source).unwrap_or(&input.path);
        let Some(entry) = looked.find(within) else { continue };
        let path = input.path.display();
        if is_written(&input.path) {
            return Err(NotMoved::ForNow(format!("a program holds {path} open for writing")));
        }
        let read = relocate::hash_of(looked, entry, cancel)?;
        if input.hash.is_empty() || read.to_hex().as_str() != input.hash {
            return Err(NotMoved::ForGood(format!("{path} is not what was converted, and stays")));
        }
        if looked.again(entry).ok().as_ref() != Some(entry) {
            return Err(NotMoved::ForGood(format!("{path} has changed since it was converted, and stays")));
        }
    }
    Ok(())
}

/// What systems left beside the sources, where nothing of anybody's own is there:
/// no reason to keep an empty folder.
fn junk<'a>(looked: &'a SourceListing, ours: &HashSet<&Path>) -> HashSet<&'a Path> {
    let is_junk = |entry: &ListedFile| {
        let named = entry.path.iter().any(|part| part.to_str().is_some_and(names::is_junk));
        named && entry.size <= MOST_JUNK && !entry.is_disguised(looked)
    };
    let others = looked.entries.iter().filter(|entry| entry.kind != FileKind::Folder);
    let others: Vec<&ListedFile> = others.filter(|entry| !ours.contains(entry.path.as_path())).collect();
    if !others.iter().all(|entry| is_junk(entry)) {
        return HashSet::new();
    }
    others.into_iter().map(|entry| entry.path.as_path()).collect()
}

/// What was converted, and the marker, by their paths within the source.
fn ours(plan: &SourceActionPlan) -> Result<HashSet<&Path>, NotMoved> {
    let mut ours = HashSet::from([Path::new(marker::NAME)]);
    for input in &plan.inputs {
        let outside = |_| NotMoved::ForGood(format!("{} lies outside of its data set", input.path.display()));
        ours.insert(input.path.strip_prefix(&plan.source).map_err(outside)?);
    }
    Ok(ours)
}

/// Holds what lies there against what was converted. What is missing is no
/// change yet: an earlier try may have got so far.
fn check(
    plan: &SourceActionPlan,
    looked: &SourceListing,
    ours: &HashSet<&Path>,
) -> Result<Vec<QueuedFile>, NotMoved> {
    let stay = |path: &Path, why: &str| NotMoved::ForGood(format!("{} {why}", path.display()));
    let there: HashMap<PathBuf, &ListedFile> =
        looked.entries.iter().map(|entry| (full(&plan.source, &entry.path), entry)).collect();
    let mut missing = Vec::new();
    for input in &plan.inputs {
        match there.get(&input.path) {
            None => missing.push(input.clone()),
            Some(entry) if entry.kind == FileKind::File && entry.size == input.size => {}
            Some(_) => return Err(stay(&input.path, "has changed since it was converted")),
        }
    }
    for (path, entry) in &there {
        if entry.kind == FileKind::Other {
            return Err(stay(path, "is a link, or no plain file; nothing is done through such"));
        }
        let known = ours.contains(entry.path.as_path());
        if entry.kind == FileKind::File && !known && entry.looks_like_a_cloud(looked) {
            return Err(stay(path, "came after the others and is not in the octree"));
        }
    }
    Ok(missing)
}

#[cfg(test)]
mod tests;
