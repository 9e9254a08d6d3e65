//! How even the samples of a finished octree are, level by level (the measures
//! of sampling: spacing within and between nodes, and coverage).
//!
//! Looked at is what a viewer draws of a level: the samples of its inner nodes
//! among those of all coarser levels, for a sample that a parent takes is stored
//! there. Leaves keep whatever is left, and no spacing.
//!
//! Levels beyond the 21st are not looked at: no cloud has so many.

use std::collections::HashSet;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::neighbors::{Cells, Placed, squared};
use crate::format::potree::{Node, NodeName};
use crate::octree::cube::SPACING_BITS;
use crate::render::Result;
use crate::render::octree::Octree;

/// Holes are looked for so many spacings wide.
const WIDEST: f64 = 2.0;

/// The samples of a level, or of several.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Evenness {
    pub samples: u64,
    /// Samples that have another of the same node closer than the spacing.
    pub inside: u64,
    /// Samples that have one of another node closer than the spacing.
    pub across: u64,
    /// Points below that were left out.
    pub rejected: u64,
    /// Farthest that one of those is from a sample of the level, in spacings; 2
    /// stands for 2 and more.
    pub hole: f64,
}

impl Evenness {
    /// Share of the samples that have one of another node too near.
    pub fn across_share(&self) -> f64 {
        self.across as f64 / self.samples.max(1) as f64
    }

    /// Share of the samples that have one of their own node too near.
    pub fn inside_share(&self) -> f64 {
        self.inside as f64 / self.samples.max(1) as f64
    }

    fn and(self, other: Evenness) -> Evenness {
        Evenness {
            samples: self.samples + other.samples,
            inside: self.inside + other.inside,
            across: self.across + other.across,
            rejected: self.rejected + other.rejected,
            hole: self.hole.max(other.hole),
        }
    }
}

/// Of each level that has inner nodes and a spacing of at least a unit of the
/// octree's positions.
pub fn of_levels(folder: &Path) -> Result<Vec<Evenness>> {
    let mut octree = Octree::open(folder)?;
    let lattice = IntegerPositions::of(&octree);
    let (mut levels, mut drawn): (Vec<Evenness>, Vec<[f64; 3]>) = (Vec::new(), Vec::new());
    let mut nodes: Vec<Node> = octree.node(NodeName::ROOT)?.into_iter().collect();
    while nodes.iter().any(|node| node.child_mask != 0) {
        let inner: Vec<Node> = nodes.into_iter().filter(|node| node.child_mask != 0).collect();
        let mut children = Vec::new();
        for node in &inner {
            for digit in (0..8u8).filter(|digit| node.child_mask >> digit & 1 == 1) {
                if let Some(name) = node.name.child(digit) {
                    children.extend(octree.node(name)?);
                }
            }
        }
        let (spacing, side) = (lattice.spacing(levels.len()), lattice.side(levels.len()));
        if spacing < 1.0 || levels.len() > 20 {
            break;
        }
        let own = points(&octree, &lattice, &inner)?;
        let node_at = |at: [f64; 3]| number(at.map(|c| (c / side) as u64));
        let placed = |points: &[[f64; 3]]| -> Vec<Placed> {
            points.iter().map(|at| Placed { node: node_at(*at), at: *at }).collect()
        };
        // Where a leaf ends the tree above, all of it is drawn, and nothing sampled.
        let sampled: HashSet<u64> =
            inner.iter().map(|node| number(node.name.cell().map(u64::from))).collect();
        drawn.retain(|at| sampled.contains(&node_at(*at)));
        drawn.extend_from_slice(&own);
        let below = points(&octree, &lattice, &children)?;
        levels.push(level(spacing, &placed(&own), &placed(&drawn), &placed(&below)));
        nodes = children;
    }
    Ok(levels)
}

/// The number of a node among those of its level.
fn number(cell: [u64; 3]) -> u64 {
    cell.into_iter().fold(0, |number, c| number << 21 | c)
}

/// All levels together.
pub fn total(levels: &[Evenness]) -> Evenness {
    levels.iter().copied().fold(Evenness::default(), Evenness::and)
}

/// Positions as the whole numbers they are stored as, seen from the cube's
/// corner: exact, as are their differences and squares within some spacings.
struct IntegerPositions {
    corner: [f64; 3],
    /// Of each axis, in multiples of the finest.
    stretch: [f64; 3],
    side: f64,
}

impl IntegerPositions {
    fn of(octree: &Octree) -> IntegerPositions {
        let metadata = &octree.metadata;
        let unit = metadata.scale.iter().copied().fold(f64::INFINITY, f64::min);
        let (low, high) = (metadata.bounding_box.min, metadata.bounding_box.max);
        let corner =
            std::array::from_fn(|axis| ((low[axis] - metadata.offset[axis]) / metadata.scale[axis]).round());
        let stretch = metadata.scale.map(|scale| scale / unit);
        IntegerPositions { corner, stretch, side: ((high[0] - low[0]) / unit).round() }
    }

    /// Of the nodes of a level, in units.
    fn side(&self, level: usize) -> f64 {
        self.side / 2f64.powi(level as i32)
    }

    fn spacing(&self, level: usize) -> f64 {
        self.side(level) / f64::from(1u32 << SPACING_BITS)
    }

    fn place(&self, record: &[u8]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let bytes = record.get(4 * axis..).and_then(|bytes| bytes.first_chunk());
            let stored = f64::from(bytes.map_or(0, |bytes| i32::from_le_bytes(*bytes)));
            (stored - self.corner[axis]) * self.stretch[axis]
        })
    }
}

fn points(octree: &Octree, lattice: &IntegerPositions, nodes: &[Node]) -> Result<Vec<[f64; 3]>> {
    let mut points = Vec::new();
    for node in nodes {
        let records = octree.records(node, node.points)?;
        points.extend(records.chunks_exact(octree.schema.record_size()).map(|record| lattice.place(record)));
    }
    Ok(points)
}

/// A level's own samples among all that are drawn of it, and the points below that
/// it was offered and did not take.
pub fn level(spacing: f64, own: &[Placed], drawn: &[Placed], below: &[Placed]) -> Evenness {
    let limit = spacing * spacing;
    let counted = Cells::new(spacing, drawn).around(
        &Cells::new(spacing, own),
        Evenness::default,
        |sum, sample, around| {
            let (mut itself, mut inside, mut across) = (true, false, false);
            for other in around.filter(|other| squared(other, sample) < limit) {
                if other.node != sample.node {
                    across = true;
                } else if itself && other.at == sample.at {
                    itself = false; // it meets itself once; a twin is another one
                } else {
                    inside = true;
                }
            }
            sum.samples += 1;
            sum.inside += u64::from(inside);
            sum.across += u64::from(across);
        },
        Evenness::and,
    );
    let wide = WIDEST * spacing;
    let holes = Cells::new(wide, drawn).around(
        &Cells::new(wide, below),
        Evenness::default,
        |sum, point, around| {
            let nearest = around.map(|sample| squared(sample, point)).fold(wide * wide, f64::min);
            sum.rejected += 1;
            sum.hole = sum.hole.max(nearest.sqrt() / spacing);
        },
        Evenness::and,
    );
    counted.and(holes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square lattice so many units wide, of nodes of 16 units.
    fn lattice(step: u32, side: u32) -> Vec<Placed> {
        let at = |i: u32| [f64::from(i % side * step), f64::from(i / side * step), 0.0];
        let node = |at: [f64; 3]| (at[0] / 16.0) as u64 + 100 * (at[1] / 16.0) as u64;
        (0..side * side).map(at).map(|at| Placed { node: node(at), at }).collect()
    }

    #[test]
    fn a_lattice_of_the_spacing_is_even_and_of_less_is_not() {
        let samples = lattice(4, 16);
        let middle = Placed { node: 0, at: [2.0, 2.0, 0.0] };
        let even = level(4.0, &samples, &samples, &[middle]);
        assert_eq!((even.samples, even.inside, even.across, even.rejected), (256, 0, 0, 1));
        assert!((even.hole - 0.5f64.sqrt()).abs() < 1e-12);
        let dense = level(5.0, &samples, &samples, &[]);
        assert_eq!((dense.inside, dense.hole), (256, 0.0));
        // Columns and rows on either side of three borders, where they cross only once.
        assert_eq!(dense.across, 256 - 10 * 10);
    }

    #[test]
    fn twins_are_too_near_and_deserts_are_holes() {
        let twin = Placed { node: 0, at: [1.0; 3] };
        let elsewhere = Placed { node: 1, at: [1.0, 1.0, 1.5] };
        let samples = [twin, twin, elsewhere];
        let found = level(1.0, &samples, &samples, &[Placed { node: 0, at: [50.0; 3] }]);
        assert_eq!((found.inside, found.across, found.hole), (2, 3, WIDEST));
        assert!(
            (found.across_share() - 1.0).abs() < 1e-12 && (found.inside_share() - 2.0 / 3.0).abs() < 1e-12
        );
    }
}
