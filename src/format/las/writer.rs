//! Writes LAS and LAZ files as a stream: records go in as they are, the header
//! with the true counts and bounds is patched at the end.
//!
//! LAZ chunks hold 50 000 points, as everybody's do, and are compressed on all
//! threads of the current rayon pool; the file is the same whatever their
//! number. No date and no random id is written: the same points give the same
//! bytes.

use std::path::Path;

use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::{LazVlr, LazVlrBuilder};
use rayon::prelude::*;

use super::coding::Coding;
use super::error::LasError;
use super::extra_bytes;
use super::gps_time::GpsEpoch;
use super::header_totals::HeaderTotals;
use super::text;
use super::vlr::{self, Vlr};
use crate::octree::attribute::ExtraField;
use crate::platform::disk::{Disk, DiskFile};

/// Points of a LAZ chunk.
const CHUNK_POINTS: u32 = 50_000;
/// Bytes that plain LAS collects before it writes them.
const PLAIN_BUFFER: usize = 4 << 20;
/// The global encoding's bit that says that the CRS is WKT (LAS 1.4 R15, table 4).
const WKT_BIT: u16 = 1 << 4;

/// What a file to be written is like.
#[derive(Debug, Clone)]
pub struct LasOptions {
    /// 1.0 to 1.5; formats above 5 need 1.4, 4 and 5 need 1.3.
    pub version: (u8, u8),
    pub point_format: u8,
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    pub compressed: bool,
    /// Fields behind the standard ones; their positions say where.
    pub extra: Vec<ExtraField>,
    /// Records that say where on Earth it is, written as they are.
    pub crs: Vec<Vlr>,
    pub software: String,
}

/// A LAS or LAZ file that is being written. Without [`LasWriter::finish`] its
/// header says that it has no points.
#[derive(Debug)]
pub struct LasWriter {
    file: DiskFile,
    header: las::raw::Header,
    /// The variable length records, as bytes.
    vlrs: Vec<u8>,
    /// What is too long for one of those, as extended ones, and how many.
    evlrs: Vec<u8>,
    extended: u32,
    record_length: usize,
    /// Where the next bytes of points go.
    position: u64,
    /// Whole records that are not yet in the file.
    pending: Vec<u8>,
    laz: Option<LazState>,
    tally: HeaderTotals,
    /// Only in LAS 1.5.
    times: Option<TimeRange>,
}

/// What a header of LAS 1.5 has behind that of 1.4.
#[derive(Debug)]
struct TimeRange {
    min: f64,
    max: f64,
    /// In 10^6 seconds.
    offset: u16,
}

/// Bytes of it.
const TIME_RANGE: u16 = 18;
/// Where the GPS time stands in a record of the formats 6 to 10, all that LAS 1.5 has.
const GPS_TIME: usize = 22;

#[derive(Debug)]
struct LazState {
    vlr: LazVlr,
    coding: Coding,
    table: ChunkTable,
}

impl LasWriter {
    pub fn create(path: &Path, options: &LasOptions) -> Result<LasWriter, LasError> {
        LasWriter::create_on(&Disk::new(), path, options)
    }

    /// The same on a disk that a test may have made faulty.
    pub fn create_on(disk: &Disk, path: &Path, options: &LasOptions) -> Result<LasWriter, LasError> {
        let standard = check(path, options)?;
        let (description, record_length) = extra_bytes::describe(&options.extra, standard)
            .map_err(|reason| LasError::write(path, reason))?;
        let length = u16::try_from(record_length).map_err(|_| {
            LasError::write(path, format!("records of {record_length} bytes are too long for LAS"))
        })?;

        let mut vlrs = Vec::new();
        let (mut evlrs, mut extended) = (Vec::new(), 0);
        if !description.is_empty() {
            vlr::put(&mut vlrs, "LASF_Spec", 4, "Extra bytes", &description)
                .map_err(|reason| LasError::write(path, reason))?;
        }
        for Vlr { user, id, data } in &options.crs {
            if data.len() <= usize::from(u16::MAX) {
                vlr::put(&mut vlrs, user, *id, "CRS", data)
                    .map_err(|reason| LasError::write(path, reason))?;
            } else if options.version >= (1, 4) {
                vlr::put_extended(&mut evlrs, user, *id, "CRS", data);
                extended += 1;
            } else {
                return Err(LasError::write(path, "its CRS is too long for a version below 1.4"));
            }
        }
        let laz = if options.compressed {
            let state = LazState::new(options.point_format, length - standard as u16)
                .map_err(|reason| LasError::write(path, reason))?;
            let mut data = Vec::new();
            state.vlr.write_to(&mut data).map_err(|e| LasError::write(path, e.to_string()))?;
            vlr::put(&mut vlrs, LazVlr::USER_ID, LazVlr::RECORD_ID, "LASzip", &data)
                .map_err(|reason| LasError::write(path, reason))?;
            Some(state)
        } else {
            None
        };

        let header = header(options, length, &vlrs);
        let position = u64::from(header.offset_to_point_data) + if laz.is_some() { 8 } else { 0 };
        let mut writer = LasWriter {
            file: disk.create(path)?,
            header,
            vlrs,
            evlrs,
            extended,
            record_length,
            position,
            pending: Vec::new(),
            laz,
            tally: HeaderTotals::new(options.point_format),
            times: is_1_5(options).then_some(TimeRange {
                min: f64::INFINITY,
                max: f64::NEG_INFINITY,
                offset: 0,
            }),
        };
        writer.write_front(None)?;
        Ok(writer)
    }

    /// Says what the GPS times count from. Until then they are seconds of the week.
    /// An offset other than that of adjusted standard time needs LAS 1.5.
    pub fn set_gps_time(&mut self, gps_time: GpsEpoch) {
        let (bits, offset) = gps_time.encoding();
        self.header.global_encoding |= bits;
        if let Some(times) = &mut self.times {
            times.offset = offset.unwrap_or(0);
        }
    }

    /// Bytes of a record: the format's own and the extra ones.
    pub fn record_length(&self) -> usize {
        self.record_length
    }

    /// Appends whole records.
    pub fn write(&mut self, records: &[u8]) -> Result<(), LasError> {
        if !records.len().is_multiple_of(self.record_length) {
            let reason = format!("{} bytes are not whole records of {}", records.len(), self.record_length);
            return Err(LasError::write(self.file.path(), reason));
        }
        self.tally.add(records, self.record_length);
        if let Some(times) = &mut self.times {
            let of_records = records.chunks_exact(self.record_length);
            let of_records = of_records.filter_map(|record| record[GPS_TIME..].first_chunk::<8>());
            for time in of_records.map(|bytes| f64::from_le_bytes(*bytes)) {
                (times.min, times.max) = (times.min.min(time), times.max.max(time));
            }
        }
        let batch = match &self.laz {
            Some(_) => CHUNK_POINTS as usize * self.record_length * rayon::current_num_threads(),
            None => PLAIN_BUFFER,
        };
        let mut records = records;
        while !records.is_empty() {
            let part = records.len().min(batch.saturating_sub(self.pending.len()));
            self.pending.extend_from_slice(&records[..part]);
            records = &records[part..];
            if self.pending.len() >= batch {
                self.flush(false)?;
            }
        }
        Ok(())
    }

    /// Writes the rest, the chunk table and the true header, and makes it last.
    pub fn finish(mut self) -> Result<(), LasError> {
        self.flush(true)?;
        let mut table_at = None;
        if let Some(laz) = &self.laz {
            let mut table = Vec::new();
            laz.table
                .write_to(&mut table, &laz.vlr)
                .map_err(|e| LasError::write(self.file.path(), e.to_string()))?;
            self.file.write_all_at(&table, self.position)?;
            table_at = Some(self.position);
            self.position += table.len() as u64;
        }
        if !self.evlrs.is_empty() {
            self.file.write_all_at(&self.evlrs, self.position)?;
            self.header.evlr = Some(las::raw::header::Evlr {
                start_of_first_evlr: self.position,
                number_of_evlrs: self.extended,
            });
        }
        self.tally.put_into(&mut self.header).map_err(|reason| LasError::write(self.file.path(), reason))?;
        self.write_front(table_at)?;
        self.file.sync()?;
        Ok(())
    }

    /// Header, variable length records and, for LAZ, where the chunk table is.
    fn write_front(&mut self, table_at: Option<u64>) -> Result<(), LasError> {
        let mut front = Vec::new();
        if let Some(TimeRange { min, max, offset }) = self.times {
            let [min, max] = if min <= max { [min, max] } else { [0.0; 2] };
            self.header.padding = [max.to_le_bytes(), min.to_le_bytes()].concat();
            self.header.padding.extend_from_slice(&offset.to_le_bytes());
        }
        self.header.write_to(&mut front).map_err(|e| LasError::write(self.file.path(), e.to_string()))?;
        if self.times.is_some() {
            // For `las` it is one of 1.4 that somebody appended to.
            front[25] = 5;
        }
        front.extend_from_slice(&self.vlrs);
        if self.laz.is_some() {
            let table_at = table_at.map_or(-1, |at| at as i64);
            front.extend_from_slice(&table_at.to_le_bytes());
        }
        self.file.write_all_at(&front, 0)?;
        Ok(())
    }

    /// Writes pending records: all of them at the end, before that only whole
    /// chunks, so that the file does not depend on the caller's portions.
    fn flush(&mut self, all: bool) -> Result<(), LasError> {
        let Some(laz) = &mut self.laz else {
            self.file.write_all_at(&self.pending, self.position)?;
            self.position += self.pending.len() as u64;
            self.pending.clear();
            return Ok(());
        };
        let chunk = CHUNK_POINTS as usize * self.record_length;
        let whole = if all { self.pending.len() } else { self.pending.len() / chunk * chunk };
        let compressed: Vec<Result<Vec<u8>, String>> =
            self.pending[..whole].par_chunks(chunk).map(|records| laz.coding.encode(records)).collect();
        for bytes in compressed {
            let bytes = bytes.map_err(|reason| LasError::write(self.file.path(), reason))?;
            self.file.write_all_at(&bytes, self.position)?;
            self.position += bytes.len() as u64;
            laz.table.push(ChunkTableEntry {
                point_count: u64::from(CHUNK_POINTS),
                byte_count: bytes.len() as u64,
            });
        }
        self.pending.drain(..whole);
        Ok(())
    }
}

impl LazState {
    fn new(point_format: u8, extra: u16) -> Result<LazState, String> {
        let vlr = LazVlrBuilder::default()
            .with_point_format(point_format, extra)
            .map_err(|e| e.to_string())?
            .with_fixed_chunk_size(CHUNK_POINTS)
            .build();
        let coding = Coding::new(vlr.items(), point_format)?;
        Ok(LazState { vlr, coding, table: ChunkTable::with_capacity(0) })
    }
}

/// Whether these options can be written; the format's own record length.
fn check(path: &Path, options: &LasOptions) -> Result<usize, LasError> {
    let refuse = |reason: String| Err(LasError::write(path, reason));
    let (major, minor) = options.version;
    let Some(standard) = super::record_length(options.point_format) else {
        return refuse(format!("there is no point format {}", options.point_format));
    };
    let needed = match options.point_format {
        0..=1 => 0,
        2..=3 => 2,
        4..=5 => 3,
        _ => 4,
    };
    let last = if options.point_format < 6 { 4 } else { 5 };
    if major != 1 || minor > last || minor < needed {
        return refuse(format!(
            "point format {} needs LAS 1.{needed} or later, up to 1.{last}, not {major}.{minor}",
            options.point_format
        ));
    }
    if options.scale.iter().any(|s| !s.is_finite() || *s == 0.0)
        || options.offset.iter().any(|o| !o.is_finite())
    {
        return refuse(format!("scale {:?} and offset {:?} are no lattice", options.scale, options.offset));
    }
    Ok(standard)
}

fn is_1_5(options: &LasOptions) -> bool {
    options.version == (1, 5)
}

fn header(options: &LasOptions, record_length: u16, vlrs: &[u8]) -> las::raw::Header {
    let version = las::Version::new(options.version.0, options.version.1.min(4));
    let header_size = version.header_size() + if is_1_5(options) { TIME_RANGE } else { 0 };
    let mut header = las::raw::Header {
        version,
        header_size,
        offset_to_point_data: u32::from(header_size) + vlrs.len() as u32,
        number_of_variable_length_records: vlr::count(vlrs),
        point_data_record_format: options.point_format | if options.compressed { 0x80 } else { 0 },
        point_data_record_length: record_length,
        x_scale_factor: options.scale[0],
        y_scale_factor: options.scale[1],
        z_scale_factor: options.scale[2],
        x_offset: options.offset[0],
        y_offset: options.offset[1],
        z_offset: options.offset[2],
        ..las::raw::Header::default()
    };
    let has_wkt = options.crs.iter().any(|record| record.id == vlr::WKT);
    if options.version >= (1, 4) && (has_wkt || (options.point_format >= 6 && options.crs.is_empty())) {
        header.global_encoding |= WKT_BIT;
    }
    header.system_identifier = [0; 32];
    header.generating_software = [0; 32];
    header.file_creation_day_of_year = 0;
    header.file_creation_year = 0;
    text::put(&mut header.system_identifier, "OTHER");
    text::put(&mut header.generating_software, &options.software);
    header
}
