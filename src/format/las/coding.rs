//! One LAZ chunk to raw records and back: by [`crate::format::laz`], and what is rare
//! by the `laz` crate (items of version 1, wave packets, encoding of the formats 0 to 5).
//! What must hold before that is given anything is checked here: it trusts sizes, and
//! panics where they lie.
//!
//! Chunks of the point formats 0 to 5 are one arithmetic-coded stream; those of
//! 6 to 10 are layers, one stream a field, whose sizes stand at the chunk's
//! front (Isenburg 2013; the layered scheme is that of LASzip 3).

use std::io::{self, Cursor};
use std::panic::{AssertUnwindSafe, catch_unwind};

use laz::record::{
    LayeredPointRecordCompressor, RecordCompressor, RecordDecompressor, SequentialPointRecordCompressor,
};
use laz::{LazItem, LazItemType};

use super::fields;
use crate::format::laz::{Decoder, Encoder, RecordShape};

/// How one file's records are compressed.
#[derive(Debug, Clone)]
pub struct Coding {
    pub items: Vec<LazItem>,
    pub layered: bool,
    /// Bytes of a decoded record.
    pub record_length: usize,
    /// Where these items are coded without the `laz` crate.
    own: Option<RecordShape>,
}

/// Extra bytes that a LAZ record may have. Every one of them costs `laz` a
/// model of some kilobytes (times four in layered chunks), so that a lie here
/// would be gigabytes.
const MOST_EXTRA_BYTES: u16 = 4096;

impl Coding {
    /// Takes the items of a LASzip VLR if they are those of the point format,
    /// in their order; `laz` would panic or mix up fields on others.
    pub fn new(items: &[LazItem], point_format: u8) -> Result<Coding, String> {
        use LazItemType::*;
        let expected: &[LazItemType] = match point_format {
            0 => &[Point10],
            1 => &[Point10, GpsTime],
            2 => &[Point10, RGB12],
            3 => &[Point10, GpsTime, RGB12],
            4 => &[Point10, GpsTime, WavePacket13],
            5 => &[Point10, GpsTime, RGB12, WavePacket13],
            6 => &[Point14],
            7 => &[Point14, RGB14],
            8 => &[Point14, RGBNIR14],
            9 => &[Point14, WavePacket14],
            10 => &[Point14, RGBNIR14, WavePacket14],
            _ => return Err(format!("point format {point_format} has no LAZ compression")),
        };
        let layered = point_format >= 6;
        let (standard, extra) = items.split_at(items.len().min(expected.len()));
        let same = standard.len() == expected.len()
            && standard
                .iter()
                .zip(expected)
                .all(|(item, kind)| item.item_type() == *kind && item.size() == size(*kind))
            && match extra {
                [] => true,
                [bytes] => matches!((bytes.item_type(), layered), (Byte(_), false) | (Byte14(_), true)),
                _ => false,
            };
        if !same {
            return Err(format!("its LASzip record does not describe points of format {point_format}"));
        }
        if let Some(bytes) = extra.iter().find(|item| item.size() > MOST_EXTRA_BYTES) {
            return Err(format!(
                "its points have {} extra bytes, and LAZ is read with at most {MOST_EXTRA_BYTES}",
                bytes.size()
            ));
        }
        if let Some(odd) = items.iter().find(|item| !supported(item, layered)) {
            return Err(format!(
                "version {} of the LAZ compression of {:?} is not supported",
                odd.version(),
                odd.item_type()
            ));
        }
        let record_length = items.iter().map(|item| usize::from(item.size())).sum();
        let extra = extra.iter().map(|item| usize::from(item.size())).sum();
        let version = items.first().map_or(0, LazItem::version);
        let own = RecordShape::new(point_format, extra, version)
            .filter(|_| items.iter().all(|item| item.version() == version));
        Ok(Coding { items: items.to_vec(), layered, record_length, own })
    }

    /// The same records by the `laz` crate, to hold our own codec against.
    #[cfg(test)]
    pub fn without_own(&self) -> Coding {
        Coding { own: None, ..self.clone() }
    }

    /// Layers of a layered chunk: nine of the point itself, one of each further
    /// field, and one of every extra byte.
    fn layers(&self) -> usize {
        self.items
            .iter()
            .map(|item| match item.item_type() {
                LazItemType::Point14 => 9,
                LazItemType::RGBNIR14 => 2,
                LazItemType::Byte14(count) => usize::from(count),
                _ => 1,
            })
            .sum()
    }

    /// Bytes in front of a layered chunk's layers: the first record as it is,
    /// the number of points, the size of each layer.
    pub fn layered_front(&self) -> usize {
        self.record_length + 4 + 4 * self.layers()
    }

    /// Points and bytes of a layered chunk, as its front says.
    pub fn layered_extent(&self, front: &[u8]) -> (u64, u64) {
        let mut words = front[self.record_length..self.layered_front()].chunks_exact(4).map(|word| {
            let mut bytes = [0; 4];
            bytes.copy_from_slice(word);
            u64::from(u32::from_le_bytes(bytes))
        });
        let points = words.next().unwrap_or(0);
        (points, self.layered_front() as u64 + words.sum::<u64>())
    }

    /// Decodes chunks, one after the other.
    pub fn decoder(&self) -> ChunkDecoder<'_> {
        ChunkDecoder { coding: self, own: self.own.map(Decoder::new) }
    }

    fn decode_by_laz(&self, chunk: &[u8], records: &mut [u8]) -> Result<(), String> {
        let points = (records.len() / self.record_length) as u64;
        if self.layered {
            self.check_layers(chunk, points)?;
            return guard(|| fields::layered(&self.items, Cursor::new(chunk))?.decompress_many(records));
        }
        let left = guard(|| {
            let mut decoder = fields::sequential(&self.items, chunk)?;
            decoder.decompress_many(records)?;
            Ok(decoder.into_inner().len())
        })?;
        match left {
            0 => Ok(()),
            _ => Err(format!("{left} of its bytes are left over")),
        }
    }

    /// The layers must fill the chunk exactly; `laz` allocates what they say.
    fn check_layers(&self, chunk: &[u8], points: u64) -> Result<(), String> {
        if chunk.len() < self.layered_front() {
            return Err(format!("its {} bytes are too few", chunk.len()));
        }
        let (said_points, bytes) = self.layered_extent(chunk);
        if bytes != chunk.len() as u64 {
            return Err(format!("its layers take {bytes} bytes, it has {}", chunk.len()));
        }
        if said_points != points {
            return Err(format!("it says that it has {said_points} points, the file says {points}"));
        }
        Ok(())
    }

    /// Compresses whole records into one chunk.
    pub fn encode(&self, records: &[u8]) -> Result<Vec<u8>, String> {
        guard(|| {
            if let Some(mut encoder) = self.own.and_then(Encoder::new) {
                let mut chunk = Vec::new();
                encoder.encode(records, &mut chunk);
                return Ok(chunk);
            }
            if self.layered {
                let mut encoder = LayeredPointRecordCompressor::new(Vec::new());
                encode_with(&mut encoder, &self.items, records)?;
                Ok(encoder.into_inner())
            } else {
                let mut encoder = SequentialPointRecordCompressor::new(Vec::new());
                encode_with(&mut encoder, &self.items, records)?;
                Ok(encoder.into_inner())
            }
        })
    }
}

/// Decodes chunks of one file.
#[derive(Debug)]
pub struct ChunkDecoder<'a> {
    coding: &'a Coding,
    own: Option<Decoder>,
}

impl ChunkDecoder<'_> {
    /// Decodes a whole chunk into `records`, whose length says how many points
    /// it has. The bytes must be used up exactly: LAZ has no checksum, and this
    /// is what gives a damaged stream away.
    pub fn decode(&mut self, chunk: &[u8], records: &mut [u8]) -> Result<(), String> {
        match &mut self.own {
            Some(decoder) => guard(|| decoder.decode(chunk, records).map_err(io::Error::other)),
            None => self.coding.decode_by_laz(chunk, records),
        }
    }
}

fn encode_with<E: RecordCompressor<Vec<u8>>>(
    encoder: &mut E,
    items: &Vec<LazItem>,
    records: &[u8],
) -> io::Result<()> {
    encoder.set_fields_from(items).map_err(io::Error::other)?;
    encoder.compress_many(records)?;
    encoder.done()
}

/// Bytes that an item of this kind has in a record.
fn size(kind: LazItemType) -> u16 {
    match kind {
        LazItemType::Point10 => 20,
        LazItemType::GpsTime => 8,
        LazItemType::RGB12 | LazItemType::RGB14 => 6,
        LazItemType::RGBNIR14 => 8,
        LazItemType::WavePacket13 | LazItemType::WavePacket14 => 29,
        LazItemType::Point14 => 30,
        LazItemType::Byte(count) | LazItemType::Byte14(count) => count,
    }
}

fn supported(item: &LazItem, layered: bool) -> bool {
    match item.version() {
        1 | 2 => !layered,
        3 | 4 => layered,
        _ => false,
    }
}

/// Runs the decoder or encoder so that a panic inside it becomes an error: on
/// damaged streams `laz` divides by zero and indexes past its tables.
pub fn guard<T>(work: impl FnOnce() -> io::Result<T>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) if error.kind() == io::ErrorKind::UnexpectedEof => {
            Err("its bytes end before its points do".to_string())
        }
        Ok(Err(error)) => Err(error.to_string()),
        Err(_) => Err("its bytes make no sense".to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::records;
    use super::*;

    fn coding(point_format: u8, extra: u16) -> Coding {
        let vlr = laz::LazVlrBuilder::default().with_point_format(point_format, extra).unwrap().build();
        Coding::new(vlr.items(), point_format).unwrap()
    }

    #[test]
    fn both_codecs_do_the_same_through_the_seam() {
        for point_format in 0..=10 {
            for extra in [0, 3] {
                let coding = coding(point_format, extra);
                let is_own = !matches!(point_format, 4 | 5 | 9 | 10);
                assert_eq!(coding.own.is_some(), is_own, "format {point_format}");
                let by_laz = coding.without_own();
                let records = records(point_format, usize::from(extra), 700, 3);
                let chunk = coding.encode(&records).unwrap();
                assert_eq!(chunk, by_laz.encode(&records).unwrap(), "format {point_format}");
                for coding in [&coding, &by_laz] {
                    let mut decoder = coding.decoder();
                    for _ in 0..2 {
                        let mut decoded = vec![0; records.len()];
                        decoder.decode(&chunk, &mut decoded).unwrap();
                        assert!(decoded == records, "format {point_format}");
                        // Damage is an error, and none for what is decoded next.
                        let cut = &chunk[..chunk.len() - 9];
                        assert!(decoder.decode(cut, &mut decoded).is_err(), "format {point_format}");
                        let one = &mut decoded[..coding.record_length];
                        assert!(decoder.decode(&chunk, one).is_err(), "format {point_format}");
                    }
                }
            }
        }
    }

    #[test]
    fn items_of_other_versions_are_left_to_laz() {
        for (point_format, versions) in [(3, [2, 1, 2]), (3, [1, 1, 1]), (7, [3, 4, 3])] {
            let own = coding(point_format, 0);
            let mut record = vec![0; 34];
            record[0] = if own.layered { 3 } else { 2 };
            record[12..16].copy_from_slice(&100u32.to_le_bytes());
            record[32] = own.items.len() as u8;
            for (item, version) in own.items.iter().zip(versions) {
                for number in [u16::from(item.item_type()), item.size(), version] {
                    record.extend_from_slice(&number.to_le_bytes());
                }
            }
            let vlr = laz::LazVlr::from_buffer(&record).unwrap();
            let coding = Coding::new(vlr.items(), point_format).unwrap();
            assert!(own.own.is_some() && coding.own.is_none(), "{versions:?}");
        }
    }
}
