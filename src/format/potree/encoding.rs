//! octree.bin: the points of one node, from records to bytes and back.
//!
//! DEFAULT is the records one behind the other. BROTLI is one brotli stream of
//! attribute columns, points in Morton order; there `position` and `rgb` are
//! Morton codes, as [`super::morton`] has them.

use std::io::Read;

use super::error::{PotreeError, Result};
use super::files;
use super::metadata::PotreeEncoding;
use super::morton;
use crate::octree::attribute::{Attribute, Scalar, Schema};

/// Bytes of a decoded node beyond which it is not believed. A node that large
/// (some 25 million points) is of no use to a viewer.
pub const LARGEST_NODE: u64 = 1 << 30;

/// A decoded node of up to so many bytes is believed whatever it is packed into: a
/// crowd of equal points packs to next to nothing.
const ALWAYS_BELIEVED: u64 = 64 << 20;
/// Beyond that, bytes that a byte of a brotli stream may stand for. Points differ in
/// their positions at least: real nodes stay below 100.
pub const MOST_RATIO: u64 = 4096;

/// Bytes of a node's points as they are when its stream is unpacked.
pub fn unpacked_size(schema: &Schema, encoding: PotreeEncoding, points: u32) -> u64 {
    let width: usize = match encoding {
        PotreeEncoding::Default => schema.record_size(),
        PotreeEncoding::Brotli => columns(schema).map(|(column, _, attribute)| column.width(attribute)).sum(),
    };
    u64::from(points).saturating_mul(width as u64)
}

/// Whether `points` points can be stored in `stored` bytes, and are worth the memory
/// of unpacking them.
pub fn is_believable(schema: &Schema, encoding: PotreeEncoding, points: u32, stored: u64) -> bool {
    let unpacked = unpacked_size(schema, encoding, points);
    match encoding {
        PotreeEncoding::Default => stored == unpacked,
        PotreeEncoding::Brotli if points == 0 || stored == 0 => points == 0 && stored == 0,
        // What cannot be packed grows by some bytes a block.
        PotreeEncoding::Brotli => {
            stored <= unpacked + unpacked / 256 + 1024
                && unpacked <= LARGEST_NODE
                && unpacked <= stored.saturating_mul(MOST_RATIO).max(ALWAYS_BELIEVED)
        }
    }
}

/// How an attribute's values stand in a BROTLI column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BrotliColumn {
    /// Two Morton codes.
    Position,
    /// One Morton code.
    Color,
    /// The bytes of the record.
    Plain,
}

impl BrotliColumn {
    fn of(attribute: &Attribute) -> BrotliColumn {
        match (attribute.name.as_str(), attribute.scalar, attribute.elements) {
            ("position", Scalar::I32, 3) => BrotliColumn::Position,
            ("rgb", Scalar::U16, 3) => BrotliColumn::Color,
            _ => BrotliColumn::Plain,
        }
    }

    /// Bytes a point.
    fn width(self, attribute: &Attribute) -> usize {
        match self {
            BrotliColumn::Position => 16,
            BrotliColumn::Color => 8,
            BrotliColumn::Plain => attribute.size(),
        }
    }
}

/// Columns with the place of their attribute in the record.
fn columns(schema: &Schema) -> impl Iterator<Item = (BrotliColumn, usize, &Attribute)> {
    let mut offset = 0;
    schema.attributes.iter().map(move |attribute| {
        let start = offset;
        offset += attribute.size();
        (BrotliColumn::of(attribute), start, attribute)
    })
}

/// Appends the brotli stream of a node's records (schema order, no padding) to
/// `out`; nothing where there are no records. `quality` is brotli's, 0 to 11.
pub fn encode_brotli(schema: &Schema, records: &[u8], quality: u32, out: &mut Vec<u8>) -> Result<()> {
    let record_size = schema.record_size();
    if records.is_empty() || record_size == 0 {
        return Ok(());
    }
    let keys = morton_keys(schema, records);
    let mut sorted = Vec::with_capacity(records.len());
    for key in &keys {
        sorted.extend_from_slice(&records[*key as u32 as usize * record_size..][..record_size]);
    }
    let width: usize = columns(schema).map(|(column, _, attribute)| column.width(attribute)).sum();
    let mut columns_bytes = vec![0; keys.len() * width];
    let mut rest = columns_bytes.as_mut_slice();
    for (column, start, attribute) in columns(schema) {
        let width = column.width(attribute);
        let (values, behind) = rest.split_at_mut(keys.len() * width);
        rest = behind;
        let fields = sorted.chunks_exact(record_size).map(|record| &record[start..]);
        match column {
            BrotliColumn::Position => {
                for (value, key) in values.as_chunks_mut::<8>().0.chunks_exact_mut(2).zip(&keys) {
                    value[0] = ((key >> 80) as u64).to_le_bytes();
                    value[1] = ((key >> 32) as u64 & LOW_CODE).to_le_bytes();
                }
            }
            BrotliColumn::Color => {
                for (value, field) in values.as_chunks_mut::<8>().0.iter_mut().zip(fields) {
                    *value = morton::encode(three(field, u16::from_le_bytes)).to_le_bytes();
                }
            }
            BrotliColumn::Plain if width == 1 => {
                values.iter_mut().zip(fields).for_each(|(to, from)| *to = from[0])
            }
            BrotliColumn::Plain => {
                for (value, field) in values.chunks_exact_mut(width.max(1)).zip(fields) {
                    value.copy_from_slice(&field[..width]);
                }
            }
        }
    }
    compress(&columns_bytes, quality, out)
}

/// The 48 bits of a code.
const LOW_CODE: u64 = (1 << 48) - 1;

/// What records are sorted by, in order: the high and the low Morton code of the
/// position, 48 bits each, and then the record's number in 32 bits, so that
/// equal positions stay in the order they have.
fn morton_keys(schema: &Schema, records: &[u8]) -> Vec<u128> {
    let position = columns(schema).find(|c| c.0 == BrotliColumn::Position).map(|(_, start, _)| start);
    let code = |record: &[u8]| match position {
        None => 0,
        Some(start) => {
            let (high, low) = morton::encode_position(three(&record[start..], i32::from_le_bytes));
            u128::from(high) << 80 | u128::from(low) << 32
        }
    };
    let records = records.chunks_exact(schema.record_size());
    let mut keys: Vec<u128> = records.zip(0u32..).map(|(record, i)| code(record) | u128::from(i)).collect();
    keys.sort_unstable();
    keys
}

fn compress(bytes: &[u8], quality: u32, out: &mut Vec<u8>) -> Result<()> {
    let parameters = brotli::enc::BrotliEncoderParams {
        quality: quality.min(11) as i32,
        // The smallest window that holds the node: the encoder's tables and the
        // viewer's ring buffer grow with it.
        lgwin: (bytes.len().max(2).ilog2() as i32 + 1).clamp(10, 22),
        size_hint: bytes.len(),
        ..Default::default()
    };
    let mut input = bytes;
    brotli::BrotliCompress(&mut input, out, &parameters).map_err(PotreeError::Compress)?;
    Ok(())
}

/// The records of a node from its bytes in octree.bin, in the order in which
/// they are stored.
pub fn decode_node(schema: &Schema, encoding: PotreeEncoding, points: u32, bytes: &[u8]) -> Result<Vec<u8>> {
    let record_size = schema.record_size();
    match encoding {
        PotreeEncoding::Default => {
            if bytes.len() as u64 != u64::from(points) * record_size as u64 {
                return Err(damaged(format!(
                    "{points} points of {record_size} bytes are not {} bytes",
                    bytes.len()
                )));
            }
            Ok(bytes.to_vec())
        }
        PotreeEncoding::Brotli if points == 0 && bytes.is_empty() => Ok(Vec::new()),
        PotreeEncoding::Brotli => {
            let count = points as usize;
            let columns_bytes = decompress(schema, points, bytes)?;
            let mut records = files::zeroed(u64::from(points).saturating_mul(record_size as u64))?;
            let mut rest = columns_bytes.as_slice();
            for (column, start, attribute) in columns(schema) {
                let (values, behind) = rest.split_at(count * column.width(attribute));
                rest = behind;
                let values = values.chunks_exact(column.width(attribute));
                for (record, value) in records.chunks_exact_mut(record_size).zip(values) {
                    put_value(column, value, &mut record[start..start + attribute.size()]);
                }
            }
            Ok(records)
        }
    }
}

fn put_value(column: BrotliColumn, value: &[u8], into: &mut [u8]) {
    match column {
        BrotliColumn::Position => {
            let position = morton::decode_position(word(&value[..8]), word(&value[8..]));
            into.chunks_exact_mut(4).zip(position).for_each(|(to, p)| to.copy_from_slice(&p.to_le_bytes()));
        }
        BrotliColumn::Color => {
            let color = morton::decode(word(value));
            into.chunks_exact_mut(2).zip(color).for_each(|(to, c)| to.copy_from_slice(&c.to_le_bytes()));
        }
        BrotliColumn::Plain => into.copy_from_slice(value),
    }
}

/// The columns of a node. Memory grows with what the stream really holds, up to
/// what the number of points asks for.
fn decompress(schema: &Schema, points: u32, bytes: &[u8]) -> Result<Vec<u8>> {
    let expected = unpacked_size(schema, PotreeEncoding::Brotli, points);
    if !is_believable(schema, PotreeEncoding::Brotli, points, bytes.len() as u64) {
        let stored = bytes.len();
        return Err(damaged(format!(
            "{points} points in {stored} bytes of a brotli stream are not believable"
        )));
    }
    // Windows of more than 16 MiB are an extension that no viewer reads.
    if bytes.first().is_some_and(|first| first & 0x7F == 0x11) {
        return Err(damaged("its brotli stream asks for a window that is too large".to_string()));
    }
    let mut columns_bytes = Vec::new();
    let memory = columns_bytes.try_reserve_exact(expected as usize + 1);
    memory.map_err(|_| damaged(format!("there is no memory for {expected} bytes of a node")))?;
    let mut stream = brotli::Decompressor::new(bytes, 4096);
    let read = (&mut stream).take(expected + 1).read_to_end(&mut columns_bytes);
    read.map_err(|error| damaged(format!("its brotli stream does not decode ({error})")))?;
    if columns_bytes.len() as u64 != expected {
        let (is, than) = match columns_bytes.len() as u64 > expected {
            true => ("more", expected),
            false => ("less", expected),
        };
        return Err(damaged(format!(
            "its brotli stream holds {is} than the {than} bytes of {points} points"
        )));
    }
    Ok(columns_bytes)
}

fn damaged(what: String) -> PotreeError {
    PotreeError::Points(what)
}

/// Three little-endian numbers.
fn three<const N: usize, T: Copy + Default>(bytes: &[u8], parse: fn([u8; N]) -> T) -> [T; 3] {
    std::array::from_fn(|i| {
        bytes.get(i * N..).and_then(|b| b.first_chunk()).map_or(T::default(), |b| parse(*b))
    })
}

fn word(bytes: &[u8]) -> u64 {
    bytes.first_chunk().map_or(0, |b| u64::from_le_bytes(*b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn schema() -> Schema {
        let attributes = vec![
            Attribute::new("position", Scalar::I32, 3),
            Attribute::new("intensity", Scalar::U16, 1),
            Attribute::new("gps-time", Scalar::F64, 1),
            Attribute::new("rgb", Scalar::U16, 3),
            Attribute::new("extra", Scalar::U8, 3),
        ];
        Schema { attributes }
    }

    fn sorted(records: &[u8], size: usize) -> Vec<&[u8]> {
        let mut records: Vec<&[u8]> = records.chunks_exact(size).collect();
        records.sort_unstable();
        records
    }

    proptest! {
        #[test]
        fn records_come_back_in_morton_order(
            bytes in proptest::collection::vec(any::<u8>(), 0..31 * 50),
            quality in prop_oneof![Just(1u32), Just(6)],
        ) {
            let size = schema().record_size();
            let points = bytes.len() / size;
            let records = &bytes[..points * size];
            let mut stream = Vec::new();
            encode_brotli(&schema(), records, quality, &mut stream).unwrap();
            prop_assert_eq!(stream.is_empty(), points == 0);
            let decoded = decode_node(&schema(), PotreeEncoding::Brotli, points as u32, &stream).unwrap();
            prop_assert_eq!(sorted(&decoded, size), sorted(records, size));
            let codes: Vec<_> = decoded
                .chunks_exact(size)
                .map(|record| morton::encode_position(three(record, i32::from_le_bytes)))
                .collect();
            prop_assert!(codes.is_sorted());
        }

        #[test]
        fn noise_does_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..300), points in any::<u32>()) {
            prop_assert!(decode_node(&schema(), PotreeEncoding::Brotli, points.max(1), &bytes).is_err());
            prop_assert!(decode_node(&schema(), PotreeEncoding::Default, points | 64, &bytes).is_err());
        }
    }

    /// Equal positions keep their order, so that equal input makes equal bytes.
    #[test]
    fn equal_positions_keep_their_order() {
        let schema = Schema {
            attributes: vec![Attribute::new("position", Scalar::I32, 3), Attribute::new("n", Scalar::U8, 1)],
        };
        let records: Vec<u8> = (0..200u8).flat_map(|n| [[0; 12].as_slice(), &[n]].concat()).collect();
        let mut stream = Vec::new();
        encode_brotli(&schema, &records, 6, &mut stream).unwrap();
        assert_eq!(decode_node(&schema, PotreeEncoding::Brotli, 200, &stream).unwrap(), records);
    }

    #[test]
    fn a_wrong_count_is_an_error_either_way() {
        let records = vec![7; schema().record_size() * 5];
        let mut stream = Vec::new();
        encode_brotli(&schema(), &records, 6, &mut stream).unwrap();
        for points in [4, 6, u32::MAX] {
            assert!(decode_node(&schema(), PotreeEncoding::Brotli, points, &stream).is_err(), "{points}");
        }
        assert!(decode_node(&schema(), PotreeEncoding::Brotli, 5, &stream[..stream.len() - 1]).is_err());
    }
}
