//! Finished nodes, and the blocks of bytes in which they go to the files.

use serde::{Deserialize, Serialize};

use crate::octree::node::NodeKey;

/// A finished node: where its points are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeEntry {
    pub node: NodeKey,
    pub points: u32,
    /// Bytes from the start of the file (or of the block it stands in).
    pub offset: u64,
    pub size: u64,
}

/// One of something for each file of points: for octree.bin, then for COPC.
pub type Each<T> = [T; 2];

/// The place of octree.bin, and of the COPC file, in an [`Each`].
pub const OCTREE: usize = 0;

pub const COPC: usize = 1;

/// A chunk's finished nodes for one file, one behind the other.
#[derive(Debug, Default)]
pub struct NodeBlock {
    pub bytes: Bytes,
    pub nodes: Vec<NodeEntry>,
}

/// How much of a block there is in each file.
pub fn lengths(blocks: &Each<NodeBlock>) -> Each<u64> {
    [OCTREE, COPC].map(|file| blocks[file].bytes.len() as u64)
}

/// Bytes that grow at their end, in memory that may have served before: it is
/// neither cleared nor asked of the system again.
#[derive(Debug, Default)]
pub struct Bytes {
    memory: Vec<u8>,
    end: usize,
}

impl Bytes {
    /// Room for so many more, to be filled; what is in it is of no meaning.
    pub fn room(&mut self, bytes: usize) -> &mut [u8] {
        let start = self.end;
        self.end += bytes;
        if self.memory.len() < self.end {
            self.memory.resize(self.end.next_multiple_of(1 << 16), 0);
        }
        &mut self.memory[start..self.end]
    }

    /// Makes sure that so many can come without moving what is there.
    pub fn reserve(&mut self, bytes: usize) {
        if self.memory.is_empty() {
            // Zeroed by the system, page by page, where they are used.
            self.memory = vec![0; bytes];
        }
    }

    /// The memory alone, to be filled anew.
    pub fn emptied(self) -> Bytes {
        Bytes { end: 0, ..self }
    }

    pub fn len(&self) -> usize {
        self.end
    }

    pub fn is_empty(&self) -> bool {
        self.end == 0
    }
}

impl std::ops::Deref for Bytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.memory[..self.end]
    }
}
