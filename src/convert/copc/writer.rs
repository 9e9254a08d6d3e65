//! Chunks of a COPC file from the nodes of the octree: the coarse ones as they are,
//! small subtrees joined to one leaf, each in the order in which it compresses best.

use super::super::error::{Result, StageError};
use super::super::values::block::{NodeBlock, NodeEntry};
use super::super::values::copc_plan::CopcPlan;
use super::super::values::counted_inputs::Survey;
use crate::format::copc::ChunkEncoder;
use crate::octree::acquisition::Sorter;
use crate::octree::collapse::{Below, Collapse, Final};
use crate::octree::moments::Moments;
use crate::octree::node::NodeKey;
use crate::octree::record;
use crate::octree::sampling::sampler::IndexedPoint;

/// Points of a chunk at most: a file's entries count in 32 bits with a sign.
const MAX_CHUNK: usize = i32::MAX as usize;

/// Writes nodes as chunks, one behind the other into a block.
pub struct CopcWriter<'a> {
    survey: &'a Survey,
    plan: &'a CopcPlan,
    /// Once there is something to encode.
    encoder: Option<ChunkEncoder>,
    collapse: Collapse,
    block: NodeBlock,
    /// Of all points that were written.
    moments: Moments,
    // Buffers.
    sorter: Sorter,
    ordered: Vec<u8>,
    las: Vec<u8>,
    chunk: Vec<u8>,
}

impl<'a> CopcWriter<'a> {
    /// Nothing where no COPC file is written.
    pub fn new(survey: &'a Survey) -> Option<CopcWriter<'a>> {
        let plan = survey.copc.as_ref()?;
        Some(CopcWriter {
            survey,
            plan,
            encoder: None,
            collapse: Collapse::default(),
            block: NodeBlock::default(),
            moments: Moments::empty(&survey.unified.schema),
            sorter: Sorter::default(),
            ordered: Vec::new(),
            las: Vec::new(),
            chunk: Vec::new(),
        })
    }

    /// Begins another block, in memory that may have served before.
    pub fn with_block(mut self, block: NodeBlock) -> CopcWriter<'a> {
        self.block = block;
        self
    }

    /// The block, and the moments of its points; both begin anew.
    pub fn take(&mut self) -> (NodeBlock, Moments) {
        let moments = Moments::empty(&self.survey.unified.schema);
        (std::mem::take(&mut self.block), std::mem::replace(&mut self.moments, moments))
    }

    /// A node of a chunk that is final, after its children; `items` number `records`.
    pub fn node(&mut self, records: &[u8], node: NodeKey, items: &[IndexedPoint]) -> Result<()> {
        let finals = self.collapse.add(node, items.iter().map(|item| item.index));
        finals.into_iter().try_for_each(|node| self.put(records, node))
    }

    /// The root of a chunk, with so many points that the nodes above may yet take some
    /// of. Gives the records of all nodes below where these are to join it, in the
    /// order of the input.
    pub fn end(&mut self, records: &[u8], root: NodeKey, points: usize) -> Result<Option<Vec<u8>>> {
        match self.collapse.end(root, points) {
            Below::Stays(finals) => {
                finals.into_iter().try_for_each(|node| self.put(records, node))?;
                Ok(None)
            }
            Below::Joins(indices) if indices.is_empty() => Ok(None),
            Below::Joins(mut indices) => {
                indices.sort_unstable();
                let mut below = Vec::new();
                gather(records, self.survey.unified.schema.record_size(), &indices, &mut below);
                Ok(Some(below))
            }
        }
    }

    /// A node of which `items` are left in `records`, and what joins it from below.
    pub fn whole_node(
        &mut self,
        records: &[u8],
        node: NodeKey,
        items: &[IndexedPoint],
        below: Option<Vec<u8>>,
    ) -> Result<()> {
        let indices: Vec<u32> = items.iter().map(|item| item.index).collect();
        let Some(below) = below else { return self.put(records, Final { node, indices }) };
        let size = self.survey.unified.schema.record_size();
        let mut all = Vec::with_capacity(indices.len() * size + below.len());
        gather(records, size, &indices, &mut all);
        all.extend_from_slice(&below);
        let indices = (0..(all.len() / size) as u32).collect();
        self.put(&all, Final { node, indices })
    }

    fn put(&mut self, records: &[u8], Final { node, mut indices }: Final) -> Result<()> {
        let offset = self.block.bytes.len() as u64;
        if indices.is_empty() {
            self.block.nodes.push(NodeEntry { node, points: 0, offset: 0, size: 0 });
            return Ok(());
        }
        let schema = &self.survey.unified.schema;
        let size = schema.record_size();
        let record = |index: u32| &records[index as usize * size..][..size];
        let time = |index: u32| match self.plan.time_at {
            Some(at) => record(index)[at..].first_chunk().map_or(0.0, |bytes| f64::from_le_bytes(*bytes)),
            None => 0.0,
        };
        let at = |index: u32| self.survey.cube.tree(record::raw_position(record(index)));
        self.sorter.sort(&mut indices, time, at);
        self.ordered.clear();
        gather(records, size, &indices, &mut self.ordered);
        self.moments.add(schema, &self.ordered);
        self.las.clear();
        self.plan.layout.promote(&self.ordered, &mut self.las);
        self.chunk.clear();
        let points = indices.len();
        let too_large = || StageError::CopcNode { node: node.to_string(), points: points as u64 };
        if points > MAX_CHUNK {
            return Err(too_large());
        }
        let encoder = match &mut self.encoder {
            Some(encoder) => encoder,
            None => self.encoder.insert(ChunkEncoder::new(&self.plan.layout)?),
        };
        encoder.encode(&self.las, &mut self.chunk).map_err(|_| too_large())?;
        let bytes = self.chunk.len();
        self.block.bytes.room(bytes).copy_from_slice(&self.chunk);
        self.block.nodes.push(NodeEntry { node, points: points as u32, offset, size: bytes as u64 });
        Ok(())
    }
}

/// Appends the records of these numbers to `out`.
fn gather(records: &[u8], size: usize, indices: &[u32], out: &mut Vec<u8>) {
    let start = out.len();
    out.resize(start + indices.len() * size, 0);
    for (index, to) in indices.iter().zip(out[start..].chunks_exact_mut(size)) {
        record::copy_record(&records[*index as usize * size..][..size], to);
    }
}
