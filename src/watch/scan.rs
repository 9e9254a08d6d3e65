//! One look at a watched folder: which data sets lie in it, by names and stats
//! alone. Symbolic links are refused, for whoever may write to an inbox must not get
//! at the rest of the machine through it.

use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::{FileType, Stat};

use super::marker::{self, Marker};
use super::{FileStamp, Found, Waiting, names};
use crate::disk::others::{self, Links};

/// How deep the tiles of a folder may lie.
const DEEPEST: usize = 24;

/// A file or folder that may be a data set.
#[derive(Debug)]
pub(super) struct Candidate {
    pub path: PathBuf,
    pub is_folder: bool,
    /// Sorted by path, so that the same tiles are the same data set.
    pub files: Vec<FileStamp>,
    pub marker: Option<Marker>,
    /// What the names alone say against taking it now.
    pub not_yet: Option<String>,
}

#[derive(Debug, Default)]
pub(super) struct Scanned {
    pub candidates: Vec<Candidate>,
    pub refused: Vec<Waiting>,
}

impl Candidate {
    /// Names, sizes, times and the marker in one word.
    pub fn stamp(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for file in &self.files {
            let path = file.path.as_os_str().as_encoded_bytes();
            hasher.update(&(path.len() as u64).to_le_bytes());
            hasher.update(path);
            hasher.update(&file.size.to_le_bytes());
            hasher.update(&file.mtime_ns.to_le_bytes());
        }
        if let Some(marker) = &self.marker {
            hasher.update(format!("{marker:?}").as_bytes());
        }
        if let Some(why) = &self.not_yet {
            hasher.update(why.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    pub fn into_found(self, points: u64) -> Found {
        let wished = self.marker.as_ref().and_then(|marker| marker.name.as_deref());
        let name = match wished {
            Some(name) => names::plain(name),
            None => names::octree_name(&self.path, self.is_folder),
        };
        let stamp = self.stamp();
        let Candidate { path, is_folder, files, marker, .. } = self;
        Found { path, is_folder, name, files, stamp, marker, points }
    }
}

/// Looks at `root`. An error means that the root itself cannot be read.
pub(super) fn scan(root: &Path, skip: &[PathBuf]) -> io::Result<Scanned> {
    let mut scanned = Scanned::default();
    let root = root.canonicalize()?;
    for entry in others::list_folder(&root, Links::Refused)? {
        let path = root.join(&entry.name);
        if skip.contains(&path) {
            continue;
        }
        let Some(name) = utf8_name(&path, &mut scanned.refused) else { continue };
        match entry.kind {
            FileType::Directory if !name.starts_with('.') => folder(path, &mut scanned),
            FileType::RegularFile if names::is_cloud(&name) => {
                let files = vec![stamp_of(&path, &entry.stat)];
                scanned.candidates.push(Candidate {
                    path,
                    is_folder: false,
                    files,
                    marker: None,
                    not_yet: None,
                });
            }
            FileType::Directory | FileType::RegularFile => {}
            other => refuse(&path, &name, no_file(other), &mut scanned.refused),
        }
    }
    scanned.candidates.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(scanned)
}

/// A folder is one data set, if there is a tile in it.
fn folder(path: PathBuf, scanned: &mut Scanned) {
    let mut candidate = Candidate { path, is_folder: true, files: vec![], marker: None, not_yet: None };
    let below = candidate.path.clone();
    walk(&below, 0, &mut candidate, &mut scanned.refused);
    candidate.files.sort_by(|a, b| a.path.cmp(&b.path));
    if !candidate.files.is_empty() {
        scanned.candidates.push(candidate);
    }
}

fn walk(folder: &Path, depth: usize, candidate: &mut Candidate, refused: &mut Vec<Waiting>) {
    let entries = match others::list_folder(folder, Links::Refused) {
        Ok(entries) => entries,
        Err(e) => {
            candidate.not_yet = Some(format!("{} cannot be read: {e}", folder.display()));
            return;
        }
    };
    for entry in entries {
        let path = folder.join(&entry.name);
        let Some(name) = utf8_name(&path, refused) else { continue };
        if depth == 0 && name == marker::NAME {
            match Marker::read(&path) {
                Ok(marker) => candidate.marker = Some(marker),
                // Its options would be lost; better to wait until it is mended.
                Err(why) => candidate.not_yet = Some(why),
            }
            continue;
        }
        match entry.kind {
            FileType::Directory if !name.starts_with('.') && depth < DEEPEST => {
                walk(&path, depth + 1, candidate, refused);
            }
            FileType::RegularFile if names::is_cloud(&name) => {
                candidate.files.push(stamp_of(&path, &entry.stat));
            }
            FileType::RegularFile if names::is_partial_cloud(&name) => {
                candidate.not_yet = Some(format!("{name} is still being written, by its name"));
            }
            FileType::Directory | FileType::RegularFile => {}
            other => refuse(&path, &name, no_file(other), refused),
        }
    }
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

fn refuse(path: &Path, name: &str, why: String, refused: &mut Vec<Waiting>) {
    // Only what could be a cloud, or hold some, is worth a word.
    if names::is_cloud(name) || !name.contains('.') {
        refused.push(Waiting { path: path.to_path_buf(), why });
    }
}

fn utf8_name(path: &Path, refused: &mut Vec<Waiting>) -> Option<String> {
    let name = path.file_name()?;
    match name.to_str() {
        Some(name) => Some(name.to_string()),
        None => {
            let why = "its name is not UTF-8; rename it".to_string();
            refuse(path, &name.to_string_lossy(), why, refused);
            None
        }
    }
}

fn stamp_of(path: &Path, stat: &Stat) -> FileStamp {
    let mtime_ns = stat.st_mtime.saturating_mul(1_000_000_000).saturating_add(stat.st_mtime_nsec as i64);
    FileStamp { path: path.to_path_buf(), size: stat.st_size as u64, mtime_ns }
}
