//! One look at a watched folder: which data sets lie in it, by names and stats
//! alone. Symbolic links are refused, for whoever may write to an inbox must not get
//! at the rest of the machine through it.

use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::{FileType, Stat};

use super::file_stamp::FileStamp;
use super::found::FoundDataSet;
use super::marker::{self, Marker};
use super::waiting::{Waiting, WaitingKind};
use super::{completeness, events, foreign, names};
use crate::format::inputs::DEEPEST_FOLDER;
use crate::platform::disk::others::{self, Links};

/// More words about what is not taken nobody reads.
const MOST_REFUSED: usize = 10_000;

/// A file or folder that may be a data set.
#[derive(Debug)]
pub(super) struct Candidate {
    pub path: PathBuf,
    pub is_folder: bool,
    /// Sorted by path, so that the same tiles are the same data set.
    pub files: Vec<FileStamp>,
    /// Files that are still being written, by their names.
    pub partials: Vec<FileStamp>,
    pub marker: Option<FoundMarker>,
    /// Why nobody can say what is in it.
    pub unreadable: Option<String>,
}

/// A marker, or what is wrong with it.
#[derive(Debug)]
pub(super) struct FoundMarker {
    pub read: Result<Marker, String>,
    file: FileStamp,
}

#[derive(Debug, Default)]
pub(super) struct Scanned {
    pub candidates: Vec<Candidate>,
    pub refused: Vec<Waiting>,
}

impl Scanned {
    fn refuse(&mut self, path: &Path, kind: WaitingKind, why: impl Into<String>) {
        if self.refused.len() < MOST_REFUSED {
            self.refused.push(Waiting::new(path, kind, why));
        }
    }

    /// Says of a file that it is not taken, and what to do with it.
    fn leave(&mut self, path: &Path, name: &str, in_folder: bool) {
        if name == marker::NAME {
            let why =
                "is not read here: a marker lies in the folder of its data set, beside or above its tiles";
            self.refuse(path, WaitingKind::NotTaken, why);
        } else if !name.starts_with('.')
            && !names::is_partial(name)
            && let Some(advice) = foreign::advice(name, in_folder)
        {
            self.refuse(path, WaitingKind::NotTaken, advice);
        }
    }
}

impl Candidate {
    fn new(path: PathBuf, is_folder: bool) -> Candidate {
        Candidate { path, is_folder, files: vec![], partials: vec![], marker: None, unreadable: None }
    }

    /// Names, sizes, times and the marker in one word.
    pub fn stamp(&self) -> String {
        self.stamp_with(true)
    }

    /// As versions before 0.2 made it, without inodes and times of change: what
    /// they took need not all be read once more.
    pub fn old_stamp(&self) -> Option<String> {
        let plain = self.partials.is_empty() && self.unreadable.is_none();
        let marker = self.marker.as_ref().is_none_or(|marker| marker.read.is_ok());
        (plain && marker).then(|| self.stamp_with(false))
    }

    fn stamp_with(&self, identity: bool) -> String {
        let mut hasher = blake3::Hasher::new();
        for file in self.files.iter().chain(&self.partials) {
            let path = file.path.as_os_str().as_encoded_bytes();
            hasher.update(&(path.len() as u64).to_le_bytes());
            hasher.update(path);
            hasher.update(&file.size.to_le_bytes());
            hasher.update(&file.mtime_ns.to_le_bytes());
            if identity {
                hasher.update(&file.inode.to_le_bytes());
                hasher.update(&file.ctime_ns.to_le_bytes());
            }
        }
        match self.marker.as_ref().map(|marker| &marker.read) {
            Some(Ok(marker)) => hasher.update(format!("{marker:?}").as_bytes()),
            Some(Err(why)) => hasher.update(why.as_bytes()),
            None => &mut hasher,
        };
        if let Some(why) = &self.unreadable {
            hasher.update(why.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// Whether its marker came last, and so says that all is there. Within one tick of
    /// the clock nobody can tell, and then it waits as any other.
    pub fn is_closed(&self) -> bool {
        self.marker.as_ref().is_some_and(|marker| {
            marker.read.is_ok() && self.files.iter().all(|file| file.ctime_ns < marker.file.ctime_ns)
        }) && self.partials.is_empty()
    }

    /// Bytes of all that is there.
    pub fn bytes(&self) -> u64 {
        self.files.iter().chain(&self.partials).map(|file| file.size).fold(0, u64::saturating_add)
    }

    pub fn into_found(self, points: u64, doubt: Option<String>) -> FoundDataSet {
        let (marker, refusal) = match &self.marker {
            Some(FoundMarker { read: Ok(marker), .. }) => (Some(marker.clone()), None),
            Some(FoundMarker { read: Err(why), .. }) => (None, Some(why.clone())),
            None => (None, None),
        };
        let name = match marker.as_ref().and_then(|marker| marker.name.as_deref()) {
            Some(name) => names::plain(name),
            None => names::octree_name(&self.path, self.is_folder),
        };
        let stamp = self.stamp();
        let Candidate { path, is_folder, files, .. } = self;
        FoundDataSet { path, is_folder, name, files, stamp, marker, points, doubt, refusal }
    }
}

/// Looks at `root`. An error means that the root itself cannot be read.
pub(super) fn scan(root: &Path, skip: &[PathBuf]) -> io::Result<Scanned> {
    let mut scanned = Scanned::default();
    let root = root.canonicalize()?;
    let inodes = events::has_inodes(&root);
    for entry in others::list_folder(&root, Links::Refused)? {
        let path = root.join(&entry.name);
        if skip.contains(&path) {
            continue;
        }
        let Some(name) = utf8_name(&path, &mut scanned) else { continue };
        if names::is_junk(&name) {
            continue;
        }
        match entry.kind {
            FileType::Directory if !name.starts_with('.') => folder(path, inodes, &mut scanned),
            FileType::RegularFile if names::is_cloud(&name) => {
                let files = vec![stamp_of(&path, &entry.stat, inodes)];
                scanned.candidates.push(Candidate { files, ..Candidate::new(path, false) });
            }
            FileType::RegularFile => scanned.leave(&path, &name, false),
            FileType::Directory => {}
            other => refuse(&path, &name, no_file(other), &mut scanned),
        }
    }
    scanned.candidates.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(scanned)
}

/// A folder is one data set, if there is a tile in it.
fn folder(path: PathBuf, inodes: bool, scanned: &mut Scanned) {
    let mut candidate = Candidate::new(path, true);
    let below = candidate.path.clone();
    walk(&below, Depth { folders: 0, in_transfer: false, inodes }, &mut candidate, scanned);
    candidate.files.sort_by(|a, b| a.path.cmp(&b.path));
    candidate.partials.sort_by(|a, b| a.path.cmp(&b.path));
    if !candidate.files.is_empty() {
        scanned.candidates.push(candidate);
    } else if !candidate.partials.is_empty() {
        let waiting = Waiting::new(
            &candidate.path,
            WaitingKind::Partial,
            format!("holds only {}", under_way(&candidate)),
        );
        scanned.refused.push(Waiting { bytes: Some(candidate.bytes()), ..waiting });
    } else if let Some(Err(why)) = candidate.marker.map(|marker| marker.read) {
        scanned.refuse(&candidate.path, WaitingKind::Marker, why);
    } else if let Some(why) = candidate.unreadable {
        scanned.refuse(&candidate.path, WaitingKind::Unreadable, why);
    }
}

/// What to tell of files that are still being written, by their names.
pub(super) fn under_way(candidate: &Candidate) -> String {
    let first = candidate.partials.first().and_then(|file| file.path.file_name());
    let name = first.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    match candidate.partials.len() {
        0 | 1 => format!("{name}, which is still being written, by its name"),
        more => format!("{name} and {} more files, which are still being written, by their names", more - 1),
    }
}

#[derive(Clone, Copy)]
struct Depth {
    folders: usize,
    /// Within a folder that a copy keeps its unfinished files in.
    in_transfer: bool,
    /// Whether inodes are to be believed here.
    inodes: bool,
}

fn walk(folder: &Path, depth: Depth, candidate: &mut Candidate, scanned: &mut Scanned) {
    let entries = match others::list_folder(folder, Links::Refused) {
        Ok(entries) => entries,
        Err(e) => {
            candidate.unreadable = Some(format!("{} cannot be read: {e}", folder.display()));
            return;
        }
    };
    let mut misnamed = None;
    for entry in entries {
        let path = folder.join(&entry.name);
        let Some(name) = utf8_name(&path, scanned) else { continue };
        let stamp = || stamp_of(&path, &entry.stat, depth.inodes);
        if depth.folders == 0 && name == marker::NAME {
            candidate.marker = Some(FoundMarker { read: Marker::read(&path), file: stamp() });
            continue;
        }
        if depth.folders == 0 && entry.kind == FileType::RegularFile && marker::is_misnamed(&name) {
            misnamed = Some(FoundMarker { read: Err(marker::misnamed(&name)), file: stamp() });
            continue;
        }
        if names::is_junk(&name) {
            continue;
        }
        match entry.kind {
            FileType::Directory => {
                let in_transfer = depth.in_transfer || names::is_transfer_folder(&name);
                if name.starts_with('.') && !in_transfer {
                    continue;
                }
                if depth.folders < DEEPEST_FOLDER {
                    let depth = Depth { folders: depth.folders + 1, in_transfer, ..depth };
                    walk(&path, depth, candidate, scanned);
                } else {
                    let why = format!(
                        "lies below more than {DEEPEST_FOLDER} folders, and is not looked into; bring it nearer"
                    );
                    // Without what is below, the set would not be whole.
                    candidate.unreadable = Some(format!("{} {why}", path.display()));
                    scanned.refuse(&path, WaitingKind::Refused, why);
                }
            }
            FileType::RegularFile if names::is_cloud(&name) => {
                let files = if depth.in_transfer { &mut candidate.partials } else { &mut candidate.files };
                files.push(stamp());
            }
            FileType::RegularFile if is_under_way(&path, &name) => candidate.partials.push(stamp()),
            FileType::RegularFile => scanned.leave(&path, &name, true),
            other => refuse(&path, &name, no_file(other), scanned),
        }
    }
    // Beside the right one it is a copy of it.
    candidate.marker = candidate.marker.take().or(misnamed);
}

/// Whether a copy has this file under way: by its name, or, where that tells nothing,
/// because it begins as a cloud does. No list of names has those of all tools.
fn is_under_way(path: &Path, name: &str) -> bool {
    names::is_under_way(name) || (names::may_be_temporary(name) && completeness::begins_as_a_cloud(path))
}

/// Why something that is neither file nor folder is not taken.
fn no_file(kind: FileType) -> String {
    match kind {
        FileType::Symlink => {
            "is a link, and links are not followed below a watched folder; copy the file, or watch its folder"
        }
        _ => "is not a plain file",
    }
    .to_string()
}

fn refuse(path: &Path, name: &str, why: String, scanned: &mut Scanned) {
    // Only what could be a cloud, or hold some, is worth a word.
    if names::is_cloud(name) || !name.contains('.') {
        scanned.refuse(path, WaitingKind::Refused, why);
    }
}

fn utf8_name(path: &Path, scanned: &mut Scanned) -> Option<String> {
    let name = path.file_name()?;
    match name.to_str() {
        Some(name) => Some(name.to_string()),
        None => {
            let why = "its name is not UTF-8; rename it".to_string();
            refuse(path, &name.to_string_lossy(), why, scanned);
            None
        }
    }
}

fn stamp_of(path: &Path, stat: &Stat, inodes: bool) -> FileStamp {
    let ns = |seconds: i64, nanos: i64| seconds.saturating_mul(1_000_000_000).saturating_add(nanos);
    FileStamp {
        path: path.to_path_buf(),
        size: stat.st_size as u64,
        mtime_ns: ns(stat.st_mtime, stat.st_mtime_nsec as i64),
        inode: if inodes { stat.st_ino } else { 0 },
        ctime_ns: ns(stat.st_ctime, stat.st_ctime_nsec as i64),
    }
}
