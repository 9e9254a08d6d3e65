//! Where the chunks of a LAZ file lie: from its chunk table, which is checked
//! against the file before it is believed; from the chunks themselves where
//! there is none; and otherwise not at all, and the file is one stream.
//!
//! A writer to a pipe puts the table's place at the very end of the file, a
//! writer that was stopped leaves no table, and LASzip 1 knew none.

use std::io::Cursor;

use laz::laszip::ChunkTable;

use super::LasError;
use super::coding::{Coding, guard};
use super::count::Claims;
use super::source::Source;

/// One chunk of points that can be decoded on its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chunk {
    /// Its first point's place in the file's order.
    pub first: u64,
    pub points: u64,
    /// Where its bytes begin in the file.
    pub at: u64,
    pub bytes: u64,
}

/// How to get at the points.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Layout {
    Chunks(Vec<Chunk>),
    /// One behind the other, from `start` to at most `end`; with a decoder that
    /// starts anew every `chunk_points`, if any.
    Stream {
        start: u64,
        end: u64,
        chunk_points: Option<u32>,
    },
}

/// What the LASzip record says of chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chunking {
    /// None: LASzip 1.
    Whole,
    Fixed(u32),
    Variable,
}

/// A table that was read, or why it cannot be.
enum Table {
    Good(Vec<(u64, u64)>),
    /// There is none, or it is nonsense.
    Bad(String),
    /// It should lie behind the end of the file.
    Beyond,
}

pub struct Locator<'a> {
    pub source: &'a Source,

    pub coding: &'a Coding,
    pub chunking: Chunking,
    /// Where the points begin, and where they end at the latest.
    pub start: u64,
    pub end: u64,
    pub claims: Claims,
}

/// No LAZ coder gets more points into a byte than this: even a point that
/// repeats the one before costs some thousandths of a bit in each of its
/// fields. A count beyond it is a lie that would have memory prepared for it.
const MOST_POINTS_A_BYTE: u64 = 1 << 16;

impl Locator<'_> {
    /// The layout and the true number of points.
    pub fn locate(&self, notes: &mut Vec<String>) -> Result<(Layout, u64), LasError> {
        let path = self.source.path();
        let most = self.most();
        if self.claims.candidates().all(|count| count > most) && self.claims.largest() > 0 {
            let reason = format!(
                "it says {} points, and {} bytes cannot hold as many",
                self.claims.said(),
                self.end.saturating_sub(self.start)
            );
            return Err(LasError::header(path, reason));
        }
        self.claims.note_disagreement(notes);
        let said = self.claims.candidates().find(|count| *count <= most).unwrap_or(0);
        if self.chunking == Chunking::Whole {
            return Ok((Layout::Stream { start: self.start, end: self.end, chunk_points: None }, said));
        }
        if said == 0 && self.end < self.start + 8 {
            return Ok((Layout::Chunks(Vec::new()), 0));
        }
        let reason = match self.table(notes)? {
            Table::Good(entries) => match self.from_table(&entries, notes) {
                Ok(found) => return Ok(found),
                Err(reason) => reason,
            },
            Table::Bad(reason) => reason,
            Table::Beyond => return Err(self.cut(said)?),
        };
        self.without_table(said, &reason, notes)
    }

    /// More points than this cannot be in the file's bytes.
    fn most(&self) -> u64 {
        self.end.saturating_sub(self.start).saturating_mul(MOST_POINTS_A_BYTE)
    }

    fn table(&self, notes: &mut Vec<String>) -> Result<Table, LasError> {
        if self.start + 8 > self.source.bytes() {
            return Ok(Table::Beyond);
        }
        let data_start = self.start + 8;
        let mut at = self.integer_at(self.start)?;
        if at <= self.start as i64 {
            at = self.integer_at(self.source.bytes() - 8)?;
            if at < data_start as i64 || at as u64 >= self.source.bytes() {
                return Ok(Table::Bad("it has no chunk table".to_string()));
            }
            notes.push("its chunk table's place stands at its end: it was written to a pipe".to_string());
        }
        let at = at as u64;
        if at + 8 > self.source.bytes() {
            return Ok(Table::Beyond);
        }
        if at < data_start {
            return Ok(Table::Bad("its chunk table should lie in front of its points".to_string()));
        }
        let room = at - data_start;
        let mut front = [0; 8];
        self.source.read_exact_at(&mut front, at)?;
        let version = u32::from_le_bytes([front[0], front[1], front[2], front[3]]);
        let count = u64::from(u32::from_le_bytes([front[4], front[5], front[6], front[7]]));
        // Before `laz` makes room for them: every chunk begins with a record as
        // it is, save one that may be empty.
        if version != 0 || count > room / self.coding.record_length as u64 + 1 {
            return Ok(Table::Bad(format!(
                "its chunk table of version {version} with {count} chunks is nonsense"
            )));
        }
        let length = (8 + 64 + 24 * count).min(self.source.bytes() - at);
        let mut bytes = vec![0; length as usize];
        self.source.read_exact_at(&mut bytes, at)?;
        let variable = self.chunking == Chunking::Variable;
        let table = match guard(|| ChunkTable::read(&mut Cursor::new(bytes.as_slice()), variable)) {
            Ok(table) => table,
            Err(reason) => return Ok(Table::Bad(format!("its chunk table cannot be read: {reason}"))),
        };
        let entries: Vec<(u64, u64)> = table.into_iter().map(|e| (e.point_count, e.byte_count)).collect();
        let total = entries.iter().try_fold(0u64, |sum, (_, bytes)| sum.checked_add(*bytes));
        match total {
            Some(total) if total <= room => {
                if total < room {
                    notes.push(format!(
                        "{} bytes between its chunks and their table belong to nothing",
                        room - total
                    ));
                }
                Ok(Table::Good(entries))
            }
            _ => Ok(Table::Bad("its chunk table promises more bytes than there are".to_string())),
        }
    }

    fn integer_at(&self, at: u64) -> Result<i64, LasError> {
        let mut bytes = [0; 8];
        self.source.read_exact_at(&mut bytes, at)?;
        Ok(i64::from_le_bytes(bytes))
    }

    /// Gives every chunk its points. `Err` where the table does not go with the
    /// header's count.
    fn from_table(&self, entries: &[(u64, u64)], notes: &mut Vec<String>) -> Result<(Layout, u64), String> {
        let mut chunks = Vec::with_capacity(entries.len());
        let (mut first, mut at) = (0u64, self.start + 8);
        for (points, bytes) in entries {
            let points = match self.chunking {
                Chunking::Fixed(points) => u64::from(points),
                _ => *points,
            };
            chunks.push(Chunk { first, points, at, bytes: *bytes });
            first = first.checked_add(points).ok_or("its chunk table promises too many points")?;
            at += bytes;
        }
        let points = match self.chunking {
            Chunking::Fixed(each) => self.last_of_fixed(&mut chunks, u64::from(each))?,
            _ => first,
        };
        if points > self.most() {
            return Err(format!("its chunk table promises {points} points, more than its bytes can hold"));
        }
        chunks.retain(|chunk| chunk.points > 0);
        if self.claims.said() != points && !self.claims.candidates().any(|count| count == points) {
            notes.push(format!(
                "its header says {} points, its chunks hold {points}; all of them are read",
                self.claims.said()
            ));
        }
        Ok((Layout::Chunks(chunks), points))
    }

    /// In a file with chunks of one size, the last one is shorter and the table
    /// does not say how much: layered chunks say it themselves, of others it
    /// has to be what the header's count leaves.
    fn last_of_fixed(&self, chunks: &mut [Chunk], each: u64) -> Result<u64, String> {
        let Some(last) = chunks.last_mut() else {
            return match self.claims.said() {
                0 => Ok(0),
                said => Err(format!("its chunk table is empty, its header says {said} points")),
            };
        };
        let before = last.first;
        if self.coding.layered && last.bytes >= self.coding.layered_front() as u64 {
            let mut front = vec![0; self.coding.layered_front()];
            self.source.read_exact_at(&mut front, last.at).map_err(|e| e.to_string())?;
            let (points, _) = self.coding.layered_extent(&front);
            if points == 0 || points > each {
                return Err(format!("its last chunk says that it has {points} points"));
            }
            last.points = points;
            return Ok(before + points);
        }
        let candidate = self.claims.candidates().find(|count| *count > before && *count <= before + each);
        match candidate {
            Some(points) => {
                last.points = points - before;
                Ok(points)
            }
            // A writer that closes a chunk without a point in it.
            None if self.claims.said() == before => {
                last.points = 0;
                Ok(before)
            }
            None => Err(format!(
                "its header says {} points, its chunk table goes with {} to {}",
                self.claims.said(),
                before + 1,
                before + each
            )),
        }
    }

    /// What can be done when the table is missing or wrong.
    fn without_table(
        &self,
        said: u64,
        reason: &str,
        notes: &mut Vec<String>,
    ) -> Result<(Layout, u64), LasError> {
        let path = self.source.path();
        if self.coding.layered {
            // A header that counts none may be that of a writer that died.
            let chunks = self.walk(if said == 0 { u64::MAX } else { said })?;
            let points = chunks.last().map_or(0, |chunk| chunk.first + chunk.points);
            if points < said {
                return Err(LasError::Cut {
                    path: path.to_path_buf(),
                    readable: points,
                    points: said,
                    reason: reason.to_string(),
                });
            }
            notes.push(format!("{reason}; its chunks were found one by one"));
            return Ok((Layout::Chunks(chunks), points));
        }
        match self.chunking {
            Chunking::Fixed(each) if said > 0 && !reason.starts_with("its header") => {
                notes.push(format!("{reason}; it can only be read from front to back"));
                let layout =
                    Layout::Stream { start: self.start + 8, end: self.end, chunk_points: Some(each) };
                Ok((layout, said))
            }
            Chunking::Fixed(_) => Err(LasError::header(path, reason)),
            _ => Err(LasError::Damaged {
                path: path.to_path_buf(),
                place: "every chunk".to_string(),
                reason: reason.to_string(),
            }),
        }
    }

    /// Layered chunks one by one: each says how many points and bytes it has.
    fn walk(&self, said: u64) -> Result<Vec<Chunk>, LasError> {
        let mut chunks = Vec::new();
        let mut front = vec![0; self.coding.layered_front()];
        let (mut first, mut at) = (0, self.start + 8);
        while first < said && at + front.len() as u64 <= self.end {
            self.source.read_exact_at(&mut front, at)?;
            let (points, bytes) = self.coding.layered_extent(&front);
            let most = match self.chunking {
                Chunking::Fixed(each) => u64::from(each),
                _ => u64::from(u32::MAX),
            };
            if points == 0 || points > most || points > said - first || at + bytes > self.end {
                break;
            }
            chunks.push(Chunk { first, points, at, bytes });
            first += points;
            at += bytes;
        }
        Ok(chunks)
    }

    /// The file ends before its chunk table. How many points are in front of
    /// that is counted, if it does not take long.
    fn cut(&self, said: u64) -> Result<LasError, LasError> {
        let readable = if self.coding.layered {
            self.walk(said)?.last().map_or(0, |chunk| chunk.first + chunk.points)
        } else {
            super::sequential::count_readable(self.source, self.coding, self.chunking, self.start + 8, said)
        };
        Ok(LasError::Cut {
            path: self.source.path().to_path_buf(),
            readable,
            points: said,
            reason: "its chunk table should lie behind its end".to_string(),
        })
    }
}
