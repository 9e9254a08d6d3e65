//! Which nodes a picture needs, and how much of each: nodes by their benefit,
//! until the picture needs no more or the budget is spent.
//!
//! The benefit of a node is what its parent lacks: the parent's spacing as it
//! appears in the picture, in pixels (Schütz' dissertation, 4.3; the 2006
//! thesis, section 4.3). A node outside every view is left out with all below
//! it. Where the nodes' points are in coarse-to-fine order, a prefix of the
//! last ones is enough.

use std::collections::BinaryHeap;

use super::camera::Camera;
use super::error::Result;
use super::octree::Octree;
use crate::format::potree::{Node, NodeName};

/// Points a square of the spacing that a Poisson-disk set has, about.
pub const POISSON_DENSITY: f64 = 0.75;

/// What a picture asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SelectionRequest {
    /// Distance of neighbouring points in the picture, in pixels.
    pub spacing: f64,
    /// Points to draw at most.
    pub budget: u64,
    pub size: [u32; 2],
    /// World z above which nothing is shown; infinite where all is.
    pub top: f64,
}

/// A node that is drawn.
#[derive(Debug, Clone)]
pub struct Chosen {
    pub node: Node,
    /// How many of its points, from the first.
    pub take: u32,
    /// Which children are drawn as well, by their place in the selection.
    pub children: [Option<u32>; 8],
}

/// A node that waits for its turn.
struct WaitingNode {
    /// Spacing of the parent in the picture, in pixels.
    benefit: f64,
    name: NodeName,
    parent: Option<(u32, u8)>,
}

impl PartialEq for WaitingNode {
    fn eq(&self, other: &WaitingNode) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for WaitingNode {}
impl PartialOrd for WaitingNode {
    fn partial_cmp(&self, other: &WaitingNode) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for WaitingNode {
    fn cmp(&self, other: &WaitingNode) -> std::cmp::Ordering {
        self.benefit.total_cmp(&other.benefit).then(other.name.cmp(&self.name))
    }
}

/// The nodes for one picture, or for all pictures of a turntable. Parents stand
/// before their children.
pub fn select(octree: &mut Octree, cameras: &[Camera], wanted: &SelectionRequest) -> Result<Vec<Chosen>> {
    let mut tight = bounds_of_points(octree);
    tight[1][2] = tight[1][2].min(wanted.top);
    let mut waiting =
        BinaryHeap::from([WaitingNode { benefit: f64::INFINITY, name: NodeName::ROOT, parent: None }]);
    let mut chosen: Vec<Chosen> = Vec::new();
    let mut left = wanted.budget;
    while let Some(candidate) = waiting.pop() {
        let Some(node) = octree.node(candidate.name)? else { continue };
        let pixels = pixels_a_unit(octree, &tight, cameras, wanted.size, node.name);
        if pixels <= 0.0 {
            continue;
        }
        let spacing = octree.spacing(node.name.level()) * pixels;
        let take = if octree.has_prefixes() { enough(&node, spacing, wanted.spacing) } else { node.points };
        if u64::from(take) > left && !chosen.is_empty() {
            break;
        }
        left = left.saturating_sub(u64::from(take));
        let place = chosen.len() as u32;
        if let Some((parent, digit)) = candidate.parent {
            chosen[parent as usize].children[usize::from(digit)] = Some(place);
        }
        chosen.push(Chosen { node, take, children: [None; 8] });
        if spacing > wanted.spacing {
            let children = (0..8u8).filter(|digit| node.child_mask >> digit & 1 == 1);
            waiting.extend(children.filter_map(|digit| {
                Some(WaitingNode {
                    benefit: spacing,
                    name: node.name.child(digit)?,
                    parent: Some((place, digit)),
                })
            }));
        }
    }
    Ok(chosen)
}

/// How many of a node's points the picture can show. `spacing` is the node's,
/// in pixels.
fn enough(node: &Node, spacing: f64, wanted: f64) -> u32 {
    // Points of a surface thin out by the square of the distance.
    let thinned = match node.child_mask {
        // What a leaf holds may lie closer than its spacing: as many as two
        // surfaces across it can show.
        0 => 2.0 * POISSON_DENSITY * (128.0 * spacing / wanted).powi(2),
        _ => f64::from(node.points) * (spacing / wanted).powi(2).min(1.0),
    };
    (thinned.ceil().max(64.0)).min(f64::from(node.points)) as u32
}

/// Pixels that a world unit covers where a node is nearest to a camera that
/// sees it; zero where none does.
fn pixels_a_unit(
    octree: &Octree,
    tight: &[[f64; 3]; 2],
    cameras: &[Camera],
    [width, height]: [u32; 2],
    name: NodeName,
) -> f64 {
    let (corner, sides) = octree.cube(name);
    let low: [f64; 3] = std::array::from_fn(|i| corner[i].max(tight[0][i]));
    if low[2] > tight[1][2] {
        return 0.0;
    }
    let high: [f64; 3] = std::array::from_fn(|i| (corner[i] + sides[i]).min(tight[1][i]).max(low[i]));
    let middle: [f64; 3] = std::array::from_fn(|i| (low[i] + high[i]) / 2.0);
    let half: [f64; 3] = std::array::from_fn(|i| (high[i] - low[i]) / 2.0);
    let focal = super::camera::focal(width, height);
    let slopes = [f64::from(width) / 2.0 / focal, f64::from(height) / 2.0 / focal];
    let of_camera = |camera: &Camera| {
        let at = camera.view(middle);
        // How far the box reaches along a direction of the camera.
        let along = |axis: [f64; 3]| (0..3).map(|i| axis[i].abs() * half[i]).sum::<f64>();
        let axes = [along(camera.right), along(camera.up), along(camera.forward)];
        let farthest = at[2] + axes[2];
        let outside = farthest <= 0.0
            || (0..2).any(|i| {
                // Against the two planes through the eye on either side.
                let reach = axes[i] + slopes[i] * axes[2];
                at[i].abs() - slopes[i] * at[2] > reach
            });
        if outside {
            return 0.0;
        }
        let nearest: f64 =
            (0..3).map(|i| (camera.eye[i] - camera.eye[i].clamp(low[i], high[i])).powi(2)).sum();
        focal / nearest.sqrt().max(farthest * 1e-4).max(f64::MIN_POSITIVE)
    };
    cameras.iter().map(of_camera).fold(0.0, f64::max)
}

/// The box of the points as the metadata gives it, within the root's cube.
pub fn bounds_of_points(octree: &Octree) -> [[f64; 3]; 2] {
    let root = &octree.metadata.bounding_box;
    let stated = octree.metadata.attributes.first().filter(|a| a.min.len() == 3 && a.max.len() == 3);
    let whole = [octree.world(root.min), octree.world(root.max)];
    let Some(position) = stated else { return whole };
    // Bounds of others are rounded; of degrees the spacing may be more than the cloud.
    let (metadata, reach) = (&octree.metadata, |i: usize| position.max[i] - position.min[i]);
    let margin = |i: usize| (metadata.spacing.min(reach(i)) / 128.0).max(metadata.scale[i].abs());
    let low: [f64; 3] = std::array::from_fn(|i| (position.min[i] - margin(i)).max(root.min[i]));
    let high: [f64; 3] = std::array::from_fn(|i| (position.max[i] + margin(i)).min(root.max[i]));
    match (0..3).all(|i| low[i] <= high[i]) {
        true => [octree.world(low), octree.world(high)],
        false => whole,
    }
}
