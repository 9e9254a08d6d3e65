//! Nearest to the cell's centre, as Entwine samples ("Fast Out-of-Core Octree
//! Generation", sections 2 and 6.3): one point a cell of a 128³ grid, that
//! which lies nearest to the middle of the cell. As fast as random in grid and
//! wider spaced, but the grid shows.

use super::one_per_cell::take_lowest;
use super::sampler::{IndexedPoint, Sampler};
use crate::octree::cube::NodeCube;
use crate::octree::node::NodeKey;

#[derive(Default)]
pub struct NearestToCentre;

/// Squared distance from the middle of a cell of 2^shift units, in half units:
/// so the middle is a whole number.
fn distance(at: [u32; 3], shift: u32) -> u64 {
    let side = 1i64 << shift;
    let along = |c: u32| (2 * (i64::from(c) & (side - 1)) + 1 - side).unsigned_abs().pow(2);
    at.map(along).iter().sum()
}

impl Sampler for NearestToCentre {
    fn sample(&mut self, _: NodeKey, frame: NodeCube, candidates: &[&[IndexedPoint]], taken: &mut Vec<bool>) {
        let shift = frame.spacing_shift();
        take_lowest(frame, candidates, taken, |at| distance(at, shift));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_point_in_the_middle_of_each_cell_is_taken() {
        // Cells of 8 units: corners, faces, and just beside the middle (4, 4, 4).
        let cell = [[0, 0, 0], [4, 4, 0], [3, 4, 4], [7, 7, 7], [5, 2, 6]];
        let at = |first: u32| cell.iter().map(move |[x, y, z]| [x + first, *y, *z]);
        let items: Vec<IndexedPoint> =
            at(0).chain(at(8)).zip(0..).map(|(at, index)| IndexedPoint { at, index }).collect();
        let mut taken = Vec::new();
        let frame = NodeCube { origin: [0; 3], side_bits: 10 };
        NearestToCentre.sample(NodeKey::ROOT, frame, &[&items], &mut taken);
        let chosen: Vec<u32> =
            items.iter().zip(taken).filter(|(_, t)| *t).map(|(item, _)| item.index).collect();
        assert_eq!(chosen, [2, 7]);
        assert_eq!((distance([5; 3], 0), distance([0; 3], 1), distance([0; 3], 3)), (0, 3, 147));
    }
}
