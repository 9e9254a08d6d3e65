//! A COPC file's header and records, as they stand, ours or anybody's. Nothing is believed
//! before it is held against the file's bytes.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::CopcError;
use super::file::{EXTENDED_FRONT, HEADER, INFO, RECORD_FRONT};
use crate::format::las::{field_text, read_chunk_table};
use crate::platform::disk::others::{Links, open_file};

/// Records that are looked at; real files have a handful.
const MAX_RECORDS: usize = 10_000;
/// Data of a record that is read at most.
const MAX_DATA: u64 = 64 << 20;
/// Bytes of a chunk table at most; one of five million chunks takes less.
const MAX_TABLE: u64 = 64 << 20;

/// The file, open for positioned reads.
#[derive(Debug)]
pub struct CopcSource {
    pub path: PathBuf,
    file: File,
    pub bytes: u64,
}

impl CopcSource {
    pub fn open(path: &Path) -> Result<CopcSource, CopcError> {
        let read = |source| CopcError::Read { path: path.to_path_buf(), source };
        let (file, metadata) = open_file(path, Links::Followed).map_err(read)?;
        Ok(CopcSource { path: path.to_path_buf(), file, bytes: metadata.len() })
    }

    pub fn damaged(&self, reason: impl Into<String>) -> CopcError {
        CopcError::Damaged { path: self.path.clone(), reason: reason.into() }
    }

    pub fn read(&self, offset: u64, length: u64) -> Result<Vec<u8>, CopcError> {
        if offset.checked_add(length).is_none_or(|end| end > self.bytes) {
            return Err(self.damaged(format!("it ends before byte {}", offset.saturating_add(length))));
        }
        let mut bytes = Vec::new();
        let room = bytes.try_reserve_exact(length as usize).map_err(|_| io::ErrorKind::OutOfMemory.into());
        let filled = room.and_then(|()| {
            bytes.resize(length as usize, 0);
            self.file.read_exact_at(&mut bytes, offset)
        });
        filled.map_err(|source| CopcError::Read { path: self.path.clone(), source })?;
        Ok(bytes)
    }
}

/// Where the chunk table begins; points and bytes of each chunk, or why there is none.
pub type ChunkTable = (u64, Result<Vec<(u64, u64)>, String>);

/// The fields of the header and of COPC's own record.
#[derive(Debug, Clone, PartialEq)]
pub struct CopcHeader {
    pub version: (u8, u8),
    pub header_size: u64,
    pub global_encoding: u16,
    /// Day of the year, year.
    pub created: (u16, u16),
    pub points_at: u64,
    pub records: u32,
    /// With the bit that marks LAZ.
    pub point_format: u8,
    pub record_length: usize,
    /// Points and points by return as 32 bits.
    pub legacy: [u32; 6],
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    pub min: [f64; 3],
    pub max: [f64; 3],
    pub extended_at: u64,
    pub extended: u32,
    pub points: u64,
    pub by_return: [u64; 15],
    pub info: Info,
}

/// COPC's own record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Info {
    pub center: [f64; 3],
    pub halfsize: f64,
    pub spacing: f64,
    /// Offset and bytes of the root page.
    pub root: (u64, u64),
    pub time: (f64, f64),
    /// Whether all of the rest is zero, as it must be.
    pub is_rest_zero: bool,
}

/// A record of the file, plain or extended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordPlace {
    pub user: String,
    pub id: u16,
    /// Where its front begins.
    pub at: u64,
    pub data_at: u64,
    pub length: u64,
    /// Whether user and description are zero behind their text.
    pub is_padded: bool,
}

impl RecordPlace {
    pub fn is(&self, user: &str, id: u16) -> bool {
        self.id == id && self.user == user
    }

    pub fn end(&self) -> u64 {
        self.data_at + self.length
    }
}

/// Whether a file's first bytes are those of COPC: for choosing a reader.
pub fn is_copc(path: &Path) -> bool {
    let front = CopcSource::open(path).and_then(|source| source.read(0, (HEADER + RECORD_FRONT) as u64));
    front.is_ok_and(|bytes| {
        &bytes[..4] == b"LASF"
            && &bytes[HEADER + 2..HEADER + 7] == b"copc\0"
            && bytes[HEADER + 18..HEADER + 20] == [1, 0]
    })
}

impl CopcHeader {
    pub fn read(source: &CopcSource) -> Result<CopcHeader, CopcError> {
        if source.bytes < (HEADER + RECORD_FRONT + INFO) as u64 {
            return Err(source.damaged(format!("it has {} bytes, too few for any COPC", source.bytes)));
        }
        let bytes = source.read(0, HEADER as u64)?;
        if &bytes[..4] != b"LASF" {
            return Err(source.damaged("it does not begin with LASF"));
        }
        let (two, four, eight) = (|at| u16_at(&bytes, at), |at| u32_at(&bytes, at), |at| u64_at(&bytes, at));
        let three =
            |at: usize, step: usize| [0, 1, 2].map(|axis| f64::from_bits(u64_at(&bytes, at + step * axis)));
        let (version, header_size) = ((bytes[24], bytes[25]), u64::from(two(94)));
        if version != (1, 4) {
            return Err(source.damaged(format!("it is LAS {}.{}, and COPC is 1.4", version.0, version.1)));
        }
        let info = source.read(header_size, (RECORD_FRONT + INFO) as u64)?;
        if field_text(&info[2..18]) != "copc" || u16_at(&info, 18) != 1 {
            return Err(source.damaged("its first record is not COPC's"));
        }
        if usize::from(u16_at(&info, 20)) != INFO {
            return Err(
                source.damaged(format!("its COPC record has {} bytes, not {INFO}", u16_at(&info, 20)))
            );
        }
        let info = &info[RECORD_FRONT..];
        let float = |at: usize| f64::from_bits(u64_at(info, at));
        let front = CopcHeader {
            version,
            header_size,
            global_encoding: two(6),
            created: (two(90), two(92)),
            points_at: u64::from(four(96)),
            records: four(100),
            point_format: bytes[104],
            record_length: usize::from(two(105)),
            legacy: [107, 111, 115, 119, 123, 127].map(four),
            scale: three(131, 8),
            offset: three(155, 8),
            max: three(179, 16),
            min: three(187, 16),
            extended_at: eight(235),
            extended: four(243),
            points: eight(247),
            by_return: std::array::from_fn(|index| eight(255 + 8 * index)),
            info: Info {
                center: [float(0), float(8), float(16)],
                halfsize: float(24),
                spacing: float(32),
                root: (u64_at(info, 40), u64_at(info, 48)),
                time: (float(56), float(64)),
                is_rest_zero: info[72..].iter().all(|byte| *byte == 0),
            },
        };
        front.check(source)?;
        Ok(front)
    }

    /// What nothing can be made of without.
    fn check(&self, source: &CopcSource) -> Result<(), CopcError> {
        let format = self.format();
        if self.point_format & 0x80 == 0 || !(6..=8).contains(&format) {
            return Err(source
                .damaged(format!("it has point format {}, COPC has LAZ of 6, 7 and 8", self.point_format)));
        }
        let standard = crate::format::las::record_length(format).unwrap_or(0);
        if self.record_length < standard {
            return Err(source.damaged(format!("its records of {} bytes are too short", self.record_length)));
        }
        let numbers = self.scale.iter().chain(&self.offset).chain(&self.info.center);
        if numbers.chain([&self.info.halfsize]).any(|number| !number.is_finite())
            || self.scale.contains(&0.0)
            || self.info.halfsize <= 0.0
        {
            return Err(source.damaged("its scale, offset or cube are no numbers that can be"));
        }
        if self.points_at.checked_add(8).is_none_or(|end| end > source.bytes)
            || self.points_at < self.header_size
        {
            return Err(source.damaged(format!("its points cannot begin at byte {}", self.points_at)));
        }
        Ok(())
    }

    /// The point format without the bit of LAZ.
    pub fn format(&self) -> u8 {
        self.point_format & 0x3f
    }

    /// World coordinate of an integer, as every reader computes it.
    pub fn world(&self, axis: usize, stored: i32) -> f64 {
        f64::from(stored) * self.scale[axis] + self.offset[axis]
    }

    /// The records in front of the points; those that do not fit end them.
    pub fn plain_records(&self, source: &CopcSource) -> Result<Vec<RecordPlace>, CopcError> {
        let (mut at, mut places) = (self.header_size, Vec::new());
        while places.len() < (self.records as usize).min(MAX_RECORDS)
            && at + RECORD_FRONT as u64 <= self.points_at
        {
            let front = source.read(at, RECORD_FRONT as u64)?;
            let place = place(&front, at, u64::from(u16_at(&front, 20)), RECORD_FRONT, 22);
            at = place.end();
            if at > self.points_at {
                break;
            }
            places.push(place);
        }
        Ok(places)
    }

    /// The extended records; those that do not fit end them.
    pub fn extended_records(&self, source: &CopcSource) -> Result<Vec<RecordPlace>, CopcError> {
        let (mut at, mut places) = (self.extended_at, Vec::new());
        while places.len() < (self.extended as usize).min(MAX_RECORDS)
            && at.checked_add(EXTENDED_FRONT as u64).is_some_and(|end| end <= source.bytes)
        {
            let front = source.read(at, EXTENDED_FRONT as u64)?;
            let length = u64_at(&front, 20);
            let data_at = at + EXTENDED_FRONT as u64;
            if data_at.checked_add(length).is_none_or(|end| end > source.bytes) {
                break;
            }
            let place = place(&front, at, length, EXTENDED_FRONT, 28);
            at = place.end();
            places.push(place);
        }
        Ok(places)
    }

    /// Where the chunk table begins, and points and bytes of each chunk; or why there is
    /// none. `chunks` is how many there can be.
    pub fn chunk_table(&self, source: &CopcSource) -> Result<ChunkTable, CopcError> {
        let at = u64_at(&source.read(self.points_at, 8)?, 0);
        if at < self.points_at + 8 || at.checked_add(8).is_none_or(|end| end > source.bytes) {
            return Ok((at, Err(format!("its chunk table cannot be at byte {at}"))));
        }
        let end = if self.extended > 0 && self.extended_at > at { self.extended_at } else { source.bytes };
        let bytes = source.read(at, (end.min(source.bytes) - at).min(MAX_TABLE))?;
        // No chunk is shorter than a record.
        let most = (at - self.points_at - 8) / self.record_length as u64;
        Ok((at, read_chunk_table(&bytes, most)))
    }
}

/// A record's data, if there is such a record and it is not too long to mean anything.
pub fn data(
    source: &CopcSource,
    places: &[RecordPlace],
    user: &str,
    id: u16,
) -> Result<Option<Vec<u8>>, CopcError> {
    let place = places.iter().find(|place| place.is(user, id) && place.length <= MAX_DATA);
    place.map(|place| source.read(place.data_at, place.length)).transpose()
}

fn place(front: &[u8], at: u64, length: u64, size: usize, description: usize) -> RecordPlace {
    let is_padded = |field: &[u8]| field.iter().skip_while(|byte| **byte != 0).all(|byte| *byte == 0);
    RecordPlace {
        user: field_text(&front[2..18]),
        id: u16_at(front, 18),
        at,
        data_at: at + size as u64,
        length,
        is_padded: is_padded(&front[2..18]) && is_padded(&front[description..description + 32]),
    }
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}
