//! The header as the rest of Lodestone sees it, and the checks of its raw
//! fields (LAS 1.4 R15, table 3). What is wrong beyond doubt is an error; what
//! can be read all the same is a note.

use super::LasError;
use super::crs::Crs;
use super::gps_time::GpsEpoch;
use super::record_length;
use super::source::FileReader;
use super::text;
use super::vlr::{self, Vlr};
use crate::octree::attribute::ExtraField;
use crate::words;

/// What a LAS or LAZ file says of itself, as far as it is true.
#[derive(Debug, Clone)]
pub struct Header {
    pub version: (u8, u8),
    /// 0 to 10, without the bits that mark LAZ.
    pub point_format: u8,
    /// LAZ.
    pub compressed: bool,
    /// Bytes of a record as [`super::LasFile::read`] gives it.
    pub record_length: usize,
    /// How many there are in truth, which may differ from what the header says.
    pub points: u64,
    /// Points that it promises beyond those: only in a file that was opened for
    /// what can be read of it.
    pub missing: u64,
    /// World = integer × scale + offset. A scale may be negative, but is never 0.
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    /// World coordinates; a hint only: header bounds are often wrong.
    pub min: [f64; 3],
    pub max: [f64; 3],
    /// Points by return, from the first; a hint too, and empty where it says
    /// nothing. Up to five in old headers, fifteen since version 1.4.
    pub returns: Vec<u64>,
    /// Fields behind the point format's own, without a gap up to the record's
    /// end.
    pub extra: Vec<ExtraField>,
    pub crs: Option<Crs>,
    /// What the GPS times count from, of the point formats that have them.
    pub gps_time: GpsEpoch,
    /// The records that it was found in, and what else of that kind there is.
    pub crs_records: Vec<Vlr>,
    /// The software and the system that made the file.
    pub software: String,
    pub system: String,
    pub created: Option<Created>,
    /// Its bits as they stand in the header (LAS 1.4 R15, table 4).
    pub global_encoding: u16,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Oddities that were tolerated, in words for a person.
    pub notes: Vec<String>,
}

/// The day on which a file was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Created {
    pub year: u16,
    /// 1 is the first of January.
    pub day: u16,
}

/// The raw header, checked, before it is known how many points there are.
pub struct RawHeader {
    /// Of LAS, whose header of 1.5 is in `raw` as one of 1.4.
    pub version: (u8, u8),
    /// In 10^6 seconds; since LAS 1.5.
    time_offset: Option<u16>,
    pub raw: las::raw::Header,
    /// Where extended records begin and how many there are, as the header says: `las`
    /// forgets the place of those that are not counted.
    extended: Option<(u64, u32)>,
    /// Bytes of the header in this file, which may be more than the standard's.
    pub size: u64,
    pub point_format: u8,
    pub compressed: bool,
}

/// Where points end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PointsEnd {
    /// Where the file ends, or something begins that is certainly no point.
    pub certain: u64,
    /// Where the header says that something else begins, be it so or not.
    pub said: u64,
}

/// The largest header of any version.
const LARGEST: usize = 393;
/// Where the time offset of LAS 1.5 stands, behind the largest and the smallest GPS
/// time.
const TIME_OFFSET: usize = 391;
/// The smallest, that of versions 1.0 to 1.2.
const SMALLEST: u64 = 227;

pub fn read(source: &FileReader, notes: &mut Vec<String>) -> Result<RawHeader, LasError> {
    let path = source.path();
    let mut bytes = [0; LARGEST];
    let there = source.bytes().min(LARGEST as u64) as usize;
    source.read_exact_at(&mut bytes[..there], 0)?;
    if &bytes[..4] != b"LASF" {
        let reason = if source.bytes() == 0 { "it is empty" } else { "it does not begin with LASF" };
        return Err(LasError::not_las(path, reason));
    }
    if (there as u64) < SMALLEST {
        return Err(LasError::not_las(path, format!("it ends after {there} bytes, within its header")));
    }
    let (major, minor) = (bytes[24], bytes[25]);
    if major != 1 || minor > 5 {
        let reason = match (major, minor) {
            (1, 6..=9) => {
                return Err(LasError::unsupported(path, format!("LAS {major}.{minor} is not known yet")));
            }
            _ => format!("it begins with LASF, but there is no LAS version {major}.{minor}"),
        };
        return Err(LasError::not_las(path, reason));
    }
    let size = u16::from_le_bytes([bytes[94], bytes[95]]);
    let standard_size = match minor {
        5 => LARGEST as u16,
        _ => las::Version::new(major, minor).header_size(),
    };
    check_size(source, size, standard_size, notes)?;
    // What lies behind the header's own end is not header, and what lies
    // behind the standard's is nobody's.
    bytes[usize::from(size).min(LARGEST)..].fill(0);
    let time_offset = (minor >= 5).then(|| u16::from_le_bytes([bytes[TIME_OFFSET], bytes[TIME_OFFSET + 1]]));
    // LAS 1.5 appends to the header of 1.4, which is the last that `las` knows.
    bytes[25] = minor.min(4);
    let known_size = las::Version::new(major, bytes[25]).header_size();
    bytes[94..96].copy_from_slice(&known_size.to_le_bytes());
    let raw =
        las::raw::Header::read_from(bytes.as_slice()).map_err(|e| LasError::header(path, e.to_string()))?;

    let front = RawHeader {
        version: (major, minor),
        time_offset,
        size: u64::from(size),
        // Bit 7 marks LAZ; bit 6 marked it in the very first versions.
        point_format: raw.point_data_record_format & 0b0011_1111,
        compressed: raw.point_data_record_format & 0b1100_0000 != 0,
        extended: (minor >= 4).then(|| extended(&bytes)),
        raw,
    };
    front.check(source, notes)?;
    Ok(front)
}

fn extended(header: &[u8; LARGEST]) -> (u64, u32) {
    let (mut start, mut number) = ([0; 8], [0; 4]);
    start.copy_from_slice(&header[235..243]);
    number.copy_from_slice(&header[243..247]);
    (u64::from_le_bytes(start), u32::from_le_bytes(number))
}

fn check_size(
    source: &FileReader,
    size: u16,
    standard: u16,
    notes: &mut Vec<String>,
) -> Result<(), LasError> {
    if u64::from(size) < SMALLEST {
        let reason = format!("it says that it has {size} bytes, and no LAS header has fewer than {SMALLEST}");
        return Err(LasError::header(source.path(), reason));
    }
    if u64::from(size) > source.bytes() {
        let reason = format!("it says that it has {size} bytes, and the whole file has {}", source.bytes());
        return Err(LasError::header(source.path(), reason));
    }
    if size < standard {
        notes.push(format!(
            "its header has {size} bytes where its version has {standard}; the rest counts as zero"
        ));
    }
    Ok(())
}

impl RawHeader {
    fn check(&self, source: &FileReader, notes: &mut Vec<String>) -> Result<(), LasError> {
        let refuse = |reason: String| Err(LasError::header(source.path(), reason));
        let format = self.point_format;
        let Some(standard) = record_length(format) else {
            return refuse(format!("there is no point format {format}"));
        };
        let length = usize::from(self.raw.point_data_record_length);
        if length < standard {
            return refuse(format!(
                "records of {length} bytes are too short for point format {format} ({standard})"
            ));
        }
        for (axis, (scale, offset)) in ["x", "y", "z"].iter().zip(self.scale().into_iter().zip(self.offset()))
        {
            if !scale.is_finite() || scale == 0.0 {
                return refuse(format!("the scale of {axis} is {}", words::number(scale)));
            }
            if !offset.is_finite() {
                return refuse(format!("the offset of {axis} is {}", words::number(offset)));
            }
        }
        if self.points_at() < self.size {
            return refuse(format!(
                "its points are said to begin at byte {}, inside its {} bytes of header; one of the two is wrong",
                self.points_at(),
                self.size
            ));
        }
        let needed = match format {
            0..=1 => 0,
            2..=3 => 2,
            4..=5 => 3,
            _ => 4,
        };
        let minor = self.version.1;
        if minor < needed {
            notes
                .push(format!("point format {format} came with LAS 1.{needed}, but the file says 1.{minor}"));
        }
        if minor >= 5 && format < 6 {
            notes.push(format!("point format {format} ended with LAS 1.4, but the file says 1.{minor}"));
        }
        Ok(())
    }

    /// Of the two tables of version 1.4, the large one if it says anything.
    pub fn returns(&self) -> Vec<u64> {
        let large = self.raw.large_file.iter().flat_map(|large| large.number_of_points_by_return).collect();
        let legacy = self.raw.number_of_points_by_return.map(u64::from).to_vec();
        let tables: [Vec<u64>; 2] = [large, legacy];
        tables.into_iter().find(|table| table.iter().any(|points| *points > 0)).unwrap_or_default()
    }

    /// Where the points begin.
    pub fn points_at(&self) -> u64 {
        u64::from(self.raw.offset_to_point_data)
    }

    /// What GPS times count from; `compatible` is the time offset of a file in
    /// LASzip's compatibility mode.
    pub fn gps_time(&self, compatible: Option<u16>, notes: &mut Vec<String>) -> GpsEpoch {
        GpsEpoch::of(self.raw.global_encoding, self.time_offset.or(compatible), notes)
    }

    /// Whether WKT comes before GeoTIFF keys: in LAS 1.4 by its bit, or by a point format
    /// that knows nothing else; before there was a bit, since it says more.
    pub fn is_crs_wkt(&self) -> bool {
        const WKT_BIT: u16 = 1 << 4;
        let minor = self.version.1;
        minor != 4 || self.raw.global_encoding & WKT_BIT != 0 || self.point_format >= 6
    }

    pub fn scale(&self) -> [f64; 3] {
        [self.raw.x_scale_factor, self.raw.y_scale_factor, self.raw.z_scale_factor]
    }

    pub fn offset(&self) -> [f64; 3] {
        [self.raw.x_offset, self.raw.y_offset, self.raw.z_offset]
    }

    /// Where the extended records begin and how many there are said to be, if
    /// that can be. One whose header counts none may have some all the same.
    pub fn extended(
        &self,
        source: &FileReader,
        notes: &mut Vec<String>,
    ) -> Result<Option<(u64, u32)>, LasError> {
        let Some((start, said)) = self.extended else { return Ok(None) };
        if (start, said) == (0, 0) {
            return Ok(None);
        }
        let can_be = start >= self.points_at() && start < source.bytes();
        if said == 0 {
            let is_one = can_be && vlr::is_extended_record(source, start)?;
            return Ok(is_one.then_some((start, said)));
        }
        if !can_be {
            notes.push(format!(
                "its extended records should begin at byte {start}, which cannot be; they are ignored"
            ));
        }
        Ok(can_be.then_some((start, said)))
    }

    /// Where the points end at the latest: something else, or the file's end, comes
    /// there.
    pub fn points_end(&self, source: &FileReader) -> Result<PointsEnd, LasError> {
        let mut end = PointsEnd { certain: source.bytes(), said: source.bytes() };
        let waveforms = self.raw.start_of_waveform_data_packet_record.map(|start| (start, 1));
        for (start, said) in self.extended.into_iter().chain(waveforms) {
            // 0 is where there are none, and inside the header nothing can be.
            if start < self.points_at() || start >= source.bytes() {
                continue;
            }
            if vlr::is_extended_record(source, start)? {
                end.certain = end.certain.min(start);
                end.said = end.said.min(start);
            } else if said > 0 && start > self.points_at() {
                end.said = end.said.min(start);
            }
        }
        Ok(end)
    }

    /// The header for the world outside.
    pub fn finish(self, source: &FileReader) -> Header {
        let raw = &self.raw;
        let created = Created { year: raw.file_creation_year, day: raw.file_creation_day_of_year };
        Header {
            version: self.version,
            point_format: self.point_format,
            compressed: self.compressed,
            record_length: usize::from(raw.point_data_record_length),
            points: 0,
            missing: 0,
            scale: self.scale(),
            offset: self.offset(),
            min: [raw.min_x, raw.min_y, raw.min_z],
            max: [raw.max_x, raw.max_y, raw.max_z],
            returns: self.returns(),
            extra: Vec::new(),
            crs: None,
            gps_time: GpsEpoch::Week,
            crs_records: Vec::new(),
            software: text::get(&raw.generating_software),
            system: text::get(&raw.system_identifier),
            // LAS is of 2003; before that there is only what was never set.
            created: (created.year >= 1990 && (1..=366).contains(&created.day)).then_some(created),
            global_encoding: raw.global_encoding,
            file_bytes: source.bytes(),
            notes: Vec::new(),
        }
    }
}
