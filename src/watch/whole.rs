//! Is a file whole, by its own word?

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use super::settle::Wholeness;

/// Judges one file.
pub(super) fn judge(path: &Path) -> Wholeness {
    let mut magic = [0u8; 4];
    match File::open(path).and_then(|mut file| file.read_exact(&mut magic)) {
        Ok(()) => {}
        Err(e) if e.kind() == ErrorKind::UnexpectedEof => {
            return Wholeness::NotYet(format!("{} is shorter than a header", path.display()));
        }
        Err(e) => return Wholeness::NotYet(format!("{} cannot be read: {e}", path.display())),
    }
    match &magic {
        b"LASF" => Wholeness::Whole { points: 0 },
        // Zeros: a copy that reserved its room before it filled it.
        [0, 0, 0, 0] => Wholeness::NotYet(format!("{} begins with zeros", path.display())),
        _ => Wholeness::Never(format!("{} is no LAS or LAZ file", path.display())),
    }
}
