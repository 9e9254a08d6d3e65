//! LASzip's compatibility mode: points of the formats 6 to 10 stored as those of
//! 1, 3, 4 and 5, so that programs of before LAS 1.4 can read them, with what
//! these have no room for in five or six fields of extra bytes. Here they become
//! what they were (LASzip, laszip_dll.cpp: `request_compatibility_mode`).

use super::header::Header;
use super::record_length;
use super::vlr::Vlr;
use crate::octree::attribute::{ExtraField, Scalar};

/// Bytes of the record that marks such a file: two numbers of versions, four bytes unused, and the end of the header: of
/// LAS 1.4, and of LAS 1.5.
const LENGTH: usize = 8 + 148;
const LENGTH_OF_15: usize = LENGTH + 18;
/// Where the points by return stand in the record.
const RETURNS: usize = 8 + 28;
/// Where the time offset of LAS 1.5 stands in it.
const TIME_OFFSET: usize = LENGTH + 16;

/// Bytes of a descriptive block of a waveform packet.
const WAVEFORM: usize = 29;

/// How to restore the points of one file.
#[derive(Debug)]
pub struct Compatible {
    /// Bytes of a record as it is stored, and as it was.
    stored_length: usize,
    length: usize,
    scan_angle: usize,
    returns: usize,
    classification: usize,
    flags_and_channel: usize,
    /// From the formats 3 and 5 alone.
    nir: Option<usize>,
    has_color: bool,
    has_waveform: bool,
    /// From, to, and how many bytes, of the other extra fields.
    extra: Vec<(usize, usize, usize)>,
}

/// Recognizes a file in compatibility mode; then the header becomes that of the
/// points that [`Compatible::restore`] gives.
pub fn recognize(header: &mut Header, records: &[Vlr]) -> Option<Compatible> {
    let record = records.iter().find(|record| record.is_mark_of_compatibility())?;
    if header.version >= (1, 4) || ![LENGTH, LENGTH_OF_15].contains(&record.data.len()) {
        return None;
    }
    let has_color = matches!(header.point_format, 3 | 5);
    let has_waveform = matches!(header.point_format, 4 | 5);
    let find = |name: &str, scalar: Scalar| {
        let is_it = |field: &&ExtraField| field.name == name && (field.scalar, field.elements) == (scalar, 1);
        header.extra.iter().find(is_it).map(|field| field.position)
    };
    let scan_angle = find("LAS 1.4 scan angle", Scalar::I16)?;
    let returns = find("LAS 1.4 extended returns", Scalar::U8)?;
    let classification = find("LAS 1.4 classification", Scalar::U8)?;
    let flags_and_channel = find("LAS 1.4 flags and channel", Scalar::U8)?;
    let nir = find("LAS 1.4 NIR band", Scalar::U16).filter(|_| has_color);
    let point_format = match (header.point_format, nir) {
        (1, _) => 6,
        (3, None) => 7,
        (3, Some(_)) => 8,
        (4, _) => 9,
        // A color without its NIR has no format with waveforms to go to.
        (5, Some(_)) => 10,
        _ => return None,
    };
    let stored_length = header.record_length;
    let consumed = [Some(scan_angle), Some(returns), Some(classification), Some(flags_and_channel), nir];
    header.extra.retain(|field| !consumed.contains(&Some(field.position)));
    let mut at = record_length(point_format)?;
    let mut extra = Vec::new();
    for field in &mut header.extra {
        let size = field.scalar.size() * field.elements;
        extra.push((field.position, at, size));
        field.position = at;
        at += size;
    }
    (header.point_format, header.record_length) = (point_format, at);
    header.version = (1, if record.data.len() == LENGTH { 4 } else { 5 });
    let by_return = record.data[RETURNS..LENGTH].chunks_exact(8).map(|count| {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(count);
        u64::from_le_bytes(bytes)
    });
    let by_return: Vec<u64> = by_return.collect();
    if by_return.iter().any(|points| *points > 0) {
        header.returns = by_return;
    }
    Some(Compatible {
        stored_length,
        length: at,
        scan_angle,
        returns,
        classification,
        flags_and_channel,
        nir,
        has_color,
        has_waveform,
        extra,
    })
}

/// The time offset of LAS 1.5, where the file is one in compatibility mode.
pub fn time_offset(records: &[Vlr]) -> Option<u16> {
    let record = records
        .iter()
        .find(|record| record.is_mark_of_compatibility() && record.data.len() == LENGTH_OF_15)?;
    Some(u16::from_le_bytes([record.data[TIME_OFFSET], record.data[TIME_OFFSET + 1]]))
}

impl Compatible {
    pub fn stored_length(&self) -> usize {
        self.stored_length
    }

    /// Turns stored records into those that they were; what was in `records` is
    /// replaced.
    pub fn restore(&self, stored: &[u8], records: &mut Vec<u8>) {
        records.clear();
        records.resize(stored.len() / self.stored_length * self.length, 0);
        let points = stored.chunks_exact(self.stored_length).zip(records.chunks_exact_mut(self.length));
        for (from, to) in points {
            self.restore_one(from, to);
        }
    }

    fn restore_one(&self, from: &[u8], to: &mut [u8]) {
        // Position and intensity.
        to[..14].copy_from_slice(&from[..14]);
        let (more_returns, more_flags) = (from[self.returns], from[self.flags_and_channel]);
        let number = (from[14] & 7).wrapping_add(more_returns >> 4) & 15;
        let count = (from[14] >> 3 & 7).wrapping_add(more_returns & 15) & 15;
        to[14] = number | count << 4;
        let flags = from[15] >> 5 | (more_flags & 1) << 3;
        let channel = more_flags >> 1 & 3;
        // Scan direction and edge of flight line have the same two bits in both.
        to[15] = flags | channel << 4 | from[14] & 0b1100_0000;
        to[16] = (from[15] & 31).wrapping_add(from[self.classification]);
        to[17] = from[17];
        let remainder = i16::from_le_bytes([from[self.scan_angle], from[self.scan_angle + 1]]);
        let angle = quantized_angle(from[16] as i8).wrapping_add(remainder);
        to[18..20].copy_from_slice(&angle.to_le_bytes());
        to[20..22].copy_from_slice(&from[18..20]);
        to[22..30].copy_from_slice(&from[20..28]);
        let (mut read, mut write) = (28, 30);
        if self.has_color {
            to[write..write + 6].copy_from_slice(&from[read..read + 6]);
            (read, write) = (read + 6, write + 6);
        }
        if let Some(nir) = self.nir {
            to[write..write + 2].copy_from_slice(&from[nir..nir + 2]);
            write += 2;
        }
        if self.has_waveform {
            to[write..write + WAVEFORM].copy_from_slice(&from[read..read + WAVEFORM]);
        }
        for &(at, new, size) in &self.extra {
            to[new..new + size].copy_from_slice(&from[at..at + size]);
        }
    }
}

/// A scan angle of whole degrees in units of 0.006 degrees, rounded as LASzip
/// rounds, in floats of 32 bits.
fn quantized_angle(degrees: i8) -> i16 {
    let units = f32::from(degrees) / 0.006;
    (if units >= 0.0 { units + 0.5 } else { units - 0.5 }) as i16
}
