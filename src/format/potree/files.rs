//! The files of an octree, whoever made it. Nothing is believed of them that would
//! cost more than they are: they must be plain files, metadata.json has a bound, and
//! what was never written (a hole in a sparse file) is no points.

use std::fs::File;
use std::io::{self, Read};
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

use rustix::fs::{SeekFrom, seek};
use rustix::io::Errno;

use super::error::{PotreeError, Result};
use crate::platform::disk::others::{self, Links};

/// Bytes of metadata.json at most: thousands of attributes with histograms take
/// less.
pub const MOST_METADATA: u64 = 16 << 20;
/// Holes shorter than this, in bytes, are read as the zeros that they stand for.
const SMALL_HOLE: u64 = 64 << 10;
/// More holes than this are not looked for.
const MOST_HOLES: usize = 1 << 16;

/// Opens one of an octree's files; with its length in bytes.
pub fn open(folder: &Path, name: &str) -> Result<(File, u64)> {
    let path = folder.join(name);
    match others::open_file(&path, Links::Followed) {
        Ok((file, meta)) => Ok((file, meta.len())),
        Err(source) => Err(PotreeError::Read { path, source }),
    }
}

/// The bytes of metadata.json.
pub(super) fn metadata(folder: &Path) -> Result<Vec<u8>> {
    let path = folder.join(super::METADATA);
    others::read_file(&path, Links::Followed, MOST_METADATA)
        .map_err(|source| PotreeError::Read { path, source })
}

/// Reads on from a place in a file, without moving anybody else's place in it.
pub struct From<'a> {
    pub file: &'a File,
    /// Bytes from the file's beginning.
    pub at: u64,
}

impl Read for From<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read_at(bytes, self.at)?;
        self.at += read as u64;
        Ok(read)
    }
}

/// Where nothing was ever written, sorted; empty where the file system does not
/// tell. A copy that was reserved and not filled has such holes, and so has a file
/// that is to look larger than it is.
pub fn holes(file: &File, length: u64) -> Vec<Range<u64>> {
    let (mut holes, mut at) = (Vec::new(), 0);
    while at < length && holes.len() < MOST_HOLES {
        let data = match seek(file, SeekFrom::Data(at)) {
            Ok(data) => data.min(length),
            Err(Errno::NXIO) => length,
            Err(_) => return Vec::new(),
        };
        if data - at >= SMALL_HOLE {
            holes.push(at..data);
        }
        at = match seek(file, SeekFrom::Hole(data)) {
            Ok(hole) => hole.max(data.saturating_add(1)),
            Err(_) => length,
        };
    }
    holes
}

/// Zeroed memory, or an error where there is not that much.
pub fn zeroed(bytes: u64) -> Result<Vec<u8>> {
    let mut memory = Vec::new();
    let length = usize::try_from(bytes).unwrap_or(usize::MAX);
    memory
        .try_reserve_exact(length)
        .map_err(|_| PotreeError::Points(format!("there is no memory for {bytes} bytes of a node")))?;
    memory.resize(length, 0);
    Ok(memory)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_found_and_written_zeros_are_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = File::options().read(true).write(true).create_new(true).open(folder.path().join("x"));
        let file = file.expect("made");
        file.write_all_at(&[0; 100_000], 0).expect("written");
        assert!(holes(&file, 100_000).is_empty());
        file.write_all_at(&[7], 50 << 20).expect("written");
        let found = holes(&file, (50 << 20) + 1);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].start >= 100_000 && found[0].end <= 50 << 20 && found[0].start < 1 << 20);
    }

    #[test]
    fn memory_that_is_not_there_is_an_error() {
        assert!(zeroed(u64::MAX).is_err() && zeroed(1 << 60).is_err());
        assert_eq!(zeroed(3).expect("little"), [0; 3]);
    }
}
