//! Poisson-disk sampling: no two samples of a node closer than its spacing
//! ("Fast Out-of-Core Octree Generation", section 5).
//!
//! Candidates are visited from the node's centre outward, as in the paper, which
//! packs the samples evenly and leaves no ridges. Where the paper searches the
//! last shell of accepted samples, which explodes in volumes, this looks at the
//! 27 cells around the candidate in a grid whose cells are as wide as the
//! spacing: five times as fast on surfaces, and linear everywhere
//! (SAMPLING.md, B7 and halo).
//!
//! Samples near a node's faces are remembered and honoured by the neighbours
//! that are sampled later, which the paper leaves open; those along the faces of
//! the whole tree are handed to the trees beside it. So samples keep their
//! distance across all nodes of a level.

use std::collections::HashMap;

use super::sampler::{BorderSamples, IndexedPoint, Sampler};
use crate::octree::cube::{NodeCube, SPACING_BITS};
use crate::octree::node::NodeKey;

/// Cells on an axis: the node's own and one layer of its neighbours' on each
/// side.
const AXIS: usize = (1 << SPACING_BITS) + 2;
const SHELLS: usize = 2048;
/// Cells of a row that a byte of the occupancy has for its own; the two behind
/// them are the next byte's, but stand in this one too. So the three cells
/// around any cell are together in one byte.
const OWN: usize = 6;
/// Bytes from one such column of cells to the next, and from layer to layer.
const COLUMN: usize = AXIS + 2;
const LAYER: usize = AXIS.div_ceil(OWN) * COLUMN;
/// The bits of a neighbourhood, a byte each for three rows: the layers below and
/// at the cell, and, in the upper half, the layer above.
const ROWS: u32 = 0x07_07_07;
const OWN_CELL: u64 = 1 << 12;
/// From a cell to the neighbour of each bit, in the table of heads.
const STEPS: [isize; 64] = {
    let mut steps = [0; 64];
    let axis = AXIS as isize;
    let mut cell = 0;
    while cell < 27 {
        let (x, y, z) = (cell % 3, cell / 3 % 3, cell / 9);
        let bit = if z < 2 { 8 * y + 3 * z + x } else { 32 + 8 * y + x };
        steps[bit as usize] = ((z - 1) * axis + y - 1) * axis + x - 1;
        cell += 1;
    }
    steps
};
const END: u32 = u32::MAX;

/// Coordinates within the node, from -spacing to side + spacing.
type Local = [i32; 3];

#[derive(Debug, Clone, Copy)]
struct Sample {
    at: Local,
    /// The sample before it in the same cell, or `END`.
    next: u32,
}

#[derive(Debug, Clone, Copy, Default)]
struct PoissonCandidate {
    at: Local,
    ordinal: u32,
}

pub struct PoissonDisk {
    /// Tree units that a distance between tree coordinates may be too long by.
    slack: u32,
    /// Whether a cell holds samples, see [`OWN`].
    occupied: Vec<u8>,
    /// Per cell the newest sample; valid where the bit is set.
    heads: Vec<u32>,
    samples: Vec<Sample>,
    visit: Vec<PoissonCandidate>,
    shells: Vec<u16>,
    halo: HashMap<NodeKey, Vec<[u32; 3]>>,
}

impl Default for PoissonDisk {
    fn default() -> PoissonDisk {
        PoissonDisk::with_slack(0)
    }
}

impl PoissonDisk {
    /// A sampler for tree coordinates that were rounded: samples keep the
    /// spacing and `slack` tree units more, so that they keep the spacing in the
    /// cloud itself. Cells are then twice as wide as the spacing.
    pub fn with_slack(slack: u32) -> PoissonDisk {
        PoissonDisk {
            slack,
            occupied: vec![0; AXIS * LAYER],
            heads: vec![0; AXIS * AXIS * AXIS],
            samples: Vec::new(),
            visit: Vec::new(),
            shells: Vec::new(),
            halo: HashMap::new(),
        }
    }
}

/// A node's spacing in tree units and how coordinates become cells.
#[derive(Clone, Copy)]
struct NodeSpacing {
    /// Cells are 2^shift tree units wide, at least as wide as the spacing.
    shift: u32,
    /// The distance that samples keep, and its square.
    reach: i64,
    squared: i64,
}

impl NodeSpacing {
    /// Below a unit the spacing only forbids two points at one position.
    fn of(frame: NodeCube, slack: u32) -> NodeSpacing {
        let spacing = frame.spacing_shift();
        let reach = (1 << spacing) + i64::from(slack);
        let mut shift = spacing;
        while 1 << shift < reach {
            shift += 1;
        }
        NodeSpacing { shift, reach, squared: reach * reach }
    }

    #[inline]
    fn cell(self, at: Local) -> [usize; 3] {
        at.map(|c| ((c >> self.shift) + 1) as usize)
    }
}

/// A cell's place in the table of heads.
#[inline]
fn head_of([x, y, z]: [usize; 3]) -> usize {
    (z * AXIS + y) * AXIS + x
}

/// Where the occupancy has a cell: its own byte and the bit in it.
#[inline]
fn bit_of([x, y, z]: [usize; 3]) -> (usize, usize) {
    (z * LAYER + x / OWN * COLUMN + y, x % OWN)
}

impl PoissonDisk {
    /// Whether a point keeps the spacing from all samples so far.
    #[inline]
    fn is_free(&self, at: Local, cell: [usize; 3], spacing: NodeSpacing) -> bool {
        let mut mask = self.neighbourhood(cell);
        // Look first where a sample is nearest.
        let own = head_of(cell);
        if mask & OWN_CELL != 0 && !self.cell_is_free(own, at, spacing) {
            return false;
        }
        mask &= !OWN_CELL;
        while mask != 0 {
            let step = STEPS[mask.trailing_zeros() as usize];
            mask &= mask - 1;
            if !self.cell_is_free(own.wrapping_add_signed(step), at, spacing) {
                return false;
            }
        }
        true
    }

    /// Whether a point keeps the spacing from the samples of an occupied cell.
    #[inline]
    fn cell_is_free(&self, cell: usize, at: Local, spacing: NodeSpacing) -> bool {
        let mut sample = self.heads[cell];
        while sample != END {
            let other = self.samples[sample as usize];
            if squared_distance(at, other.at) < spacing.squared {
                return false;
            }
            sample = other.next;
        }
        true
    }

    /// The occupancy of the 27 cells around a cell: one read a layer.
    #[inline]
    fn neighbourhood(&self, [x, y, z]: [usize; 3]) -> u64 {
        let (first, bit) = bit_of([x - 1, y - 1, z - 1]);
        // One check instead of one for each layer.
        let Some(window) = self.occupied[first..].first_chunk::<{ 2 * LAYER + 4 }>() else { return 0 };
        let layer = |at: usize| {
            let rows = [window[at], window[at + 1], window[at + 2], window[at + 3]];
            u32::from_le_bytes(rows) >> bit & ROWS
        };
        u64::from(layer(0) | layer(LAYER) << 3) | u64::from(layer(2 * LAYER)) << 32
    }

    #[inline]
    fn add(&mut self, at: Local, cell: [usize; 3]) {
        let (byte, bit) = bit_of(cell);
        let head = &mut self.heads[head_of(cell)];
        let next = if self.occupied[byte] >> bit & 1 == 0 { END } else { *head };
        *head = self.samples.len() as u32;
        self.samples.push(Sample { at, next });
        self.occupied[byte] |= 1 << bit;
        if bit < 8 - OWN && cell[0] >= OWN {
            self.occupied[byte - COLUMN] |= 1 << (bit + OWN);
        }
    }

    fn clear(&mut self, spacing: NodeSpacing) {
        for sample in self.samples.drain(..) {
            let cell = spacing.cell(sample.at);
            let (byte, _) = bit_of(cell);
            self.occupied[byte] = 0;
            if cell[0] >= OWN {
                self.occupied[byte - COLUMN] = 0;
            }
        }
    }

    /// Puts the candidates into `visit`, from the centre outward, in input
    /// order within a shell: one counting sort.
    fn order_inside_out(&mut self, frame: NodeCube, candidates: &[&[IndexedPoint]]) {
        let centre = (1u64 << frame.side_bits) as f32 / 2.0;
        // The corner lies √3 half sides away.
        let per_shell = SHELLS as f32 / (centre * 1.733);
        let mut starts = [0u32; SHELLS];
        self.shells.clear();
        for set in candidates {
            self.shells.extend(set.iter().map(|item| {
                let [x, y, z] = frame.local(item.at).map(|c| c as f32 - centre);
                let distance = (x * x + y * y + z * z).sqrt();
                let shell = ((distance * per_shell) as u32).min(SHELLS as u32 - 1) as u16;
                starts[usize::from(shell)] += 1;
                shell
            }));
        }
        let mut before = 0;
        for start in &mut starts {
            before += std::mem::replace(start, before);
        }
        self.visit.resize(self.shells.len(), PoissonCandidate::default());
        let mut ordinal = 0;
        for set in candidates {
            for (item, shell) in set.iter().zip(&self.shells[ordinal as usize..]) {
                let slot = &mut starts[usize::from(*shell)];
                self.visit[*slot as usize] =
                    PoissonCandidate { at: frame.local(item.at).map(|c| c as i32), ordinal };
                *slot += 1;
                ordinal += 1;
            }
        }
    }

    /// Takes in the samples of neighbours sampled earlier that lie within the
    /// spacing of this node.
    fn load_halo(&mut self, node: NodeKey, frame: NodeCube, spacing: NodeSpacing) {
        if self.halo.is_empty() {
            return;
        }
        let side = 1i64 << frame.side_bits;
        let reach = spacing.reach;
        for neighbour in neighbours(node) {
            let Some(samples) = self.halo.get(&neighbour) else { continue };
            let near: Vec<Local> = samples
                .iter()
                .filter_map(|at| {
                    let mut local = [0; 3];
                    for a in 0..3 {
                        let c = i64::from(at[a]) - i64::from(frame.origin[a]);
                        if c < -reach || c >= side + reach {
                            return None;
                        }
                        local[a] = c as i32;
                    }
                    Some(local)
                })
                .collect();
            near.into_iter().for_each(|at| self.add(at, spacing.cell(at)));
        }
    }

    /// Remembers the node's samples near its faces.
    fn save_halo(&mut self, node: NodeKey, frame: NodeCube, spacing: NodeSpacing, own_from: usize) {
        let side = 1i64 << frame.side_bits;
        let reach = spacing.reach;
        let near_face = |c: i32| i64::from(c) < reach || i64::from(c) >= side - reach;
        let near: Vec<[u32; 3]> = self.samples[own_from..]
            .iter()
            .filter(|s| s.at.iter().any(|c| near_face(*c)))
            .map(|s| std::array::from_fn(|a| s.at[a] as u32 + frame.origin[a]))
            .collect();
        if !near.is_empty() {
            self.halo.insert(node, near);
        }
    }
}

/// The up to 26 nodes around a node, on its level.
fn neighbours(node: NodeKey) -> impl Iterator<Item = NodeKey> {
    let end = 1u64 << node.level;
    (0..27u32).filter(|i| *i != 13).filter_map(move |i| {
        let step = [i % 3, i / 3 % 3, i / 9];
        let mut at = [0; 3];
        for a in 0..3 {
            at[a] = (node.at[a] + step[a]).checked_sub(1)?;
            if u64::from(at[a]) >= end {
                return None;
            }
        }
        Some(NodeKey { level: node.level, at })
    })
}

#[inline]
fn squared_distance(a: Local, b: Local) -> i64 {
    let d = |i: usize| i64::from(a[i] - b[i]);
    d(0) * d(0) + d(1) * d(1) + d(2) * d(2)
}

impl Sampler for PoissonDisk {
    fn begin(&mut self, around: Vec<BorderSamples>) {
        self.halo.clear();
        self.halo.extend(around.into_iter().map(|rim| (rim.node, rim.samples)));
    }

    fn end(&mut self, root: NodeKey, frame: NodeCube) -> Vec<BorderSamples> {
        let mut rims: Vec<BorderSamples> =
            self.halo.drain().map(|(node, samples)| BorderSamples { node, samples }).collect();
        rims.retain_mut(|rim| {
            let Some(below) = rim.node.level.checked_sub(root.level) else { return false };
            let own = NodeCube { side_bits: frame.side_bits - u32::from(below), ..frame };
            let reach = NodeSpacing::of(own, self.slack).reach;
            let near = |c: u32| i64::from(c) < reach || i64::from(c) >= (1 << frame.side_bits) - reach;
            rim.samples.retain(|at| frame.local(*at).into_iter().any(near));
            rim.node.ancestor(root.level) == root && !rim.samples.is_empty()
        });
        // In an order that is always the same.
        rims.sort_unstable_by_key(|rim| (rim.node.level, rim.node.at));
        rims
    }

    fn sample(
        &mut self,
        node: NodeKey,
        frame: NodeCube,
        candidates: &[&[IndexedPoint]],
        taken: &mut Vec<bool>,
    ) {
        let spacing = NodeSpacing::of(frame, self.slack);
        self.load_halo(node, frame, spacing);
        let own_from = self.samples.len();
        self.order_inside_out(frame, candidates);
        taken.clear();
        taken.resize(self.visit.len(), false);
        let visit = std::mem::take(&mut self.visit);
        for candidate in &visit {
            let cell = spacing.cell(candidate.at);
            if self.is_free(candidate.at, cell, spacing) {
                self.add(candidate.at, cell);
                taken[candidate.ordinal as usize] = true;
            }
        }
        self.visit = visit;
        self.save_halo(node, frame, spacing, own_from);
        self.clear(spacing);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sampled(sampler: &mut PoissonDisk, node: NodeKey, bits: u32, points: &[[u32; 3]]) -> Vec<[u32; 3]> {
        let frame = NodeCube::of(bits, node);
        let items: Vec<IndexedPoint> =
            points.iter().enumerate().map(|(i, at)| IndexedPoint { at: *at, index: i as u32 }).collect();
        let mut taken = Vec::new();
        sampler.sample(node, frame, &[&items], &mut taken);
        items.iter().zip(taken).filter(|(_, t)| *t).map(|(i, _)| i.at).collect()
    }

    fn closest(a: &[[u32; 3]], b: &[[u32; 3]], same: bool) -> i64 {
        let mut least = i64::MAX;
        for (i, p) in a.iter().enumerate() {
            for (j, q) in b.iter().enumerate() {
                if !same || i != j {
                    least = least.min(squared_distance(p.map(|c| c as i32), q.map(|c| c as i32)));
                }
            }
        }
        least
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// No two samples closer than the spacing; every candidate that was not
        /// taken has a sample closer than that (no holes); and a neighbour
        /// sampled later keeps its distance.
        #[test]
        fn samples_keep_their_distance_and_leave_no_hole(
            points in proptest::collection::vec((0u32..2048, 0u32..1024, 0u32..1024), 1..600),
            squeeze in prop_oneof![Just(1u32), Just(16), Just(64)],
        ) {
            let points: Vec<[u32; 3]> =
                points.into_iter().map(|(x, y, z)| [x, y / squeeze, z / squeeze]).collect();
            let (left, right): (Vec<_>, Vec<_>) = points.into_iter().partition(|p| p[0] < 1024);
            let mut sampler = PoissonDisk::default();
            sampler.begin(Vec::new());
            let a = sampled(&mut sampler, NodeKey::ROOT.child(0), 11, &left);
            let b = sampled(&mut sampler, NodeKey::ROOT.child(4), 11, &right);
            let squared = 8 * 8;
            prop_assert!(closest(&a, &a, true) >= squared);
            prop_assert!(closest(&b, &b, true) >= squared);
            prop_assert!(closest(&a, &b, false) >= squared);
            for p in &left {
                prop_assert!(a.contains(p) || closest(&[*p], &a, false) < squared);
            }
        }
    }

    #[test]
    fn slack_is_kept_on_top_of_the_spacing() {
        let points: Vec<[u32; 3]> =
            (0..4000u32).map(|i| [i * 7919 % 1024, i * 5309 % 1024, i * 3461 % 16]).collect();
        let samples = sampled(&mut PoissonDisk::with_slack(2), NodeKey::ROOT, 10, &points);
        assert!(closest(&samples, &samples, true) >= 10 * 10);
        assert!(points.iter().all(|p| samples.contains(p) || closest(&[*p], &samples, false) < 10 * 10));
    }

    #[test]
    fn one_of_a_crowd_at_one_position() {
        let mut sampler = PoissonDisk::default();
        assert_eq!(sampled(&mut sampler, NodeKey::ROOT, 3, &[[5; 3]; 1000]), vec![[5; 3]]);
    }

    #[test]
    fn the_choice_is_repeatable_and_state_is_cleared() {
        let points: Vec<[u32; 3]> =
            (0..5000u32).map(|i| [i * 7919 % 4096, i * 5309 % 4096, i * 3461 % 64]).collect();
        let mut sampler = PoissonDisk::default();
        let first = sampled(&mut sampler, NodeKey::ROOT, 12, &points);
        sampler.begin(Vec::new());
        assert_eq!(sampled(&mut sampler, NodeKey::ROOT, 12, &points), first);
        assert!(first.len() > 100);
    }
}
