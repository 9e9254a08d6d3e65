//! What can be checked without the points: metadata, hierarchy, byte ranges,
//! counts.

use super::color_attributes;
use super::octree::{OctreeUnderTest, depth, points};
use super::report::{Check, Findings, plural};
use crate::format::potree::hierarchy::HierarchyWarning;
use crate::format::potree::{Metadata, Node};
use crate::words::{self, grouped};

/// Whether Lodestone made it, so that its rules bind.
pub fn is_ours(metadata: &Metadata) -> bool {
    metadata.generator.as_ref().is_some_and(|generator| generator.name == "lodestone")
}

/// The numbers of metadata.json on their own.
pub fn metadata(metadata: &Metadata) -> Check {
    let mut wrong = Findings::default();
    let mut must = |holds: bool, text: &str| {
        if !holds {
            wrong.add(0, || text.to_string());
        }
    };
    let (min, max) = (metadata.bounding_box.min, metadata.bounding_box.max);
    let sides: [f64; 3] = std::array::from_fn(|a| max[a] - min[a]);
    let numbers = [metadata.offset, metadata.scale, min, max].concat();
    must(metadata.version == "2.0", "version is not 2.0");
    must(numbers.iter().all(|n| n.is_finite()), "a box, scale or offset is not finite");
    must(metadata.scale.iter().all(|&s| s > 0.0), "a scale is not above 0");
    must(sides.iter().all(|&s| s > 0.0), "the bounding box has no extent");
    must(metadata.spacing.is_finite() && metadata.spacing > 0.0, "the spacing is not above 0");
    must(metadata.hierarchy.step_size > 0, "the hierarchy has a step size of 0");
    // As much as the rounding of the coordinates can make of it.
    let noise = 8.0 * f64::EPSILON * numbers.iter().fold(0.0, |most: f64, n| most.max(n.abs()));
    must(sides.iter().all(|s| (s - sides[0]).abs() <= noise), "the bounding box is no cube");
    let names: Vec<&str> = metadata.attributes.iter().map(|a| a.name.as_str()).collect();
    let doubled = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name));
    must(doubled.is_none(), "two attributes have the same name");
    must(
        color_attributes::are_there(metadata),
        "the averaged colours that it speaks of are not among the attributes",
    );
    let ratio = (sides[0] / metadata.spacing).round();
    let attributes = metadata.attributes.len();
    let side = words::coordinate(sides[0], metadata.scale[0]);
    let fine = format!("{attributes} attributes; cube of {side}, root spacing 1/{ratio} of it");
    Check::of("metadata", wrong, fine, "numbers of metadata.json are wrong")
}

/// Oddities of hierarchy.bin, and what metadata.json says of the tree. A
/// hierarchy that is no tree could not be opened at all.
pub fn hierarchy(octree: &OctreeUnderTest) -> Check {
    let mut wrong = Findings::default();
    for oddity in &octree.oddities {
        // The reference converter writes no mask for proxies.
        let tolerated =
            matches!(oddity, HierarchyWarning::ProxyMask { proxy: 0, .. }) && !is_ours(&octree.metadata);
        if !tolerated {
            wrong.add(0, || in_words(oddity));
        }
    }
    let (deepest, said) = (depth(&octree.nodes), octree.metadata.hierarchy.depth);
    if deepest != said {
        wrong.add(0, || format!("metadata.json says depth {said}, the deepest node has {deepest}"));
    }
    let leaves = octree.nodes.iter().filter(|node| node.child_mask == 0);
    let largest = leaves.clone().map(|leaf| leaf.points).max().unwrap_or(0);
    for leaf in leaves.clone().filter(|leaf| leaf.points == 0 && octree.nodes.len() > 1) {
        wrong.add(1, || format!("leaf {} has no points", leaf.name));
    }
    let (nodes, leaves) = (octree.nodes.len() as u64, leaves.count() as u64);
    let fine = format!(
        "{} {}, {} of them leaves of at most {} points",
        grouped(nodes),
        plural(nodes, "node", "nodes"),
        grouped(leaves),
        grouped(largest.into())
    );
    Check::of("hierarchy", wrong, fine, "faults of the hierarchy")
}

fn in_words(oddity: &HierarchyWarning) -> String {
    match oddity {
        HierarchyWarning::WrongType { node } => format!("{node}: its type and its child mask disagree"),
        HierarchyWarning::ProxyMask { node, proxy, chunk } => {
            format!("{node}: its proxy has child mask {proxy:08b}, its chunk {chunk:08b}")
        }
        HierarchyWarning::ProxyPoints { node, proxy, chunk } => {
            format!("{node}: its proxy has {proxy} points, its chunk {chunk}")
        }
        HierarchyWarning::Unused { bytes } => format!("{bytes} bytes of hierarchy.bin belong to no chunk"),
        HierarchyWarning::ProxyLevel { node } => {
            format!("{node}: a proxy, but not four levels below its chunk's root")
        }
    }
}

/// Every byte of octree.bin belongs to exactly one node, and every node's bytes
/// are in it and as many as its points take.
pub fn bytes(octree: &OctreeUnderTest) -> Check {
    let mut wrong = Findings::default();
    let mut ranges: Vec<(u64, u64, usize)> = Vec::new();
    for (index, node) in octree.nodes.iter().enumerate() {
        let Node { name, points, offset, size, .. } = *node;
        if !octree.is_readable(node) {
            wrong.add(index, || {
                format!("{name}: {points} points cannot be bytes {offset} to {offset} + {size}")
            });
        } else if size > 0 {
            ranges.push((offset, offset + size, index));
        }
    }
    ranges.sort_unstable();
    let mut end = 0;
    for (start, stop, index) in ranges {
        let name = octree.nodes[index].name;
        if start < end {
            wrong.add(index, || format!("{name}: its bytes from {start} on are also another node's"));
        } else if start > end {
            wrong.add(index, || format!("bytes {end} to {start} belong to no node"));
        }
        end = end.max(stop);
    }
    if end < octree.bytes {
        wrong.add(octree.nodes.len(), || format!("bytes {end} to {} belong to no node", octree.bytes));
    }
    let fine = format!("each of {} bytes belongs to one node", grouped(octree.bytes));
    Check::of("bytes", wrong, fine, "faults of byte ranges in octree.bin")
}

/// The nodes' points add up to what metadata.json says.
pub fn counts(octree: &OctreeUnderTest) -> Check {
    let sum = points(&octree.nodes);
    let said = octree.metadata.points;
    match sum == said {
        true => Check::ok("points", format!("{} points, as metadata.json says", grouped(sum))),
        false => Check::wrong(
            "points",
            format!("metadata.json says {} points, the nodes hold {}", grouped(said), grouped(sum)),
        ),
    }
}
