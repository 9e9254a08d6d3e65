//! Raw records become the octree's, once, in the order in which they lie; finished
//! nodes become bytes: records picked coarse to fine, and encoded; and beside them,
//! or instead, the chunks of a COPC file.

use super::color_averages::Averages;
use super::copc::CopcWriter;
use super::error::StageError;
use super::options::{Encoding, Options};
use super::values::block::{Each, NodeBlock, NodeEntry};
use super::values::counted_inputs::Survey;
use crate::format::potree;
use crate::octree::attribute::Schema;
use crate::octree::cube::NodeCube;
use crate::octree::local_octree::NodeSink;
use crate::octree::moments::Moments;
use crate::octree::node::NodeKey;
use crate::octree::node_order;
use crate::octree::record;
use crate::octree::sampling::sampler::IndexedPoint;
use crate::octree::statistics::Statistics;

/// Brotli's effort, by its curve on nodes of terrain (processor time as a
/// multiple of quality 4's, bytes a point): 1 0.6, 12.2 · **2** 0.5, 10.28 ·
/// 3 0.6, 10.23 · 4 1, 10.00 · 5 8, 9.77 · 9 12, 9.74. Other windows and blocks
/// change neither by more than the noise.
const BROTLI_QUALITY: u32 = 2;

/// Turns nodes into blocks of the files of points.
pub struct NodeWriter<'a> {
    /// What items are numbers of: records in the octree's layout.
    pub records: Vec<u8>,
    schema: &'a Schema,
    /// Of octree.bin, where that is written.
    encoding: Option<Encoding>,
    /// Where coarse levels have averaged colours.
    pub averages: Option<Averages>,
    /// Buffers.
    order: Vec<u32>,
    plain: Vec<u8>,
    pub block: NodeBlock,
    pub points: u64,
    /// Where a COPC file is written.
    pub copc: Option<CopcWriter<'a>>,
}

impl<'a> NodeWriter<'a> {
    pub fn new(survey: &'a Survey, options: &Options) -> NodeWriter<'a> {
        NodeWriter {
            records: Vec::new(),
            schema: &survey.unified.schema,
            encoding: options.format.potree.then_some(options.encoding),
            averages: Averages::of(&survey.unified.schema),
            order: Vec::new(),
            plain: Vec::new(),
            block: NodeBlock::default(),
            points: 0,
            copc: None,
        }
    }

    /// Makes room for so many records in octree.bin, where they are stored as they are.
    pub fn reserve(&mut self, records: usize) {
        if self.encoding == Some(Encoding::Default) {
            self.block.bytes.reserve(records * self.schema.record_size());
        }
    }

    /// What came of it: records, blocks, and of the points in the nodes of the COPC
    /// file their moments.
    pub fn finish(self) -> Written<'a> {
        let NodeWriter { records, block, points, averages, mut copc, .. } = self;
        let (copc_block, moments) = copc.as_mut().map(CopcWriter::take).unwrap_or_default();
        Written { records, blocks: [block, copc_block], points, averages, moments, copc }
    }

    /// Puts a node that is final into octree.bin.
    pub fn octree_node(&mut self, node: NodeKey, items: &[IndexedPoint]) -> Result<(), StageError> {
        if let Some(averages) = &mut self.averages {
            averages.written(&self.records, items);
        }
        let points = u32::try_from(items.len())
            .map_err(|_| StageError::Inconsistent(format!("node {node} holds {} points", items.len())))?;
        self.points += u64::from(points);
        let offset = self.block.bytes.len() as u64;
        match self.encoding {
            None => return Ok(()),
            Some(Encoding::Default) => self.put_plain(items),
            Some(Encoding::Brotli) => self.put_brotli(items)?,
        }
        let size = self.block.bytes.len() as u64 - offset;
        self.block.nodes.push(NodeEntry { node, points, offset, size });
        Ok(())
    }

    /// The records of items, in an order of their ranks, into `out`.
    pub fn gather(&mut self, items: &[IndexedPoint], order: impl Iterator<Item = usize>, out: &mut [u8]) {
        let size = self.schema.record_size();
        // Numbers first: then the copies wait for nothing but themselves, and
        // many of them are on their way at once.
        self.order.clear();
        self.order.extend(order.map(|rank| items[rank].index));
        for (to, index) in out.chunks_exact_mut(size).zip(&self.order) {
            let from = *index as usize * size;
            record::copy_record(&self.records[from..from + size], to);
        }
    }

    /// Puts a node's records behind those before, as they are.
    fn put_plain(&mut self, items: &[IndexedPoint]) {
        let mut block = std::mem::take(&mut self.block.bytes);
        let room = block.room(items.len() * self.schema.record_size());
        self.gather(items, node_order::coarse_to_fine(items.len()), room);
        self.block.bytes = block;
    }

    fn put_brotli(&mut self, items: &[IndexedPoint]) -> Result<(), StageError> {
        let mut plain = std::mem::take(&mut self.plain);
        plain.resize(items.len() * self.schema.record_size(), 0);
        self.gather(items, node_order::coarse_to_fine(items.len()), &mut plain);
        self.plain = plain;
        let mut stream = Vec::new();
        potree::encode_brotli(self.schema, &self.plain, BROTLI_QUALITY, &mut stream)
            .map_err(|e| StageError::Inconsistent(e.to_string()))?;
        self.block.bytes.room(stream.len()).copy_from_slice(&stream);
        Ok(())
    }
}

impl NodeSink for NodeWriter<'_> {
    type Error = StageError;

    fn sampled(&mut self, frame: NodeCube, has_below: bool, candidates: &[&[IndexedPoint]], taken: &[bool]) {
        let Some(Averages { averager, field, .. }) = &mut self.averages else { return };
        let records = &mut self.records;
        let colour = |_: usize, index: u32| field.get(records, index);
        for mean in averager.means(frame, has_below, candidates, taken, colour) {
            field.put(records, mean.index, mean.colour);
        }
    }

    fn node(&mut self, node: NodeKey, _: NodeCube, items: &[IndexedPoint]) -> Result<(), StageError> {
        self.octree_node(node, items)?;
        match &mut self.copc {
            None => Ok(()),
            Some(copc) => copc.node(&self.records, node, items),
        }
    }
}

/// What a [`NodeWriter`] wrote.
pub struct Written<'a> {
    pub records: Vec<u8>,
    pub blocks: Each<NodeBlock>,
    pub points: u64,
    pub averages: Option<Averages>,
    pub moments: Moments,
    pub copc: Option<CopcWriter<'a>>,
}

/// A chunk's raw records, in parts of several runs, in the order of the input.
pub struct RawPoints<'a> {
    survey: &'a Survey,
    /// The input, and its records.
    parts: Vec<(usize, &'a [u8])>,
}

/// Records that are moved together: few enough to stay in the core's first cache.
const BLOCK: usize = 512;
/// And counted together: few enough for its second.
const COUNTED: usize = 8 * BLOCK;

impl<'a> RawPoints<'a> {
    pub fn new(survey: &'a Survey, parts: impl Iterator<Item = (usize, &'a [u8])>) -> RawPoints<'a> {
        RawPoints { survey, parts: parts.filter(|(_, bytes)| !bytes.is_empty()).collect() }
    }

    /// All points: as items of the tree, and as records in the octree's layout;
    /// and their statistics, made while the records are at hand. Fails if a point
    /// lies outside the cube.
    pub fn unpack(
        &self,
        items: &mut Vec<IndexedPoint>,
        records: &mut Vec<u8>,
    ) -> Result<Statistics, StageError> {
        let Survey { inputs, cube, unified, .. } = self.survey;
        let size = unified.schema.record_size();
        let points = |(input, bytes): &(usize, &[u8])| bytes.len() / inputs[*input].source.record_length;
        let all = self.parts.iter().map(points).sum::<usize>();
        items.clear();
        items.reserve(all);
        records.resize(all * size, 0);
        let mut statistics = Statistics::empty(&unified.schema);
        let mut rest = records.as_mut_slice();
        for (number, bytes) in &self.parts {
            let input = &inputs[*number];
            let length = input.source.record_length;
            let mut outside = false;
            for counted in bytes.chunks(COUNTED * length) {
                let (into, behind) = rest.split_at_mut(counted.len() / length * size);
                rest = behind;
                for (block, into) in counted.chunks(BLOCK * length).zip(into.chunks_mut(BLOCK * size)) {
                    let first = items.len() as u32;
                    let points = block.chunks_exact(length).zip(into.chunks_exact_mut(size)).zip(first..);
                    items.extend(points.map(|((raw, record), index)| {
                        let stored = input.requantise.stored(record::raw_position(raw));
                        record::put_position(record, stored);
                        let at = cube.tree(stored);
                        outside |= !cube.holds(at);
                        IndexedPoint { at, index }
                    }));
                    unified.mover(*number).apply(block, length, into);
                }
                statistics.add(&unified.schema, into);
            }
            if outside {
                return Err(StageError::changed(&input.las));
            }
        }
        Ok(statistics)
    }

    /// All raw records with the number of their layout, in their order.
    pub fn records(&self) -> impl Iterator<Item = (usize, &'a [u8])> {
        let inputs = &self.survey.inputs;
        self.parts.iter().flat_map(move |(number, bytes)| {
            let input = &inputs[*number];
            bytes.chunks_exact(input.source.record_length).map(move |record| (input.layout, record))
        })
    }
}
