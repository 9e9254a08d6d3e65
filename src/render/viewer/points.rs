//! A node's points on their way to the browser: positions as parts of the node's cube, and
//! colors.
//!
//! A position is three little-endian `u16`, counted in [`STEPS`]ths of the cube's sides
//! from its lower corner, so that it is off by half a step at most: of a node whose side is
//! 128 spacings a thousandth of the spacing. A color is red, green and blue, a byte each.
//! All positions come first, then all colors.

use std::ops::Range;

use super::attributes::Paint;
use crate::format::potree::Node;
use crate::render::error::Result;
use crate::render::octree::Octree;

/// Parts of a cube's side.
pub const STEPS: f64 = 65_536.0;

/// Some points of a node, `range` of them by their places in [`Octree::range`]: with their
/// positions, or colors alone for a viewer that has the positions.
///
/// # Errors
/// Where they cannot be read.
pub fn encode(
    octree: &Octree,
    node: &Node,
    range: Range<u32>,
    paint: &Paint,
    with_positions: bool,
) -> Result<Vec<u8>> {
    let records = octree.range(node, range)?;
    let cube = octree.cube(node.name);
    let record_size = octree.schema.record_size();
    let points = records.len() / record_size;
    let mut bytes = Vec::with_capacity(points * if with_positions { 9 } else { 3 });
    let positions = || records.chunks_exact(record_size).map(|record| (record, octree.position(record)));
    if with_positions {
        for (_, position) in positions() {
            bytes.extend(quantized(position, cube).iter().flat_map(|step| step.to_le_bytes()));
        }
    }
    for (record, position) in positions() {
        bytes.extend(paint.color(record, position[2]));
    }
    Ok(bytes)
}

/// In which step of the cube's sides a position lies; what is outside or no number, at the
/// nearest.
pub fn quantized(position: [f64; 3], (corner, sides): ([f64; 3], [f64; 3])) -> [u16; 3] {
    std::array::from_fn(|i| ((position[i] - corner[i]) / sides[i] * STEPS).floor() as u16)
}

/// The middle of a step.
pub fn dequantized(steps: [u16; 3], (corner, sides): ([f64; 3], [f64; 3])) -> [f64; 3] {
    std::array::from_fn(|i| corner[i] + (f64::from(steps[i]) + 0.5) / STEPS * sides[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn positions_come_back_to_half_a_step(
            share in [0.0..1.0f64, 0.0..1.0f64, 0.0..1.0f64],
            corner in [-1e7..1e7f64, -1e7..1e7f64, -1e4..1e4f64],
            side in 1e-2..1e5f64,
        ) {
            let cube = (corner, [side, 2.0 * side, side / 3.0]);
            let position: [f64; 3] = std::array::from_fn(|i| corner[i] + share[i] * cube.1[i]);
            let back = dequantized(quantized(position, cube), cube);
            for i in 0..3 {
                let allowed = cube.1[i] / STEPS / 2.0 + corner[i].abs() * 1e-15;
                prop_assert!((back[i] - position[i]).abs() <= allowed * (1.0 + 1e-6) + 1e-9);
            }
        }
    }

    #[test]
    fn what_lies_outside_is_at_the_nearest_step() {
        let cube = ([0.0; 3], [1.0; 3]);
        assert_eq!(quantized([-1.0, 1.0, f64::NAN], cube), [0, 65_535, 0]);
        assert_eq!(quantized([f64::INFINITY, f64::NEG_INFINITY, 0.5], cube), [65_535, 0, 32_768]);
    }
}
