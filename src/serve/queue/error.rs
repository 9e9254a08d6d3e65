//! Why the queue could not be worked, in words for the person who runs the daemon.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rustix::fs::Access;
use rustix::io::Errno;

use crate::serve::job::JobId;

#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error("could not open the queue {}: {}", path.display(), obstacle(path).unwrap_or_else(|| format!("{source} (is this a Lodestone database?)")))]
    Open {
        path: PathBuf,
        #[source]
        source: sqlx::Error,
    },
    #[error("there is no queue {}: {} (name the daemon's root folder by --root, LODESTONE_ROOT or the file of --config)", path.display(), obstacle(path).unwrap_or_else(|| "no daemon has worked here yet".to_string()))]
    Missing { path: PathBuf },
    #[error("the queue {} is of version {found}, and this program needs {needed}: start its daemon once, which brings it up to date", path.display())]
    Outdated { path: PathBuf, found: i64, needed: i64 },
    #[error("{} is no queue of Lodestone's (name the daemon's root folder by --root)", path.display())]
    NotAQueue { path: PathBuf },
    #[error("could not bring the queue {} up to date: {source} (it may have been written by a newer Lodestone)", path.display())]
    Migrate {
        path: PathBuf,
        #[source]
        source: sqlx::migrate::MigrateError,
    },
    #[error("the queue did not answer: {0} (see the free space and the health of its disk)")]
    Query(#[from] sqlx::Error),
    #[error("there is no job {0} (`lodestone jobs list` shows all)")]
    NoSuchJob(JobId),
    #[error("job {job} is {state}; an order to {asked} it means nothing now")]
    Illegal { job: JobId, state: &'static str, asked: &'static str },
    #[error(
        "the queue holds {what} `{value}` that this version does not know (was it written by a newer Lodestone?)"
    )]
    Unknown { what: &'static str, value: String },
}

pub type Result<T> = std::result::Result<T, StoreError>;

/// What is in the way of opening a queue, where its place says it: SQLite has the same
/// few words for all of that. It writes beside the file even to read it.
fn obstacle(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let told = folder.display();
    match folder.metadata() {
        Ok(metadata) if !metadata.is_dir() => return Some(format!("{told} is not a folder")),
        Ok(_) => {}
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return Some(format!("the folder {told} is not there"));
        }
        Err(error) => return Some(format!("the folder {told} cannot be looked at: {error}")),
    }
    if path.is_dir() {
        return Some("it is a folder".to_string());
    }
    let may = |path: &Path, access: Access| rustix::fs::access(path, access);
    if let Err(error) = may(folder, Access::WRITE_OK | Access::EXEC_OK) {
        return Some(format!(
            "the folder {told} cannot be written to: {error} (check who owns it and its permissions)"
        ));
    }
    match may(path, Access::READ_OK | Access::WRITE_OK) {
        Err(error) if error != Errno::NOENT => {
            Some(format!("it cannot be read and written: {error} (check who owns it and its permissions)"))
        }
        _ => None,
    }
}
