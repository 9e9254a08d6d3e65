//! Finished nodes become bytes: ordered coarse to fine, moved from raw records
//! to the octree's, counted into the statistics, encoded.

use super::error::StageError;
use super::options::Encoding;
use super::output::{Block, NodeEntry};
use super::survey::Survey;
use crate::cloud::attribute::Schema;
use crate::cloud::cube::Frame;
use crate::cloud::node::NodeKey;
use crate::cloud::record;
use crate::cloud::statistics::Statistics;
use crate::format::potree;
use crate::lod::order::Orderer;
use crate::lod::sampler::Item;
use crate::lod::tree::Emit;

/// Brotli's effort. The reference uses 6; 4 takes about half as long on nodes of
/// some thousand points. The curve of size against time is still to be drawn.
const BROTLI_QUALITY: u32 = 4;

/// Gives octree records (schema layout) for items.
pub trait Records {
    /// Appends the records of `count` item indices to `out`.
    fn gather(&self, indices: impl Iterator<Item = u32>, count: usize, out: &mut Vec<u8>);
}

/// Turns nodes into a block of octree.bin.
pub struct NodeWriter<'a, R: Records> {
    pub records: R,
    schema: &'a Schema,
    encoding: Encoding,
    orderer: Orderer,
    plain: Vec<u8>,
    pub block: Block,
    pub statistics: Statistics,
    pub points: u64,
}

impl<'a, R: Records> NodeWriter<'a, R> {
    pub fn new(survey: &'a Survey, encoding: Encoding, records: R) -> NodeWriter<'a, R> {
        let schema = &survey.unified.schema;
        NodeWriter {
            records,
            schema,
            encoding,
            orderer: Orderer::default(),
            plain: Vec::new(),
            block: Block::default(),
            statistics: Statistics::empty(schema),
            points: 0,
        }
    }

    fn encode(&mut self, node: NodeKey, points: usize) -> Result<(), StageError> {
        let offset = self.block.bytes.len() as u64;
        self.statistics.add(self.schema, &self.plain);
        match self.encoding {
            Encoding::Default => self.block.bytes.extend_from_slice(&self.plain),
            Encoding::Brotli => {
                potree::encode_brotli(self.schema, &self.plain, BROTLI_QUALITY, &mut self.block.bytes)
                    .map_err(|e| StageError::Inconsistent(e.to_string()))?;
            }
        }
        let size = self.block.bytes.len() as u64 - offset;
        let points = u32::try_from(points)
            .map_err(|_| StageError::Inconsistent(format!("node {node} holds {points} points")))?;
        self.block.nodes.push(NodeEntry { node, points, offset, size });
        self.points += u64::from(points);
        Ok(())
    }
}

impl<R: Records> Emit for NodeWriter<'_, R> {
    type Error = StageError;

    fn node(&mut self, node: NodeKey, frame: Frame, items: &[Item]) -> Result<(), StageError> {
        self.plain.clear();
        let order = self.orderer.coarse_to_fine(frame, items);
        self.records.gather(order, items.len(), &mut self.plain);
        self.encode(node, items.len())
    }
}

/// A chunk's raw records, in parts of several runs.
pub struct RawPoints<'a> {
    survey: &'a Survey,
    parts: Vec<RawPart<'a>>,
    /// For every 2^shift-th index, the part that holds it.
    pages: Vec<u32>,
    shift: u32,
}

struct RawPart<'a> {
    first: u32,
    input: usize,
    bytes: &'a [u8],
}

impl<'a> RawPoints<'a> {
    /// Parts in input order: (input, raw records).
    pub fn new(survey: &'a Survey, parts: impl Iterator<Item = (usize, &'a [u8])>) -> RawPoints<'a> {
        let mut listed: Vec<RawPart> = Vec::new();
        let mut points = 0u32;
        for (input, bytes) in parts.filter(|(_, b)| !b.is_empty()) {
            listed.push(RawPart { first: points, input, bytes });
            points += (bytes.len() / survey.inputs[input].source.record_length) as u32;
        }
        // About as many pages as parts and then some: a look-up takes a step
        // or two from its page.
        let shift = (u32::BITS - points.leading_zeros()).saturating_sub(12);
        let pages = (0..=points >> shift)
            .map(|page| listed.partition_point(|p| p.first <= page << shift).saturating_sub(1) as u32)
            .collect();
        RawPoints { survey, parts: listed, pages, shift }
    }

    /// All points as items of the tree, or the first that lies outside it.
    pub fn items(&self, items: &mut Vec<Item>) -> Result<(), StageError> {
        items.clear();
        for part in &self.parts {
            let input = &self.survey.inputs[part.input];
            let mut outside = false;
            items.extend(part.bytes.chunks_exact(input.source.record_length).zip(part.first..).map(
                |(raw, index)| {
                    let at = self.survey.cube.tree(input.requantise.stored(record::raw_position(raw)));
                    outside |= !self.survey.cube.holds(at);
                    Item { at, index }
                },
            ));
            if outside {
                return Err(StageError::changed(&input.las));
            }
        }
        Ok(())
    }

    /// All raw records with the number of their layout, in their order.
    pub fn records(&self) -> impl Iterator<Item = (usize, &'a [u8])> {
        let inputs = &self.survey.inputs;
        self.parts.iter().flat_map(move |part| {
            let input = &inputs[part.input];
            part.bytes.chunks_exact(input.source.record_length).map(move |record| (input.layout, record))
        })
    }

    fn part_of(&self, index: u32) -> &RawPart<'a> {
        let mut part = self.pages[(index >> self.shift) as usize] as usize;
        while self.parts.get(part + 1).is_some_and(|next| next.first <= index) {
            part += 1;
        }
        &self.parts[part]
    }
}

impl Records for RawPoints<'_> {
    fn gather(&self, indices: impl Iterator<Item = u32>, count: usize, out: &mut Vec<u8>) {
        let size = self.survey.unified.schema.record_size();
        let start = out.len();
        out.resize(start + count * size, 0);
        for (record, index) in out[start..].chunks_exact_mut(size).zip(indices) {
            let part = self.part_of(index);
            let input = &self.survey.inputs[part.input];
            let length = input.source.record_length;
            let raw = &part.bytes[(index - part.first) as usize * length..][..length];
            record::put_position(record, input.requantise.stored(record::raw_position(raw)));
            self.survey.unified.mover(part.input).apply(raw, record);
        }
    }
}

/// Records that are in the octree's layout already.
pub struct PlainRecords {
    pub bytes: Vec<u8>,
    /// Bytes a record.
    pub size: usize,
}

impl Records for PlainRecords {
    fn gather(&self, indices: impl Iterator<Item = u32>, _count: usize, out: &mut Vec<u8>) {
        for index in indices {
            out.extend_from_slice(&self.bytes[index as usize * self.size..][..self.size]);
        }
    }
}
