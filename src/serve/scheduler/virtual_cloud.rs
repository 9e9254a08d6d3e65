//! Keeps a list of all published COPC files beside them, `lodestone.vpc`: QGIS and PDAL
//! open the whole folder as one cloud by it. It is derived and never waited for: whenever
//! the files are others than those listed, it is written anew.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, UNIX_EPOCH};

use tokio::task::JoinHandle;

use super::tools::Tools;
use crate::export::vpc;
use crate::platform::clock::Millis;
use crate::platform::disk::Disk;

/// The list's name in the folder of octrees.
const NAME: &str = "lodestone.vpc";
/// The least time between two looks at the folder, in milliseconds.
const MIN_PAUSE_MS: Millis = 5_000;
/// The pause is so many times what the last look took.
const PAUSE_FACTOR: u128 = 20;

/// Path, bytes, and when each file was last changed.
type Files = Vec<(PathBuf, u64, Duration)>;

#[derive(Default)]
pub(super) struct VirtualCloud {
    look: Option<JoinHandle<(Option<Files>, Duration)>>,
    /// What the list has; nothing if it is to be written anew.
    listed: Option<Files>,
    next_at: Millis,
}

impl VirtualCloud {
    /// Takes note of what was written, and looks at the folder again if it is time.
    pub async fn turn(&mut self, tools: &Tools, resting: bool) {
        let now = tools.clock.now();
        if let Some(look) = self.look.take_if(|look| look.is_finished()) {
            let (listed, took) = look.await.unwrap_or_else(|error| {
                tracing::error!(%error, "the list of COPC files could not be made");
                (None, Duration::ZERO)
            });
            self.listed = listed;
            self.next_at = now + MIN_PAUSE_MS.max((took.as_millis() * PAUSE_FACTOR) as Millis);
        }
        // A clock that was set back must not silence it.
        let is_due = now >= self.next_at || self.next_at - now > 100 * MIN_PAUSE_MS;
        if resting || self.look.is_some() || !is_due {
            return;
        }
        let (folder, disk, listed) = (tools.config.octrees(), tools.disk.clone(), self.listed.take());
        let memory = tools.config.memory_limit / 8;
        self.look = Some(tokio::task::spawn_blocking(move || {
            let begun = Instant::now();
            (update(&folder, &disk, listed, memory), begun.elapsed())
        }));
    }
}

/// Writes the list if it is not that of the files, and gives what it then has; nothing if
/// some file is to be tried again.
fn update(folder: &Path, disk: &Disk, listed: Option<Files>, memory: u64) -> Option<Files> {
    let files = files(folder);
    if listed.as_ref() == Some(&files) {
        return listed;
    }
    let path = folder.join(NAME);
    if files.is_empty() {
        if path.exists()
            && let Err(error) = disk.remove_file(&path)
        {
            tracing::warn!(%error, "the list of COPC files stays, though there are none");
        }
        return Some(files);
    }
    let list = vpc::list(folder, folder, None, memory);
    for (path, reason) in &list.left_out {
        tracing::warn!(path = %path.display(), reason, "left out of {NAME}");
    }
    match disk.write_atomic(&path, list.json.as_bytes()) {
        Ok(()) => tracing::debug!(files = list.files, points = list.points, "wrote {NAME}"),
        Err(error) => {
            tracing::warn!(%error, "{NAME} could not be written; will retry");
            return None;
        }
    }
    list.left_out.is_empty().then_some(files)
}

fn files(folder: &Path) -> Files {
    let stamp = |path: PathBuf| {
        let metadata = std::fs::metadata(&path).ok()?;
        let changed = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        Some((path, metadata.len(), changed.unwrap_or_default()))
    };
    vpc::found(folder).into_iter().filter_map(stamp).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_follows_the_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, disk) = (folder.path().join(NAME), Disk::new());
        assert_eq!(update(folder.path(), &disk, None, 1 << 20), Some(Vec::new()));
        assert!(!path.exists());
        // A file that cannot be read is left out, and tried again.
        let below = folder.path().join("a");
        std::fs::create_dir(&below).expect("made");
        std::fs::write(below.join("a.copc.laz"), b"LASF").expect("written");
        assert_eq!(update(folder.path(), &disk, Some(Vec::new()), 1 << 20), None);
        let list: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&path).expect("read")).expect("JSON");
        assert_eq!(list["features"], serde_json::json!([]));
        std::fs::remove_dir_all(&below).expect("removed");
        assert_eq!(update(folder.path(), &disk, None, 1 << 20), Some(Vec::new()));
        assert!(!path.exists());
    }
}
