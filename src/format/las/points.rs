//! What the points' part of a file turns out to be: how many there are, where they
//! lie, and whether every byte between the first of them and what verifiably follows is
//! accounted for. This is the one place where that is settled, for LAS and for LAZ: a
//! file is opened only as what comes out of [`settle`], with a note where its header
//! says otherwise, or not at all.

use std::sync::Arc;

use laz::LazVlr;
use laz::laszip::CompressorType;

use super::behind::{PlainRecords, Reach, RecordsBehind};
use super::chunks::{ChunkLayout, Chunking, Located, Locator, PointChunk};
use super::coding::Coding;
use super::declared_counts::{Behind, DeclaredCounts, Evidence, ResolvedCounts, judge};
use super::header::RawHeader;
use super::sequential::SequentialDecoder;
use super::source::FileReader;
use super::vlr::{self, Vlr};
use super::{LasError, ReadMode};

/// How to get at the points of a file.
#[derive(Debug)]
pub enum PointBody {
    /// Records one behind the other, from this byte on.
    Plain { at: u64 },
    /// LAZ chunks, each on its own.
    Chunks { coding: Coding, chunks: Vec<PointChunk> },
    /// LAZ from front to back.
    Stream(Box<SequentialDecoder>),
}

/// What the points' part of a file turned out to be.
pub struct PointsPart {
    pub body: PointBody,
    pub count: u64,
    pub missing: u64,
    pub record_length: usize,
    pub complete: bool,
    /// Points that the last chunk may have, where only its bytes say how many it does.
    pub most_in_last: Option<u64>,
}

/// The variable length records that mean something, the extended ones last.
pub fn records(
    source: &FileReader,
    front: &RawHeader,
    notes: &mut Vec<String>,
) -> Result<Vec<Vlr>, LasError> {
    let said = front.raw.number_of_variable_length_records;
    let mut records = vlr::read(source, front.size, front.points_at(), said, notes)?;
    if let Some((start, said)) = front.extended(source, notes)? {
        records.extend(vlr::read_extended(source, start, said, notes)?);
    }
    Ok(records)
}

/// Holes of a sparse file that may be an oddity of its copy; of more than this, and
/// more than half of the points, there is nothing to read.
const MOST_HOLES: u64 = 64 << 20;

pub fn plain(
    source: &FileReader,
    front: &RawHeader,
    reading: ReadMode,
    notes: &mut Vec<String>,
) -> Result<PointsPart, LasError> {
    let length = u64::from(front.raw.point_data_record_length);
    let at = front.points_at();
    let returns = front.returns();
    let point_format = front.point_format;
    let records = PlainRecords { source, at, length, point_format, raw: &front.raw, returns: &returns };
    let claims = DeclaredCounts::of(&front.raw);
    claims.note_disagreement(notes);
    let judged = |end: u64| -> Result<(RecordsBehind, ResolvedCounts), LasError> {
        let end = end.max(at);
        let look = records.look(claims.against((end - at) / length), end)?;
        let torn = look.rest > 0;
        let RecordsBehind { behind, room, header_is_exact, .. } = look;
        Ok((look, judge(&Evidence { claims, room, torn, behind, header_is_exact })))
    };
    let end = front.points_end(source)?;
    let (mut look, mut verdict) = judged(end.said)?;
    // Where something else is only said to begin, its place may be wrong.
    if matches!(verdict, ResolvedCounts::TooFew { .. }) && end.said < end.certain {
        notes.push("its extended records or waveforms should begin among its points".to_string());
        (look, verdict) = judged(end.certain)?;
    }
    let there = verdict.there();
    let left = (look.room - there.min(look.room)) * length + look.rest;
    let reason = match verdict {
        ResolvedCounts::Contradiction { .. } if left > 0 => {
            format!("and {left} bytes behind them that are no whole one")
        }
        ResolvedCounts::Contradiction { .. } => "and the header is true of the first ones alone".to_string(),
        _ => format!("the last whole record ends at byte {}", at.min(source.bytes()) + there * length),
    };
    if let ResolvedCounts::Counted(points) = verdict
        && left > 0
    {
        let what = if look.behind == Behind::Padding { "padding" } else { "no points" };
        notes.push(format!("{left} bytes behind its {points} points are {what} and are ignored"));
    }
    let holes = source.holes(at, (at + there * length).min(source.bytes()));
    if holes > MOST_HOLES && holes > there * length / 2 {
        let bytes = there * length;
        let reason = format!("of the {bytes} bytes of its {there} points {holes} were never written");
        return Err(LasError::header(source.path(), reason));
    }
    let (count, missing) = settle(source, verdict, &reason, look.rest > 0, reading, notes)?;
    let complete = matches!(verdict, ResolvedCounts::Counted(_));
    let (body, record_length) = (PointBody::Plain { at }, length as usize);
    Ok(PointsPart { body, count, missing, record_length, complete, most_in_last: None })
}

/// What a verdict means for who opens a file: the points that are read and those that
/// are missing, with a note, or an error with both numbers.
fn settle(
    source: &FileReader,
    verdict: ResolvedCounts,
    reason: &str,
    torn: bool,
    reading: ReadMode,
    notes: &mut Vec<String>,
) -> Result<(u64, u64), LasError> {
    let (path, reason) = (source.path().to_path_buf(), reason.to_string());
    match verdict {
        ResolvedCounts::Counted(points) => Ok((points, 0)),
        ResolvedCounts::Proven { said, there } => {
            notes
                .push(format!("its header says {said} points, the file holds {there}; all of them are read"));
            Ok((there, 0))
        }
        ResolvedCounts::TooFew { said, there } if reading == ReadMode::Readable => {
            notes.push(format!("{there} of its {said} points are there: {reason}"));
            Ok((there, said - there))
        }
        ResolvedCounts::TooFew { said, there } => {
            Err(LasError::Cut { path, readable: there, points: said, reason })
        }
        ResolvedCounts::Contradiction { said, there } if reading == ReadMode::Readable => {
            notes.push(format!(
                "its header says {said} points, {there} whole records are there, {reason}; all whole ones are read"
            ));
            // The record that is torn was a point.
            Ok((there, u64::from(torn)))
        }
        ResolvedCounts::Contradiction { said, there } => {
            Err(LasError::Contradiction { path, said, there, reason })
        }
    }
}

pub fn compressed(
    source: &Arc<FileReader>,
    front: &RawHeader,
    records: &[Vlr],
    reading: ReadMode,
    notes: &mut Vec<String>,
) -> Result<PointsPart, LasError> {
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
    let (start, end) = (front.points_at(), front.points_end(source)?.said.max(front.points_at()));
    let bytes = end.min(source.bytes()).saturating_sub(start);
    let locator = Locator {
        source,
        chunking: chunking(&record.data, &vlr, coding.layered)
            .map_err(|reason| LasError::unsupported(path, reason))?,
        coding: &coding,
        start,
        end,
        written: bytes - source.holes(start, start + bytes).min(bytes),
        claims: DeclaredCounts::of(&front.raw),
        reach: Reach::of_header(&front.raw),
        reading,
    };
    let located = locator.locate(notes)?;
    let Located { layout, verdict, complete, reason } = located;
    let (count, missing) = settle(source, verdict, &reason, true, reading, notes)?;
    let record_length = coding.record_length;
    let most_in_last = match locator.chunking {
        Chunking::Fixed(each) if !coding.layered => Some(u64::from(each)),
        _ => None,
    };
    let body = match layout {
        ChunkLayout::Chunks(chunks) => PointBody::Chunks { coding, chunks },
        layout => PointBody::Stream(Box::new(SequentialDecoder::new(source.clone(), coding, layout))),
    };
    Ok(PointsPart { body, count, missing, record_length, complete, most_in_last })
}

/// How a LASzip record says that chunks are cut. The compressor is the first
/// number of the record; `laz` keeps it to itself.
///
/// Layers only exist in chunks, whose fronts say how many bytes they take. Held against
/// the bytes that there are, those are what memory is prepared for; a stream of layers
/// has no such front, and no writer makes one.
fn chunking(data: &[u8], vlr: &LazVlr, layered: bool) -> Result<Chunking, String> {
    match u16::from_le_bytes([data[0], data[1]]) {
        kind if kind == CompressorType::PointWise as u16 && layered => {
            Err("its LASzip record says one stream without chunks, and its points come in layers, \
                 which only chunks have"
                .to_string())
        }
        kind if kind == CompressorType::PointWise as u16 => Ok(Chunking::Whole),
        kind if kind == CompressorType::None as u16 => {
            Err("its LASzip record says that it is not compressed".to_string())
        }
        _ if vlr.uses_variable_size_chunks() => Ok(Chunking::Variable),
        _ => Ok(Chunking::Fixed(vlr.chunk_size())),
    }
}
