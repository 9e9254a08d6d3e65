//! What a file looked like, to see whether it changed.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// What a file looked like, without opening it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileStamp {
    pub path: PathBuf,
    /// Bytes.
    pub size: u64,
    /// Nanoseconds since 1970.
    pub mtime_ns: i64,
    /// The file's number on its file system; zero where such numbers do not last.
    pub inode: u64,
    /// When anything of it changed last, its name among it; in nanoseconds since
    /// 1970. Nobody can set it, as one can the other time.
    pub ctime_ns: i64,
}

impl FileStamp {
    pub fn new(path: &Path, meta: &fs::Metadata) -> FileStamp {
        let ns = |seconds: i64, nanos: i64| seconds.saturating_mul(1_000_000_000).saturating_add(nanos);
        FileStamp {
            path: path.to_path_buf(),
            size: meta.len(),
            mtime_ns: ns(meta.mtime(), meta.mtime_nsec()),
            inode: meta.ino(),
            ctime_ns: ns(meta.ctime(), meta.ctime_nsec()),
        }
    }
}
