//! Where a node's points may lie: its box, as ranges of the octree's integers.
//!
//! Where the root cube's corner and side are whole numbers of units, and the
//! side a power of two of them, boxes are exact and half open, as the lattice of
//! a Lodestone octree has them. Otherwise a box is widened by one unit of the
//! coarsest axis.

use crate::format::potree::{Metadata, NodeName};

/// The root cube on one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
enum CubeAxis {
    /// First unit and the exponent of the side in units.
    Lattice { corner: i64, side: u32 },
    /// Corner and side in units, and how far a point may lie outside.
    Loose { corner: f64, side: f64, slack: f64 },
}

/// The root cube of an octree.
#[derive(Debug, Clone)]
pub struct RootCube {
    axes: [CubeAxis; 3],
}

impl RootCube {
    /// The metadata's numbers are finite and its scales positive.
    pub fn new(metadata: &Metadata) -> RootCube {
        let coarsest = metadata.scale.iter().copied().fold(0.0, f64::max);
        let axis = |a: usize| {
            let (min, max) = (metadata.bounding_box.min[a], metadata.bounding_box.max[a]);
            let (scale, offset) = (metadata.scale[a], metadata.offset[a]);
            let (corner, side) = ((min - offset) / scale, (max - min) / scale);
            // Both ends of a difference are rounded to floats; their noise grows
            // with the coordinates.
            let noise = 1e-6 + 4.0 * f64::EPSILON * (min.abs() + max.abs() + offset.abs()) / scale;
            let exponent = side.log2().round();
            let is_lattice = noise < 0.05
                && (0.0..=40.0).contains(&exponent)
                && (corner - corner.round()).abs() <= noise
                && (side - exponent.exp2()).abs() <= noise;
            match is_lattice {
                true => CubeAxis::Lattice { corner: corner.round() as i64, side: exponent as u32 },
                false => CubeAxis::Loose { corner, side, slack: coarsest / scale },
            }
        };
        RootCube { axes: [axis(0), axis(1), axis(2)] }
    }

    /// Whether boxes are exact.
    pub fn is_lattice(&self) -> bool {
        self.axes.iter().all(|axis| matches!(axis, CubeAxis::Lattice { .. }))
    }

    /// The exponent of a node's side in units, where all axes agree on it; below
    /// 0 for nodes that are smaller than a unit.
    pub fn side_exponent(&self, level: u8) -> Option<i32> {
        let [first, rest @ ..] = &self.axes;
        let CubeAxis::Lattice { side, .. } = first else { return None };
        let same = |axis: &CubeAxis| matches!(axis, CubeAxis::Lattice { side: other, .. } if other == side);
        rest.iter().all(same).then_some(*side as i32 - i32::from(level))
    }

    /// The smallest and largest integers that a position in a node may have.
    pub fn bounds(&self, node: NodeName) -> [(i64, i64); 3] {
        let (cell, level) = (node.cell(), node.level());
        std::array::from_fn(|a| match self.axes[a] {
            CubeAxis::Lattice { corner, side } if u32::from(level) <= side => {
                let step = 1i64 << (side - u32::from(level));
                let first = corner.saturating_add((cell[a] as i64).saturating_mul(step));
                (first, first.saturating_add(step - 1))
            }
            CubeAxis::Lattice { corner, side } => {
                loose(corner as f64, f64::from(side).exp2(), 0.0, cell[a], level)
            }
            CubeAxis::Loose { corner, side, slack } => loose(corner, side, slack, cell[a], level),
        })
    }
}

fn loose(corner: f64, side: f64, slack: f64, cell: u64, level: u8) -> (i64, i64) {
    let step = side / f64::from(level).exp2();
    let first = corner + cell as f64 * step;
    ((first - slack).ceil() as i64, (first + step + slack).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::tests_support::metadata;

    #[test]
    fn boxes_of_a_lattice_are_exact_and_tile_it() {
        let mut octree = metadata(10);
        octree.scale = [0.001; 3];
        octree.offset = [440_000.0, 4_500_000.0, -3.0];
        octree.bounding_box.min = [439_999.5, 4_500_000.0, -3.0];
        octree.bounding_box.max = octree.bounding_box.min.map(|v| v + 1.024);
        let cube = RootCube::new(&octree);
        assert!(cube.is_lattice());
        assert_eq!(cube.side_exponent(3), Some(7));
        assert_eq!(cube.bounds(NodeName::ROOT), [(-500, 523), (0, 1023), (0, 1023)]);
        assert_eq!(cube.bounds("r4".parse().unwrap()), [(12, 523), (0, 511), (0, 511)]);
        assert_eq!(cube.bounds("r31".parse().unwrap())[2], (768, 1023));
    }

    #[test]
    fn a_cube_off_the_lattice_has_slack() {
        let mut octree = metadata(10);
        octree.bounding_box.max = [1000.0; 3];
        let cube = RootCube::new(&octree);
        assert!(!cube.is_lattice());
        assert_eq!(cube.bounds("r7".parse().unwrap()), [(499, 1001); 3]);
    }
}
