//! A first look at a cloud: the points of its coarsest nodes, some ten
//! thousand, from which framing and colours are decided.

use std::collections::VecDeque;

use super::error::{RenderError, Result};
use super::octree::Octree;
use crate::format::potree::NodeName;

/// Points that are enough of a look, and nodes that are enough of a search.
const ENOUGH_POINTS: usize = 20_000;
const ENOUGH_NODES: usize = 512;
/// Positions taken of one node at most, about.
const MOST_POSITIONS: usize = 1_000_000;

/// The points of the coarsest nodes.
pub struct Sample {
    /// World positions; finite.
    pub positions: Vec<[f64; 3]>,
    /// Records of each node looked at.
    nodes: Vec<Vec<u8>>,
    record_size: usize,
}

impl Sample {
    /// Reads from the root down until there is enough to judge by.
    pub fn take(octree: &mut Octree) -> Result<Sample> {
        let record_size = octree.schema.record_size();
        let mut sample = Sample { positions: Vec::new(), nodes: Vec::new(), record_size };
        let mut waiting = VecDeque::from([NodeName::ROOT]);
        let mut seen = 0;
        while let Some(name) = waiting.pop_front() {
            if sample.positions.len() >= ENOUGH_POINTS || seen >= ENOUGH_NODES {
                break;
            }
            seen += 1;
            let Some(node) = octree.node(name)? else { continue };
            let take =
                if octree.has_prefixes() { node.points.min(ENOUGH_POINTS as u32) } else { node.points };
            if take > 0 {
                let records = octree.records(&node, take)?;
                // Of a node far larger than any sample, some points are as good as all.
                let step = (records.len() / record_size / MOST_POSITIONS).max(1);
                let looked_at = records.chunks_exact(record_size).step_by(step);
                let positions = looked_at.map(|record| octree.position(record));
                sample.positions.extend(positions.filter(|p| p.iter().all(|c| c.is_finite())));
                sample.nodes.push(records);
            }
            waiting.extend((0..8).filter(|d| node.child_mask >> d & 1 == 1).filter_map(|d| name.child(d)));
        }
        match sample.positions.is_empty() {
            true => Err(RenderError::NotFinite { folder: octree.folder.clone() }),
            false => Ok(sample),
        }
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
