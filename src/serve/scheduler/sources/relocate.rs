//! Moving and removing. A move is one rename where it can be; across file systems
//! it is a copy that is held against the fingerprints, made to last, brought in
//! place by a rename, and only then are the sources removed. Nothing that is there
//! already is ever overwritten.

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use rustix::fs::{AtFlags, CWD, RenameFlags, fsync, renameat_with, unlinkat};
use rustix::io::Errno;

use super::listing::{FileKind, ListedFile, SourceListing, look};
use super::plan::{NotMoved, SourceActionPlan, full};
use crate::convert::context::Cancel;
use crate::platform::disk::{Disk, DiskError};
use crate::serve::config::size::Size;
use crate::serve::job::QueuedFile;

const BLOCK: usize = 1 << 20;
/// Where a copy lies until it is whole.
const ON_ITS_WAY: &str = ".on-its-way";

/// Moves a source to `done/<name>/`; returns where it lies there.
pub(super) fn carry(
    plan: &SourceActionPlan,
    looked: &SourceListing,
    missing: &[QueuedFile],
    disk: &Disk,
    cancel: &Cancel,
) -> Result<PathBuf, NotMoved> {
    let folder = plan.done.join(&plan.name);
    disk.create_dir_all(&folder).map_err(left)?;
    // Of a try that a crash cut off.
    disk.remove_dir_all(&folder.join(ON_ITS_WAY)).map_err(left)?;
    for target in targets(&folder, &looked.name, plan.revision, looked.entries[0].kind) {
        if target.symlink_metadata().is_ok() {
            // An earlier try may have got as far as removing what it had copied.
            if covers(&target, plan, looked, missing)? {
                remove(plan, looked, |_| true, cancel)?;
                return Ok(target);
            }
            continue;
        }
        if let Some(gone) = missing.first() {
            return Err(NotMoved::ForGood(format!("{} is no longer there", gone.path.display())));
        }
        match rename(looked, &looked.name, &target) {
            Ok(()) => {
                disk.sync_dir(&folder).map_err(left)?;
                let _ = fsync(&looked.root);
                return Ok(target);
            }
            Err(Errno::EXIST | Errno::NOTEMPTY) => continue,
            Err(Errno::XDEV) => {
                copy(plan, looked, &folder, &target, disk, cancel)?;
                return remove(plan, looked, |_| true, cancel).map(|()| target);
            }
            Err(errno) => return Err(left(DiskError::new("move", &plan.source, errno.into()))),
        }
    }
    Err(NotMoved::ForGood(format!("{} is full of its namesakes", folder.display())))
}

/// Names to try: its own, with its revision, with a number.
fn targets(folder: &Path, name: &Path, revision: i64, kind: FileKind) -> impl Iterator<Item = PathBuf> {
    let (folder, name) = (folder.to_path_buf(), name.to_path_buf());
    (0..1000).map(move |n| {
        let suffix = match n {
            0 => return folder.join(&name),
            1 => format!("-r{revision}"),
            n => format!("-r{revision}-{n}"),
        };
        let ending = if kind == FileKind::File { name.extension() } else { None };
        let mut new = if ending.is_some() { name.file_stem() } else { Some(name.as_os_str()) }
            .unwrap_or_default()
            .to_os_string();
        new.push(suffix);
        if let Some(ending) = ending {
            new.push(".");
            new.push(ending);
        }
        folder.join(new)
    })
}

/// Renames, never over something.
fn rename(looked: &SourceListing, from: &Path, to: &Path) -> Result<(), Errno> {
    match renameat_with(&looked.root, from, CWD, to, RenameFlags::NOREPLACE) {
        // A file system without this; under the lock nobody but us writes to `done`.
        Err(Errno::INVAL | Errno::NOSYS) if to.symlink_metadata().is_err() => {
            rustix::fs::renameat(&looked.root, from, CWD, to)
        }
        other => other,
    }
}

/// Copies to a name of its own first, so that what stands under the last one is
/// whole.
pub(super) fn copy(
    plan: &SourceActionPlan,
    looked: &SourceListing,
    folder: &Path,
    target: &Path,
    disk: &Disk,
    cancel: &Cancel,
) -> Result<(), NotMoved> {
    room(plan, looked, folder, disk)?;
    let temporary = folder.join(ON_ITS_WAY);
    disk.remove_dir_all(&temporary).map_err(left)?;
    disk.create_dir_all(&temporary).map_err(left)?;
    let copied = copy_into(plan, looked, &temporary.join("it"), disk, cancel)
        .and_then(|()| disk.rename(&temporary.join("it"), target).map_err(left));
    disk.remove_dir_all(&temporary).map_err(left)?;
    copied
}

/// A copy must not take the room that conversions need.
fn room(plan: &SourceActionPlan, looked: &SourceListing, folder: &Path, disk: &Disk) -> Result<(), NotMoved> {
    let bytes: u64 = looked.entries.iter().map(|entry| entry.size).sum();
    let (free, needed) = (disk.free_space(folder).map_err(left)?, bytes.saturating_add(plan.reserve));
    if free < needed {
        let (folder, free, needed) = (folder.display(), Size(free), Size(needed));
        return Err(NotMoved::ForNow(format!(
            "{folder} has {free} free, and a copy needs {needed} with the reserve"
        )));
    }
    Ok(())
}

fn copy_into(
    plan: &SourceActionPlan,
    looked: &SourceListing,
    to: &Path,
    disk: &Disk,
    cancel: &Cancel,
) -> Result<(), NotMoved> {
    for entry in &looked.entries {
        let target = full(to, &entry.path);
        match entry.kind {
            FileKind::Folder => disk.create_dir_all(&target).map_err(left)?,
            _ => copy_file(plan, looked, entry, &target, disk, cancel)?,
        }
    }
    for entry in looked.entries.iter().rev().filter(|entry| entry.kind == FileKind::Folder) {
        disk.sync_dir(&to.join(&entry.path)).map_err(left)?;
    }
    Ok(())
}

fn copy_file(
    plan: &SourceActionPlan,
    looked: &SourceListing,
    entry: &ListedFile,
    target: &Path,
    disk: &Disk,
    cancel: &Cancel,
) -> Result<(), NotMoved> {
    let path = full(&plan.source, &entry.path);
    let reading = |e: io::Error| left(DiskError::new("read", &path, e));
    let mut from = looked.open(entry).map_err(|errno| reading(errno.into()))?;
    let to = disk.create(target).map_err(left)?;
    let (mut hasher, mut block, mut at) = (blake3::Hasher::new(), vec![0u8; BLOCK], 0u64);
    loop {
        stopped(cancel)?;
        let read = from.read(&mut block).map_err(reading)?;
        if read == 0 {
            break;
        }
        hasher.update(&block[..read]);
        to.write_all_at(&block[..read], at).map_err(left)?;
        at += read as u64;
    }
    to.sync().map_err(left)?;
    let time = UNIX_EPOCH + Duration::from_nanos(entry.mtime_ns.max(0) as u64);
    // Its time is a courtesy; the bytes are what counts.
    let _ = fs::File::options().write(true).open(target).and_then(|file| file.set_modified(time));
    let input = input_of(plan, entry);
    let differs = input
        .is_some_and(|input| !input.hash.is_empty() && input.hash != hasher.finalize().to_hex().as_str());
    if at != entry.size || differs {
        return Err(NotMoved::ForGood(format!("{} is not what was converted", path.display())));
    }
    Ok(())
}

/// Whether all that is still in the source, and all that is missing from it, lies
/// under `target` with the same content.
fn covers(
    target: &Path,
    plan: &SourceActionPlan,
    looked: &SourceListing,
    missing: &[QueuedFile],
) -> Result<bool, NotMoved> {
    let (Some(folder), Some(name)) = (target.parent(), target.file_name()) else { return Ok(false) };
    let Some(there) = look(folder, name)? else { return Ok(false) };
    let all_missing = missing.iter().all(|input| {
        let relative = input.path.strip_prefix(&plan.source).unwrap_or(&input.path);
        there.find(relative).is_some_and(|entry| entry.size == input.size)
    });
    if !all_missing {
        return Ok(false);
    }
    for entry in &looked.entries {
        match there.find(&entry.path) {
            Some(twin) if twin.kind == entry.kind && entry.kind == FileKind::Folder => {}
            Some(twin) if twin.kind == entry.kind && twin.size == entry.size => {
                let same = hash(&there, twin).is_ok_and(|h| hash(looked, entry).is_ok_and(|g| g == h));
                if !same {
                    return Ok(false);
                }
            }
            _ => return Ok(false),
        }
    }
    Ok(true)
}

/// The hash of a file's content, read in pieces that a stop can end.
pub(super) fn hash_of(
    looked: &SourceListing,
    entry: &ListedFile,
    cancel: &Cancel,
) -> Result<blake3::Hash, NotMoved> {
    let path = full(&looked.name, &entry.path);
    let reading = |e: io::Error| left(DiskError::new("read", &path, e));
    let mut file = looked.open(entry).map_err(|errno| reading(errno.into()))?;
    let (mut hasher, mut block) = (blake3::Hasher::new(), vec![0u8; BLOCK]);
    loop {
        stopped(cancel)?;
        match file.read(&mut block).map_err(reading)? {
            0 => return Ok(hasher.finalize()),
            read => hasher.update(&block[..read]),
        };
    }
}

fn hash(looked: &SourceListing, entry: &ListedFile) -> io::Result<blake3::Hash> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(looked.open(entry)?)?;
    Ok(hasher.finalize())
}

/// Removes the chosen files, each looked at once more, and the folders that are
/// empty then. What is gone already is fine.
pub(super) fn remove(
    plan: &SourceActionPlan,
    looked: &SourceListing,
    chosen: impl Fn(&ListedFile) -> bool,
    cancel: &Cancel,
) -> Result<(), NotMoved> {
    let is_folder = looked.entries.first().is_some_and(|entry| entry.kind == FileKind::Folder);
    for entry in looked.entries.iter().rev() {
        stopped(cancel)?;
        let path = full(&plan.source, &entry.path);
        let failing = |errno: Errno| left(DiskError::new("remove", &path, errno.into()));
        let removed = match entry.kind {
            FileKind::Folder => removed(looked, entry, AtFlags::REMOVEDIR),
            _ if is_folder && !chosen(entry) => continue,
            _ => match looked.again(entry) {
                Ok(now) if now == *entry => removed(looked, entry, AtFlags::empty()),
                Ok(_) => {
                    return Err(NotMoved::ForGood(format!(
                        "{} has changed since it was converted",
                        path.display()
                    )));
                }
                Err(errno) => Err(errno),
            },
        };
        match removed {
            Ok(()) | Err(Errno::NOENT) => {}
            // Something of somebody's is still in it.
            Err(Errno::NOTEMPTY | Errno::EXIST) if entry.kind == FileKind::Folder => {}
            Err(errno) => return Err(failing(errno)),
        }
    }
    let _ = fsync(&looked.root);
    Ok(())
}

fn removed(looked: &SourceListing, entry: &ListedFile, flags: AtFlags) -> Result<(), Errno> {
    let (folder, name) = looked.place(&entry.path)?;
    unlinkat(&folder, &name, flags)
}

fn input_of<'a>(plan: &'a SourceActionPlan, entry: &ListedFile) -> Option<&'a QueuedFile> {
    plan.inputs.iter().find(|input| input.path.strip_prefix(&plan.source).is_ok_and(|p| p == entry.path))
}

fn stopped(cancel: &Cancel) -> Result<(), NotMoved> {
    if cancel.is_cancelled() { Err(NotMoved::ForNow("the daemon stops".to_string())) } else { Ok(()) }
}

fn left(error: DiskError) -> NotMoved {
    if error.may_pass() { NotMoved::ForNow(error.to_string()) } else { NotMoved::ForGood(error.to_string()) }
}
