//! What the inputs' headers promise, held against the points that were found in
//! them. Read here anew from the files' bytes, by nothing that the conversion uses:
//! points that a reader passes over would be missing on both sides, and nobody would
//! see it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::report::{Check, EXAMPLES, plural};
use crate::words::grouped;

/// Records behind the found points that are looked at.
const SAMPLES: u64 = 1000;

/// The numbers of a LAS header that count or place points (LAS 1.4 R15, table 3).
struct Promise {
    /// Those that are not 0.
    counts: Vec<u64>,
    /// Points by return, added up; 0 where nothing is said.
    by_return: u64,
    compressed: bool,
    points_at: u64,
    record_length: u64,
    /// Where extended records should begin, or the file ends.
    end: u64,
    scale: [f64; 3],
    offset: [f64; 3],
    min: [f64; 3],
    max: [f64; 3],
}

impl Promise {
    fn read(file: &File) -> io::Result<Promise> {
        let bytes = file.metadata()?.len();
        let mut header = [0; 375];
        let there = bytes.min(375) as usize;
        file.read_exact_at(&mut header[..there], 0)?;
        let short = |at: usize| u64::from(u16::from_le_bytes([header[at], header[at + 1]]));
        let word = |at: usize| short(at) | short(at + 2) << 16;
        let long = |at: usize| word(at) | word(at + 4) << 32;
        let float = |at: usize| f64::from_bits(long(at));
        let modern = header[25] >= 4 && short(94) >= 375;
        let legacy_returns: u64 = (0..5).map(|number| word(111 + 4 * number)).sum();
        let returns: u128 = (0..15).map(|number| u128::from(long(255 + 8 * number))).sum();
        let returns = if modern { u64::try_from(returns).unwrap_or(u64::MAX) } else { 0 };
        let counts = [if modern { long(247) } else { 0 }, word(107)];
        let extended = if modern { long(235) } else { 0 };
        let points_at = word(96);
        let at = |first: usize, step: usize| std::array::from_fn(|axis| float(first + step * axis));
        Ok(Promise {
            counts: counts.into_iter().filter(|count| *count > 0).collect(),
            by_return: if returns > 0 { returns } else { legacy_returns },
            compressed: header[104] >= 64,
            points_at,
            record_length: short(105).max(1),
            end: if extended > points_at && extended < bytes { extended } else { bytes },
            scale: at(131, 8),
            offset: at(155, 8),
            max: at(179, 16),
            min: at(187, 16),
        })
    }

    /// Whole records behind the found ones that lie in the header's box, if most do.
    fn passed_over(&self, file: &File, found: u64) -> io::Result<u64> {
        let from = self.points_at + found * self.record_length;
        let records = self.end.saturating_sub(from) / self.record_length;
        if self.compressed || records == 0 || (0..3).all(|axis| self.min[axis] == self.max[axis]) {
            return Ok(0);
        }
        let samples = records.min(SAMPLES);
        let mut inside = 0;
        let mut record = vec![0; self.record_length.max(12) as usize];
        for number in 0..samples {
            let place = from + records * number / samples * self.record_length;
            file.read_exact_at(&mut record[..self.record_length as usize], place)?;
            let is_inside = |axis: usize| {
                let at = 4 * axis;
                let raw = [record[at], record[at + 1], record[at + 2], record[at + 3]];
                let world = f64::from(i32::from_le_bytes(raw)) * self.scale[axis] + self.offset[axis];
                let slack = self.scale[axis].abs();
                world >= self.min[axis] - slack && world <= self.max[axis] + slack
            };
            inside += u64::from(record.iter().any(|byte| *byte != 0) && (0..3).all(is_inside));
        }
        Ok(if inside * 2 > samples { records } else { 0 })
    }
}

/// What is to be said of one file.
enum FileFinding {
    Kept,
    Note(String),
    Broken(String),
}

fn judge(path: &Path, found: u64) -> io::Result<FileFinding> {
    let file = File::open(path)?;
    let promise = Promise::read(&file)?;
    let passed_over = promise.passed_over(&file, found)?;
    let name = path.display();
    let said: Vec<String> = promise.counts.iter().map(|count| grouped(*count)).collect();
    let said = if said.is_empty() { "no".to_string() } else { said.join(" or ") };
    let said = format!("{name}: the header promises {said} points, {} were found", grouped(found));
    if passed_over > 0 {
        return Ok(FileFinding::Broken(format!(
            "{said}, and {} more records in its box lie behind them",
            grouped(passed_over)
        )));
    }
    if promise.counts.contains(&found) || promise.counts.is_empty() && found == 0 {
        return Ok(FileFinding::Kept);
    }
    match promise.counts.iter().any(|count| *count > found) {
        true => Ok(FileFinding::Broken(said)),
        false if promise.by_return > found => {
            Ok(FileFinding::Broken(format!("{said}, and {} by return", grouped(promise.by_return))))
        }
        false => Ok(FileFinding::Note(said)),
    }
}

/// Holds what the headers of `files` promise against what was found in each.
pub fn check(files: &[PathBuf], found: &BTreeMap<PathBuf, u64>, damaged: bool) -> Check {
    let all: u64 = found.values().sum();
    let (mut broken, mut notes) = (Vec::new(), Vec::new());
    for path in files {
        let found = found.get(path).copied().unwrap_or(0);
        match judge(path, found) {
            Ok(FileFinding::Kept) => {}
            Ok(FileFinding::Note(text)) => notes.push(text),
            Ok(FileFinding::Broken(text)) => broken.push(text),
            Err(error) => broken.push(format!("{}: {error}", path.display())),
        }
    }
    let summary = |texts: &[String]| {
        let files = plural(texts.len() as u64, "file", "files");
        format!("{} {files} with other points than its header promises", grouped(texts.len() as u64))
    };
    let mut check = match (broken.is_empty(), notes.is_empty()) {
        (true, true) => {
            Check::ok("promises", format!("the headers promise the {} points found", grouped(all)))
        }
        (true, false) => Check { count: notes.len() as u64, ..Check::note("promises", summary(&notes)) },
        (false, _) => Check { count: broken.len() as u64, ..Check::wrong("promises", summary(&broken)) },
    };
    check.examples = if broken.is_empty() { notes } else { broken };
    check.examples.truncate(EXAMPLES);
    // Of a damaged file it was asked to take what there is.
    if damaged { check.softened() } else { check }
}

#[cfg(test)]
mod tests {
    use super::super::report::CheckOutcome;
    use super::*;

    /// Twelve records of 20 bytes in a box of ten, and what is said of them.
    fn file(count: u32, by_return: u32, tail: &[u8]) -> tempfile::NamedTempFile {
        let mut bytes = vec![0u8; 227];
        bytes[..4].copy_from_slice(b"LASF");
        (bytes[24], bytes[25]) = (1, 2);
        bytes[96..100].copy_from_slice(&227u32.to_le_bytes());
        bytes[105] = 20;
        bytes[107..111].copy_from_slice(&count.to_le_bytes());
        bytes[111..115].copy_from_slice(&by_return.to_le_bytes());
        for at in [131, 139, 147] {
            bytes[at..at + 8].copy_from_slice(&1f64.to_le_bytes());
        }
        for at in [179, 195, 211] {
            bytes[at..at + 8].copy_from_slice(&12f64.to_le_bytes());
        }
        for number in 1..=12i32 {
            (0..3).for_each(|_| bytes.extend_from_slice(&number.to_le_bytes()));
            bytes.extend_from_slice(&[9; 8]);
        }
        bytes.extend_from_slice(tail);
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        file
    }

    fn outcome(file: &tempfile::NamedTempFile, found: u64) -> CheckOutcome {
        let path = file.path().to_path_buf();
        check(std::slice::from_ref(&path), &BTreeMap::from([(path.clone(), found)]), false).outcome
    }

    #[test]
    fn what_was_promised_and_found_is_fine() {
        assert_eq!(outcome(&file(12, 12, &[]), 12), CheckOutcome::Ok);
        assert_eq!(outcome(&file(12, 12, b"text behind the points, of no meaning"), 12), CheckOutcome::Ok);
        assert_eq!(outcome(&file(12, 12, &[0; 400]), 12), CheckOutcome::Ok);
    }

    #[test]
    fn fewer_than_promised_are_wrong() {
        assert_eq!(outcome(&file(13, 0, &[]), 12), CheckOutcome::Wrong);
        assert_eq!(outcome(&file(12, 12, &[]), 0), CheckOutcome::Wrong);
    }

    #[test]
    fn more_than_promised_are_a_note() {
        assert_eq!(outcome(&file(5, 5, &[]), 12), CheckOutcome::Note);
        assert_eq!(outcome(&file(0, 0, &[]), 12), CheckOutcome::Note);
        assert_eq!(outcome(&file(5, 13, &[]), 12), CheckOutcome::Wrong);
    }

    #[test]
    fn points_that_were_passed_over_are_wrong() {
        assert_eq!(outcome(&file(5, 5, &[]), 5), CheckOutcome::Wrong);
        assert_eq!(outcome(&file(0, 0, &[1, 2, 3]), 0), CheckOutcome::Wrong);
    }
}
