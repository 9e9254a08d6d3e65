//! Opens a LAS or LAZ file and gives its records as they are, slice by slice,
//! to any number of threads.

use std::io;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use super::LasError;
use super::chunks::{ChunkLayout, PointChunk};
use super::coding::Coding;
use super::compatible::{self, Compatible};
use super::gps_time::TimeShift;
use super::header::{self, Header};
use super::points::{self, PointBody};
use super::sequential::SequentialDecoder;
use super::source::FileReader;
use super::stream::Broken;
use super::{ReadMode, crs, extra_bytes, mend};
use crate::platform::disk::others::Links;

/// Decoded bytes of a slice at most, however many points were asked for.
const MOST_SLICE: u64 = 128 << 20;
/// Points of a chunk that is decoded whole; larger ones go through the
/// turnstile in parts.
const MOST_CHUNK: u64 = 4_000_000;

/// A LAS or LAZ file, open for reading.
#[derive(Debug)]
pub struct LasFile {
    pub(super) source: Arc<FileReader>,
    pub(super) header: Header,
    pub(super) body: PointBody,
    /// Where its chunks lie, if that is not where their table says.
    pub(super) mended: OnceLock<Option<Vec<PointChunk>>>,
    complete: bool,
    /// Points that the last chunk may have, where only its bytes say how many it does.
    pub(super) most_in_last: Option<u64>,
    /// Decoded bytes of a slice at most.
    pub(super) most_slice: u64,
    /// Where points are stored as those of another format.
    compatible: Option<Compatible>,
    /// Where GPS times are to count from elsewhere.
    pub(super) time_shift: Option<TimeShift>,
    /// The descriptions of extra fields, by name.
    descriptors: Vec<(String, Vec<u8>)>,
}

/// Consecutive points of a file, as [`LasFile::slices`] cut them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slice {
    /// The first point's place in the file's order.
    pub first: u64,
    pub points: u32,
}

impl LasFile {
    pub fn open(path: &Path) -> Result<LasFile, LasError> {
        LasFile::open_with(path, Links::Followed)
    }

    /// The same; links may be refused, as below a watched folder.
    pub fn open_with(path: &Path, links: Links) -> Result<LasFile, LasError> {
        LasFile::open_as(path, ReadMode::Whole, links)
    }

    /// Opens a file in a watched folder, which may still be on its way: quickly,
    /// through no link, and without the lenience that [`LasFile::open`] has for LAZ without a sound chunk table.
    pub fn open_strictly(path: &Path) -> Result<LasFile, LasError> {
        LasFile::open_as(path, ReadMode::Strict, Links::Refused)
    }

    pub(super) fn open_as(path: &Path, reading: ReadMode, links: Links) -> Result<LasFile, LasError> {
        let source = Arc::new(FileReader::open(path, links)?);
        let mut notes = Vec::new();
        let front = header::read(&source, &mut notes)?;
        let records = points::records(&source, &front, &mut notes)?;
        let points = if front.compressed {
            points::compressed(&source, &front, &records, reading, &mut notes)?
        } else {
            points::plain(&source, &front, reading, &mut notes)?
        };

        let is_crs_wkt = front.is_crs_wkt();
        let gps_time = front.gps_time(compatible::time_offset(&records), &mut notes);
        let mut header = front.finish(&source);
        header.gps_time = gps_time;
        (header.points, header.missing) = (points.count, points.missing);
        header.record_length = points.record_length;
        let descriptions = records.iter().filter(|r| r.is("LASF_Spec", 4)).map(|r| r.data.as_slice());
        let standard = super::record_length(header.point_format).unwrap_or(points.record_length);
        header.extra = extra_bytes::parse(descriptions, standard, points.record_length, &mut notes);
        let descriptions = records.iter().filter(|r| r.is("LASF_Spec", 4)).map(|r| r.data.as_slice());
        let descriptors = extra_bytes::descriptors(descriptions, &header.extra);
        let compatible = compatible::recognize(&mut header, &records);
        header.crs = crs::find(&records, is_crs_wkt, &mut notes);
        header.crs_records = crs::records(records);
        header.notes = notes;
        let mended = OnceLock::new();
        let mut file = LasFile {
            source,
            header,
            body: points.body,
            mended,
            complete: points.complete,
            most_in_last: points.most_in_last,
            most_slice: MOST_SLICE,
            compatible,
            time_shift: None,
            descriptors,
        };
        file.bound_slices(MOST_SLICE);
        Ok(file)
    }

    /// The description of each of the header's extra fields as the file has it: 192 bytes
    /// (LAS 1.4 R15, table 24), with what a field's no-data value is. None of bytes that
    /// nothing describes.
    pub fn extra_descriptors(&self) -> Vec<Option<&[u8]>> {
        let of = |name: &String| self.descriptors.iter().find(|(other, _)| other == name);
        self.header.extra.iter().map(|field| of(&field.name).map(|(_, bytes)| bytes.as_slice())).collect()
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

    /// Has no more than about so many bytes of records be decoded at once: with several
    /// threads at it, many large chunks would be beyond the memory that there is.
    pub fn bound_slices(&mut self, bytes: u64) {
        let length = self.header.record_length.max(self.stored_length()) as u64;
        self.most_slice = bytes.clamp(length, MOST_SLICE);
        let PointBody::Chunks { coding, chunks } = &mut self.body else { return };
        if chunks.iter().any(|chunk| chunk.points > MOST_CHUNK || chunk.points * length > self.most_slice) {
            let layout = ChunkLayout::Chunks(std::mem::take(chunks));
            self.body = PointBody::Stream(Box::new(SequentialDecoder::new(
                self.source.clone(),
                coding.clone(),
                layout,
            )));
        }
    }

    /// Bytes of a record as the file has it.
    pub(super) fn stored_length(&self) -> usize {
        self.compatible.as_ref().map_or(self.header.record_length, Compatible::stored_length)
    }

    /// Consecutive slices of about `points` points that cover all of them. LAZ
    /// slices begin and end where its chunks do. Ask for them in this order:
    /// some LAZ files can only be decoded from front to back.
    pub fn slices(&self, points: u32) -> Vec<Slice> {
        let length = self.header.record_length.max(self.stored_length());
        let most = (self.most_slice / length as u64).clamp(1, u64::from(u32::MAX));
        let wanted = u64::from(points.max(1)).min(most);
        let PointBody::Chunks { chunks, .. } = &self.body else {
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
                self.check_unchanged().err().unwrap_or_else(|| self.recounted(slice, error))
            }
            error => error,
        })
    }

    fn read_slice(&self, slice: Slice, records: &mut Vec<u8>) -> Result<(), LasError> {
        match &self.compatible {
            None => self.read_stored(slice, records)?,
            Some(compatible) => {
                let mut stored = Vec::new();
                self.read_stored(slice, &mut stored)?;
                compatible.restore(&stored, records);
            }
        }
        match self.time_shift {
            None => Ok(()),
            Some(shift) => shift.apply(self.path(), records, self.header.record_length),
        }
    }

    /// A slice's records as the file has them.
    fn read_stored(&self, slice: Slice, records: &mut Vec<u8>) -> Result<(), LasError> {
        let end = slice.first.checked_add(u64::from(slice.points));
        if end.is_none_or(|end| end > self.header.points) {
            return Err(self.not_a_slice(slice));
        }
        let length = self.stored_length();
        let room = |records: &mut Vec<u8>| match slice.points as usize * length {
            // The system gives zeroed memory for less than it takes to zero it.
            bytes if records.capacity() < bytes => *records = vec![0; bytes],
            bytes => records.resize(bytes, 0),
        };
        match &self.body {
            PointBody::Plain { at } => {
                room(records);
                self.source.read_exact_at(records, at + slice.first * length as u64)
            }
            PointBody::Chunks { coding, chunks } => {
                let chunks = self.chunks_of(slice, chunks)?;
                room(records);
                self.decode(coding, chunks, records)
            }
            PointBody::Stream(turnstile) => {
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

    fn chunks_of<'a>(&self, slice: Slice, chunks: &'a [PointChunk]) -> Result<&'a [PointChunk], LasError> {
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
        chunks: &[PointChunk],
        records: &mut [u8],
    ) -> Result<(), LasError> {
        let (Some(first), Some(last)) = (chunks.first(), chunks.last()) else { return Ok(()) };
        let mut bytes = vec![0; (last.at + last.bytes - first.at) as usize];
        self.source.read_exact_at(&mut bytes, first.at)?;
        let mut records = records;
        let mut decoder = coding.decoder();
        for chunk in chunks {
            let (now, later) = records.split_at_mut(chunk.points as usize * coding.record_length);
            let start = (chunk.at - first.at) as usize;
            let decoded = decoder.decode(&bytes[start..start + chunk.bytes as usize], now);
            if let Err(reason) = decoded
                && !self.decode_mended(coding, chunk, now)?
            {
                let last = chunk.first + chunk.points - 1;
                let place = format!(
                    "the LAZ chunk of {} bytes at byte {} with the points {} to {last}",
                    chunk.bytes, chunk.at, chunk.first
                );
                return Err(LasError::Damaged { path: self.path().to_path_buf(), place, reason });
            }
            records = later;
        }
        Ok(())
    }

    /// Decodes a chunk from where it really lies, if the table was wrong about that.
    fn decode_mended(
        &self,
        coding: &Coding,
        chunk: &PointChunk,
        records: &mut [u8],
    ) -> Result<bool, LasError> {
        let PointBody::Chunks { chunks, .. } = &self.body else { return Ok(false) };
        let mended = self.mended.get_or_init(|| mend::borders(&self.source, coding, chunks));
        let Some(mended) = mended else { return Ok(false) };
        let found = mended.binary_search_by_key(&chunk.first, |other| other.first);
        let Some(other) = found.ok().map(|place| &mended[place]).filter(|other| *other != chunk) else {
            return Ok(false);
        };
        let mut bytes = vec![0; other.bytes as usize];
        self.source.read_exact_at(&mut bytes, other.at)?;
        Ok(coding.decoder().decode(&bytes, records).is_ok())
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
