//! What a sampling strategy is ("Fast Out-of-Core Octree Generation",
//! section 5): from the points of a node's children it picks those that the
//! node itself shows.

use crate::octree::cube::NodeCube;
use crate::octree::node::NodeKey;

/// A point on its way through the tree: where it lies, and which it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(C)]
pub struct IndexedPoint {
    /// Tree coordinates.
    pub at: [u32; 3],
    /// The point's number among those of its chunk, in input order.
    pub index: u32,
}

/// Samples of a node that lie near its faces.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BorderSamples {
    pub node: NodeKey,
    /// Tree coordinates.
    pub samples: Vec<[u32; 3]>,
}

/// Picks samples. Candidates come in Morton order, each child's together and its
/// cells at the node's spacing too. Deterministic: the choice depends on the candidates, their
/// order and the node alone (and, for samplers that honour neighbours, on the
/// nodes of the same level that were sampled before in this tree, or handed over
/// when it began).
pub trait Sampler {
    /// Decides for each candidate, in the order given, whether the node takes
    /// it: `taken` gets one flag a candidate.
    fn sample(
        &mut self,
        node: NodeKey,
        frame: NodeCube,
        candidates: &[&[IndexedPoint]],
        taken: &mut Vec<bool>,
    );

    /// A new tree begins: nothing is known any more but the nodes around it that
    /// are to be honoured.
    fn begin(&mut self, _around: Vec<BorderSamples>) {}

    /// The tree is done. Returns what trees beside it are to honour: the samples
    /// along the faces of its root, whose frame this is.
    fn end(&mut self, _root: NodeKey, _frame: NodeCube) -> Vec<BorderSamples> {
        Vec::new()
    }
}
