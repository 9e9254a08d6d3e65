//! Is a file whole, by its own word? LAS: room for all points that the header
//! counts; LAZ: a chunk table that accounts for every byte. A copy that reserves
//! the whole length first and fills it later has holes, or ends in zeros, which no
//! record does.

use std::io::{ErrorKind, Read};
use std::path::Path;

use super::file_stamp::FileStamp;
use super::settle::{Completeness, NotYet};
use super::waiting::WaitingKind;
use super::zeros::{self, Holes};
use crate::format::las::{LasFile, Layout, Slice};
use crate::platform::disk::others::{self, Links};

/// Whether a file's first bytes are those of a LAS or LAZ file.
pub(super) fn begins_as_a_cloud(path: &Path) -> bool {
    let mut magic = [0u8; 4];
    let read = others::open_file(path, Links::Refused).and_then(|(mut file, _)| file.read_exact(&mut magic));
    read.is_ok() && magic == *b"LASF"
}

/// Judges one file.
pub(super) fn judge(path: &Path) -> Completeness {
    let incomplete = |why: String| Completeness::NotYet(NotYet::new(WaitingKind::Incomplete, why));
    if let Some(verdict) = first_word(path) {
        return verdict;
    }
    if let Some(Holes { first, bytes }) = holes_of(path) {
        return Completeness::NotYet(NotYet::new(
            WaitingKind::Zeros,
            format!(
                "{} has holes: {bytes} bytes of it were never written, the first at {} to {}",
                path.display(),
                first.start,
                first.end
            ),
        ));
    }
    let file = match LasFile::open_strictly(path) {
        Ok(file) => file,
        // Even a header that cannot be right may be the torso of one that can.
        Err(error) => return incomplete(error.to_string()),
    };
    let points = file.header().points;
    let path = path.display();
    if points == 0 {
        // Some programs write the count last.
        return incomplete(format!("{path} counts no points (yet)"));
    }
    if !file.is_complete() {
        return incomplete(format!("{path} holds points that its header does not count (yet)"));
    }
    if !file.header().compressed && ends_in_zeros(&file, points) {
        return Completeness::NotYet(NotYet::new(WaitingKind::Zeros, format!("{path} ends in zeros")));
    }
    Completeness::Whole { points }
}

/// How many bytes of these files are there, and how many are to come by the word
/// of their headers.
pub(super) fn progress(files: &[FileStamp]) -> (u64, Option<u64>) {
    let (mut there, mut expected, mut told) = (0u64, 0u64, false);
    for file in files {
        let missing = holes_of(&file.path).map_or(0, |holes| holes.bytes);
        let layout =
            others::open_file(&file.path, Links::Refused).ok().and_then(|(file, _)| Layout::read(&file));
        let promised = layout.and_then(|layout| layout.promised_bytes()).unwrap_or(0);
        told |= promised > file.size || missing > 0;
        there = there.saturating_add(file.size.saturating_sub(missing));
        expected = expected.saturating_add(promised.max(file.size));
    }
    (there, told.then_some(expected))
}

fn holes_of(path: &Path) -> Option<Holes> {
    let (file, meta) = others::open_file(path, Links::Refused).ok()?;
    zeros::holes(&file, meta.len())
}

/// What the first four bytes tell, where they decide.
fn first_word(path: &Path) -> Option<Completeness> {
    let incomplete = |why: String| Some(Completeness::NotYet(NotYet::new(WaitingKind::Incomplete, why)));
    let mut magic = [0u8; 4];
    let file = others::open_file(path, Links::Refused);
    match file.and_then(|(mut file, _)| file.read_exact(&mut magic)) {
        Ok(()) => {}
        Err(e) if e.kind() == ErrorKind::UnexpectedEof => {
            let is_empty = std::fs::symlink_metadata(path).is_ok_and(|file| file.len() == 0);
            let what = if is_empty { "is empty" } else { "is shorter than a header" };
            return incomplete(format!("{} {what}", path.display()));
        }
        Err(e) => return Some(Completeness::Unreadable(format!("{} cannot be read: {e}", path.display()))),
    }
    match &magic {
        b"LASF" => None,
        [0, 0, 0, 0] => incomplete(format!("{} begins with zeros", path.display())),
        _ => Some(Completeness::Never(format!("{} is no LAS or LAZ file", path.display()))),
    }
}

fn ends_in_zeros(file: &LasFile, points: u64) -> bool {
    let mut record = Vec::new();
    let read = file.read(Slice { first: points - 1, points: 1 }, &mut record);
    read.is_err() || record.iter().all(|byte| *byte == 0)
}
