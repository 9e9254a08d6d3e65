//! The folders under the root, and the lock that keeps a second daemon out.

use std::fs::File;
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};

use super::DaemonError;
use crate::config::Config;
use crate::disk::{Disk, DiskError};

/// Makes the folders, and names all of them from the file system's root: paths in
/// the queue must mean the same wherever the daemon is started.
pub(super) fn open(mut config: Config, disk: &Disk) -> Result<Config, DaemonError> {
    disk.create_dir_all(&config.root)?;
    config.root = absolute(&config.root)?;
    for folder in [config.inbox(), config.octrees(), config.scratch()] {
        disk.create_dir_all(&folder)?;
    }
    disk.create_dir_all(&config.octrees().join(".staged"))?;
    for folder in &mut config.watch {
        // One that is not there now may be a mount that comes later.
        *folder = match folder.canonicalize() {
            Ok(folder) => folder,
            Err(_) => std::path::absolute(&folder).unwrap_or_else(|_| folder.clone()),
        };
    }
    Ok(config)
}

fn absolute(path: &Path) -> Result<PathBuf, DiskError> {
    path.canonicalize().map_err(|source| DiskError::new("find", path, source))
}

/// Takes the lock of the root; it is free again when the file is dropped, or the
/// process dies in whatever way.
pub(super) fn lock(config: &Config) -> Result<File, DaemonError> {
    let path = config.root.join("lodestone.lock");
    let file = File::create(&path).map_err(|source| DiskError::new("create", &path, source))?;
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(file),
        Err(rustix::io::Errno::WOULDBLOCK) => {
            Err(DaemonError::Locked { root: config.root.clone(), lock: path })
        }
        Err(errno) => Err(DiskError::new("lock", &path, errno.into()).into()),
    }
}
