//! One chunk's octree, built in memory ("Fast Out-of-Core Octree Generation",
//! 4.2): a hierarchical counting sort brings the points into leaves of at most
//! `leaf_limit` points, several levels at once; each leaf is brought into Morton
//! order, and so is all that follows; then coarser nodes are sampled from their
//! children, bottom up.
//!
//! A node is divided exactly where it holds more points than a leaf may, so the
//! tree's shape does not depend on how the cloud was cut into chunks. Recursion
//! always ends: at the cube's deepest level a node is one position, and a leaf
//! whatever it holds. A crowd there may be thinned to a leaf's worth; then it is
//! joined with the leaves around it, so that no chain of levels leads down to it.

use super::node_limit::{NODE_LIMIT, thin};
use super::node_order;
use super::sampling::sampler::{BorderSamples, IndexedPoint, Sampler};
use crate::octree::cube::NodeCube;
use crate::octree::node::NodeKey;

/// Levels that one counting sort divides at most: 32³ cells.
const SPLIT_LEVELS: u32 = 5;

/// Receives each node once its points are final, children before parents.
pub trait NodeSink {
    type Error;
    /// A node's sample was chosen: which of the candidates (its children's points)
    /// it takes, before any of them is moved. `has_below` says whether there are
    /// nodes below the children.
    fn sampled(
        &mut self,
        _frame: NodeCube,
        _has_below: bool,
        _candidates: &[&[IndexedPoint]],
        _taken: &[bool],
    ) {
    }
    /// A node that holds points or has children. `items` are the node's own, in
    /// Morton order.
    fn node(&mut self, node: NodeKey, frame: NodeCube, items: &[IndexedPoint]) -> Result<(), Self::Error>;
}

/// Builds trees, one chunk after the other, with one sampler.
pub struct LocalOctreeBuilder<'s, E: NodeSink> {
    /// Bits of the root cube.
    pub bits: u32,
    pub leaf_limit: usize,
    pub sampler: &'s mut dyn Sampler,
    pub emit: E,
    /// Whether a position keeps no more than a leaf's worth of points.
    pub thin_crowds: bool,
    /// Samples around the tree that it is to honour.
    pub around: Vec<BorderSamples>,
    /// Indices of what was kept out for it: the last of each crowd.
    pub aside: Vec<u32>,
    taken: Vec<bool>,
}

/// A node's points: where the sort left them, or those it sampled.
enum NodePoints<'a> {
    Sorted(&'a mut [IndexedPoint]),
    Sampled(Vec<IndexedPoint>),
}

impl NodePoints<'_> {
    fn items(&mut self) -> &mut [IndexedPoint] {
        match self {
            NodePoints::Sorted(items) => items,
            NodePoints::Sampled(items) => items,
        }
    }
}

/// A node whose parent has not sampled it yet.
struct UnsampledNode<'a> {
    node: NodeKey,
    set: NodePoints<'a>,
    has_children: bool,
    /// Whether it is the leaf of a crowd that was thinned.
    crowded: bool,
}

/// What a chunk's root holds before the levels above have sampled it.
pub struct Root {
    pub items: Vec<IndexedPoint>,
    pub has_children: bool,
    pub crowded: bool,
    /// Samples along its faces, of all levels.
    pub rims: Vec<BorderSamples>,
}

/// Whether leaves become one leaf: where a crowd was thinned, a chain of levels
/// led down to its position, one around the other, and what is left of it is no
/// reason for them any more. `children` are points, whether there are nodes
/// below, whether it is crowded.
pub fn is_hollow(leaf_limit: usize, children: impl Iterator<Item = (usize, bool, bool)>) -> bool {
    let (mut points, mut crowded) = (0, false);
    for (own, has_children, is_crowded) in children {
        if has_children {
            return false;
        }
        points += own;
        crowded |= is_crowded;
    }
    crowded && points <= 2 * leaf_limit
}

impl<'s, E: NodeSink> LocalOctreeBuilder<'s, E> {
    pub fn new(bits: u32, leaf_limit: usize, sampler: &'s mut dyn Sampler, emit: E) -> Self {
        LocalOctreeBuilder {
            bits,
            leaf_limit,
            sampler,
            emit,
            thin_crowds: false,
            around: Vec::new(),
            aside: Vec::new(),
            taken: Vec::new(),
        }
    }

    /// Builds the tree below `node` from all of its points (`spare` is room for
    /// as many). All nodes but the root are emitted.
    pub fn build(
        &mut self,
        node: NodeKey,
        items: &mut [IndexedPoint],
        spare: &mut [IndexedPoint],
    ) -> Result<Root, E::Error> {
        self.sampler.begin(std::mem::take(&mut self.around));
        let mut grown = self.grow(node, items, spare)?;
        let items = match grown.set {
            NodePoints::Sampled(items) => items,
            NodePoints::Sorted(_) => grown.set.items().to_vec(),
        };
        let rims = self.sampler.end(node, NodeCube::of(self.bits, node));
        Ok(Root { items, has_children: grown.has_children, crowded: grown.crowded, rims })
    }

    fn is_leaf(&self, node: NodeKey, points: usize) -> bool {
        points <= self.leaf_limit || u32::from(node.level) >= self.bits
    }

    fn grow<'a>(
        &mut self,
        node: NodeKey,
        items: &'a mut [IndexedPoint],
        spare: &'a mut [IndexedPoint],
    ) -> Result<UnsampledNode<'a>, E::Error> {
        if self.is_leaf(node, items.len()) {
            return Ok(self.leaf(node, items, spare));
        }
        let levels = self.split_levels(node, items.len());
        let shift = self.bits - u32::from(node.level) - levels;
        let starts = sort_into_cells(items, spare, shift, levels);
        self.grow_cells(node, levels, &starts, spare, items)
    }

    /// A leaf; where that is a single position, a crowd there may be too much.
    fn leaf<'a>(
        &mut self,
        node: NodeKey,
        items: &'a mut [IndexedPoint],
        spare: &mut [IndexedPoint],
    ) -> UnsampledNode<'a> {
        let kept = if self.thin_crowds { items.len().min(self.leaf_limit) } else { items.len() };
        // The sort is stable: what came first stays.
        let (items, aside) = items.split_at_mut(kept);
        self.aside.extend(aside.iter().map(|item| item.index));
        node_order::sort(NodeCube::of(self.bits, node), items, &mut spare[..kept]);
        UnsampledNode {
            node,
            set: NodePoints::Sorted(items),
            has_children: false,
            crowded: !aside.is_empty(),
        }
    }

    /// How many levels to divide at once: a surface loses three quarters of a
    /// node's points a level, and one level more finds the denser places.
    fn split_levels(&self, node: NodeKey, points: usize) -> u32 {
        let quarters = (points / self.leaf_limit.max(1)).max(1).ilog2() / 2;
        (quarters + 2).min(SPLIT_LEVELS).min(self.bits - u32::from(node.level))
    }

    /// Grows a node from items that are sorted into the cells `levels` below
    /// it; `starts` are the cells' first items, relative to the slice's own.
    fn grow_cells<'a>(
        &mut self,
        node: NodeKey,
        levels: u32,
        starts: &[u32],
        items: &'a mut [IndexedPoint],
        spare: &'a mut [IndexedPoint],
    ) -> Result<UnsampledNode<'a>, E::Error> {
        if self.is_leaf(node, items.len()) {
            return Ok(self.leaf(node, items, spare));
        }
        if levels == 0 {
            return self.grow(node, items, spare);
        }
        let cells = 1usize << (3 * (levels - 1));
        let (mut items, mut spare) = (items, spare);
        let mut children = Vec::with_capacity(8);
        for index in 0..8 {
            let of_child = &starts[usize::from(index) * cells..][..=cells];
            let points = (of_child[cells] - of_child[0]) as usize;
            let (child_items, rest) = items.split_at_mut(points);
            let (child_spare, spare_rest) = spare.split_at_mut(points);
            (items, spare) = (rest, spare_rest);
            if points > 0 {
                let child = node.child(index);
                children.push(self.grow_cells(child, levels - 1, of_child, child_items, child_spare)?);
            }
        }
        self.sample(node, children)
    }

    /// Samples a node from its children, which are then final.
    fn sample<'a>(
        &mut self,
        node: NodeKey,
        mut children: Vec<UnsampledNode<'a>>,
    ) -> Result<UnsampledNode<'a>, E::Error> {
        let leaves = children.iter_mut().map(|c| (c.set.items().len(), c.has_children, c.crowded));
        if is_hollow(self.leaf_limit, leaves) {
            let items = children.iter_mut().flat_map(|c| c.set.items().iter().copied()).collect();
            return Ok(UnsampledNode {
                node,
                set: NodePoints::Sampled(items),
                has_children: false,
                crowded: true,
            });
        }
        let has_below = children.iter().any(|c| c.has_children);
        let candidates: Vec<&[IndexedPoint]> = children.iter_mut().map(|c| &*c.set.items()).collect();
        let frame = NodeCube::of(self.bits, node);
        self.sampler.sample(node, frame, &candidates, &mut self.taken);
        thin(NODE_LIMIT, &mut self.taken);
        self.emit.sampled(frame, has_below, &candidates, &self.taken);
        let mut accepted = Vec::with_capacity(self.taken.iter().filter(|t| **t).count() + 1);
        let mut rest = self.taken.as_slice();
        let mut kept = Vec::with_capacity(children.len());
        for child in &mut children {
            let items = child.set.items();
            let (taken, behind) = rest.split_at(items.len());
            kept.push(move_taken(items, taken, &mut accepted));
            rest = behind;
        }
        let mut has_children = false;
        for (mut child, kept) in children.into_iter().zip(kept) {
            if kept > 0 || child.has_children {
                has_children = true;
                let frame = NodeCube::of(self.bits, child.node);
                self.emit.node(child.node, frame, &child.set.items()[..kept])?;
            }
        }
        Ok(UnsampledNode { node, set: NodePoints::Sampled(accepted), has_children, crowded: false })
    }
}

/// Moves the taken items to the end of `accepted` and closes the gaps they leave;
/// returns how many stay. Order is kept on both sides.
///
/// About every other item is taken, by no pattern, so there is no branch to be
/// guessed wrong: each is written to both places and then counted in one.
pub fn move_taken(items: &mut [IndexedPoint], taken: &[bool], accepted: &mut Vec<IndexedPoint>) -> usize {
    let (mut kept, mut end) = (0, accepted.len());
    // One more than fits: where an item that stays is written for nothing.
    accepted.resize(end + taken.iter().filter(|t| **t).count() + 1, IndexedPoint::default());
    for i in 0..items.len() {
        let item = items[i];
        items[kept] = item;
        accepted[end] = item;
        kept += usize::from(!taken[i]);
        end += usize::from(taken[i]);
    }
    accepted.truncate(end);
    kept
}

/// Every fifth-bit number with its bits spread to every third.
const SPREAD: [u16; 1 << SPLIT_LEVELS] = {
    let mut table = [0; 1 << SPLIT_LEVELS];
    let mut v = 0;
    while v < table.len() {
        let mut bit = 0;
        while bit < SPLIT_LEVELS {
            table[v] |= ((v >> bit & 1) as u16) << (3 * bit);
            bit += 1;
        }
        v += 1;
    }
    table
};

/// Counting sort of `items` into `sorted` by the cell `levels` below their node,
/// in Morton order (child digits); stable. Returns where each cell starts.
fn sort_into_cells(items: &[IndexedPoint], sorted: &mut [IndexedPoint], shift: u32, levels: u32) -> Vec<u32> {
    let mask = (1u32 << levels) - 1;
    let cell = |at: [u32; 3]| {
        let [x, y, z] = at.map(|c| usize::from(SPREAD[(c >> shift & mask) as usize]));
        x << 2 | y << 1 | z
    };
    let mut starts = vec![0u32; (1 << (3 * levels)) + 1];
    for item in items {
        starts[cell(item.at) + 1] += 1;
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    let mut next = starts.clone();
    for item in items {
        let slot = &mut next[cell(item.at)];
        sorted[*slot as usize] = *item;
        *slot += 1;
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::super::sampling::poisson::PoissonDisk;
    use super::super::sampling::random_in_grid::RandomInGrid;
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    #[derive(Default)]
    struct Collect(HashMap<NodeKey, Vec<IndexedPoint>>);

    impl NodeSink for Collect {
        type Error = std::convert::Infallible;
        fn node(&mut self, node: NodeKey, _: NodeCube, items: &[IndexedPoint]) -> Result<(), Self::Error> {
            assert!(self.0.insert(node, items.to_vec()).is_none(), "{node} emitted twice");
            Ok(())
        }
    }

    fn tree(
        points: &[[u32; 3]],
        bits: u32,
        leaf: usize,
        sampler: &mut dyn Sampler,
    ) -> HashMap<NodeKey, Vec<IndexedPoint>> {
        let mut items: Vec<IndexedPoint> =
            points.iter().enumerate().map(|(i, at)| IndexedPoint { at: *at, index: i as u32 }).collect();
        let mut spare = items.clone();
        let mut builder = LocalOctreeBuilder::new(bits, leaf, sampler, Collect::default());
        let root = builder.build(NodeKey::ROOT, &mut items, &mut spare).unwrap();
        let mut nodes = builder.emit.0;
        nodes.insert(NodeKey::ROOT, root.items);
        nodes
    }

    fn squared(a: [u32; 3], b: [u32; 3]) -> u64 {
        (0..3).map(|i| (i64::from(a[i]) - i64::from(b[i])).pow(2) as u64).sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        /// Every point is in exactly one node, which holds it; every parent
        /// exists; a leaf above the deepest level is within its limit; and with
        /// Poisson no two points of a level's inner nodes are closer than the
        /// level's spacing, across nodes too.
        #[test]
        fn the_tree_keeps_every_point_and_its_distance(
            points in proptest::collection::vec(
                prop_oneof![(0u32..512, 0u32..512, 0u32..8), (100u32..104, 200u32..203, 3u32..4)], 1..1500),
            leaf in 1usize..60,
            random in any::<bool>(),
        ) {
            let points: Vec<[u32; 3]> = points.into_iter().map(|(x, y, z)| [x, y, z]).collect();
            let bits = 9;
            let nodes = if random {
                tree(&points, bits, leaf, &mut RandomInGrid)
            } else {
                tree(&points, bits, leaf, &mut PoissonDisk::default())
            };
            let mut seen = vec![false; points.len()];
            let has_child = |n: &NodeKey| (0..8).any(|i| nodes.contains_key(&n.child(i)));
            for (node, items) in &nodes {
                for item in items {
                    prop_assert!(!std::mem::replace(&mut seen[item.index as usize], true));
                    prop_assert_eq!(points[item.index as usize], item.at);
                    prop_assert_eq!(item.at.map(|c| c >> (bits - u32::from(node.level))), node.at);
                }
                if let Some(parent) = node.parent() {
                    prop_assert!(nodes.contains_key(&parent));
                }
                if !has_child(node) {
                    prop_assert!(!items.is_empty() || node.level == 0);
                }
                // A node above the limit was divided, but may have taken all of
                // its children's points: then they keep its spacing.
                if !random && !has_child(node) && items.len() > leaf && u32::from(node.level) < bits {
                    let spacing = 1u64 << (bits - u32::from(node.level)).saturating_sub(7);
                    for (i, a) in items.iter().enumerate() {
                        prop_assert!(items[..i].iter().all(|b| squared(a.at, b.at) >= spacing * spacing));
                    }
                }
            }
            prop_assert!(seen.iter().all(|s| *s));
            if !random {
                for level in 0..bits as u8 {
                    let spacing = 1u64 << (bits - u32::from(level)).saturating_sub(7);
                    let shown: Vec<[u32; 3]> = nodes.iter()
                        .filter(|(n, _)| n.level == level && has_child(n))
                        .flat_map(|(_, items)| items.iter().map(|i| i.at)).collect();
                    for (i, a) in shown.iter().enumerate() {
                        for b in &shown[..i] {
                            prop_assert!(squared(*a, *b) >= spacing * spacing, "level {level}: {a:?} {b:?}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_crowd_at_one_position_ends_in_a_leaf() {
        let nodes = tree(&[[77, 3, 500]; 5000], 9, 10, &mut PoissonDisk::default());
        assert_eq!(nodes.values().map(Vec::len).sum::<usize>(), 5000);
        assert_eq!(nodes.keys().map(|n| n.level).max(), Some(9));
    }
}
