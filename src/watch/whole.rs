//! Is a file whole, by its own word? LAS: room for all points that the header
//! counts; LAZ: a chunk table that accounts for every byte. A copy that reserves
//! the whole length first and fills it later ends in zeros, which no record does.

use std::io::{ErrorKind, Read};
use std::path::Path;

use super::settle::Wholeness;
use crate::disk::others::{self, Links};
use crate::format::las::{LasFile, Slice};

/// Judges one file.
pub(super) fn judge(path: &Path) -> Wholeness {
    if let Some(verdict) = first_word(path) {
        return verdict;
    }
    let file = match LasFile::open_strictly(path) {
        Ok(file) => file,
        // Even a header that cannot be right may be the torso of one that can.
        Err(error) => return Wholeness::NotYet(error.to_string()),
    };
    let points = file.header().points;
    if points == 0 {
        // Some programs write the count last.
        return Wholeness::NotYet(format!("{} counts no points (yet)", path.display()));
    }
    if !file.is_complete() {
        let path = path.display();
        return Wholeness::NotYet(format!("{path} holds points that its header does not count (yet)"));
    }
    if !file.header().compressed && ends_in_zeros(&file, points) {
        return Wholeness::NotYet(format!("{} ends in zeros", path.display()));
    }
    Wholeness::Whole { points }
}

/// What the first four bytes tell, where they decide.
fn first_word(path: &Path) -> Option<Wholeness> {
    let mut magic = [0u8; 4];
    let file = others::open_file(path, Links::Refused);
    match file.and_then(|(mut file, _)| file.read_exact(&mut magic)) {
        Ok(()) => {}
        Err(e) if e.kind() == ErrorKind::UnexpectedEof => {
            return Some(Wholeness::NotYet(format!("{} is shorter than a header", path.display())));
        }
        Err(e) => return Some(Wholeness::Unreadable(format!("{} cannot be read: {e}", path.display()))),
    }
    match &magic {
        b"LASF" => None,
        [0, 0, 0, 0] => Some(Wholeness::NotYet(format!("{} begins with zeros", path.display()))),
        _ => Some(Wholeness::Never(format!("{} is no LAS or LAZ file", path.display()))),
    }
}

fn ends_in_zeros(file: &LasFile, points: u64) -> bool {
    let mut record = Vec::new();
    let read = file.read(Slice { first: points - 1, points: 1 }, &mut record);
    read.is_err() || record.iter().all(|byte| *byte == 0)
}
