//! What lies in a source, found without following a single link: every folder is
//! opened by its name within the one above, so that nobody who may write to the
//! inbox can lead us elsewhere, not even while we look.

use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use rustix::fs::{AtFlags, CWD, Dir, FileType, Mode, OFlags, Stat, openat, statat};
use rustix::io::Errno;

use super::plan::{NotMoved, full};
use crate::serve::watch::names;

const FOLDER: OFlags = OFlags::DIRECTORY.union(OFlags::NOFOLLOW).union(OFlags::CLOEXEC);
/// Deeper than any data set that the watcher takes.
const DEEPEST: usize = 40;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FileKind {
    File,
    Folder,
    /// A link, a socket, a device.
    Other,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ListedFile {
    /// Within the source; empty for the source itself.
    pub path: PathBuf,
    pub kind: FileKind,
    pub size: u64,
    pub mtime_ns: i64,
    /// The number and the time of change, of a file: those of a folder change with
    /// what is removed from it.
    pub inode: u64,
    pub ctime_ns: i64,
}

impl ListedFile {
    fn new(path: PathBuf, stat: &Stat) -> ListedFile {
        let kind = match FileType::from_raw_mode(stat.st_mode) {
            FileType::RegularFile => FileKind::File,
            FileType::Directory => FileKind::Folder,
            _ => FileKind::Other,
        };
        let ns = |seconds: i64, nanos: i64| seconds.saturating_mul(1_000_000_000).saturating_add(nanos);
        let (mtime_ns, ctime_ns) =
            (ns(stat.st_mtime, stat.st_mtime_nsec as i64), ns(stat.st_ctime, stat.st_ctime_nsec as i64));
        ListedFile { path, kind, size: stat.st_size as u64, mtime_ns, inode: stat.st_ino, ctime_ns }
    }

    /// Whether it has the name of what macOS keeps beside a file, and is not that.
    pub fn is_disguised(&self, looked: &SourceListing) -> bool {
        let Some(name) = self.path.file_name().and_then(OsStr::to_str) else { return true };
        if !name.starts_with("._") {
            return self.kind != FileKind::File;
        }
        self.kind != FileKind::File || self.first_bytes(looked) != Some([0, 5, 0x16, 7])
    }

    /// By its name, or by its first bytes where the name tells nothing.
    pub fn looks_like_a_cloud(&self, looked: &SourceListing) -> bool {
        let Some(name) = self.path.file_name().or(Some(looked.name.as_os_str())).and_then(OsStr::to_str)
        else {
            return true;
        };
        names::is_cloud(name)
            || names::is_under_way(name)
            || (names::may_be_temporary(name) && self.first_bytes(looked) == Some(*b"LASF"))
    }

    fn first_bytes(&self, looked: &SourceListing) -> Option<[u8; 4]> {
        let mut bytes = [0; 4];
        looked.open(self).ok()?.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }
}

/// A source with all that is in it, folders before what they hold.
pub(super) struct SourceListing {
    pub root: OwnedFd,
    pub name: PathBuf,
    pub entries: Vec<ListedFile>,
}

impl SourceListing {
    pub fn find(&self, relative: &Path) -> Option<&ListedFile> {
        self.entries.iter().find(|entry| entry.path == relative)
    }

    /// The folder that an entry lies in, opened link by link, and its name there.
    pub fn place(&self, entry: &Path) -> Result<(OwnedFd, PathBuf), Errno> {
        let path = full(&self.name, entry);
        let mut folder = openat(&self.root, ".", FOLDER, Mode::empty())?;
        for component in path.parent().into_iter().flat_map(Path::components) {
            folder = openat(&folder, component.as_os_str(), FOLDER, Mode::empty())?;
        }
        let name = path.file_name().ok_or(Errno::INVAL)?.into();
        Ok((folder, name))
    }

    /// What an entry is now.
    pub fn again(&self, entry: &ListedFile) -> Result<ListedFile, Errno> {
        let (folder, name) = self.place(&entry.path)?;
        let stat = statat(&folder, &name, AtFlags::SYMLINK_NOFOLLOW)?;
        Ok(ListedFile::new(entry.path.clone(), &stat))
    }

    pub fn open(&self, entry: &ListedFile) -> Result<File, Errno> {
        let (folder, name) = self.place(&entry.path)?;
        let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        openat(&folder, &name, flags, Mode::empty()).map(File::from)
    }
}

/// Looks at a source; nothing where it is gone.
pub(super) fn look(root: &Path, name: &OsStr) -> Result<Option<SourceListing>, NotMoved> {
    let path = root.join(name);
    let cannot = |errno: Errno| NotMoved::ForNow(format!("{} cannot be looked at: {errno}", path.display()));
    // Not to be mistaken for a source that is gone: a mount that is missing.
    let root = openat(CWD, root, FOLDER, Mode::empty())
        .map_err(|errno| NotMoved::ForNow(format!("{} is not there ({errno})", root.display())))?;
    let stat = match statat(&root, name, AtFlags::SYMLINK_NOFOLLOW) {
        Ok(stat) => stat,
        Err(Errno::NOENT) => return Ok(None),
        Err(errno) => return Err(cannot(errno)),
    };
    let entry = ListedFile::new(PathBuf::new(), &stat);
    let is_folder = entry.kind == FileKind::Folder;
    let mut entries = vec![entry];
    if is_folder {
        let folder = openat(&root, name, FOLDER, Mode::empty()).map_err(cannot)?;
        walk(folder, Path::new(""), 0, &mut entries).map_err(cannot)?;
    }
    Ok(Some(SourceListing { root, name: PathBuf::from(name), entries }))
}

fn walk(folder: OwnedFd, at: &Path, depth: usize, entries: &mut Vec<ListedFile>) -> Result<(), Errno> {
    if depth > DEEPEST {
        return Err(Errno::NAMETOOLONG);
    }
    for found in Dir::read_from(&folder)? {
        let found = found?;
        let name = OsStr::from_bytes(found.file_name().to_bytes());
        if name == "." || name == ".." {
            continue;
        }
        let stat = statat(folder.as_fd(), name, AtFlags::SYMLINK_NOFOLLOW)?;
        let entry = ListedFile::new(at.join(name), &stat);
        let (path, is_folder) = (entry.path.clone(), entry.kind == FileKind::Folder);
        entries.push(entry);
        if is_folder {
            walk(openat(&folder, name, FOLDER, Mode::empty())?, &path, depth + 1, entries)?;
        }
    }
    Ok(())
}
