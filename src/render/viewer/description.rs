//! What a viewer has to know of an octree before it asks for any of its points.

use serde::Serialize;

use super::attributes::{Offer, offers};
use crate::format::potree::NodeName;
use crate::render::ceiling::ceiling;
use crate::render::error::Result;
use crate::render::framing::{View, frame};
use crate::render::node_selection::bounds_of_points;
use crate::render::octree::Octree;
use crate::render::sample::CoarseSample;

/// An octree as a whole. Lengths are in the picture's world: the octree's, or of one in
/// degrees, meters; `unit` leads back.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Description {
    pub points: u64,
    /// The root's cube, in the octree's own units.
    pub low: [f64; 3],
    pub side: f64,
    /// What a unit of each axis counts in the picture's world.
    pub unit: [f64; 3],
    /// Digits behind the point that coordinates have, by axis.
    pub decimals: [u32; 3],
    /// Of the root; each level halves it.
    pub spacing: f64,
    /// The box of the points.
    pub bounds: [[f64; 3]; 2],
    /// Whether any number of a node's first points is an even subsample of it.
    pub has_prefixes: bool,
    /// Whether all axes count the same.
    pub has_cubes: bool,
    /// From where all is seen well, as the octree's picture has it.
    pub start: Start,
    /// Height of the ceiling above which a view from outside shows nothing.
    pub ceiling: Option<f64>,
    /// Ways to color, the usual one first.
    pub colors: Vec<Offer>,
}

/// Where a viewer begins.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Start {
    pub target: [f64; 3],
    pub azimuth: f64,
    pub elevation: f64,
    pub distance: f64,
}

impl Description {
    /// Describes an octree to a viewer whose picture has this size.
    pub fn of(octree: &Octree, sample: &CoarseSample, size: [u32; 2]) -> Description {
        let ceiling = ceiling(&sample.positions);
        let top = ceiling.unwrap_or(f64::INFINITY);
        let shown: Vec<[f64; 3]> = sample.together.iter().filter(|p| p[2] <= top).copied().collect();
        let shot = frame(&shown, View::Overview, size, false);
        let root = &octree.metadata.bounding_box;
        Description {
            points: octree.metadata.points,
            low: root.min,
            side: root.max[0] - root.min[0],
            unit: octree.world([1.0; 3]),
            decimals: octree.metadata.scale.map(decimals),
            spacing: octree.spacing(NodeName::ROOT.level()),
            bounds: bounds_of_points(octree),
            has_prefixes: octree.has_prefixes(),
            has_cubes: octree.has_cubes(),
            start: Start {
                target: shot.target,
                azimuth: shot.azimuth,
                elevation: shot.elevation,
                distance: shot.distance,
            },
            ceiling,
            colors: offers(octree, sample),
        }
    }
}

/// Digits that tell a lattice's steps apart.
fn decimals(scale: f64) -> u32 {
    (0..12).find(|digits| scale * 10f64.powi(*digits as i32) > 0.999).unwrap_or(12)
}

/// A point of a node: where it is, in the octree's own units, and its attributes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    pub position: [f64; 3],
    pub attributes: Vec<(String, serde_json::Value)>,
}

impl Point {
    /// The point at a place of [`Octree::range`]; nothing where the node has fewer.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn at(octree: &Octree, node: &crate::format::potree::Node, place: u32) -> Result<Option<Point>> {
        if place >= node.points {
            return Ok(None);
        }
        let record = octree.range(node, place..place + 1)?;
        let (position, unit) = (octree.position(&record), octree.world([1.0; 3]));
        Ok(Some(Point {
            position: std::array::from_fn(|i| position[i] / unit[i]),
            attributes: super::attributes::values(octree, &record),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_have_the_digits_of_their_lattice() {
        for (scale, digits) in [(0.001, 3), (0.01, 2), (1.0, 0), (1e-7, 7), (0.00025, 4), (100.0, 0)] {
            assert_eq!(decimals(scale), digits, "{scale}");
        }
    }
}
