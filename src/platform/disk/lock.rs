//! Locks on folders (`flock`). Such a lock belongs to the folder itself, not to its
//! name, and folders change names here: an octree in the making takes the name of
//! the one that it replaces. So a lock only counts while the name leads to what was
//! locked.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::Duration;

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use super::{Disk, DiskError, Result};

/// A process that is just being started (a hook) holds all that its parent had open,
/// until it is on its own feet, and one that has published lets go a moment later: a
/// little patience.
const TRIES: u32 = 50;
/// Where all the work is done but for the last step.
const PATIENT_TRIES: u32 = 50 * TRIES;
const PAUSE: Duration = Duration::from_millis(20);

/// A lock on a folder; dropping it lets go.
#[derive(Debug)]
pub struct DirLock {
    folder: File,
}

impl DirLock {
    /// Whether `path` leads to the folder that is locked.
    pub fn is_at(&self, path: &Path) -> bool {
        let is = |meta: fs::Metadata| (meta.dev(), meta.ino());
        match (self.folder.metadata(), fs::metadata(path)) {
            (Ok(ours), Ok(there)) => is(ours) == is(there),
            _ => false,
        }
    }
}

impl Disk {
    /// Makes a folder, where there is none, and locks it for this process, as long
    /// as the lock is kept and whatever the folder is called by then; nothing where
    /// another process has it. The lock ends with the process, however that ends.
    pub fn lock_dir(&self, path: &Path) -> Result<Option<DirLock>> {
        for _ in 0..TRIES {
            self.create_dir_all(path)?;
            match try_lock(path)? {
                // Else its holder gave it another name, or removed it, while we came.
                Some(lock) if lock.is_at(path) => return Ok(Some(lock)),
                Some(_) => {}
                None => std::thread::sleep(PAUSE),
            }
        }
        Ok(None)
    }
}

/// Locks a folder that others may take away or exchange at any time. Nothing where it
/// is gone, cannot be locked, or another process has it for long.
pub(super) fn lock_if_there(path: &Path) -> Option<DirLock> {
    for _ in 0..PATIENT_TRIES {
        match try_lock(path).ok()? {
            Some(lock) if lock.is_at(path) => return Some(lock),
            Some(_) => {}
            None if path.exists() => std::thread::sleep(PAUSE),
            None => return None,
        }
    }
    None
}

/// One try; nothing where another process has it, or it has just gone.
pub(super) fn try_lock(path: &Path) -> Result<Option<DirLock>> {
    let folder = match File::open(path) {
        Ok(folder) => folder,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(DiskError::new("open", path, error)),
    };
    match flock(&folder, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(Some(DirLock { folder })),
        Err(Errno::WOULDBLOCK) => Ok(None),
        Err(errno) => Err(DiskError::new("lock", path, errno.into())),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn a_folder_that_changed_its_name_is_not_held_under_the_old_one() {
        let root = tempfile::tempdir().expect("a folder");
        let (path, other) = (root.path().join("a"), root.path().join("b"));
        let disk = Disk::new();
        let first = disk.lock_dir(&path).expect("locked").expect("free");
        assert!(try_lock(&path).expect("asked").is_none(), "held");
        fs::rename(&path, &other).expect("renamed");
        assert!(!first.is_at(&path) && first.is_at(&other));
        let second = disk.lock_dir(&path).expect("locked").expect("a new folder is free");
        assert!(second.is_at(&path) && try_lock(&other).expect("asked").is_none());
        fs::remove_dir(&path).expect("removed");
        assert!(!second.is_at(&path) && lock_if_there(&path).is_none());
    }

    #[test]
    fn a_folder_that_others_take_away_is_made_nevertheless() {
        let root = tempfile::tempdir().expect("a folder");
        let path = root.path().join("a");
        let done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !done.load(Ordering::Relaxed) {
                    let _ = fs::create_dir(&path);
                    let _ = fs::remove_dir(&path);
                }
            });
            let disk = Disk::new();
            let made = (0..20_000).try_for_each(|_| disk.create_dir_all(&path));
            done.store(true, Ordering::Relaxed);
            made.expect("made");
        });
        fs::create_dir_all(&path).expect("made");
        fs::remove_dir(&path).expect("removed");
        fs::write(&path, "in its place").expect("written");
        let refused = Disk::new().create_dir_all(&path).expect_err("a file is there");
        assert_eq!(refused.source.kind(), io::ErrorKind::AlreadyExists);
    }
}
