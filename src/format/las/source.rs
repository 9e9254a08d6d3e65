//! The file that is read: positioned reads from any thread, and a memory of
//! what the file was like when it was opened.
//!
//! Never a memory map: users replace and cut files while they are read, and a
//! cut map kills the process.

use std::fs::{File, Metadata};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use super::error::LasError;
use crate::platform::disk::others::{self, Links};

/// Handles that all sources together keep open. A data set may have more tiles
/// than a process may have files; those beyond are opened for each read.
const MOST_KEPT: usize = 64;

/// Extents of a sparse file that are looked at.
const MOST_EXTENTS: usize = 1 << 16;

static KEPT: AtomicUsize = AtomicUsize::new(0);

#[derive(Debug)]
pub struct FileReader {
    kept: Option<PooledFile>,
    path: PathBuf,
    links: Links,
    opened: FileIdentity,
}

/// A handle that counts.
#[derive(Debug)]
struct PooledFile(File);

impl PooledFile {
    fn new(file: File) -> Option<PooledFile> {
        // Counted first, so that no two threads take the last place.
        let kept = KEPT.fetch_add(1, Ordering::Relaxed) < MOST_KEPT;
        if !kept {
            KEPT.fetch_sub(1, Ordering::Relaxed);
        }
        kept.then(|| PooledFile(file))
    }
}

impl Drop for PooledFile {
    fn drop(&mut self) {
        KEPT.fetch_sub(1, Ordering::Relaxed);
    }
}

/// What tells a file from one that took its place or grew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FileIdentity {
    device: u64,
    inode: u64,
    bytes: u64,
    /// Seconds and nanoseconds of the last change.
    modified: (i64, i64),
}

impl FileIdentity {
    fn of(metadata: &Metadata) -> FileIdentity {
        FileIdentity {
            device: metadata.dev(),
            inode: metadata.ino(),
            bytes: metadata.len(),
            modified: (metadata.mtime(), metadata.mtime_nsec()),
        }
    }
}

impl FileReader {
    pub fn open(path: &Path, links: Links) -> Result<FileReader, LasError> {
        let (file, metadata) = others::open_file(path, links).map_err(|error| match error.kind() {
            io::ErrorKind::InvalidInput => LasError::not_las(path, error.to_string()),
            _ => LasError::io("open", path, error),
        })?;
        let opened = FileIdentity::of(&metadata);
        Ok(FileReader { kept: PooledFile::new(file), path: path.to_path_buf(), links, opened })
    }

    /// A second handle on the same file.
    pub fn reopen(&self) -> Result<FileReader, LasError> {
        let file = match &self.kept {
            Some(PooledFile(file)) => {
                Some(file.try_clone().map_err(|e| LasError::io("open", &self.path, e))?)
            }
            None => None,
        };
        let kept = file.and_then(PooledFile::new);
        Ok(FileReader { kept, path: self.path.clone(), links: self.links, opened: self.opened })
    }

    /// Reads by the handle that is kept, or by one for this read alone.
    fn with<T>(&self, read: impl FnOnce(&File) -> io::Result<T>) -> Result<T, LasError> {
        let read = |file: &File| {
            read(file).map_err(|error| match error.kind() {
                io::ErrorKind::UnexpectedEof => self.changed("it became shorter"),
                _ => LasError::io("read", &self.path, error),
            })
        };
        if let Some(PooledFile(file)) = &self.kept {
            return read(file);
        }
        let (file, now) = others::open_file(&self.path, self.links).map_err(|e| self.gone("open", e))?;
        if (now.dev(), now.ino()) != (self.opened.device, self.opened.inode) {
            return Err(self.changed("another file took its place"));
        }
        read(&file)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The length when it was opened.
    pub fn bytes(&self) -> u64 {
        self.opened.bytes
    }

    pub fn read_exact_at(&self, bytes: &mut [u8], position: u64) -> Result<(), LasError> {
        self.with(|file| file.read_exact_at(bytes, position))
    }

    /// Its length and the time of its last change, when it was opened.
    pub fn stamp(&self) -> String {
        let FileIdentity { bytes, modified: (seconds, nanos), .. } = self.opened;
        format!("{bytes} {seconds}.{nanos:09}")
    }

    /// As much as there is, up to the buffer's length.
    pub fn read_at(&self, bytes: &mut [u8], position: u64) -> io::Result<usize> {
        self.with(|file| file.read_at(bytes, position)).map_err(io::Error::other)
    }

    pub fn check_unchanged(&self) -> Result<(), LasError> {
        // By its path, too: a file that was replaced lives on behind the
        // handle, but it is no longer what the user means.
        let now = others::look_at(&self.path, self.links).map_err(|e| self.gone("look at", e))?;
        let now = FileIdentity::of(&now);
        let then = self.opened;
        if now.bytes != then.bytes {
            return Err(self.changed(&format!("it had {} bytes and now has {}", then.bytes, now.bytes)));
        }
        if (now.device, now.inode) != (then.device, then.inode) {
            return Err(self.changed("another file took its place"));
        }
        if now.modified != then.modified {
            return Err(self.changed("somebody wrote to it"));
        }
        Ok(())
    }

    /// Why what was a file when it was opened is none any more.
    fn gone(&self, action: &'static str, error: io::Error) -> LasError {
        match error.kind() {
            io::ErrorKind::NotFound => self.changed("it was removed or renamed"),
            io::ErrorKind::InvalidInput => self.changed(&format!("something took its place: {error}")),
            _ => LasError::io(action, &self.path, error),
        }
    }

    /// Where a hole of a sparse file that reaches up to `end` begins, but not in
    /// front of `from`; `end` where there is none, or the file system tells nothing.
    pub fn hole_before(&self, end: u64, from: u64) -> u64 {
        let data_from = |at: u64| {
            self.with(|file| match rustix::fs::seek(file, rustix::fs::SeekFrom::Data(at)) {
                Ok(data) => Ok(data),
                // There is nothing but a hole up to the file's end.
                Err(rustix::io::Errno::NXIO) => Ok(u64::MAX),
                Err(error) => Err(error.into()),
            })
        };
        let is_hole = |at: u64| data_from(at).is_ok_and(|data| data >= end);
        if from >= end || !is_hole(end - 1) {
            return end;
        }
        if is_hole(from) {
            return from;
        }
        // Not the lowest of all places that will do where data and holes alternate.
        let (mut data, mut hole) = (from, end - 1);
        while hole - data > 1 {
            let middle = data + (hole - data) / 2;
            if is_hole(middle) { hole = middle } else { data = middle }
        }
        hole
    }

    /// Bytes between `from` and `to` that were never written: holes of a sparse file.
    pub fn holes(&self, from: u64, to: u64) -> u64 {
        if to <= from {
            return 0;
        }
        let measured = self.with(|file| {
            let (mut at, mut data) = (from, 0);
            for _ in 0..MOST_EXTENTS {
                let start = match rustix::fs::seek(file, rustix::fs::SeekFrom::Data(at)) {
                    Ok(start) if start < to => start,
                    Ok(_) | Err(rustix::io::Errno::NXIO) => return Ok(to - from - data),
                    Err(error) => return Err(error.into()),
                };
                let end = rustix::fs::seek(file, rustix::fs::SeekFrom::Hole(start))?.min(to);
                data += end - start;
                at = end;
                if at >= to {
                    return Ok(to - from - data);
                }
            }
            // So torn that it is not worth looking further: what is left counts as data.
            Ok(at - from - data)
        });
        measured.unwrap_or(0)
    }

    fn changed(&self, reason: &str) -> LasError {
        LasError::Changed { path: self.path.clone(), reason: reason.to_string() }
    }
}
