//! File events as hints. All that is taken from an event is "look soon" or
//! "events were lost, look at everything": what happened, the scan finds out.
//!
//! Events do not come from other machines on network file systems, nor through
//! many bind mounts, and no error tells so. Each folder is therefore tested, and
//! where events cannot be trusted the scans come more often instead.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use notify::event::{AccessKind, AccessMode};
use notify::{EventKind, RecursiveMode, Watcher as _};
use serde::Serialize;
use tokio::sync::Notify;

/// How news of a watched folder comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum NotifyMode {
    /// The system tells us.
    Events,
    /// We look often.
    Polling,
}

/// What the events have said since they were last asked.
#[derive(Debug, Default)]
pub struct Hints {
    /// Rung at every event that may matter.
    pub bell: Notify,
    lost: AtomicBool,
    events: AtomicU64,
    overflows: AtomicU64,
}

impl Hints {
    /// Events that mattered, since the start.
    pub fn events(&self) -> u64 {
        self.events.load(Ordering::Relaxed)
    }
    /// How often events were lost, since the start.
    pub fn overflows(&self) -> u64 {
        self.overflows.load(Ordering::Relaxed)
    }
    /// Whether events were lost since this was last asked.
    pub fn take_lost(&self) -> bool {
        self.lost.swap(false, Ordering::SeqCst)
    }

    fn hear(&self, event: notify::Result<notify::Event>) {
        match event {
            Ok(event) if event.need_rescan() => self.lose(),
            Ok(event) if !matters(&event.kind) => return,
            Ok(_) => {
                self.events.fetch_add(1, Ordering::Relaxed);
            }
            Err(error) => {
                // Errors come in swarms, as events do.
                if !self.lost.load(Ordering::SeqCst) {
                    tracing::warn!(%error, "file events failed; the folders are scanned instead");
                }
                self.lose();
            }
        }
        self.bell.notify_one();
    }

    fn lose(&self) {
        self.lost.store(true, Ordering::SeqCst);
        self.overflows.fetch_add(1, Ordering::Relaxed);
    }
}

/// Reading is no news, least of all our own.
fn matters(kind: &EventKind) -> bool {
    match kind {
        EventKind::Access(AccessKind::Close(AccessMode::Write)) => true,
        EventKind::Access(_) => false,
        _ => true,
    }
}

/// The system's watcher; events stop when it is dropped.
pub struct Events {
    watcher: Option<notify::RecommendedWatcher>,
    pub hints: Arc<Hints>,
    pub modes: Vec<(PathBuf, NotifyMode)>,
}

impl Events {
    /// Starts watching; where that fails a folder is polled.
    pub fn start(roots: &[PathBuf]) -> Events {
        let hints = Arc::new(Hints::default());
        let heard = hints.clone();
        // A link in a watched folder must not have us watch the whole machine.
        let config = notify::Config::default().with_follow_symlinks(false);
        let mut watcher = notify::RecommendedWatcher::new(move |event| heard.hear(event), config)
            .inspect_err(|error| tracing::warn!(%error, "no file events; the folders are scanned instead"))
            .ok();
        let modes = roots.iter().map(|root| (root.clone(), mode_of(root, &mut watcher, &hints))).collect();
        Events { watcher, hints, modes }
    }

    /// Watches again what came back, as a mount does.
    pub fn revive(&mut self, root: &Path) {
        if let Some(watcher) = &mut self.watcher {
            // The old watch may be dead or alive; either way the new one counts.
            let _ = watcher.unwatch(&root.canonicalize().unwrap_or_else(|_| root.to_path_buf()));
        }
        let mode = mode_of(root, &mut self.watcher, &self.hints);
        self.modes.iter_mut().filter(|(path, _)| path == root).for_each(|(_, m)| *m = mode);
    }

    pub fn any_polling(&self) -> bool {
        self.modes.iter().any(|(_, mode)| *mode == NotifyMode::Polling)
    }
}

fn mode_of(root: &Path, watcher: &mut Option<notify::RecommendedWatcher>, hints: &Hints) -> NotifyMode {
    let Some(watcher) = watcher else { return NotifyMode::Polling };
    // The folder itself may be a link.
    let real = root.canonicalize().unwrap_or_else(|_| root.to_path_buf());
    if let Err(error) = watcher.watch(&real, RecursiveMode::Recursive) {
        tracing::warn!(
            root = %root.display(), %error,
            "no file events for this folder, it is polled (a watch limit? see fs.inotify.max_user_watches)"
        );
        return NotifyMode::Polling;
    }
    if is_remote(root) {
        tracing::info!(root = %root.display(), "a network or virtual file system: polled, for its events are incomplete");
        return NotifyMode::Polling;
    }
    match self_test(root, hints) {
        Some(false) => {
            tracing::warn!(root = %root.display(), "its events do not arrive: polled");
            NotifyMode::Polling
        }
        _ => NotifyMode::Events,
    }
}

/// File systems on which others write without our kernel noticing.
fn is_remote(root: &Path) -> bool {
    const REMOTE: [u64; 7] = [
        0x6969,      // NFS
        0x517B,      // SMB
        0xFF53_4D42, // CIFS
        0xFE53_4D42, // SMB2
        0x6573_5546, // FUSE: sshfs, s3fs, virtiofs, Docker Desktop
        0x0102_1997, // 9P
        0x786F_4256, // VirtualBox
    ];
    rustix::fs::statfs(root).is_ok_and(|stat| REMOTE.contains(&(stat.f_type as u64 & 0xFFFF_FFFF)))
}

/// Whether a file keeps its inode's number here as long as it is there. Where
/// others give the numbers out, they may change whenever it is mounted.
pub(super) fn has_inodes(root: &Path) -> bool {
    const OVERLAY: u64 = 0x794C_7630;
    let is_overlay = rustix::fs::statfs(root).is_ok_and(|stat| stat.f_type as u64 & 0xFFFF_FFFF == OVERLAY);
    !is_remote(root) && !is_overlay
}

/// Makes a file and listens for it; nothing is told where we may not write.
fn self_test(root: &Path, hints: &Hints) -> Option<bool> {
    let path = root.join(format!(".lodestone-self-test-{}", std::process::id()));
    let before = hints.events();
    std::fs::write(&path, b"").ok()?;
    let start = Instant::now();
    let mut heard = false;
    while !heard && start.elapsed() < Duration::from_secs(2) {
        std::thread::sleep(Duration::from_millis(10));
        heard = hints.events() > before;
    }
    if let Err(error) = std::fs::remove_file(&path) {
        tracing::warn!(path = %path.display(), %error, "the self-test's file is left over");
    }
    Some(heard)
}

#[cfg(test)]
mod tests {
    use super::*;
    use notify::event::{CreateKind, Flag};

    /// As the system tells it when its queue ran over: no paths, only that
    /// something was lost.
    #[test]
    fn an_overflow_of_the_event_queue_asks_for_a_rescan() {
        let hints = Hints::default();
        hints.hear(Ok(notify::Event::new(EventKind::Create(CreateKind::File))));
        assert!(!hints.take_lost(), "an event is not a loss");
        hints.hear(Ok(notify::Event::new(EventKind::Other).set_flag(Flag::Rescan)));
        assert_eq!((hints.events(), hints.overflows()), (1, 1));
        assert!(hints.take_lost() && !hints.take_lost(), "told once");
        hints.hear(Err(notify::Error::generic("the watch died")));
        assert!(hints.take_lost(), "so is a failure of the events themselves");
    }

    #[test]
    fn our_own_reading_is_no_news() {
        let hints = Hints::default();
        hints.hear(Ok(notify::Event::new(EventKind::Access(AccessKind::Read))));
        assert_eq!(hints.events(), 0);
    }
}
