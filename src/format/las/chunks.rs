//! Where the chunks of a LAZ file lie: from its chunk table, which is checked
//! against the file before it is believed; from the chunks themselves where
//! there is none; and otherwise not at all, and the file is one stream. A writer
//! that was stopped leaves no table, and LASzip 1 knew none.

use super::chunk_table::{self, Table};
use super::coding::Coding;
use super::count::Claims;
use super::source::Source;
use super::{LasError, Reading, stream};

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

/// What was found out about the points of a LAZ file.
#[derive(Debug)]
pub struct Located {
    pub layout: Layout,
    /// Their true number.
    pub points: u64,
    /// Nothing that a finished file has is missing.
    pub complete: bool,
}

impl Located {
    fn complete(layout: Layout, points: u64) -> Located {
        Located { layout, points, complete: true }
    }

    fn makeshift(layout: Layout, points: u64) -> Located {
        Located { layout, points, complete: false }
    }
}

/// What the LASzip record says of chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chunking {
    /// None: LASzip 1.
    Whole,
    Fixed(u32),
    Variable,
}

/// Why a readable table does not go with the rest of the file.
enum Trouble {
    /// It is the table that is wrong; there are other ways to the points.
    Table(String),
    /// It is right, and the header's count is not.
    Header(String),
}

impl From<String> for Trouble {
    fn from(reason: String) -> Trouble {
        Trouble::Table(reason)
    }
}

/// What is known of a LAZ file before its chunks are.
pub struct Locator<'a> {
    pub source: &'a Source,
    pub coding: &'a Coding,
    pub chunking: Chunking,
    /// Where the points begin, and where they end at the latest.
    pub start: u64,
    pub end: u64,
    pub claims: Claims,
    /// Strictly, only a chunk table that accounts for every byte will do. Where
    /// what can be read is asked for, a count may turn out to be too high.
    pub reading: Reading,
}

/// No LAZ coder gets more points into a byte than this: even a point that
/// repeats the one before costs some thousandths of a bit in each of its
/// fields. A count beyond it is a lie that would have memory prepared for it.
const MOST_POINTS_A_BYTE: u64 = 1 << 16;

impl Locator<'_> {
    pub fn locate(&self, notes: &mut Vec<String>) -> Result<Located, LasError> {
        let path = self.source.path();
        let most = self.most();
        let beyond = self.claims.candidates().all(|count| count > most) && self.claims.largest() > 0;
        if beyond && self.reading != Reading::Readable {
            let reason = format!(
                "it says {} points, and {} bytes cannot hold as many",
                self.claims.said(),
                self.end.saturating_sub(self.start)
            );
            return Err(LasError::header(path, reason));
        }
        self.claims.note_disagreement(notes);
        let said = self.claims.candidates().find(|count| *count <= most);
        let said = said.unwrap_or(if beyond { most } else { 0 });
        if self.chunking == Chunking::Whole {
            let layout = Layout::Stream { start: self.start, end: self.end, chunk_points: None };
            return Ok(Located::complete(layout, said));
        }
        if said == 0 && self.end < self.start + 8 {
            return Ok(Located::complete(Layout::Chunks(Vec::new()), 0));
        }
        let variable = self.chunking == Chunking::Variable;
        let table = chunk_table::read(self.source, self.start, variable, self.coding.record_length, notes)?;
        let reason = match table {
            Table::Good(entries) => match self.with_table(&entries, notes) {
                Ok(found) => return Ok(found),
                Err(Trouble::Header(reason)) => return Err(LasError::header(path, reason)),
                Err(Trouble::Table(reason)) => reason,
            },
            Table::Bad(reason) => reason,
            Table::Beyond if self.reading == Reading::Strict => {
                "it should lie behind the end of the file".to_string()
            }
            Table::Beyond => {
                let reason = "its chunk table should lie behind its end".to_string();
                let whole = self.reading == Reading::Whole;
                let readable = if whole { self.readable(said)? } else { said };
                if readable < said {
                    let path = path.to_path_buf();
                    return Err(LasError::Cut { path, readable, points: said, reason });
                }
                reason
            }
        };
        if self.reading == Reading::Strict {
            let place = "its chunk table".to_string();
            return Err(LasError::Damaged { path: path.to_path_buf(), place, reason });
        }
        self.without_table(said, &reason, notes)
    }

    /// More points than this cannot be in the file's bytes.
    fn most(&self) -> u64 {
        self.end.saturating_sub(self.start).saturating_mul(MOST_POINTS_A_BYTE)
    }

    /// Gives every chunk of the table its points.
    fn with_table(&self, entries: &[(u64, u64)], notes: &mut Vec<String>) -> Result<Located, Trouble> {
        let said = self.claims.said();
        if entries.is_empty() && said > 0 {
            return Err(Trouble::Table(format!("its chunk table is empty, its header says {said} points")));
        }
        let mut chunks = Vec::with_capacity(entries.len());
        let (mut first, mut at) = (0u64, self.start + 8);
        for (points, bytes) in entries {
            let points = match self.chunking {
                Chunking::Fixed(points) => u64::from(points),
                _ => *points,
            };
            chunks.push(Chunk { first, points, at, bytes: *bytes });
            first = first
                .checked_add(points)
                .ok_or_else(|| "its chunk table promises too many points".to_string())?;
            at += bytes;
        }
        let points = match (self.chunking, chunks.last_mut()) {
            (Chunking::Fixed(each), Some(last)) => {
                last.points = self.last_of_fixed(*last, u64::from(each))?;
                last.first + last.points
            }
            _ => first,
        };
        if points > self.most() {
            return Err(Trouble::Table(format!(
                "its chunk table promises {points} points, more than its bytes can hold"
            )));
        }
        chunks.retain(|chunk| chunk.points > 0);
        if !self.claims.are(points) {
            notes.push(format!(
                "its header says {said} points, its chunks hold {points}; all of them are read"
            ));
        }
        Ok(Located { layout: Layout::Chunks(chunks), points, complete: self.claims.are(points) })
    }

    /// In a file with chunks of one size, the last one is shorter and the table
    /// does not say by how much: a layered chunk says it itself, of any other it
    /// has to be what the header's count leaves.
    fn last_of_fixed(&self, last: Chunk, each: u64) -> Result<u64, Trouble> {
        let (before, said) = (last.first, self.claims.said());
        // Some writers close a chunk without a point in it.
        if said == before && last.bytes < self.coding.record_length as u64 {
            return Ok(0);
        }
        if self.coding.layered {
            let mut front = vec![0; self.coding.layered_front()];
            if last.bytes < front.len() as u64 {
                return Err(Trouble::Table(format!("its last chunk has only {} bytes", last.bytes)));
            }
            self.source.read_exact_at(&mut front, last.at).map_err(|e| e.to_string())?;
            let (points, _) = self.coding.layered_extent(&front);
            if points == 0 || points > each {
                return Err(Trouble::Table(format!("its last chunk says that it has {points} points")));
            }
            return Ok(points);
        }
        let found = self.claims.candidates().find(|count| *count > before && *count <= before + each);
        found.map(|points| points - before).ok_or_else(|| {
            Trouble::Header(format!(
                "it says {said} points, but its LAZ chunks hold {} to {}",
                before + 1,
                before + each
            ))
        })
    }

    /// What can be done when the table is missing or wrong.
    fn without_table(&self, said: u64, reason: &str, notes: &mut Vec<String>) -> Result<Located, LasError> {
        let path = self.source.path();
        if self.coding.layered {
            // A header that counts none may be that of a writer that died.
            let chunks = self.walk(if said == 0 { u64::MAX } else { said })?;
            let points = chunks.last().map_or(0, |chunk| chunk.first + chunk.points);
            if points < said && self.reading != Reading::Readable {
                return Err(LasError::Cut {
                    path: path.to_path_buf(),
                    readable: points,
                    points: said,
                    reason: reason.to_string(),
                });
            }
            notes.push(format!("{reason}; its chunks were found one by one"));
            return Ok(Located::makeshift(Layout::Chunks(chunks), points));
        }
        match self.chunking {
            Chunking::Fixed(each) => {
                notes.push(format!("{reason}; it can only be read from front to back"));
                let layout =
                    Layout::Stream { start: self.start + 8, end: self.end, chunk_points: Some(each) };
                Ok(Located::makeshift(layout, said))
            }
            _ if self.reading == Reading::Readable => {
                notes.push(format!("{reason}; without it nobody knows where its chunks begin"));
                Ok(Located::makeshift(Layout::Chunks(Vec::new()), 0))
            }
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

    /// How many points are in a file that ends before its chunk table, as far as
    /// counting them does not take long.
    fn readable(&self, said: u64) -> Result<u64, LasError> {
        if self.coding.layered {
            let chunks = self.walk(said)?;
            return Ok(chunks.last().map_or(0, |chunk| chunk.first + chunk.points));
        }
        Ok(stream::count_readable(self.source, self.coding, self.chunking, self.start + 8, said))
    }
}
