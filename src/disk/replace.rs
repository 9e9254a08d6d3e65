//! A folder takes another's name in one step, so that whoever looks sees the old
//! one or the new one, and after a crash it can be told which of the two it is.

use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;

use super::{Disk, DiskError, Result};

/// What tells a folder from another that has, or had, its name.
pub fn inode(path: &Path) -> io::Result<u64> {
    std::fs::symlink_metadata(path).map(|meta| meta.ino())
}

impl Disk {
    /// Gives the folder `new` the name `to`, on the same file system, and makes
    /// that last. What has the name until then is exchanged, and removed after.
    pub fn replace_dir(&self, new: &Path, to: &Path) -> Result<()> {
        if to.symlink_metadata().is_err() {
            return self.rename(new, to);
        }
        self.strike("put in its place", to)?;
        match renameat_with(CWD, new, CWD, to, RenameFlags::EXCHANGE) {
            Ok(()) => {
                let (target, source) = (to.parent(), new.parent());
                for folder in target.into_iter().chain(source.filter(|folder| Some(*folder) != target)) {
                    self.sync_dir(folder)?;
                }
                self.remove_dir_all(new)
            }
            // Not every file system can exchange. The name is then free for a
            // moment, but never half of a folder has it.
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {
                let old = new.with_extension("old");
                self.remove_dir_all(&old)?;
                self.rename(to, &old)?;
                self.rename(new, to)?;
                self.remove_dir_all(&old)
            }
            Err(errno) => Err(DiskError::new("put in its place", to, errno.into())),
        }
    }
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
}
