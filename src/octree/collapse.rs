//! Which nodes of an octree become one: where a subtree holds few points, a file
//! whose chunks are compressed one by one is smaller and quicker to write with all
//! of it in one leaf. Coarser nodes stay as they are.
//!
//! Nodes come in as the tree gives them, children before parents. A subtree is
//! final when its parent is known to stay, for until then it may join its parent.

use std::collections::HashMap;

use crate::octree::node::NodeKey;

/// Points that a leaf holds at most, as those of PDAL and untwine. A node whose own
/// points are more (as where many share a position) is not divided for it.
pub const MAX_POINTS: usize = 100_000;
/// Levels of the octree that a leaf takes in at most: viewers that show few points
/// have to load all of a leaf.
pub const MAX_LEVELS: u8 = 3;

/// Nodes that were taken in and whose parents were not.
#[derive(Debug, Default)]
pub struct Collapse {
    waiting: HashMap<NodeKey, Subtree>,
}

#[derive(Debug)]
enum Subtree {
    /// Small enough for a leaf so far: its levels, and the indices of its points.
    Small(u8, Vec<u32>),
    /// Its nodes stay apart, and are final.
    Large,
}

/// A node that is final, and the indices of its points in no order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Final {
    pub node: NodeKey,
    pub indices: Vec<u32>,
}

/// What becomes of the nodes below a tree's root.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Below {
    /// All their points join the root.
    Joins(Vec<u32>),
    /// These are final, beside those that already were, and so is what is above them.
    Stays(Vec<Final>),
}

impl Collapse {
    /// Takes in a node with its own points, after its children. Gives what is final
    /// by that, the node itself last if it stays.
    pub fn add(&mut self, node: NodeKey, own: impl ExactSizeIterator<Item = u32>) -> Vec<Final> {
        match self.below(node, own.len()) {
            (levels, Below::Joins(mut indices)) => {
                indices.extend(own);
                self.waiting.insert(node, Subtree::Small(levels + 1, indices));
                Vec::new()
            }
            (_, Below::Stays(mut finals)) => {
                finals.push(Final { node, indices: own.collect() });
                self.waiting.insert(node, Subtree::Large);
                finals
            }
        }
    }

    /// The root of the tree, of which some points may yet leave it for nodes above.
    /// Nothing is waiting any more.
    pub fn end(&mut self, root: NodeKey, own_points: usize) -> Below {
        let (_, below) = self.below(root, own_points);
        self.waiting.clear();
        below
    }

    /// Decides on the children of a node with so many points of its own. Gives the
    /// levels below it, if they join.
    fn below(&mut self, node: NodeKey, own_points: usize) -> (u8, Below) {
        let (mut points, mut deepest, mut joins) = (own_points, 0, true);
        let mut children = Vec::new();
        for index in 0..8 {
            match self.waiting.remove(&node.child(index)) {
                None => {}
                Some(Subtree::Large) => joins = false,
                Some(Subtree::Small(levels, indices)) => {
                    points += indices.len();
                    deepest = deepest.max(levels);
                    children.push(Final { node: node.child(index), indices });
                }
            }
        }
        // A node without any below it is a leaf already, whatever it holds.
        let is_leaf = joins && children.is_empty();
        if is_leaf || joins && points <= MAX_POINTS && deepest < MAX_LEVELS {
            let indices = children.into_iter().flat_map(|child| child.indices).collect();
            return (deepest, Below::Joins(indices));
        }
        (deepest, Below::Stays(children))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A tree as it is given: nodes with their own points, children first.
    fn walk(
        node: NodeKey,
        points: &mut dyn FnMut(NodeKey) -> Option<usize>,
        out: &mut Vec<(NodeKey, usize)>,
    ) {
        let Some(own) = points(node) else { return };
        (0..8).for_each(|index| walk(node.child(index), points, out));
        out.push((node, own));
    }

    #[test]
    fn three_levels_join_and_a_fourth_does_not() {
        let chain: Vec<NodeKey> =
            std::iter::successors(Some(NodeKey::ROOT), |n| Some(n.child(3))).take(5).collect();
        let mut collapse = Collapse::default();
        let mut finals = Vec::new();
        for (node, index) in chain[1..].iter().rev().zip(0u32..) {
            finals.extend(collapse.add(*node, [index].into_iter()));
        }
        // Of four nodes in a row the lower three are a leaf.
        let leaf = Final { node: chain[2], indices: vec![0, 1, 2] };
        assert_eq!(finals, [leaf, Final { node: chain[1], indices: vec![3] }]);
        assert_eq!(collapse.end(NodeKey::ROOT, 1), Below::Stays(vec![]));
    }

    #[test]
    fn a_crowded_leaf_stays_whole_and_joins_nothing() {
        let mut collapse = Collapse::default();
        let (crowd, few) = (NodeKey::ROOT.child(0), NodeKey::ROOT.child(1));
        assert!(collapse.add(crowd, 0..MAX_POINTS as u32 + 1).is_empty());
        assert!(collapse.add(few, 0..1).is_empty());
        let Below::Stays(leaves) = collapse.end(NodeKey::ROOT, 1) else { panic!("too many points") };
        assert_eq!(leaves.iter().map(|leaf| leaf.indices.len()).collect::<Vec<_>>(), [MAX_POINTS + 1, 1]);
        // At the bound all of it is one.
        collapse.add(crowd, 0..MAX_POINTS as u32 - 2);
        collapse.add(few, 0..1);
        assert!(matches!(collapse.end(NodeKey::ROOT, 1), Below::Joins(all) if all.len() == MAX_POINTS - 1));
    }

    proptest! {
        /// Every point is in one node that is final or joins the root; a leaf made of
        /// several nodes keeps both bounds, and its parent would break one.
        #[test]
        fn leaves_are_the_largest_within_their_bounds(
            shape in proptest::collection::vec((0usize..3, 0usize..40_000), 1..80),
        ) {
            let mut rest = shape.iter();
            let mut own = |node: NodeKey| {
                let (kind, points) = rest.next()?;
                (node.level == 0 || (*kind > 0 && node.level < 6)).then_some(*points)
            };
            let mut nodes = Vec::new();
            walk(NodeKey::ROOT, &mut own, &mut nodes);
            let (root_node, root_points) = nodes.pop().unwrap();
            let mut collapse = Collapse::default();
            let (mut finals, mut next) = (Vec::new(), 0u32);
            let mut ranges = HashMap::new();
            for (node, points) in &nodes {
                let range = next..next + *points as u32;
                next = range.end;
                ranges.insert(*node, range.clone());
                finals.extend(collapse.add(*node, range));
            }
            let joined = match collapse.end(root_node, root_points) {
                Below::Joins(indices) => indices,
                Below::Stays(more) => { finals.extend(more); Vec::new() }
            };
            let mut seen: Vec<u32> = finals.iter().flat_map(|f| f.indices.clone()).chain(joined).collect();
            seen.sort_unstable();
            prop_assert!(seen.into_iter().eq(0..next));
            let lies_in = |node: &NodeKey, above: &NodeKey|
                node.level >= above.level && node.ancestor(above.level) == *above;
            let measure = |above: &NodeKey| {
                let below = nodes.iter().filter(|(node, _)| lies_in(node, above));
                let (mut points, mut deepest) = (0, above.level);
                for (node, own) in below { points += own; deepest = deepest.max(node.level); }
                (points, deepest - above.level + 1)
            };
            let fits = |node: &NodeKey| {
                let (points, levels) = measure(node);
                levels == 1 || points <= MAX_POINTS && levels <= MAX_LEVELS
            };
            for Final { node, indices } in &finals {
                let mut indices = indices.clone();
                indices.sort_unstable();
                if indices.len() == measure(node).0 && fits(node) {
                    let parent = node.parent().unwrap();
                    if parent.level > 0 { prop_assert!(!fits(&parent), "{node} could have joined {parent}"); }
                } else {
                    prop_assert!(indices.into_iter().eq(ranges[node].clone()), "{node} keeps its own points");
                }
            }
        }
    }
}
