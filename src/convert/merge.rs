//! Merge: the levels above the chunks, sampled from the chunks' roots in the
//! same way and written behind them ("Fast Out-of-Core Octree Generation", 4.3).
//!
//! The subtrees below a cut are merged side by side, then what is above them. The
//! cut follows from the chunks alone, so that the threads decide nothing, and leaves
//! few chunks to each subtree, whose finished nodes wait in memory until it is done.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex};

use super::borders::{self, StoredBorder, UnitBorder};
use super::checkpoint::scratch::Scratch;
use super::color_averages::Averages;
use super::context::{Context, Stage};
use super::copc::CopcWriter;
use super::error::{Result, StageError};
use super::node_writer::{NodeWriter, Written};
use super::octree_writer::OutputFiles;
use super::options::Options;
use super::pending_root::{self, FinishedUnit, Indexed, PendingRoot, RootRecords};
use super::values::counted_inputs::Survey;
use super::workers;
use crate::octree::cube::NodeCube;
use crate::octree::local_octree::{is_hollow, move_taken};
use crate::octree::moments::Moments;
use crate::octree::node::{LEAF_LIMIT, NodeKey};
use crate::octree::node_limit::{NODE_LIMIT, thin};
use crate::octree::record;
use crate::octree::sampling::sampler::{IndexedPoint, Sampler};
use crate::octree::statistics::Statistics;

/// Highest level of the cut: it has up to 64 nodes, of which a flat country fills 16.
const CUT: u8 = 2;

/// Chunks below a node of the cut. A chunk's root holds about 8000 points that no
/// level above took, so this is some 20 MB of nodes.
const MOST_CHUNKS: usize = 64;

/// What there is to say of the nodes.
pub struct Merged {
    /// In all nodes, those of the chunks too.
    pub points: u64,
    /// Of what the merge wrote, as far as the chunks could not know it: the range
    /// of averaged colours.
    pub statistics: Statistics,
    /// Of all points in the COPC file.
    pub moments: Moments,
}

/// Samples and writes everything above the chunks, and the chunks' roots.
pub fn merge(
    survey: &Survey,
    indexed: Indexed,
    files: &OutputFiles,
    scratch: Option<&Arc<Scratch>>,
    options: &Options,
    context: &Context,
) -> Result<Merged> {
    let scratch = scratch.map(|scratch| &**scratch);
    let rising_points: u64 = indexed.pending.iter().map(|r| r.points(survey)).sum();
    context.progress.begin(Stage::Merge, rising_points);
    let above = ancestors(&indexed.pending);
    let mut next_block = indexed.pending.len();
    let mut points = indexed.points;
    let mut statistics = Statistics::empty(&survey.unified.schema);
    let mut moments = indexed.moments;

    let (subtrees, mut top) = cut(indexed.pending);
    let mut halos = indexed.halos;
    halos.add(subtrees.iter().map(|(node, _)| *node).chain([NodeKey::ROOT]));
    let merged: Vec<SubtreeSlot> = subtrees.iter().map(|_| Mutex::new(None)).collect();
    workers::in_order(
        context.threads,
        subtrees.len(),
        &context.cancel,
        || (),
        |(), i| {
            let number = next_block + i;
            let (node, roots) = &subtrees[i];
            let turn = halos.turn(number);
            let roots = std::mem::take(&mut *roots.lock().unwrap_or_else(|e| e.into_inner()));
            let before = scratch.and_then(|scratch| scratch.past.built.get(&(number as u32)));
            let subtree = match before {
                Some(built) => {
                    context.progress.advance(roots.values().map(|r| r.points(survey)).sum());
                    pending_root::resubmit(files, number, built)
                }
                None => {
                    let merger = Merger::new(survey, options, context, &above, roots, scratch);
                    merger.subtree(*node, files, &turn, number)
                }
            };
            let FinishedUnit { root, points, statistics, moments, halo, .. } =
                subtree.inspect_err(|_| files.fail())?;
            turn.done(halo);
            *merged[i].lock().unwrap_or_else(|e| e.into_inner()) = Some((root, points, statistics, moments));
            Ok(())
        },
    )?;
    next_block += subtrees.len();
    for subtree in merged.into_iter().filter_map(|m| m.into_inner().unwrap_or_else(|e| e.into_inner())) {
        let (root, more, range, of_points) = subtree;
        points += more;
        statistics.merge(&range);
        moments.merge(&of_points);
        top.insert(root.node, root);
    }

    let turn = halos.turn(next_block);
    let mut merger = Merger::new(survey, options, context, &above, top, scratch);
    merger.begin(&turn)?;
    let root = merger.grow(NodeKey::ROOT)?;
    let root = root.ok_or_else(|| StageError::Inconsistent("the octree has no root".into()))?;
    merger.write(vec![root])?;
    let Written { blocks, points: more, averages, moments: of_points, .. } = merger.writer.finish();
    moments.merge(&of_points);
    files.submit(next_block, blocks, None)?;
    turn.done(StoredBorder::Memory(Vec::new()));
    if let Some(averages) = averages {
        let mut range = Statistics::empty(&survey.unified.schema);
        averages.tell(&mut range);
        statistics.merge(&range);
    }
    Ok(Merged { points: points + more, statistics, moments })
}

/// Nodes that have chunks below them.
fn ancestors(pending: &[PendingRoot]) -> HashSet<NodeKey> {
    let mut above = HashSet::new();
    for pending in pending {
        let mut node = pending.node;
        while let Some(parent) = node.parent()
            && above.insert(parent)
        {
            node = parent;
        }
    }
    above
}

type Roots = HashMap<NodeKey, PendingRoot>;

/// A subtree's topmost node once it is there, the points below it, their statistics,
/// and the moments of those that were written.
type SubtreeSlot = Mutex<Option<(PendingRoot, u64, Statistics, Moments)>>;

/// Chunks below the cut by the subtree they are in, in the order in which the
/// subtrees take their turns, and those at or above it.
fn cut(pending: Vec<PendingRoot>) -> (Vec<(NodeKey, Mutex<Roots>)>, Roots) {
    let roots = cut_nodes(&pending.iter().map(|pending| pending.node).collect::<Vec<_>>());
    let mut subtrees: HashMap<NodeKey, Roots> = HashMap::new();
    let mut top = HashMap::new();
    for (pending, root) in pending.into_iter().zip(&roots) {
        let into = match root {
            Some(root) => subtrees.entry(*root).or_default(),
            None => &mut top,
        };
        into.insert(pending.node, pending);
    }
    let mut nodes: Vec<NodeKey> = roots.into_iter().flatten().collect();
    nodes.dedup();
    let in_turn = borders::order(&nodes).into_iter().map(|number| nodes[number]);
    (in_turn.filter_map(|node| Some((node, Mutex::new(subtrees.remove(&node)?)))).collect(), top)
}

/// For each chunk the node of the cut above it: the topmost, from the level of the
/// cut down, that has few enough chunks below it.
fn cut_nodes(chunks: &[NodeKey]) -> Vec<Option<NodeKey>> {
    let above = |chunk: NodeKey| (CUT..chunk.level).map(move |level| chunk.ancestor(level));
    let mut below: HashMap<NodeKey, usize> = HashMap::new();
    for node in chunks.iter().flat_map(|chunk| above(*chunk)) {
        *below.entry(node).or_default() += 1;
    }
    let is_small = |node: &NodeKey| below.get(node).is_some_and(|chunks| *chunks <= MOST_CHUNKS);
    chunks.iter().map(|chunk| above(*chunk).find(is_small)).collect()
}

struct Merger<'a> {
    survey: &'a Survey,
    context: &'a Context,
    above: &'a HashSet<NodeKey>,
    sampler: Box<dyn Sampler>,
    roots: Roots,
    scratch: Option<&'a Scratch>,
    writer: NodeWriter<'a>,
    taken: Vec<bool>,
}

/// A node above or at a chunk's root that its parent has not sampled yet.
struct UnsampledCoarseNode {
    node: NodeKey,
    has_children: bool,
    crowded: bool,
    records: Vec<u8>,
    items: Vec<IndexedPoint>,
    /// The records of all nodes below, where these join it in the COPC file.
    below: Option<RootRecords>,
}

impl<'a> Merger<'a> {
    fn new(
        survey: &'a Survey,
        options: &Options,
        context: &'a Context,
        above: &'a HashSet<NodeKey>,
        roots: Roots,
        scratch: Option<&'a Scratch>,
    ) -> Merger<'a> {
        let mut writer = NodeWriter::new(survey, options);
        // At once: memory that grows is there twice while it moves.
        let points: u64 = roots.values().map(|root| root.points(survey)).sum();
        writer.reserve(points as usize);
        writer.copc = CopcWriter::new(survey);
        Merger {
            survey,
            context,
            above,
            sampler: options.sampling.sampler(survey.cube.slack()),
            roots,
            scratch,
            writer,
            taken: Vec::new(),
        }
    }

    /// Learns of the samples around, of the levels that are sampled here: those
    /// above the deepest root.
    fn begin(&mut self, turn: &UnitBorder) -> Result<()> {
        let deepest = self.roots.keys().map(|node| node.level).max().unwrap_or(0);
        self.sampler.begin(turn.around(deepest.saturating_sub(1), &self.context.cancel)?);
        Ok(())
    }

    /// Merges all below a node, and hands it in.
    fn subtree(
        mut self,
        node: NodeKey,
        files: &OutputFiles,
        turn: &UnitBorder,
        number: usize,
    ) -> Result<FinishedUnit> {
        self.begin(turn)?;
        let root = self.grow(node)?;
        let halo = StoredBorder::Memory(self.sampler.end(node, NodeCube::of(self.survey.cube.bits, node)));
        let UnsampledCoarseNode { node, has_children, crowded, records, below, .. } =
            root.ok_or_else(|| StageError::Inconsistent(format!("nothing lies below {node}")))?;
        let Written { blocks, points, averages, moments, .. } = self.writer.finish();
        let mut statistics = Statistics::empty(&self.survey.unified.schema);
        averages.iter().for_each(|averages| averages.tell(&mut statistics));
        let root = PendingRoot { node, has_children, crowded, records: RootRecords::Memory(records), below };
        let done = FinishedUnit { root, statistics, moments, points, aside: Vec::new(), halo };
        pending_root::hand_in(files, number, blocks, done, self.scratch)
    }

    fn grow(&mut self, node: NodeKey) -> Result<Option<UnsampledCoarseNode>> {
        if self.context.cancel.is_cancelled() {
            return Err(StageError::Cancelled);
        }
        if let Some(PendingRoot { has_children, crowded, records, below, .. }) = self.roots.remove(&node) {
            let records = records.fetch(self.scratch)?;
            let items = self.items(&records);
            return Ok(Some(UnsampledCoarseNode { node, has_children, crowded, records, items, below }));
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

    fn items(&self, records: &[u8]) -> Vec<IndexedPoint> {
        let size = self.survey.unified.schema.record_size();
        let tree = |r: &[u8]| self.survey.cube.tree(record::raw_position(r));
        records.chunks_exact(size).zip(0..).map(|(r, index)| IndexedPoint { at: tree(r), index }).collect()
    }

    fn sample(
        &mut self,
        node: NodeKey,
        mut children: Vec<UnsampledCoarseNode>,
    ) -> Result<UnsampledCoarseNode> {
        let leaves = children.iter().map(|c| (c.items.len(), c.has_children, c.crowded));
        if is_hollow(LEAF_LIMIT, leaves) {
            let records = children.into_iter().flat_map(|c| c.records).collect::<Vec<u8>>();
            let items = self.items(&records);
            return Ok(UnsampledCoarseNode {
                node,
                has_children: false,
                crowded: true,
                records,
                items,
                below: None,
            });
        }
        let has_below = children.iter().any(|c| c.has_children);
        let candidates: Vec<&[IndexedPoint]> = children.iter().map(|c| c.items.as_slice()).collect();
        let frame = NodeCube::of(self.survey.cube.bits, node);
        self.sampler.sample(node, frame, &candidates, &mut self.taken);
        thin(NODE_LIMIT, &mut self.taken);
        if let Some(Averages { averager, field, .. }) = &mut self.writer.averages {
            let colour = |set: usize, index: u32| field.get(&children[set].records, index);
            let means = averager.means(frame, has_below, &candidates, &self.taken, colour);
            for mean in means {
                field.put(&mut children[usize::from(mean.set)].records, mean.index, mean.colour);
            }
        }
        let size = self.survey.unified.schema.record_size();
        let mut records = Vec::new();
        let mut items = Vec::new();
        let mut rest = self.taken.as_slice();
        for child in &mut children {
            let first = items.len();
            let (taken, behind) = rest.split_at(child.items.len());
            let kept = move_taken(&mut child.items, taken, &mut items);
            rest = behind;
            child.items.truncate(kept);
            for (item, index) in items[first..].iter_mut().zip(first as u32..) {
                records.extend_from_slice(&child.records[item.index as usize * size..][..size]);
                item.index = index;
            }
        }
        children.retain(|c| !c.items.is_empty() || c.has_children);
        let has_children = !children.is_empty();
        self.write(children)?;
        Ok(UnsampledCoarseNode { node, has_children, crowded: false, records, items, below: None })
    }

    /// Writes nodes that are final.
    fn write(&mut self, nodes: Vec<UnsampledCoarseNode>) -> Result<()> {
        for grown in nodes {
            let UnsampledCoarseNode { node, records, items, below, .. } = grown;
            self.writer.records = records;
            self.writer.octree_node(node, &items)?;
            if let Some(copc) = &mut self.writer.copc {
                let below = below.map(|below| below.fetch(self.scratch)).transpose()?;
                copc.whole_node(&self.writer.records, node, &items, below)?;
            }
            self.context.progress.advance(items.len() as u64);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Chunks that no other lies in, of any depth: each is in one subtree of few,
        /// which no other subtree lies in, or a child of a node with too many.
        #[test]
        fn the_cut_leaves_few_chunks_to_a_subtree(
            paths in proptest::collection::vec(proptest::collection::vec(0u8..8, 1..5), 1..400),
            dense in proptest::collection::vec(0u8..8, 0..6),
        ) {
            let mut chunks: Vec<NodeKey> = paths.iter().map(|path| {
                dense.iter().chain(path).fold(NodeKey::ROOT, |node, digit| node.child(*digit))
            }).collect();
            chunks.sort_by_key(|chunk| (chunk.digits().collect::<Vec<_>>(), chunk.level));
            let lies_in = |node: &NodeKey, above: &NodeKey| node.level >= above.level
                && node.ancestor(above.level) == *above;
            chunks.dedup_by(|next, before| lies_in(next, before));
            let roots = cut_nodes(&chunks);
            let below = |node: &NodeKey| chunks.iter().filter(|chunk| lies_in(chunk, node)).count();
            for (chunk, root) in chunks.iter().zip(&roots) {
                match root {
                    Some(root) => {
                        prop_assert!(lies_in(chunk, root) && chunk != root && root.level >= CUT);
                        prop_assert!(below(root) <= MOST_CHUNKS);
                        let parent = root.parent().filter(|parent| parent.level >= CUT);
                        prop_assert!(parent.is_none_or(|parent| below(&parent) > MOST_CHUNKS));
                    }
                    None => {
                        let parent = chunk.parent().filter(|parent| parent.level >= CUT);
                        prop_assert!(parent.is_none_or(|parent| below(&parent) > MOST_CHUNKS));
                    }
                }
            }
            // Those of one subtree stand together.
            let mut nodes: Vec<NodeKey> = roots.into_iter().flatten().collect();
            nodes.dedup();
            let different: HashSet<NodeKey> = nodes.iter().copied().collect();
            prop_assert_eq!(nodes.len(), different.len());
        }
    }
}
