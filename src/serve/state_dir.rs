//! The folders under the root, and the lock that keeps a second daemon out.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::{FlockOperation, flock};

use super::error::DaemonError;
use crate::platform::disk::{Disk, DiskError};
use crate::serve::config::Config;

/// Makes the folders, and names all of them from the file system's root: paths in
/// the queue must mean the same wherever the daemon is started.
pub(super) fn open(mut config: Config, disk: &Disk) -> Result<Config, DaemonError> {
    disk.create_dir_all(&config.root)?;
    config.root = absolute(&config.root)?;
    for folder in [config.inbox(), config.octrees(), config.scratch()] {
        disk.create_dir_all(&folder)?;
    }
    disk.create_dir_all(&config.octrees().join(".staged"))?;
    // Of a daemon that died over them; whoever sent them knows.
    disk.remove_dir_all(&crate::serve::web::uploads(&config.inbox()))?;
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

/// How long a lock is waited for: a daemon that was killed holds its own until the
/// kernel has cleared all of it away, and who restarts it is often quicker.
const PATIENCE: Duration = Duration::from_secs(3);
const LOOK: Duration = Duration::from_millis(50);

/// Takes the lock of the root; it is free again when the file is dropped, or the
/// process dies in whatever way.
pub(super) async fn lock(config: &Config) -> Result<File, DaemonError> {
    let path = config.root.join("lodestone.lock");
    let file = File::create(&path).map_err(|source| DiskError::new("create", &path, source))?;
    let start = Instant::now();
    loop {
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => return Ok(file),
            Err(rustix::io::Errno::WOULDBLOCK) if start.elapsed() < PATIENCE => {
                tokio::time::sleep(LOOK).await;
            }
            Err(rustix::io::Errno::WOULDBLOCK) => {
                return Err(DaemonError::Locked { root: config.root.clone(), lock: path });
            }
            Err(errno) => return Err(DiskError::new("lock", &path, errno.into()).into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::config::Layer;

    #[tokio::test]
    async fn the_lock_of_a_daemon_that_is_just_dying_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = Config::from_layer(Layer::default()).unwrap();
        config.root = folder.path().to_path_buf();
        let dying = lock(&config).await.unwrap();
        let mut restarted = std::pin::pin!(lock(&config));
        tokio::select! {
            biased;
            outcome = &mut restarted => panic!("not waited: {outcome:?}"),
            () = tokio::task::yield_now() => {}
        }
        drop(dying);
        restarted.await.unwrap();
    }
}
