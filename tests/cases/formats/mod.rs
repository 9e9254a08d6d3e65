//! Versions, point formats, coordinate systems and attribute names of LAS files.

mod compatible;
mod extremes;
mod las_files;
mod names;
mod reference;
mod versions;
mod viewer;

use std::fs;
use std::path::{Path, PathBuf};

use super::cases;
use super::common::judge::{Held, IN_CORE, held_with};
use super::common::write_las;
use lodestone::convert::options::Options;
use lodestone::format::las::{LasFile, LasOptions};

/// A file that failed once, where there are such.
fn case(name: &str) -> Option<PathBuf> {
    cases().map(|folder| folder.join(name))
}

/// Converts and holds the octree against its input.
fn octree_of(input: &Path, folder: &Path) -> Held {
    held_with(input, &folder.join("octree"), &Options::default(), IN_CORE)
}

/// Writes a tile, and changes bytes of it.
fn tile(path: &Path, options: &LasOptions, records: &[u8], changes: &[(usize, &[u8])]) {
    fs::create_dir_all(path.parent().expect("in a folder")).expect("made");
    write_las(path, options, records);
    super::common::judge::patch(path, changes);
}

/// All records of a file as they are read.
fn records_of(path: &Path) -> Vec<u8> {
    let file = LasFile::open(path).expect("it can be read");
    let mut all = Vec::new();
    for slice in file.slices(1 << 20) {
        let mut records = Vec::new();
        file.read(slice, &mut records).expect("it can be decoded");
        all.extend(records);
    }
    all
}

/// A note that says all of this.
fn told(notes: &[String], parts: &[&str]) -> bool {
    notes.iter().any(|note| parts.iter().all(|part| note.contains(part)))
}
