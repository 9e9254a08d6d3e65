//! Merge: the levels above the chunks, sampled from the chunks' roots in the
//! same way and written behind them ("Fast Out-of-Core Octree Generation", 4.3).
//!
//! The subtrees below the nodes of one fixed level are merged side by side, then
//! what is above them; the cut is fixed, so that the threads decide nothing.

use std::collections::{HashMap, HashSet};
use std::sync::Mutex;

use super::context::{Context, Stage};
use super::error::{Result, StageError};
use super::index::{self, Indexed, Rising};
use super::nodes::{NodeWriter, PlainRecords};
use super::options::Options;
use super::output::OctreeFile;
use super::survey::Survey;
use super::workers;
use crate::cloud::cube::Frame;
use crate::cloud::node::NodeKey;
use crate::cloud::record;
use crate::cloud::statistics::Statistics;
use crate::lod::sampler::{Item, Sampler};
use crate::lod::tree::{Emit, move_taken};

/// Level whose nodes' subtrees are merged side by side: up to 64, of which a
/// flat country fills 16.
const CUT: u8 = 2;

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
    let above = ancestors(&indexed.rising);
    let mut next_block = indexed.rising.len();
    let (mut statistics, mut points) = (indexed.statistics, indexed.points);

    let (subtrees, mut top) = cut(indexed.rising);
    let merged: Vec<Mutex<Option<Merged>>> = subtrees.iter().map(|_| Mutex::new(None)).collect();
    workers::in_order(
        context.threads,
        subtrees.len(),
        &context.cancel,
        || (),
        |(), i| {
            let (node, roots) = &subtrees[i];
            let roots = std::mem::take(&mut *roots.lock().unwrap_or_else(|e| e.into_inner()));
            let mut merger = Merger::new(survey, options, context, &above, roots);
            let merge =
                merger.grow(*node).and_then(|root| Ok((root, merger.finish(octree, next_block + i)?)));
            let (root, counted) = merge.inspect_err(|_| octree.fail())?;
            let merged_subtree = root.map(|root| Merged { root: root.rising, counted });
            *merged[i].lock().unwrap_or_else(|e| e.into_inner()) = merged_subtree;
            Ok(())
        },
    )?;
    next_block += subtrees.len();
    for subtree in merged.into_iter().filter_map(|m| m.into_inner().unwrap_or_else(|e| e.into_inner())) {
        statistics.merge(&subtree.counted.0);
        points += subtree.counted.1;
        top.insert(subtree.root.node, subtree.root);
    }

    let mut merger = Merger::new(survey, options, context, &above, top);
    let root = merger.grow(NodeKey::ROOT)?;
    let root = root.ok_or_else(|| StageError::Inconsistent("the octree has no root".into()))?;
    merger.write(vec![root])?;
    let counted = merger.finish(octree, next_block)?;
    statistics.merge(&counted.0);
    Ok((statistics, points + counted.1))
}

/// Nodes that have chunks below them.
fn ancestors(rising: &[Rising]) -> HashSet<NodeKey> {
    let mut above = HashSet::new();
    for rising in rising {
        let mut node = rising.node;
        while let Some(parent) = node.parent()
            && above.insert(parent)
        {
            node = parent;
        }
    }
    above
}

type Roots = HashMap<NodeKey, Rising>;

/// Chunks below the cut by the subtree they are in, in the order of the plan,
/// and those at or above it.
fn cut(rising: Vec<Rising>) -> (Vec<(NodeKey, Mutex<Roots>)>, Roots) {
    let mut subtrees: Vec<(NodeKey, Roots)> = Vec::new();
    let mut top = HashMap::new();
    for rising in rising {
        let Some(up) = rising.node.level.checked_sub(CUT).filter(|up| *up > 0) else {
            top.insert(rising.node, rising);
            continue;
        };
        let node = NodeKey { level: CUT, at: rising.node.at.map(|c| c >> up) };
        if subtrees.last().is_none_or(|(last, _)| *last != node) {
            subtrees.push((node, HashMap::new()));
        }
        if let Some((_, roots)) = subtrees.last_mut() {
            roots.insert(rising.node, rising);
        }
    }
    (subtrees.into_iter().map(|(node, roots)| (node, Mutex::new(roots))).collect(), top)
}

/// A merged subtree: its root, and what was counted in the nodes written.
struct Merged {
    root: Rising,
    counted: (Statistics, u64),
}

struct Merger<'a> {
    survey: &'a Survey,
    context: &'a Context,
    above: &'a HashSet<NodeKey>,
    sampler: Box<dyn Sampler>,
    roots: Roots,
    writer: NodeWriter<'a, PlainRecords>,
    taken: Vec<bool>,
}

/// A node above or at a chunk's root that its parent has not sampled yet.
struct Grown {
    rising: Rising,
    items: Vec<Item>,
}

impl<'a> Merger<'a> {
    fn new(
        survey: &'a Survey,
        options: &Options,
        context: &'a Context,
        above: &'a HashSet<NodeKey>,
        roots: Roots,
    ) -> Merger<'a> {
        let size = survey.unified.schema.record_size();
        let records = PlainRecords { bytes: Vec::new(), size };
        Merger {
            survey,
            context,
            above,
            sampler: index::sampler(survey, options.sampling),
            roots,
            writer: NodeWriter::new(survey, options.encoding, records),
            taken: Vec::new(),
        }
    }

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
        let frame = Frame::of(self.survey.cube.bits, node);
        self.sampler.sample(node, frame, &candidates, &mut self.taken);
        let size = self.survey.unified.schema.record_size();
        let mut records = Vec::new();
        let mut items = Vec::new();
        let mut flags = self.taken.iter();
        for child in &mut children {
            let first = items.len();
            let kept = move_taken(&mut child.items, &mut flags, &mut items);
            child.items.truncate(kept);
            for (item, index) in items[first..].iter_mut().zip(first as u32..) {
                records.extend_from_slice(&child.rising.records[item.index as usize * size..][..size]);
                item.index = index;
            }
        }
        children.retain(|c| !c.items.is_empty() || c.rising.has_children);
        let has_children = !children.is_empty();
        self.write(children)?;
        Ok(Grown { rising: Rising { node, records, has_children }, items })
    }

    /// Writes nodes that are final.
    fn write(&mut self, nodes: Vec<Grown>) -> Result<()> {
        for grown in nodes {
            let node = grown.rising.node;
            self.writer.records.bytes = grown.rising.records;
            self.writer.node(node, Frame::of(self.survey.cube.bits, node), &grown.items)?;
            self.context.progress.advance(grown.items.len() as u64);
        }
        Ok(())
    }

    /// Hands in what was written, as the block of a number.
    fn finish(self, octree: &OctreeFile, block: usize) -> Result<(Statistics, u64)> {
        octree.submit(block, self.writer.block)?;
        Ok((self.writer.statistics, self.writer.points))
    }
}
