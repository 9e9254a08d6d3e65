//! Records of a node to the bytes of one LAZ chunk and back.

use super::{CopcError, RecordLayout};
use crate::format::las::record_length;
use crate::format::laz::{Decoder, Encoder, RecordShape};

/// The version of LAZ's items that we write; 4 is for what LASzip 3.5 writes and others
/// do not read yet.
pub const ITEM_VERSION: u16 = 3;

/// Encodes nodes, one after the other.
#[derive(Debug)]
pub struct ChunkEncoder {
    encoder: Encoder,
    record_length: usize,
}

impl ChunkEncoder {
    pub fn new(layout: &RecordLayout) -> Result<ChunkEncoder, CopcError> {
        let (format, extra) = (layout.point_format(), layout.extra_bytes());
        let encoder = RecordShape::new(format, extra, ITEM_VERSION).and_then(Encoder::new);
        let encoder = encoder.ok_or_else(|| {
            CopcError::Unholdable(format!("it has no point format {format}, only 6, 7 and 8"))
        })?;
        Ok(ChunkEncoder { encoder, record_length: layout.record_length() })
    }

    /// Appends one chunk of all these LAS records; nothing, if there are none. The point
    /// count and size of a chunk must fit 31 bits, as they do in the hierarchy.
    pub fn encode(&mut self, records: &[u8], chunk: &mut Vec<u8>) -> Result<(), CopcError> {
        if !records.len().is_multiple_of(self.record_length) {
            let reason = format!("{} bytes are not whole records of {}", records.len(), self.record_length);
            return Err(CopcError::Records(reason));
        }
        let (before, points) = (chunk.len(), records.len() / self.record_length);
        self.encoder.encode(records, chunk);
        match i32::try_from(points).is_ok() && i32::try_from(chunk.len() - before).is_ok() {
            true => Ok(()),
            false => {
                Err(CopcError::Unholdable(format!("a node of {points} points is larger than 2^31 bytes")))
            }
        }
    }
}

/// Decodes nodes, one after the other.
#[derive(Debug)]
pub struct NodeDecoder {
    decoder: Decoder,
    record_length: usize,
}

impl NodeDecoder {
    /// Of point format 6 to 8, with so many extra bytes; nothing for what is none of COPC.
    pub fn new(point_format: u8, extra: usize, version: u16) -> Option<NodeDecoder> {
        let shape = RecordShape::new(point_format, extra, version).filter(|_| point_format >= 6)?;
        let record_length = record_length(point_format)? + extra;
        Some(NodeDecoder { decoder: Decoder::new(shape), record_length })
    }

    /// LAS records of a whole chunk; what was in `records` is replaced.
    pub fn decode(&mut self, chunk: &[u8], points: u64, records: &mut Vec<u8>) -> Result<(), CopcError> {
        // No LAZ byte stands for more points (docs/bombs.md).
        const MAX_POINTS_PER_BYTE: u64 = 2048;
        let broken = |reason: String| CopcError::Chunk { points, reason };
        if points > (chunk.len() as u64).saturating_mul(MAX_POINTS_PER_BYTE) {
            return Err(broken(format!("its {} bytes cannot be so many", chunk.len())));
        }
        records.clear();
        records.resize(points as usize * self.record_length, 0);
        match points {
            0 => Ok(()),
            _ => self.decoder.decode(chunk, records).map_err(|error| broken(error.to_string())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Described;
    use super::*;
    use crate::octree::attribute::{Attribute, Scalar, Schema};

    #[test]
    fn chunks_come_back_and_damage_is_an_error() {
        let attributes = [("position", Scalar::I32, 3), ("rgb", Scalar::U16, 3), ("a", Scalar::F32, 1)];
        let attributes = attributes.map(|(name, scalar, elements)| Attribute::new(name, scalar, elements));
        let layout =
            RecordLayout::new(&Schema { attributes: attributes.to_vec() }, &Described::default()).unwrap();
        let octree: Vec<u8> = (0..22 * 500u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let (mut las, mut chunk) = (Vec::new(), vec![7]);
        layout.promote(&octree, &mut las);
        let mut encoder = ChunkEncoder::new(&layout).unwrap();
        encoder.encode(&las, &mut chunk).unwrap();
        encoder.encode(&[], &mut chunk).unwrap();
        assert!(encoder.encode(&las[1..], &mut chunk).is_err());
        let mut decoder = NodeDecoder::new(7, 4, ITEM_VERSION).unwrap();
        let mut decoded = Vec::new();
        decoder.decode(&chunk[1..], 500, &mut decoded).unwrap();
        assert_eq!(decoded, las);
        assert!(decoder.decode(&chunk[1..], 499, &mut decoded).is_err());
        assert!(decoder.decode(&chunk[1..chunk.len() - 1], 500, &mut decoded).is_err());
        assert!(decoder.decode(&chunk[1..], u64::MAX, &mut decoded).is_err());
        assert!(NodeDecoder::new(3, 0, 2).is_none());
    }
}
