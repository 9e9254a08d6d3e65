//! Our LAZ codec against the `laz` crate: the same records of the same bytes, the same
//! bytes of the same records, and of damaged ones an error or the same records.

mod clouds;
mod files;
mod fuzz;
mod tiny;

use std::io::Cursor;

use laz::record::{
    LayeredPointRecordCompressor, LayeredPointRecordDecompressor, RecordCompressor, RecordDecompressor,
    SequentialPointRecordCompressor, SequentialPointRecordDecompressor,
};
use laz::{LazItem, LazItemRecordBuilder, LazItemType, LazVlr};
use lodestone::format::laz::{Decoder, Encoder, RecordShape};

use clouds::{Dice, records};

/// The `laz` crate on one kind of points.
struct Oracle {
    items: Vec<LazItem>,
    layered: bool,
    length: usize,
}

impl Oracle {
    fn new(point_format: u8, extra: u16, version: u16) -> Oracle {
        use LazItemType::*;
        let mut kinds = match point_format {
            0 => vec![Point10],
            1 => vec![Point10, GpsTime],
            2 => vec![Point10, RGB12],
            3 => vec![Point10, GpsTime, RGB12],
            6 => vec![Point14],
            7 => vec![Point14, RGB14],
            8 => vec![Point14, RGBNIR14],
            _ => panic!("format {point_format} is left to laz"),
        };
        let layered = point_format >= 6;
        match (extra, layered) {
            (0, _) => {}
            (_, false) => kinds.push(Byte(extra)),
            (_, true) => kinds.push(Byte14(extra)),
        }
        // Items of another version than the builder's can only be had from bytes.
        let mut builder = LazItemRecordBuilder::new();
        for kind in &kinds {
            builder.add_item(*kind);
        }
        let items = builder.build();
        let mut bytes = (items.len() as u16).to_le_bytes().to_vec();
        for item in &items {
            for number in [u16::from(item.item_type()), item.size(), version] {
                bytes.extend_from_slice(&number.to_le_bytes());
            }
        }
        let mut vlr = vec![0; 32];
        vlr[0] = if layered { 3 } else { 2 };
        vlr[12..16].copy_from_slice(&50_000u32.to_le_bytes());
        vlr.extend_from_slice(&bytes);
        let items = LazVlr::from_buffer(&vlr).unwrap().items().clone();
        assert!(items.iter().all(|item| item.version() == version));
        let length = items.iter().map(|item| usize::from(item.size())).sum();
        Oracle { items, layered, length }
    }

    /// Of damaged bytes it may panic.
    fn decode(&self, chunk: &[u8], points: usize) -> Result<Vec<u8>, String> {
        let mut records = vec![0; points * self.length];
        let input = Cursor::new(chunk);
        if self.layered {
            let mut decoder = LayeredPointRecordDecompressor::new(input);
            decoder.set_fields_from(&self.items).unwrap();
            decoder.decompress_many(&mut records).map_err(|e| e.to_string())?;
            return Ok(records);
        }
        let mut decoder = SequentialPointRecordDecompressor::new(input);
        decoder.set_fields_from(&self.items).unwrap();
        decoder.decompress_many(&mut records).map_err(|e| e.to_string())?;
        match decoder.into_inner().position() == chunk.len() as u64 {
            true => Ok(records),
            false => Err("bytes are left over".to_string()),
        }
    }

    fn encode(&self, records: &[u8]) -> Vec<u8> {
        if self.layered {
            let mut encoder = LayeredPointRecordCompressor::new(Vec::new());
            encoder.set_fields_from(&self.items).unwrap();
            encoder.compress_many(records).unwrap();
            encoder.done().unwrap();
            return encoder.into_inner();
        }
        let mut encoder = SequentialPointRecordCompressor::new(Vec::new());
        encoder.set_fields_from(&self.items).unwrap();
        encoder.compress_many(records).unwrap();
        encoder.done().unwrap();
        encoder.into_inner()
    }
}

/// Formats and versions that are coded here.
const KINDS: [(u8, u16); 10] =
    [(0, 2), (1, 2), (2, 2), (3, 2), (6, 3), (6, 4), (7, 3), (7, 4), (8, 3), (8, 4)];

/// Both codecs on the same clouds, with the same decoder and encoder for all.
fn compare(point_format: u8, version: u16, extra: u16, sizes: &[usize], seed: u64) {
    let oracle = Oracle::new(point_format, extra, version);
    let shape = RecordShape::new(point_format, usize::from(extra), version).unwrap();
    assert_eq!(shape.record_length(), oracle.length);
    let mut decoder = Decoder::new(shape);
    let mut encoder = Encoder::new(shape);
    for (number, points) in sizes.iter().enumerate() {
        let what = format!("format {point_format}, version {version}, {extra} extra bytes, {points} points");
        let records = records(point_format, oracle.length, *points, seed + number as u64);
        let chunk = oracle.encode(&records);
        let mut decoded = vec![0xA5; records.len()];
        decoder.decode(&chunk, &mut decoded).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(decoded == oracle.decode(&chunk, *points).unwrap(), "{what}: other records");
        if let Some(encoder) = &mut encoder {
            let mut own = Vec::new();
            encoder.encode(&records, &mut own);
            assert!(own == chunk, "{what}: other bytes");
        }
    }
}

#[test]
fn random_clouds_are_coded_as_laz_does() {
    for (point_format, version) in KINDS {
        for extra in [0, 1, 3, 17] {
            let seed = 1000 * u64::from(point_format) + 100 * u64::from(version) + u64::from(extra);
            compare(point_format, version, extra, &[1, 2, 3, 10, 63, 64, 65, 66, 129, 2000, 5], seed);
        }
        for seed in 0..40 {
            compare(point_format, version, 2, &[300, 20, 700], 77 * seed);
        }
    }
}

#[test]
fn chunks_of_200_000_points_are_coded_as_laz_does() {
    for (point_format, version) in KINDS {
        compare(point_format, version, 1, &[200_000], 5);
    }
}

#[test]
fn shapes_that_are_left_to_laz() {
    for point_format in [4, 5, 9, 10, 11] {
        for version in 1..=4 {
            assert_eq!(RecordShape::new(point_format, 0, version), None);
        }
    }
    for (point_format, version) in [(0, 1), (3, 1), (0, 3), (6, 2), (8, 1), (6, 5)] {
        assert_eq!(RecordShape::new(point_format, 0, version), None);
    }
}

/// LASzip compares times as numbers, and so loses the sign of a zero; here it is kept.
/// What is no number is always another, whatever its bits.
#[test]
fn times_that_are_no_numbers_are_kept_bit_by_bit() {
    let oracle = Oracle::new(6, 0, 3);
    let shape = RecordShape::new(6, 0, 3).unwrap();
    let nan = f64::from_bits(0x7FF8_0000_0000_1234);
    for (times, as_laz) in [
        ([f64::NAN, f64::NAN, nan, nan, 1.0], true),
        ([f64::INFINITY, -f64::INFINITY, 0.0, 0.0, f64::MIN_POSITIVE], true),
        ([0.0, -0.0, -0.0, 0.0, 0.0], false),
        ([-0.0, 5.0, 0.0, -0.0, nan], false),
    ] {
        let mut records = Vec::new();
        for time in times {
            records.extend_from_slice(&[7; 22]);
            records.extend_from_slice(&time.to_le_bytes());
        }
        let mut chunk = Vec::new();
        Encoder::new(shape).unwrap().encode(&records, &mut chunk);
        assert_eq!(chunk == oracle.encode(&records), as_laz, "{times:?}");
        assert!(oracle.decode(&chunk, times.len()).unwrap() == records, "{times:?}");
        let mut decoded = vec![0; records.len()];
        Decoder::new(shape).decode(&chunk, &mut decoded).unwrap();
        assert!(decoded == records, "{times:?}");
    }
}
