//! A folder takes another's name in one step, so that whoever looks sees the old
//! one or the new one, and after a crash it can be told which of the two it is.

use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;

use super::lock::{lock_if_there, try_lock};
use super::{Disk, DiskError, Result};

/// What tells a folder from another that has, or had, its name.
pub fn inode(path: &Path) -> io::Result<u64> {
    std::fs::symlink_metadata(path).map(|meta| meta.ino())
}

/// Ends the name of a folder that was replaced and is being removed.
const REPLACED: &str = ".old";

impl Disk {
    /// Gives the folder `new` the name `to`, on the same file system, and makes
    /// that last. What has the name until then is exchanged, gets a name of its own,
    /// and is removed after. Others may do the same at the same time: whoever comes
    /// last has the name, and each folder stays whole.
    pub fn replace_dir(&self, new: &Path, to: &Path) -> Result<()> {
        while !self.put_where_nothing_is(new, to)? {
            let failed = |kind| DiskError::new("put in its place", to, io::Error::from(kind));
            if to.is_file() {
                return Err(failed(io::ErrorKind::NotADirectory));
            }
            // What is replaced is not to be taken, under the name that the exchange
            // gives it, for a folder in the making: it is locked until it is gone.
            let lock = lock_if_there(to);
            if lock.is_none() && to.is_dir() {
                return Err(failed(io::ErrorKind::ResourceBusy));
            }
            self.strike("put in its place", to)?;
            match renameat_with(CWD, new, CWD, to, RenameFlags::EXCHANGE) {
                Ok(()) => {
                    return self.clear_exchanged(new, to).inspect_err(|_| {
                        // It would lie there under our name; its lock is still ours.
                        let _ = self.remove_dir_all(new);
                    });
                }
                // It vanished in this moment, or `new` is not there at all.
                Err(Errno::NOENT) if new.symlink_metadata().is_ok() => {}
                // Not every file system can exchange. The name is then free for a
                // moment, but never half of a folder has it.
                Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {
                    let old = name_of_replaced(new);
                    self.rename(to, &old)?;
                    self.rename(new, to)?;
                    return self.remove_dir_all(&old);
                }
                Err(errno) => return Err(DiskError::new("put in its place", to, errno.into())),
            }
        }
        Ok(())
    }

    /// Makes an exchange last, and removes what has the name `new` since.
    fn clear_exchanged(&self, new: &Path, to: &Path) -> Result<()> {
        let (target, source) = (to.parent(), new.parent());
        for folder in target.into_iter().chain(source.filter(|folder| Some(*folder) != target)) {
            self.sync_dir(folder)?;
        }
        let old = name_of_replaced(new);
        // It has its name even where that does not last.
        let renamed = self.rename(new, &old);
        self.remove_dir_all(&old)?;
        renamed
    }

    /// Gives the folder `new` the name `to` if nothing has it, and makes that last;
    /// false where something has.
    pub fn put_where_nothing_is(&self, new: &Path, to: &Path) -> Result<bool> {
        if to.symlink_metadata().is_ok() {
            return Ok(false);
        }
        self.strike("rename", new)?;
        match renameat_with(CWD, new, CWD, to, RenameFlags::NOREPLACE) {
            Err(Errno::EXIST | Errno::NOTEMPTY) => Ok(false),
            // A file system without this: a plain rename replaces no folder that
            // holds anything.
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => self.rename(new, to).map(|()| true),
            Err(errno) => Err(DiskError::new("rename", new, errno.into())),
            Ok(()) => to.parent().map_or(Ok(()), |folder| self.sync_dir(folder)).map(|()| true),
        }
    }

    /// Removes what [`Disk::replace_dir`] of this folder left half removed when its
    /// process was killed.
    pub fn clear_replaced(&self, new: &Path) -> Result<()> {
        let (Some(folder), Some(name)) = (new.parent(), new.file_name()) else { return Ok(()) };
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let start = format!("{}.", name.to_string_lossy());
        let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let digits = name.strip_prefix(&start).and_then(|rest| rest.strip_suffix(REPLACED));
            if !digits.is_some_and(|d| !d.is_empty() && d.bytes().all(|b| b.is_ascii_digit() || b == b'-')) {
                continue;
            }
            // Who is about it holds its lock.
            if let Some(_lock) = try_lock(&entry.path())? {
                self.remove_dir_all(&entry.path())?;
            }
        }
        Ok(())
    }
}

/// A name that no other has: with the process, the time, and a count.
fn name_of_replaced(new: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let time = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_nanos());
    let (process, count) = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let mut name = new.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{process}-{time}-{count}{REPLACED}"));
    new.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_folder_takes_a_free_name_and_then_a_taken_one() {
        let root = tempfile::tempdir().expect("a folder");
        let (new, to) = (root.path().join("in/new"), root.path().join("to"));
        for text in ["one", "two"] {
            fs::create_dir_all(&new).expect("made");
            fs::write(new.join("file"), text).expect("written");
            let known = inode(&new).expect("there");
            Disk::new().replace_dir(&new, &to).expect("replaced");
            assert_eq!(inode(&to).expect("there"), known);
            assert_eq!(fs::read_to_string(to.join("file")).expect("there"), text);
            assert!(!new.exists());
        }
        assert!(Disk::new().replace_dir(&new, &to).is_err(), "there is nothing new");
        assert!(to.exists());
    }

    #[test]
    fn what_a_killed_process_left_half_removed_is_cleared() {
        let root = tempfile::tempdir().expect("a folder");
        let new = root.path().join(".x.building");
        let old = name_of_replaced(&new);
        for folder in [&old, &root.path().join(".x.building.mine.old"), &root.path().join("x")] {
            fs::create_dir_all(folder.join("in")).expect("made");
        }
        Disk::new().clear_replaced(&new).expect("cleared");
        assert!(!old.exists());
        assert_eq!(fs::read_dir(root.path()).expect("listed").count(), 2, "others' folders stay");
    }

    /// Threads of one process do not share locks on handles of their own.
    #[test]
    fn many_replace_one_folder_and_each_stays_whole() {
        let root = tempfile::tempdir().expect("a folder");
        let to = root.path().join("to");
        std::thread::scope(|scope| {
            for number in 0..4 {
                let (root, to) = (root.path(), &to);
                scope.spawn(move || {
                    let new = root.join(format!(".{number}"));
                    for _ in 0..50 {
                        fs::create_dir(&new).expect("made");
                        for file in ["a", "b"] {
                            fs::write(new.join(file), [number]).expect("written");
                        }
                        Disk::new().replace_dir(&new, to).expect("replaced");
                        assert!(!new.exists());
                    }
                });
            }
        });
        let read = |file| fs::read(to.join(file)).expect("there");
        assert_eq!(read("a"), read("b"));
        assert_eq!(fs::read_dir(root.path()).expect("listed").count(), 1);
    }
}
