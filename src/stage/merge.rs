//! Merge: the levels above the chunks, sampled from the chunks' roots in the
//! same way and written behind them ("Fast Out-of-Core Octree Generation", 4.3).

use std::collections::{HashMap, HashSet};

use super::context::{Context, Stage};
use super::error::{Result, StageError};
use super::index::{self, Indexed, Rising};
use super::nodes::{NodeWriter, PlainRecords};
use super::options::Options;
use super::output::OctreeFile;
use super::survey::Survey;
use crate::cloud::node::NodeKey;
use crate::cloud::record;
use crate::cloud::statistics::Statistics;
use crate::lod::sampler::{Item, Sampler};
use crate::lod::tree::{Emit, frame, move_taken};

/// Samples and writes everything above the chunks, and the chunks' roots.
/// Returns the statistics and number of all points.
pub fn merge(
    survey: &Survey,
    indexed: Indexed,
    octree: &OctreeFile,
    options: &Options,
    context: &Context,
) -> Result<(Statistics, u64)> {
    let size = survey.unified.schema.record_size();
    let rising_points: usize = indexed.rising.iter().map(|r| r.records.len() / size).sum();
    context.progress.begin(Stage::Merge, rising_points as u64);
    let mut above = HashSet::new();
    for rising in &indexed.rising {
        let mut node = rising.node;
        while let Some(parent) = node.parent() {
            above.insert(parent);
            node = parent;
        }
    }
    let next_block = indexed.rising.len();
    let mut merger = Merger {
        survey,
        options,
        context,
        octree,
        sampler: index::sampler(options.sampling),
        roots: indexed.rising.into_iter().map(|r| (r.node, r)).collect(),
        above,
        next_block,
        statistics: indexed.statistics,
        points: indexed.points,
        taken: Vec::new(),
    };
    let root = merger
        .grow(NodeKey::ROOT)?
        .ok_or_else(|| StageError::Inconsistent("the octree has no root".into()))?;
    merger.write(vec![root])?;
    Ok((merger.statistics, merger.points))
}

struct Merger<'a> {
    survey: &'a Survey,
    options: &'a Options,
    context: &'a Context,
    octree: &'a OctreeFile,
    sampler: Box<dyn Sampler>,
    roots: HashMap<NodeKey, Rising>,
    /// Nodes that have chunks below them.
    above: HashSet<NodeKey>,
    next_block: usize,
    statistics: Statistics,
    points: u64,
    taken: Vec<bool>,
}

/// A node above or at a chunk's root that its parent has not sampled yet.
struct Grown {
    rising: Rising,
    items: Vec<Item>,
}

impl Merger<'_> {
    fn grow(&mut self, node: NodeKey) -> Result<Option<Grown>> {
        if self.context.cancel.is_cancelled() {
            return Err(StageError::Cancelled);
        }
        if let Some(rising) = self.roots.remove(&node) {
            let items = self.items(&rising.records);
            return Ok(Some(Grown { rising, items }));
        }
        if !self.above.contains(&node) {
            return Ok(None);
        }
        let mut children = Vec::with_capacity(8);
        for child in 0..8 {
            children.extend(self.grow(node.child(child))?);
        }
        self.sample(node, children).map(Some)
    }

    fn items(&self, records: &[u8]) -> Vec<Item> {
        let size = self.survey.unified.schema.record_size();
        let tree = |r: &[u8]| self.survey.cube.tree(record::raw_position(r));
        records.chunks_exact(size).zip(0..).map(|(r, index)| Item { at: tree(r), index }).collect()
    }

    fn sample(&mut self, node: NodeKey, mut children: Vec<Grown>) -> Result<Grown> {
        let candidates: Vec<&[Item]> = children.iter().map(|c| c.items.as_slice()).collect();
        let frame = frame(self.survey.cube.bits, node);
        self.sampler.sample(node, frame, &candidates, &mut self.taken);
        let size = self.survey.unified.schema.record_size();
        let mut records = Vec::new();
        let mut flags = self.taken.iter();
        let mut accepted = Vec::new();
        for child in &mut children {
            accepted.clear();
            let kept = move_taken(&mut child.items, &mut flags, &mut accepted);
            child.items.truncate(kept);
            for item in &accepted {
                records.extend_from_slice(&child.rising.records[item.index as usize * size..][..size]);
            }
        }
        children.retain(|c| !c.items.is_empty() || c.rising.has_children);
        let has_children = !children.is_empty();
        self.write(children)?;
        let items = self.items(&records);
        Ok(Grown { rising: Rising { node, records, has_children }, items })
    }

    /// Writes nodes that are final.
    fn write(&mut self, nodes: Vec<Grown>) -> Result<()> {
        let size = self.survey.unified.schema.record_size();
        for grown in nodes {
            let records = PlainRecords { bytes: &grown.rising.records, size };
            let mut writer = NodeWriter::new(self.survey, self.options.encoding, records);
            let node = grown.rising.node;
            writer.node(node, frame(self.survey.cube.bits, node), &grown.items)?;
            self.statistics.merge(&writer.statistics);
            self.points += writer.points;
            self.context.progress.advance(writer.points);
            self.octree.submit(self.next_block, writer.block)?;
            self.next_block += 1;
        }
        Ok(())
    }
}
