//! Nodes: which cube of the octree is meant, and what it is called.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Points of a leaf, by default ("Fast Out-of-Core Octree Generation", 4.2): what
/// holds more is divided.
pub const LEAF_LIMIT: usize = 10_000;

/// A node of the octree: `level` steps below the root, at integer coordinates
/// among the 2^level cubes of that level on each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct NodeKey {
    pub level: u8,
    pub at: [u32; 3],
}

impl NodeKey {
    pub const ROOT: NodeKey = NodeKey { level: 0, at: [0; 3] };

    /// Child `index` (0 to 7): bit 2 is x, bit 1 y, bit 0 z, as in Potree.
    pub fn child(self, index: u8) -> NodeKey {
        let [x, y, z] = self.at;
        NodeKey {
            level: self.level + 1,
            at: [
                x << 1 | u32::from(index >> 2 & 1),
                y << 1 | u32::from(index >> 1 & 1),
                z << 1 | u32::from(index & 1),
            ],
        }
    }

    pub fn parent(self) -> Option<NodeKey> {
        let level = self.level.checked_sub(1)?;
        Some(NodeKey { level, at: self.at.map(|c| c >> 1) })
    }

    /// The node of a coarser level that this one lies in; itself at its own level.
    ///
    /// # Panics
    /// Where `level` is below this node's.
    pub fn ancestor(self, level: u8) -> NodeKey {
        NodeKey { level, at: self.at.map(|c| c >> (self.level - level)) }
    }

    /// Which child of its parent this is.
    pub fn index_in_parent(self) -> u8 {
        let [x, y, z] = self.at;
        ((x & 1) << 2 | (y & 1) << 1 | z & 1) as u8
    }

    /// The node's path from the root, a digit 0 to 7 a level.
    pub fn digits(self) -> impl Iterator<Item = u8> {
        let [x, y, z] = self.at;
        (0..self.level).rev().map(move |bit| ((x >> bit & 1) << 2 | (y >> bit & 1) << 1 | z >> bit & 1) as u8)
    }
}

impl fmt::Display for NodeKey {
    /// The name viewers use: `r` and the digits.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("r")?;
        self.digits().try_for_each(|digit| write!(f, "{digit}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_follow_potree() {
        let node = NodeKey::ROOT.child(0).child(6).child(3);
        assert_eq!(node.to_string(), "r063");
        assert_eq!(node.index_in_parent(), 3);
        assert_eq!(node.parent(), Some(NodeKey::ROOT.child(0).child(6)));
        assert_eq!(NodeKey::ROOT.child(4).at, [1, 0, 0]);
        assert_eq!(NodeKey::ROOT.parent(), None);
        assert_eq!([3, 2, 0].map(|level| node.ancestor(level).to_string()), ["r063", "r06", "r"]);
    }
}
