//! The root cube: from lattice integers to tree coordinates.
//!
//! The cube's side is 2^bits *tree units*. Where the lattice has the same scale
//! on every axis (nearly always), a tree unit is a lattice unit (or a power of
//! two of them), and the child a point belongs to at level L is three bits of
//! its coordinates. Where scales differ between the axes, each axis is stretched
//! onto the common unit by one integer multiplication, fixed once: still no
//! float decides where a point belongs.

use serde::{Deserialize, Serialize};

use super::lattice::Lattice;
use super::node::NodeKey;

/// Tree coordinates stay below 2^31, so that differences fit an i32.
pub const MAX_BITS: u32 = 31;

/// Cells on an axis of a node's sampling grid: spacing = node side / 128
/// (FORMATS.md; the paper's section 5).
pub const SPACING_BITS: u32 = 7;

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum ToTree {
    /// Tree coordinate = distance from the corner >> shift.
    Shift(u32),
    /// Tree coordinate = distance × factor >> 32, per axis.
    Stretch([u64; 3]),
}

/// The octree's root cube on a lattice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cube {
    /// Lattice integers of the cube's smallest corner.
    pub corner: [i32; 3],
    /// The side is 2^bits tree units; also the deepest level there can be.
    pub bits: u32,
    /// World length of a tree unit.
    pub unit: f64,
    to_tree: ToTree,
}

impl Cube {
    /// The smallest cube with its corner at the box's minimum that holds the
    /// lattice's box.
    pub fn around(lattice: &Lattice) -> Cube {
        let extent: [u64; 3] =
            std::array::from_fn(|a| (i64::from(lattice.max[a]) - i64::from(lattice.min[a])) as u64);
        let scale = lattice.scale;
        if scale[0] == scale[1] && scale[1] == scale[2] {
            let longest = extent[0].max(extent[1]).max(extent[2]);
            let shift = bits_for(longest).saturating_sub(MAX_BITS);
            return Cube {
                corner: lattice.min,
                bits: bits_for(longest) - shift,
                unit: scale[0] * f64::from(1u32 << shift),
                to_tree: ToTree::Shift(shift),
            };
        }
        Cube::stretched(lattice, extent)
    }

    fn stretched(lattice: &Lattice, extent: [u64; 3]) -> Cube {
        let world = (0..3).map(|a| extent[a] as f64 * lattice.scale[a]).fold(0.0, f64::max);
        let mut unit = lattice.scale.iter().copied().fold(f64::INFINITY, f64::min);
        // One unit of head room for the rounding of the factors.
        while world / unit + 2.0 >= f64::from(1u32 << MAX_BITS) {
            unit *= 2.0;
        }
        let factor: [u64; 3] =
            std::array::from_fn(|a| (lattice.scale[a] / unit * (1u64 << 32) as f64).round() as u64);
        let longest = (0..3).map(|a| (extent[a] * factor[a]) >> 32).max().unwrap_or(0);
        Cube { corner: lattice.min, bits: bits_for(longest), unit, to_tree: ToTree::Stretch(factor) }
    }

    /// Tree coordinates of a stored position. A position outside the lattice's
    /// box gives coordinates that [`Cube::holds`] refuses.
    #[inline]
    pub fn tree(&self, stored: [i32; 3]) -> [u32; 3] {
        let distance: [u32; 3] =
            std::array::from_fn(|a| (stored[a] as u32).wrapping_sub(self.corner[a] as u32));
        match self.to_tree {
            ToTree::Shift(shift) => distance.map(|d| d >> shift),
            ToTree::Stretch(factor) => {
                // Distances beyond the box may overflow; they must not panic.
                std::array::from_fn(|a| ((u64::from(distance[a]).wrapping_mul(factor[a])) >> 32) as u32)
            }
        }
    }

    /// Whether tree coordinates lie within the cube.
    #[inline]
    pub fn holds(&self, tree: [u32; 3]) -> bool {
        u64::from(tree[0] | tree[1] | tree[2]) >> self.bits == 0
    }

    /// Tree units that the distance of two points in tree coordinates may be
    /// longer than it is on the lattice: 0 unless coordinates are rounded, and
    /// then less than one an axis, √3 in all.
    pub fn slack(&self) -> u32 {
        match self.to_tree {
            ToTree::Shift(0) => 0,
            ToTree::Shift(_) | ToTree::Stretch(_) => 2,
        }
    }

    /// World length by which the cube can be moved down and still divide the same points:
    /// half of the distance that tree coordinates can have from a node's face.
    pub fn margin(&self) -> f64 {
        /// Parts of a unit at most that positions are multiples of.
        const MAX_PARTS: u64 = 64;
        let parts = match self.to_tree {
            ToTree::Shift(shift) => 1 << shift,
            ToTree::Stretch(factors) => factors
                .iter()
                .map(|factor| {
                    (1..=MAX_PARTS).find(|parts| is_whole(factor.wrapping_mul(*parts))).unwrap_or(MAX_PARTS)
                })
                .fold(1, |all, parts| lcm(all, parts).min(MAX_PARTS * MAX_PARTS)),
        };
        self.unit / (2 * parts) as f64
    }

    /// World length of the side.
    pub fn side(&self) -> f64 {
        self.unit * (1u64 << self.bits) as f64
    }

    /// World length that the root's points keep from each other.
    pub fn spacing(&self) -> f64 {
        self.side() / f64::from(1u32 << SPACING_BITS)
    }
}

/// Whether a factor of a stretched axis is a whole number, but for its last bits.
fn is_whole(factor: u64) -> bool {
    (factor as u32).wrapping_add(64) <= 128
}

fn lcm(a: u64, b: u64) -> u64 {
    let (mut x, mut y) = (a, b);
    while y > 0 {
        (x, y) = (y, x % y);
    }
    a / x * b
}

/// Bits that hold the value.
fn bits_for(value: u64) -> u32 {
    u64::BITS - value.leading_zeros()
}

/// A node's cube in tree units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeCube {
    pub origin: [u32; 3],
    /// The side is 2^side_bits tree units.
    pub side_bits: u32,
}

impl NodeCube {
    /// Where a node lies in a root cube of 2^bits tree units.
    pub fn of(bits: u32, node: NodeKey) -> NodeCube {
        let side_bits = bits - u32::from(node.level);
        NodeCube { origin: node.at.map(|c| c << side_bits), side_bits }
    }

    /// How far to shift coordinates within the node to get cells as wide as
    /// the node's spacing; 0 where the spacing is a unit or less.
    pub fn spacing_shift(&self) -> u32 {
        self.side_bits.saturating_sub(SPACING_BITS)
    }

    /// Coordinates within the node.
    #[inline]
    pub fn local(&self, tree: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|a| tree[a] - self.origin[a])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice(scale: [f64; 3], min: [i32; 3], max: [i32; 3]) -> Lattice {
        let (finest, too_wide) = (scale, [false; 3]);
        Lattice { scale, offset: [0.0; 3], exact: [true; 3], finest, too_wide, min, max }
    }

    #[test]
    fn the_cube_is_the_smallest_power_of_two() {
        let cube = Cube::around(&lattice([0.01; 3], [5, 5, 5], [5 + 1023, 7, 5]));
        assert_eq!(cube.bits, 10);
        assert_eq!(cube.tree([5 + 1023, 7, 5]), [1023, 2, 0]);
        assert!(cube.holds([1023, 2, 0]) && !cube.holds([1024, 0, 0]));
        assert!((cube.side() - 10.24).abs() < 1e-12);
        assert_eq!(Cube::around(&lattice([0.01; 3], [0; 3], [1024, 0, 0])).bits, 11);
    }

    #[test]
    fn a_single_position_is_a_cube_of_one_unit() {
        let cube = Cube::around(&lattice([0.01; 3], [9; 3], [9; 3]));
        assert_eq!((cube.bits, cube.tree([9; 3])), (0, [0; 3]));
    }

    #[test]
    fn the_whole_int32_range_fits() {
        let cube = Cube::around(&lattice([1.0; 3], [i32::MIN; 3], [i32::MAX; 3]));
        assert_eq!(cube.bits, 31);
        assert_eq!(cube.tree([i32::MAX; 3]), [(1 << 31) - 1; 3]);
        assert!(cube.holds(cube.tree([i32::MAX; 3])));
    }

    #[test]
    fn the_margin_is_half_of_what_positions_are_apart() {
        let margin = |scale: [f64; 3], max: i32| Cube::around(&lattice(scale, [0; 3], [max; 3])).margin();
        assert_eq!(margin([0.01; 3], 1000), 0.005);
        let whole = Cube::around(&lattice([0.5; 3], [i32::MIN; 3], [i32::MAX; 3]));
        assert_eq!(whole.margin(), 0.25, "half a unit of the lattice, not of the tree");
        assert_eq!(margin([0.01, 0.01, 0.001], 1000), 0.0005);
        assert_eq!(margin([0.01, 0.01, 0.004], 1000), 0.001);
    }

    #[test]
    fn axes_of_different_scale_share_one_unit() {
        let l = lattice([1e-6, 1e-7, 1e-3], [0; 3], [1_000_000, 1_000_000, 5_000]);
        let cube = Cube::around(&l);
        let [x, y, z] = cube.tree([1_000_000, 1_000_000, 5_000]);
        assert!(cube.holds([x, y, z]));
        assert!(z > 49_000_000 && (9_999_999..=10_000_000).contains(&x) && y == 1_000_000, "{x} {y} {z}");
    }
}
