//! Bytes that were never written. A copy in several streams, or into a file of
//! its last length, has both ends long before its middle; what is missing is a
//! hole, or reads as zeros. No header tells, so the bytes must.
//!
//! A hole alone proves nothing where a sparse copy of an honest file has one, nor
//! does a file's number of blocks, which packing file systems lower: but points
//! that are nothing but zeros are no points in any case.

use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;

use rustix::fs::{SeekFrom, seek};

use crate::format::las::Layout;

/// Files are looked at in pieces of so many bytes.
const PIECE: usize = 64;
/// More holes need not be counted.
const MOST_HOLES: usize = 4096;

/// Holes in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Holes {
    pub first: Range<u64>,
    /// Bytes in all of them.
    pub bytes: u64,
}

/// The holes of a file of `size` bytes, where its file system tells of any. The
/// end of the file is none.
pub(super) fn holes(file: &File, size: u64) -> Option<Holes> {
    let (mut found, mut at): (Option<Holes>, u64) = (None, 0);
    for _ in 0..MOST_HOLES {
        let Ok(start) = seek(file, SeekFrom::Hole(at)) else { break };
        if start >= size {
            break;
        }
        let end = seek(file, SeekFrom::Data(start)).unwrap_or(size).min(size);
        if end <= start {
            break;
        }
        // Some file systems had the fault of telling of holes where bytes were
        // not on the disk yet.
        if is_zero_at(file, start) && is_zero_at(file, (end - 1).saturating_sub(4095).max(start)) {
            let holes = found.get_or_insert(Holes { first: start..end, bytes: 0 });
            holes.bytes += end - start;
        }
        at = end;
    }
    found
}

fn is_zero_at(file: &File, at: u64) -> bool {
    let mut block = [0u8; 4096];
    file.read_at(&mut block, at).is_ok_and(|read| block[..read].iter().all(|byte| *byte == 0))
}

/// Looks for points that are nothing but zeros, in a file that is read once from
/// its beginning to its end.
pub(super) struct ZeroRun {
    points: Range<u64>,
    /// A shorter run may be by chance.
    least: u64,
    at: u64,
    run: Range<u64>,
    longest: Range<u64>,
}

impl ZeroRun {
    pub fn new(layout: Layout, size: u64) -> ZeroRun {
        let end = layout.points_end.unwrap_or(size).min(size);
        // The first eight bytes of LAZ are where its chunk table lies.
        let start = layout.points_at.saturating_add(if layout.compressed { 8 } else { 0 }).min(end);
        let record = layout.record_length.max(1);
        // A dozen records of zeros follow each other in no cloud. Packed points
        // have few zeros, but records that are all alike are packed into some.
        let least = if layout.compressed {
            ((end - start) / 8).clamp(512, 4096).max(3 * record)
        } else {
            16 * record
        };
        ZeroRun { points: start..end, least, at: 0, run: 0..0, longest: 0..0 }
    }

    /// The next bytes; of a length that is a multiple of 64, but for the last.
    pub fn feed(&mut self, bytes: &[u8]) {
        for piece in bytes.chunks(PIECE) {
            let end = self.at + piece.len() as u64;
            if end > self.points.start && self.at < self.points.end {
                let from = self.points.start.saturating_sub(self.at) as usize;
                let to = (self.points.end - self.at).min(piece.len() as u64) as usize;
                self.look(&piece[from.min(to)..to], self.at + from as u64);
            }
            self.at = end;
        }
    }

    fn look(&mut self, piece: &[u8], at: u64) {
        if piece.iter().fold(0u8, |all, byte| all | byte) != 0 {
            return;
        }
        let end = at + piece.len() as u64;
        self.run = if self.run.end == at { self.run.start..end } else { at..end };
        if self.run.end - self.run.start > self.longest.end - self.longest.start {
            self.longest = self.run.clone();
        }
    }

    /// Where the longest run is, if there is one that is not by chance.
    pub fn found(&self) -> Option<Range<u64>> {
        let length = self.longest.end - self.longest.start;
        // What is zero in the pieces around it is not counted.
        (length + 2 * PIECE as u64 > self.least && length >= PIECE as u64 * 2).then(|| self.longest.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LAS: Layout = Layout { compressed: false, record_length: 20, points_at: 227, points_end: None };

    fn found(layout: Layout, bytes: &[u8]) -> Option<Range<u64>> {
        let mut run = ZeroRun::new(layout, bytes.len() as u64);
        bytes.chunks(1024).for_each(|block| run.feed(block));
        run.found()
    }

    #[test]
    fn a_file_with_a_hole_has_it_told() {
        let file = tempfile::tempfile().expect("a file");
        file.write_all_at(&[1; 100_000], 0).expect("written");
        assert_eq!(holes(&file, 100_000), None);
        file.write_all_at(&[1; 100_000], 1_000_000).expect("written");
        if let Some(holes) = holes(&file, 1_100_000) {
            assert!(holes.first.start >= 100_000 && holes.first.end <= 1_000_000);
            assert!(holes.bytes > 800_000);
        }
    }

    #[test]
    fn zeros_before_and_behind_the_points_are_fine() {
        let mut bytes = vec![7u8; 20_000];
        bytes[..3_000].fill(0);
        bytes[15_000..].fill(0);
        let layout = Layout { points_at: 3_000, points_end: Some(15_000), ..LAS };
        assert_eq!(found(layout, &bytes), None);
        assert!(found(Layout { points_end: Some(16_000), ..layout }, &bytes).is_some());
        assert!(found(Layout { points_at: 2_000, ..layout }, &bytes).is_some());
    }

    proptest! {
        #[test]
        fn runs_are_found_from_their_least_length_on(
            start in 227usize..40_000,
            length in 0usize..3_000,
            record_length in 20u64..80,
        ) {
            let mut bytes = vec![7u8; 50_000];
            bytes[start..start + length].fill(0);
            let layout = Layout { record_length, ..LAS };
            let run = found(layout, &bytes);
            if length as u64 >= 16 * record_length {
                let run = run.clone().expect("it is found");
                prop_assert!(run.start >= start as u64 && run.end <= (start + length) as u64);
            }
            if (length as u64) + 128 <= 16 * record_length {
                prop_assert_eq!(run, None);
            }
        }
    }
}
