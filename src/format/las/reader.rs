//! Opens a LAS or LAZ file and gives its records as they are, slice by slice,
//! to any number of threads.

use std::io;
use std::path::Path;
use std::sync::Arc;

use laz::LazVlr;
use laz::laszip::CompressorType;

use super::LasError;
use super::chunks::{Chunk, Chunking, Layout, Locator};
use super::coding::Coding;
use super::count::Claims;
use super::header::{self, Front, Header};
use super::source::Source;
use super::stream::Broken;
use super::turnstile::Turnstile;
use super::vlr::{self, Vlr};
use super::{Reading, crs, extra_bytes};
use crate::disk::others::Links;

/// Decoded bytes of a slice at most, however many points were asked for.
const MOST_SLICE: u64 = 128 << 20;
/// Points of a chunk that is decoded whole; larger ones go through the
/// turnstile in parts.
const MOST_CHUNK: u64 = 4_000_000;

/// A LAS or LAZ file, open for reading.
#[derive(Debug)]
pub struct LasFile {
    source: Arc<Source>,
    pub(super) header: Header,
    pub(super) body: Body,
    complete: bool,
}

/// What the points' part of a file turned out to be.
struct Points {
    body: Body,
    count: u64,
    missing: u64,
    record_length: usize,
    complete: bool,
}

/// Consecutive points of a file, as [`LasFile::slices`] cut them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slice {
    /// The first point's place in the file's order.
    pub first: u64,
    pub points: u32,
}

#[derive(Debug)]
pub(super) enum Body {
    /// Records one behind the other, from this byte on.
    Plain { at: u64 },
    /// LAZ chunks, each on its own.
    Chunks { coding: Coding, chunks: Vec<Chunk> },
    /// LAZ from front to back.
    Stream(Turnstile),
}

impl LasFile {
    pub fn open(path: &Path) -> Result<LasFile, LasError> {
        LasFile::open_with(path, Links::Followed)
    }

    /// The same; links may be refused, as below a watched folder.
    pub fn open_with(path: &Path, links: Links) -> Result<LasFile, LasError> {
        LasFile::open_as(path, Reading::Whole, links)
    }

    /// Opens a file in a watched folder, which may still be on its way: quickly,
    /// through no link, and without the lenience that [`LasFile::open`] has for LAZ without a sound chunk table.
    pub fn open_strictly(path: &Path) -> Result<LasFile, LasError> {
        LasFile::open_as(path, Reading::Strict, Links::Refused)
    }

    pub(super) fn open_as(path: &Path, reading: Reading, links: Links) -> Result<LasFile, LasError> {
        let source = Arc::new(Source::open(path, links)?);
        let mut notes = Vec::new();
        let front = header::read(&source, &mut notes)?;
        let records = records(&source, &front, &mut notes)?;
        let points = if front.compressed {
            compressed(&source, &front, &records, reading, &mut notes)?
        } else {
            plain(&source, &front, reading, &mut notes)?
        };

        let mut header = front.finish(&source);
        (header.points, header.missing) = (points.count, points.missing);
        header.record_length = points.record_length;
        let descriptions = records.iter().filter(|r| r.is("LASF_Spec", 4)).map(|r| r.data.as_slice());
        let standard = super::record_length(header.point_format).unwrap_or(points.record_length);
        header.extra = extra_bytes::parse(descriptions, standard, points.record_length, &mut notes);
        header.crs = crs::find(&records, &mut notes);
        header.crs_records = crs::records(records);
        header.notes = notes;
        Ok(LasFile { source, header, body: points.body, complete: points.complete })
    }

    /// Whether the file is finished by its own word: its header counts the
    /// points that there are, and a LAZ file has its chunk table. One that can
    /// be read and is not complete may still be growing.
    pub fn is_complete(&self) -> bool {
        self.complete
    }

    pub fn path(&self) -> &Path {
        self.source.path()
    }

    /// Changes whenever the file does: its length and the time of its last change.
    pub fn stamp(&self) -> String {
        self.source.stamp()
    }

    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Consecutive slices of about `points` points that cover all of them. LAZ
    /// slices begin and end where its chunks do. Ask for them in this order:
    /// some LAZ files can only be decoded from front to back.
    pub fn slices(&self, points: u32) -> Vec<Slice> {
        let most = (MOST_SLICE / self.header.record_length as u64).clamp(1, u64::from(u32::MAX));
        let wanted = u64::from(points.max(1)).min(most);
        let Body::Chunks { chunks, .. } = &self.body else {
            return (0..self.header.points.div_ceil(wanted))
                .map(|slice| slice * wanted)
                .map(|first| Slice { first, points: wanted.min(self.header.points - first) as u32 })
                .collect();
        };
        let mut slices: Vec<Slice> = Vec::new();
        for chunk in chunks {
            match slices.last_mut() {
                Some(slice) if u64::from(slice.points) + chunk.points <= wanted => {
                    slice.points += chunk.points as u32;
                }
                _ => slices.push(Slice { first: chunk.first, points: chunk.points as u32 }),
            }
        }
        slices
    }

    /// Decodes a slice into raw records of `header().record_length` bytes, laid
    /// out as LAS says for `header().point_format`. What was in `records` is
    /// replaced.
    pub fn read(&self, slice: Slice, records: &mut Vec<u8>) -> Result<(), LasError> {
        self.read_slice(slice, records).map_err(|error| match error {
            // What somebody writes to while it is read does not decode, but it
            // is not damaged: read again, it may be fine. One that is gone still
            // has its bytes.
            LasError::Cut { .. } | LasError::Damaged { .. } if self.path().exists() => {
                self.check_unchanged().err().unwrap_or(error)
            }
            error => error,
        })
    }

    fn read_slice(&self, slice: Slice, records: &mut Vec<u8>) -> Result<(), LasError> {
        let end = slice.first.checked_add(u64::from(slice.points));
        if end.is_none_or(|end| end > self.header.points) {
            return Err(self.not_a_slice(slice));
        }
        let length = self.header.record_length;
        let room = |records: &mut Vec<u8>| match slice.points as usize * length {
            // The system gives zeroed memory for less than it takes to zero it.
            bytes if records.capacity() < bytes => *records = vec![0; bytes],
            bytes => records.resize(bytes, 0),
        };
        match &self.body {
            Body::Plain { at } => {
                room(records);
                self.source.read_exact_at(records, at + slice.first * length as u64)
            }
            Body::Chunks { coding, chunks } => {
                let chunks = self.chunks_of(slice, chunks)?;
                room(records);
                self.decode(coding, chunks, records)
            }
            Body::Stream(turnstile) => {
                room(records);
                turnstile.read(slice.first, records).map_err(|broken| self.broken(slice, broken))
            }
        }
    }

    /// Fails with the reason if the file is no longer what it was when it was
    /// opened.
    pub fn check_unchanged(&self) -> Result<(), LasError> {
        self.source.check_unchanged()
    }

    fn chunks_of<'a>(&self, slice: Slice, chunks: &'a [Chunk]) -> Result<&'a [Chunk], LasError> {
        let end = slice.first + u64::from(slice.points);
        let from = chunks.partition_point(|chunk| chunk.first < slice.first);
        let to = chunks.partition_point(|chunk| chunk.first < end);
        let covered = chunks[from..to].iter().map(|chunk| chunk.points).sum::<u64>();
        if covered != u64::from(slice.points) || chunks.get(from).is_some_and(|c| c.first != slice.first) {
            return Err(self.not_a_slice(slice));
        }
        Ok(&chunks[from..to])
    }

    /// Chunks that follow one another in the file: one read, then each.
    pub(super) fn decode(
        &self,
        coding: &Coding,
        chunks: &[Chunk],
        records: &mut [u8],
    ) -> Result<(), LasError> {
        let (Some(first), Some(last)) = (chunks.first(), chunks.last()) else { return Ok(()) };
        let mut bytes = vec![0; (last.at + last.bytes - first.at) as usize];
        self.source.read_exact_at(&mut bytes, first.at)?;
        let mut records = records;
        for chunk in chunks {
            let (now, later) = records.split_at_mut(chunk.points as usize * coding.record_length);
            let start = (chunk.at - first.at) as usize;
            coding.decode(&bytes[start..start + chunk.bytes as usize], now).map_err(|reason| {
                let last = chunk.first + chunk.points - 1;
                let place = format!(
                    "the LAZ chunk of {} bytes at byte {} with the points {} to {last}",
                    chunk.bytes, chunk.at, chunk.first
                );
                LasError::Damaged { path: self.path().to_path_buf(), place, reason }
            })?;
            records = later;
        }
        Ok(())
    }

    fn broken(&self, slice: Slice, broken: Broken) -> LasError {
        let path = self.path().to_path_buf();
        if broken.unread {
            return LasError::io("read", &path, io::Error::other(broken.reason));
        }
        if broken.ended {
            let Broken { readable, reason, .. } = broken;
            return LasError::Cut { path, readable, points: self.header.points, reason };
        }
        let last = slice.first + u64::from(slice.points) - 1;
        let place = format!(
            "the LAZ stream behind point {}, within the points {} to {last}",
            broken.readable, slice.first
        );
        LasError::Damaged { path, place, reason: broken.reason }
    }

    fn not_a_slice(&self, slice: Slice) -> LasError {
        let last = slice.first.saturating_add(u64::from(slice.points)).saturating_sub(1);
        LasError::NotASlice { path: self.path().to_path_buf(), first: slice.first, last }
    }
}

/// The variable length records that mean something, the extended ones last.
fn records(source: &Source, front: &Front, notes: &mut Vec<String>) -> Result<Vec<Vlr>, LasError> {
    let said = front.raw.number_of_variable_length_records;
    let mut records = vlr::read(source, front.size, front.points_at(), said, notes)?;
    if let Some((start, said)) = front.extended(source, notes) {
        records.extend(vlr::read_extended(source, start, said, notes)?);
    }
    Ok(records)
}

fn plain(
    source: &Source,
    front: &Front,
    reading: Reading,
    notes: &mut Vec<String>,
) -> Result<Points, LasError> {
    let length = usize::from(front.raw.point_data_record_length);
    let claims = Claims::of(&front.raw);
    let at = front.points_at();
    // Where something else begins behind the points, they end there, unless
    // its place is wrong and the points are all there.
    let bytes = front.points_end(source).saturating_sub(at);
    let (room, rest) = (bytes / length as u64, bytes % length as u64);
    let all = source.bytes().saturating_sub(at);
    let mut missing = 0;
    let judged = claims.judge(room, rest, notes).or_else(|too_many| {
        if all / (length as u64) < too_many.said {
            let end = at.min(source.bytes()) + room * length as u64;
            let reason = format!("the last whole record ends at byte {end}");
            let (path, readable, points) = (source.path().to_path_buf(), room, too_many.said);
            if reading != Reading::Readable {
                return Err(LasError::Cut { path, readable, points, reason });
            }
            missing = points - readable;
            notes.push(format!("{readable} of its {points} points are there: {reason}"));
            return Ok(readable);
        }
        let (room, rest) = (all / length as u64, all % length as u64);
        notes.push("its extended records or waveforms should begin among its points".to_string());
        claims
            .judge(room, rest.max(1), notes)
            .map_err(|_| LasError::header(source.path(), "its counts contradict"))
    })?;
    let complete = claims.are(judged);
    Ok(Points { body: Body::Plain { at }, count: judged, missing, record_length: length, complete })
}

fn compressed(
    source: &Arc<Source>,
    front: &Front,
    records: &[Vlr],
    reading: Reading,
    notes: &mut Vec<String>,
) -> Result<Points, LasError> {
    let path = source.path();
    let record = records
        .iter()
        .find(|r| r.is(LazVlr::USER_ID, LazVlr::RECORD_ID))
        .ok_or_else(|| LasError::header(path, "it is marked as LAZ but has no LASzip record"))?;
    let vlr = LazVlr::from_buffer(&record.data)
        .map_err(|e| LasError::header(path, format!("its LASzip record cannot be read: {e}")))?;
    let coding =
        Coding::new(vlr.items(), front.point_format).map_err(|reason| LasError::unsupported(path, reason))?;
    if coding.record_length != usize::from(front.raw.point_data_record_length) {
        notes.push(format!(
            "its header says records of {} bytes, its LASzip record {}",
            front.raw.point_data_record_length, coding.record_length
        ));
    }
    let locator = Locator {
        source,
        chunking: chunking(&record.data, &vlr).map_err(|reason| LasError::unsupported(path, reason))?,
        coding: &coding,
        start: front.points_at(),
        end: front.points_end(source).max(front.points_at()),
        claims: Claims::of(&front.raw),
        reading,
    };
    let located = locator.locate(notes)?;
    let missing = match reading {
        Reading::Readable => locator.claims.said().saturating_sub(located.points),
        Reading::Strict | Reading::Whole => 0,
    };
    if missing > 0 {
        notes.push(format!("{} of its {} points are there", located.points, located.points + missing));
    }
    let record_length = coding.record_length;
    let body = match located.layout {
        Layout::Chunks(chunks) if chunks.iter().all(|chunk| is_small(chunk, record_length)) => {
            Body::Chunks { coding, chunks }
        }
        layout => Body::Stream(Turnstile::new(source.clone(), coding, layout)),
    };
    Ok(Points { body, count: located.points, missing, record_length, complete: located.complete })
}

fn is_small(chunk: &Chunk, record_length: usize) -> bool {
    chunk.points <= MOST_CHUNK && chunk.points * record_length as u64 <= MOST_SLICE
}

/// How a LASzip record says that chunks are cut. The compressor is the first
/// number of the record; `laz` keeps it to itself.
fn chunking(data: &[u8], vlr: &LazVlr) -> Result<Chunking, String> {
    match u16::from_le_bytes([data[0], data[1]]) {
        kind if kind == CompressorType::PointWise as u16 => Ok(Chunking::Whole),
        kind if kind == CompressorType::None as u16 => {
            Err("its LASzip record says that it is not compressed".to_string())
        }
        _ if vlr.uses_variable_size_chunks() => Ok(Chunking::Variable),
        _ => Ok(Chunking::Fixed(vlr.chunk_size())),
    }
}
