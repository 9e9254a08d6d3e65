//! Everything that is written goes through here: positioned writes,
//! write-sync-rename, and a counter of faults that a test can set, so that
//! "the disk is full at the n-th operation" is something that happens.
//!
//! Reading of inputs is positioned too, never by memory map: a file that is
//! truncated under a map kills the process with SIGBUS, and users do replace
//! files while they are read. Maps are for files that we wrote ourselves and
//! that nobody changes.

mod lock;
pub mod others;
mod replace;
mod seal;

use std::fs::{self, File, OpenOptions};
use std::io;
use std::num::NonZeroU64;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use rustix::fs::Advice;

pub use lock::DirLock;
use others::Links;
pub use replace::inode;
pub use seal::seal;

/// Whether nothing but a folder is at this path.
fn may_be_made(path: &Path) -> bool {
    path.symlink_metadata().map_or_else(|e| e.kind() == io::ErrorKind::NotFound, |meta| meta.is_dir())
}

/// What went wrong with which file, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[error("could not {action} {}: {source}{}", path.display(), advice(source))]
pub struct DiskError {
    pub action: &'static str,
    pub path: PathBuf,
    #[source]
    pub source: io::Error,
}

impl DiskError {
    pub fn new(action: &'static str, path: &Path, source: io::Error) -> DiskError {
        DiskError { action, path: path.to_path_buf(), source }
    }

    /// Whether trying again later, with nothing changed but the machine's
    /// state, can help: no room, no handles, an I/O error, a disk that is
    /// mounted read-only after one. Not so for a path that cannot exist or may
    /// not be touched.
    pub fn may_pass(&self) -> bool {
        !matches!(
            self.source.kind(),
            io::ErrorKind::NotFound
                | io::ErrorKind::PermissionDenied
                | io::ErrorKind::NotADirectory
                | io::ErrorKind::InvalidInput
                | io::ErrorKind::InvalidFilename
        )
    }
}

fn advice(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => " (free some room and try again)",
        io::ErrorKind::PermissionDenied => " (check who owns it and its permissions)",
        io::ErrorKind::ReadOnlyFilesystem => " (the file system is mounted read-only)",
        _ => "",
    }
}

pub type Result<T> = std::result::Result<T, DiskError>;

/// A fault that strikes the n-th operation that changes the disk.
#[derive(Debug)]
struct Faults {
    countdown: AtomicI64,
    error: io::ErrorKind,
}

/// The disk as the stages see it. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Disk {
    faults: Option<Arc<Faults>>,
    written: Arc<AtomicU64>,
    links: Links,
}

impl Disk {
    pub fn new() -> Disk {
        Disk::default()
    }

    /// A disk whose `nth` changing operation (from 0) and all after it fail
    /// with `error`, writes after half of their bytes; for tests.
    pub fn failing_from(nth: i64, error: io::ErrorKind) -> Disk {
        Disk { faults: Some(Arc::new(Faults { countdown: AtomicI64::new(nth), error })), ..Disk::default() }
    }

    /// A disk whose inputs lie in watched folders, where others may put links.
    pub fn refusing_links(self) -> Disk {
        Disk { links: Links::Refused, ..self }
    }

    /// Whether links on the way to inputs are followed.
    pub fn links(&self) -> Links {
        self.links
    }

    /// Ends the faults of this disk, and of all its clones.
    pub fn heal(&self) {
        if let Some(faults) = &self.faults {
            faults.countdown.store(i64::MAX, Ordering::SeqCst);
        }
    }

    /// Whether a fault has struck.
    pub fn has_failed(&self) -> bool {
        self.faults.as_ref().is_some_and(|faults| faults.countdown.load(Ordering::SeqCst) < 0)
    }

    /// Bytes written through this disk so far.
    pub fn bytes_written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    fn strike(&self, action: &'static str, path: &Path) -> Result<()> {
        match &self.faults {
            Some(faults) if faults.countdown.fetch_sub(1, Ordering::SeqCst) <= 0 => {
                Err(DiskError::new(action, path, io::Error::from(faults.error)))
            }
            _ => Ok(()),
        }
    }

    pub fn create_dir_all(&self, path: &Path) -> Result<()> {
        self.strike("make the folder", path)?;
        loop {
            match fs::create_dir_all(path) {
                // It was there, and had another name, or was gone, when it was looked at.
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists && may_be_made(path) => {}
                made => return made.map_err(|e| DiskError::new("make the folder", path, e)),
            }
        }
    }

    /// Creates a file, or empties the one that is there.
    pub fn create(&self, path: &Path) -> Result<DiskFile> {
        self.open_for_writing(path, true)
    }

    /// Opens a file to go on writing it, or creates it.
    pub fn reopen(&self, path: &Path) -> Result<DiskFile> {
        self.open_for_writing(path, false)
    }

    fn open_for_writing(&self, path: &Path, truncate: bool) -> Result<DiskFile> {
        self.strike("create", path)?;
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(truncate)
            .open(path)
            .map_err(|e| DiskError::new("create", path, e))?;
        Ok(DiskFile { file, path: path.to_path_buf(), disk: self.clone() })
    }

    /// Makes a file of ours last that is open nowhere; one that is gone is fine.
    pub fn sync_file(&self, path: &Path) -> Result<()> {
        self.strike("sync", path)?;
        match File::open(path).and_then(|file| file.sync_data()) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(DiskError::new("sync", path, e)),
            _ => Ok(()),
        }
    }

    /// Empties a folder, which stays, or makes it.
    pub fn empty_dir(&self, path: &Path) -> Result<()> {
        self.create_dir_all(path)?;
        let failed = |e| DiskError::new("empty the folder", path, e);
        for entry in fs::read_dir(path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            if entry.file_type().map_err(failed)?.is_dir() {
                self.remove_dir_all(&entry.path())?;
            } else {
                self.remove_file(&entry.path())?;
            }
        }
        Ok(())
    }

    /// Writes a whole small file so that it is there whole or not at all, also
    /// after a power cut: temporary name, sync, rename, sync of the folder.
    pub fn write_atomic(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let mut temporary = path.as_os_str().to_owned();
        temporary.push(".tmp");
        let temporary = PathBuf::from(temporary);
        let file = self.create(&temporary)?;
        file.write_all_at(bytes, 0)?;
        file.sync()?;
        self.rename(&temporary, path)
    }

    /// Renames and makes the rename last (both in the same folder, or in two
    /// folders of one file system).
    pub fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        self.strike("rename", from)?;
        fs::rename(from, to).map_err(|e| DiskError::new("rename", from, e))?;
        if let Some(folder) = to.parent() {
            self.sync_dir(folder)?;
        }
        Ok(())
    }

    pub fn sync_dir(&self, path: &Path) -> Result<()> {
        self.strike("sync the folder", path)?;
        let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
        File::open(path).and_then(|f| f.sync_all()).map_err(|e| DiskError::new("sync the folder", path, e))
    }

    /// Removes a folder and all in it; one that is not there is fine.
    pub fn remove_dir_all(&self, path: &Path) -> Result<()> {
        match fs::remove_dir_all(path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => {
                Err(DiskError::new("remove the folder", path, e))
            }
            _ => Ok(()),
        }
    }

    /// Removes a file; one that is not there is fine.
    pub fn remove_file(&self, path: &Path) -> Result<()> {
        match fs::remove_file(path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(DiskError::new("remove", path, e)),
            _ => Ok(()),
        }
    }

    /// Bytes that may still be written on the file system that holds `path`
    /// (or the nearest folder above it that exists).
    pub fn free_space(&self, path: &Path) -> Result<u64> {
        let existing = path.ancestors().find(|p| p.exists()).unwrap_or(Path::new("/"));
        let stat = rustix::fs::statvfs(existing)
            .map_err(|e| DiskError::new("ask the free space of", existing, e.into()))?;
        Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
    }
}

/// A file open for positioned reads and writes, from several threads at once.
#[derive(Debug)]
pub struct DiskFile {
    file: File,
    path: PathBuf,
    disk: Disk,
}

impl DiskFile {
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn write_all_at(&self, bytes: &[u8], offset: u64) -> Result<()> {
        self.disk.strike("write to", &self.path).inspect_err(|_| {
            // A full disk takes what still fits.
            let _ = self.file.write_all_at(&bytes[..bytes.len() / 2], offset);
        })?;
        self.file.write_all_at(bytes, offset).map_err(|e| DiskError::new("write to", &self.path, e))?;
        self.disk.written.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    /// Has the system begin to carry to the disk what was just written, so that
    /// [`DiskFile::sync`] finds little left to wait for. It is how Linux starts on
    /// "not needed soon": pages that are on their way stay in memory. Only advice:
    /// whether it was taken is not asked.
    pub fn begin_sync(&self, offset: u64, bytes: u64) {
        if let Some(bytes) = NonZeroU64::new(bytes) {
            let _ = rustix::fs::fadvise(&self.file, offset, Some(bytes), Advice::DontNeed);
        }
    }

    pub fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> Result<()> {
        self.file.read_exact_at(bytes, offset).map_err(|e| DiskError::new("read from", &self.path, e))
    }

    /// Its length in bytes.
    pub fn length(&self) -> Result<u64> {
        let metadata = self.file.metadata();
        metadata.map(|m| m.len()).map_err(|e| DiskError::new("look at", &self.path, e))
    }

    /// Bytes of disk that it takes up now; less than its length where it has holes.
    pub fn allocated(&self) -> Result<u64> {
        use std::os::unix::fs::MetadataExt;
        let metadata = self.file.metadata();
        metadata.map(|m| m.blocks() * 512).map_err(|e| DiskError::new("look at", &self.path, e))
    }

    /// Cuts off what lies behind `length`.
    pub fn cut_to(&self, length: u64) -> Result<()> {
        self.disk.strike("cut", &self.path)?;
        self.file.set_len(length).map_err(|e| DiskError::new("cut", &self.path, e))
    }

    /// Makes what was written last.
    pub fn sync(&self) -> Result<()> {
        self.disk.strike("sync", &self.path)?;
        self.file.sync_data().map_err(|e| DiskError::new("sync", &self.path, e))
    }
}
