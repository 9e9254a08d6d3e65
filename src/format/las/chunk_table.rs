//! The chunk table of a LAZ file: how many bytes, and sometimes points, each
//! chunk has. It is checked against the file before `laz` makes room for what
//! it promises.
//!
//! Its place stands in front of the points; a writer to a pipe, which cannot go
//! back there, puts it at the very end of the file.

use std::io::Cursor;

use laz::laszip::ChunkTable;

use super::LasError;
use super::coding::guard;
use super::source::FileReader;

/// Bytes of a table; one of twenty million chunks takes less.
const MOST_BYTES: u64 = 64 << 20;

/// A table that was read, or why it cannot be.
pub enum ReadTable {
    /// One that can be: where it begins, and points (0 where all chunks have the
    /// same) and bytes of every chunk. They may be too few.
    Good { at: u64, entries: Vec<(u64, u64)> },
    /// There is none, or it is nonsense.
    Bad(String),
    /// It should lie behind the end of the file.
    Beyond,
}

/// Reads the table of a file whose points begin at `start` with the table's
/// place. `variable` tables say points, too.
pub fn read(
    source: &FileReader,
    start: u64,
    variable: bool,
    record_length: usize,
    notes: &mut Vec<String>,
) -> Result<ReadTable, LasError> {
    let data_start = start + 8;
    if data_start > source.bytes() {
        return Ok(ReadTable::Beyond);
    }
    let mut at = integer_at(source, start)?;
    if at <= start as i64 {
        at = integer_at(source, source.bytes() - 8)?;
        if at < data_start as i64 || at as u64 >= source.bytes() {
            return Ok(ReadTable::Bad("it has no chunk table".to_string()));
        }
        notes.push("its chunk table's place stands at its end: it was written to a pipe".to_string());
    }
    let at = at as u64;
    if at + 8 > source.bytes() {
        return Ok(ReadTable::Beyond);
    }
    if at < data_start {
        return Ok(ReadTable::Bad("its chunk table should lie in front of its points".to_string()));
    }
    // No chunk but an empty one is shorter than a record, and none lies in a hole.
    let room = at - data_start;
    let most = (room - source.holes(data_start, at).min(room)) / record_length as u64 + 1;
    let entries = match entries(source, at, variable, most)? {
        Ok(entries) => entries,
        Err(reason) => return Ok(ReadTable::Bad(reason)),
    };
    match entries.iter().try_fold(0u64, |sum, (_, bytes)| sum.checked_add(*bytes)) {
        Some(total) if total <= room => Ok(ReadTable::Good { at, entries }),
        _ => Ok(ReadTable::Bad("its chunk table promises more bytes than there are".to_string())),
    }
}

/// The table's entries, of which there can be at most `most`; or what is wrong
/// with it.
fn entries(
    source: &FileReader,
    at: u64,
    variable: bool,
    most: u64,
) -> Result<Result<Vec<(u64, u64)>, String>, LasError> {
    let mut front = [0; 8];
    source.read_exact_at(&mut front, at)?;
    let version = u32::from_le_bytes([front[0], front[1], front[2], front[3]]);
    let count = u64::from(u32::from_le_bytes([front[4], front[5], front[6], front[7]]));
    if version != 0 || count > most {
        return Ok(Err(format!("its chunk table of version {version} with {count} chunks is nonsense")));
    }
    // Two numbers of 32 bits take at most a dozen bytes in this coding.
    let length = (64 + 24 * count).min(source.bytes() - at).min(MOST_BYTES);
    let mut bytes = vec![0; length as usize];
    source.read_exact_at(&mut bytes, at)?;
    let table = guard(|| ChunkTable::read(&mut Cursor::new(bytes.as_slice()), variable));
    Ok(match table {
        Ok(table) => Ok(table.into_iter().map(|entry| (entry.point_count, entry.byte_count)).collect()),
        Err(reason) => Err(format!("its chunk table cannot be read: {reason}")),
    })
}

/// Whether a chunk table of so many chunks begins there, as behind the last chunk of a
/// file that only lacks the table's place.
pub fn is_at(source: &FileReader, at: u64, chunks: u64) -> Result<bool, LasError> {
    if at + 8 > source.bytes() {
        return Ok(false);
    }
    let front = integer_at(source, at)? as u64;
    Ok(front as u32 == 0 && front >> 32 == chunks)
}

fn integer_at(source: &FileReader, at: u64) -> Result<i64, LasError> {
    let mut bytes = [0; 8];
    source.read_exact_at(&mut bytes, at)?;
    Ok(i64::from_le_bytes(bytes))
}

/// Bytes that are looked at to tell padding from points.
const MOST_PADDING: u64 = 1 << 20;

/// Whether points that end at `at` in a file of so many chunks end where they should:
/// at `end`, or where the chunk table is said to be, or at one, or only padding follows.
pub fn is_end(
    source: &FileReader,
    at: u64,
    end: u64,
    chunks: u64,
    table: Option<u64>,
) -> Result<bool, LasError> {
    if at >= end || table == Some(at) || chunks > 0 && is_at(source, at, chunks)? {
        return Ok(true);
    }
    let mut rest = vec![0; (end - at).min(MOST_PADDING) as usize];
    source.read_exact_at(&mut rest, at)?;
    // One that was cut within the first words of its table shows only those.
    let is_torn_table = rest.len() < 8 && rest.iter().take(4).all(|byte| *byte == 0);
    Ok(is_torn_table || rest.iter().all(|byte| *byte == rest[0]))
}
