//! Where the chunks of a LAZ file lie: from its chunk table, which is checked
//! against the file before it is believed; from the chunks themselves where
//! there is none, or it lacks some; and otherwise not at all, and the file is one
//! stream. A writer that was stopped leaves no table, and LASzip 1 knew none.

use super::behind::Reach;
use super::chunk_table::{self, ReadTable};
use super::coding::Coding;
use super::declared_counts::{Behind, DeclaredCounts, Evidence, ResolvedCounts, judge};
use super::source::FileReader;
use super::{LasError, ReadMode};

/// One chunk of points that can be decoded on its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PointChunk {
    /// Its first point's place in the file's order.
    pub first: u64,
    pub points: u64,
    /// Where its bytes begin in the file.
    pub at: u64,
    pub bytes: u64,
}

/// How to get at the points.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ChunkLayout {
    Chunks(Vec<PointChunk>),
    /// One behind the other, from `start` to at most `end`; with a decoder that
    /// starts anew every `chunk_points`, if any.
    Stream {
        start: u64,
        end: u64,
        chunk_points: Option<u32>,
        /// How many are read.
        points: u64,
        /// What lies behind them was looked at and is nothing.
        settled: bool,
    },
}

/// What was found out about the points of a LAZ file.
#[derive(Debug)]
pub struct Located {
    pub layout: ChunkLayout,
    pub verdict: ResolvedCounts,
    /// Nothing that a finished file has is missing.
    pub complete: bool,
    /// Why the verdict is no simple one.
    pub reason: String,
}

/// What the LASzip record says of chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chunking {
    /// None: LASzip 1.
    Whole,
    Fixed(u32),
    Variable,
}

/// What is known of a LAZ file before its chunks are.
pub struct Locator<'a> {
    pub source: &'a FileReader,
    pub coding: &'a Coding,
    pub chunking: Chunking,
    /// Where the points begin, and where they end at the latest.
    pub start: u64,
    pub end: u64,
    /// Bytes between those that were ever written; a sparse file has holes.
    pub written: u64,
    pub claims: DeclaredCounts,
    /// Where points may be expected.
    pub reach: Reach,
    /// Strictly, only a chunk table that accounts for every byte will do. Where
    /// what can be read is asked for, a count may turn out to be too high.
    pub reading: ReadMode,
}

/// What the chunk table of a file is worth.
#[derive(Debug, Default)]
pub struct Listed {
    /// Chunks as it says them, one behind the other. Of chunks of one size the last has
    /// as many points as the others, which need not be so.
    pub chunks: Vec<PointChunk>,
    /// Where their bytes end.
    pub end: u64,
    /// Where the bytes of all chunks end at the latest: the table begins there.
    pub limit: u64,
    /// Why it cannot be used at all.
    pub trouble: Option<String>,
}

impl Listed {
    pub fn points(&self) -> u64 {
        self.chunks.last().map_or(0, |chunk| chunk.first + chunk.points)
    }

    /// Whether every byte in front of it belongs to a chunk that it lists.
    pub fn is_whole(&self) -> bool {
        self.trouble.is_none() && self.end == self.limit
    }
}

/// No LAZ coder gets more points into a byte than this. The most probable of n
/// symbols takes (n − 1) of 32 768 parts of a coder's interval from the others, and no
/// point is coded in less than a symbol of 64 and the lengths of three corrections:
/// 0.0075 bits, or 1 070 points a byte. A count beyond twice that is a lie that would
/// have memory prepared for it.
pub const MOST_POINTS_A_BYTE: u64 = 2048;

impl Locator<'_> {
    pub fn locate(&self, notes: &mut Vec<String>) -> Result<Located, LasError> {
        self.check_bound()?;
        self.claims.note_disagreement(notes);
        if self.chunking == Chunking::Whole {
            return self.stream(None, self.start, self.end, None, notes);
        }
        if self.claims.said() == 0 && self.end < self.start + 8 {
            return Ok(self.counted(ChunkLayout::Chunks(Vec::new()), 0));
        }
        let listed = self.listed(notes)?;
        if let (ReadMode::Strict, Some(reason)) = (self.reading, &listed.trouble) {
            let (path, place) = (self.source.path().to_path_buf(), "its chunk table".to_string());
            return Err(LasError::Damaged { path, place, reason: reason.clone() });
        }
        match self.chunking {
            _ if self.coding.layered => self.layered(listed, notes),
            Chunking::Fixed(each) => self.pointwise(listed, each, notes),
            Chunking::Variable | Chunking::Whole => self.variable(listed, notes),
        }
    }

    /// More points than this cannot be in the file's bytes.
    pub fn most(&self) -> u64 {
        self.written.saturating_mul(MOST_POINTS_A_BYTE)
    }

    /// A count that no LAZ can hold in so many bytes.
    fn check_bound(&self) -> Result<(), LasError> {
        let most = self.most();
        let beyond = self.claims.largest() > 0 && self.claims.candidates().all(|count| count > most);
        if !beyond || self.reading == ReadMode::Readable {
            return Ok(());
        }
        let (said, bytes) = (self.claims.said(), self.written);
        let reason = format!("it says {said} points, and {bytes} bytes cannot hold as many");
        Err(LasError::header(self.source.path(), reason))
    }

    fn listed(&self, notes: &mut Vec<String>) -> Result<Listed, LasError> {
        let start = self.start + 8;
        let variable = self.chunking == Chunking::Variable;
        let table = chunk_table::read(self.source, self.start, variable, self.coding.record_length, notes)?;
        let without = |reason: String| Listed {
            chunks: Vec::new(),
            end: start,
            limit: self.end.max(start),
            trouble: Some(reason),
        };
        let (limit, entries) = match table {
            ReadTable::Good { at, entries } => (at, entries),
            ReadTable::Bad(reason) => return Ok(without(reason)),
            ReadTable::Beyond => return Ok(without("its chunk table should lie behind its end".to_string())),
        };
        let mut chunks: Vec<PointChunk> = Vec::with_capacity(entries.len());
        let (mut first, mut at) = (0u64, start);
        for (points, bytes) in entries {
            let points = match self.chunking {
                Chunking::Fixed(each) => u64::from(each),
                Chunking::Variable | Chunking::Whole => points,
            };
            let Some(next) = first.checked_add(points) else {
                return Ok(without("its chunk table promises too many points".to_string()));
            };
            // An entry without points or bytes is no chunk.
            if points > 0 && bytes > 0 {
                chunks.push(PointChunk { first, points, at, bytes });
                first = next;
            }
            at += bytes;
        }
        // Some writers close a chunk without a point in it.
        if let Some(last) = chunks.last()
            && last.bytes < self.coding.record_length as u64
            && (self.claims.are(last.first) || variable)
        {
            chunks.pop();
        }
        Ok(Listed { chunks, end: at, limit, trouble: None })
    }

    pub fn counted(&self, layout: ChunkLayout, points: u64) -> Located {
        let (verdict, complete) = (ResolvedCounts::Counted(points), self.claims.are(points));
        Located { layout, verdict, complete, reason: String::new() }
    }

    /// Layered chunks say how many points and bytes they have.
    fn layered(&self, mut listed: Listed, notes: &mut Vec<String>) -> Result<Located, LasError> {
        if listed.is_whole() && self.set_last(&mut listed.chunks)? && self.claims.are(listed.points()) {
            let points = listed.points();
            return Ok(self.counted(ChunkLayout::Chunks(listed.chunks), points));
        }
        let (chunks, end) = self.walk(&listed)?;
        let points = chunks.last().map_or(0, |chunk| chunk.first + chunk.points);
        let knows_end = listed.trouble.is_none();
        let is_end = match knows_end {
            true => end == listed.limit,
            false => chunk_table::is_end(self.source, end, listed.limit, chunks.len() as u64, None)?,
        };
        let spare = listed.limit.saturating_sub(end);
        let reason = match &listed.trouble {
            Some(reason) => reason.clone(),
            None if is_end => "its chunks say so, and nothing is left behind them".to_string(),
            None => format!("{spare} bytes between its chunks and their table belong to nothing"),
        };
        match &listed.trouble {
            Some(reason) => notes.push(format!("{reason}; its chunks were found one by one")),
            None if chunks.len() != listed.chunks.len() => notes.push(format!(
                "its chunk table lists {} of its {} chunks; the others were found one by one",
                listed.chunks.len(),
                chunks.len()
            )),
            None if !is_end => notes.push(reason.clone()),
            None => {}
        }
        let behind = Behind::Points;
        let evidence =
            Evidence { claims: self.claims, room: points, torn: !is_end, behind, header_is_exact: false };
        let complete = knows_end && is_end && listed.is_whole() && self.claims.are(points);
        Ok(Located { layout: ChunkLayout::Chunks(chunks), verdict: judge(&evidence), complete, reason })
    }

    /// Gives the last of chunks of one size the points that it says it has.
    fn set_last(&self, chunks: &mut [PointChunk]) -> Result<bool, LasError> {
        let (Chunking::Fixed(_), Some(last)) = (self.chunking, chunks.last_mut()) else { return Ok(true) };
        match self.front(last.at, last.at + last.bytes)? {
            Some((points, _)) if points <= last.points => {
                last.points = points;
                Ok(true)
            }
            _ => Ok(false),
        }
    }

    /// Points and bytes of the layered chunk that begins at `at`, if there is one that
    /// ends at `end` at the latest.
    fn front(&self, at: u64, end: u64) -> Result<Option<(u64, u64)>, LasError> {
        let mut front = vec![0; self.coding.layered_front()];
        if end.saturating_sub(at) < front.len() as u64 {
            return Ok(None);
        }
        self.source.read_exact_at(&mut front, at)?;
        let (points, bytes) = self.coding.layered_extent(&front);
        let most = match self.chunking {
            Chunking::Fixed(each) => u64::from(each),
            Chunking::Variable | Chunking::Whole => u64::from(u32::MAX),
        };
        let can_be = points > 0
            && points <= most
            && points <= bytes.saturating_mul(MOST_POINTS_A_BYTE)
            && bytes <= end - at;
        Ok(can_be.then_some((points, bytes)))
    }

    /// Layered chunks one by one, and where they end. Over a chunk whose front makes no
    /// sense the table helps, where it knows one there.
    fn walk(&self, listed: &Listed) -> Result<(Vec<PointChunk>, u64), LasError> {
        let mut chunks = Vec::new();
        let (mut first, mut at) = (0, self.start + 8);
        loop {
            if listed.trouble.is_some() && chunk_table::is_at(self.source, at, chunks.len() as u64)? {
                break;
            }
            let known = listed.chunks.binary_search_by_key(&at, |chunk| chunk.at).ok();
            let known = known.map(|place| {
                let PointChunk { points, bytes, .. } = listed.chunks[place];
                // Of the last one of several of one size, what the header's count leaves.
                let is_last = place + 1 == listed.chunks.len();
                let left =
                    self.claims.candidates().find(|count| (1..=points).contains(&count.wrapping_sub(first)));
                (left.filter(|_| is_last).map_or(points, |count| count - first), bytes)
            });
            let Some((points, bytes)) = self.front(at, listed.limit)?.or(known) else { break };
            chunks.push(PointChunk { first, points, at, bytes });
            (first, at) = (first + points, at + bytes);
        }
        Ok((chunks, at))
    }
}
