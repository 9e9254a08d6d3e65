//! A first look at a cloud: the points of its coarsest nodes, some ten
//! thousand, from which framing and colours are decided.

use super::error::{RenderError, Result};
use super::lone_points::without_lone;
use super::octree::Octree;
use crate::format::potree::{Node, NodeName};

/// Points that are enough of a look, and nodes that are enough of a search.
const ENOUGH_POINTS: usize = 20_000;
const ENOUGH_NODES: usize = 512;
/// Points of a node that are looked at, however many nodes its level has.
const LEAST_POINTS: usize = 64;

/// The points of the coarsest nodes.
pub struct CoarseSample {
    /// World positions; finite.
    pub positions: Vec<[f64; 3]>,
    /// Those of them that do not stand alone: what is looked at.
    pub together: Vec<[f64; 3]>,
    /// Records of each node looked at.
    nodes: Vec<Vec<u8>>,
    record_size: usize,
}

impl CoarseSample {
    /// Reads from the root down until there is enough to judge by.
    pub fn take(octree: &mut Octree) -> Result<CoarseSample> {
        let record_size = octree.schema.record_size();
        let mut sample =
            CoarseSample { positions: Vec::new(), together: Vec::new(), nodes: Vec::new(), record_size };
        let mut level = vec![NodeName::ROOT];
        let mut seen = 0;
        // Level by level: half of one would be a look at one side of the cloud.
        while !level.is_empty() && sample.positions.len() < ENOUGH_POINTS && seen < ENOUGH_NODES {
            let share = (ENOUGH_POINTS / level.len()).max(LEAST_POINTS);
            let stride = level.len().div_ceil(ENOUGH_NODES - seen);
            let mut below = Vec::new();
            for name in level.into_iter().step_by(stride) {
                seen += 1;
                let Some(node) = octree.node(name)? else { continue };
                sample.look_at(octree, &node, share)?;
                below.extend((0..8).filter(|d| node.child_mask >> d & 1 == 1).filter_map(|d| name.child(d)));
            }
            level = below;
        }
        sample.together = without_lone(&sample.positions);
        match sample.positions.is_empty() {
            true => Err(RenderError::NotFinite { folder: octree.folder.clone() }),
            false => Ok(sample),
        }
    }

    /// Adds about as many of a node's points as are asked for, evenly spread.
    fn look_at(&mut self, octree: &Octree, node: &Node, points: usize) -> Result<()> {
        let take = if octree.has_prefixes() { node.points.min(points as u32) } else { node.points };
        if take == 0 {
            return Ok(());
        }
        let all = octree.records(node, take)?;
        let step = (all.len() / self.record_size).div_ceil(points).max(1);
        let records: Vec<u8> = match step {
            1 => all,
            step => all.chunks_exact(self.record_size).step_by(step).flatten().copied().collect(),
        };
        let positions = records.chunks_exact(self.record_size).map(|record| octree.position(record));
        self.positions.extend(positions.filter(|p| p.iter().all(|c| c.is_finite())));
        self.nodes.push(records);
        Ok(())
    }

    pub fn records(&self) -> impl Iterator<Item = &[u8]> {
        self.nodes.iter().flat_map(|node| node.chunks_exact(self.record_size))
    }

    /// The records node by node.
    pub fn nodes(&self) -> impl Iterator<Item = std::slice::ChunksExact<'_, u8>> {
        self.nodes.iter().map(|node| node.chunks_exact(self.record_size))
    }

    /// Points looked at.
    pub fn size(&self) -> usize {
        self.nodes.iter().map(|node| node.len() / self.record_size).sum()
    }
}

/// The value that a share of the values lies below; 0 where there are none.
/// Changes their order.
pub fn percentile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = (share * (values.len() - 1) as f64).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}
