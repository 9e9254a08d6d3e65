//! Why the daemon could not start.

use std::net::SocketAddr;
use std::path::PathBuf;

use crate::platform::disk::DiskError;
use crate::serve::queue::StoreError;

#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    #[error(transparent)]
    Disk(#[from] DiskError),
    #[error("another Lodestone works in {} (its lock {} is held); stop that one, or give this one its own --root", root.display(), lock.display())]
    Locked { root: PathBuf, lock: PathBuf },
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("could not listen on {address}: {source} (is the port taken? see --listen)")]
    Listen {
        address: SocketAddr,
        #[source]
        source: std::io::Error,
    },
    #[error("could not start: {0}")]
    Start(#[source] std::io::Error),
    #[error("a metric stands twice: {0}")]
    Metrics(#[from] prometheus::Error),
}
