//! The hierarchy in pages of bounded size: a viewer of ten million nodes reads those that
//! it looks at.
//!
//! A page is the subtree of one node, breadth first, until it is full. A node is six bytes:
//! a bit for each child, flags, and its points as a little-endian `u32`. The children of a
//! node with the flag [`ELSEWHERE`] are in the page of that node; all others follow in
//! their order. Names are not written: they follow from the order.

use std::collections::VecDeque;

use crate::format::potree::{Node, NodeName};
use crate::render::error::Result;
use crate::render::octree::Octree;

/// Nodes of a page at most, so that one is six kilobytes.
pub const MAX_NODES: usize = 1024;
/// Bytes of a node.
pub const RECORD: usize = 6;
/// Flag of a node whose children are in a page of their own.
pub const ELSEWHERE: u8 = 1;

/// The page of a node; nothing where there is no such node.
///
/// # Errors
/// Where the hierarchy is damaged or cannot be read.
pub fn page(octree: &mut Octree, root: NodeName) -> Result<Option<Vec<u8>>> {
    bounded_page(octree, root, MAX_NODES)
}

/// The same with other pages than usual, of at least nine nodes.
///
/// # Errors
/// As for [`page`].
pub fn bounded_page(octree: &mut Octree, root: NodeName, max_nodes: usize) -> Result<Option<Vec<u8>>> {
    let Some(root) = octree.node(root)? else { return Ok(None) };
    let mut bytes = Vec::new();
    let mut waiting = VecDeque::from([root]);
    let mut nodes = 1;
    while let Some(node) = waiting.pop_front() {
        let wanted = node.child_mask.count_ones() as usize;
        // The root's children are always here, or its page would lead nowhere.
        let is_full = nodes + wanted > max_nodes && !bytes.is_empty();
        let (mut mask, mut flags) = (node.child_mask, 0);
        if is_full && wanted > 0 {
            flags = ELSEWHERE;
        } else {
            let children = children(octree, &node)?;
            mask = children.iter().fold(0, |mask, child| mask | 1 << child.name.digit());
            nodes += children.len();
            waiting.extend(children);
        }
        bytes.extend([mask, flags]);
        bytes.extend(node.points.to_le_bytes());
    }
    Ok(Some(bytes))
}

/// The children that there are; a mask may promise more.
fn children(octree: &mut Octree, node: &Node) -> Result<Vec<Node>> {
    let mut children = Vec::new();
    for digit in (0..8).filter(|digit| node.child_mask >> digit & 1 == 1) {
        let Some(name) = node.name.child(digit) else { continue };
        children.extend(octree.node(name)?);
    }
    Ok(children)
}
