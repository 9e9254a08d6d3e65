//! octree.bin while it is written. Chunks come from several threads in any
//! order; each gets its place as soon as all chunks before it have theirs, so
//! the file is the same whatever the threads did, has no holes, and is never
//! copied. (The design asks for regions of known size; but what rises above a
//! chunk, and what brotli saves, is only known when the chunk is done.)

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex};

use super::error::{Result, StageError};
use crate::cloud::node::NodeKey;
use crate::disk::DiskFile;

/// A finished node: where its points are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeEntry {
    pub node: NodeKey,
    pub points: u32,
    /// Bytes from the start of octree.bin (or of the block it stands in).
    pub offset: u64,
    pub size: u64,
}

/// A chunk's finished nodes, one behind the other.
#[derive(Debug, Default)]
pub struct Block {
    pub bytes: Vec<u8>,
    pub nodes: Vec<NodeEntry>,
}

#[derive(Default)]
struct State {
    /// The block that gets the next place, and that place.
    next: usize,
    end: u64,
    /// Blocks that wait for their place.
    waiting: BTreeMap<usize, Block>,
    waiting_bytes: u64,
    nodes: Vec<NodeEntry>,
    failed: bool,
}

/// The file, and who writes where.
pub struct OctreeFile {
    file: DiskFile,
    /// Bytes that may wait in memory before threads are held back.
    most_waiting: u64,
    state: Mutex<State>,
    moved: Condvar,
}

impl OctreeFile {
    pub fn new(file: DiskFile, most_waiting: u64) -> OctreeFile {
        OctreeFile { file, most_waiting, state: Mutex::default(), moved: Condvar::new() }
    }

    /// Hands in the block of a number; each number from 0 on comes once. Holds
    /// the caller back while too much waits, unless it brings the block that
    /// everybody waits for.
    pub fn submit(&self, number: usize, block: Block) -> Result<()> {
        let mut state = self.state.lock().unwrap_or_else(|e| e.into_inner());
        while number != state.next && state.waiting_bytes > self.most_waiting && !state.failed {
            state = self.moved.wait(state).unwrap_or_else(|e| e.into_inner());
        }
        state.waiting_bytes += block.bytes.len() as u64;
        state.waiting.insert(number, block);
        // Place what can be placed, write it outside the lock.
        let mut ready = Vec::new();
        while let Some(block) = {
            let next = state.next;
            state.waiting.remove(&next)
        } {
            let at = state.end;
            state.next += 1;
            state.end += block.bytes.len() as u64;
            state.waiting_bytes -= block.bytes.len() as u64;
            state.nodes.extend(block.nodes.iter().map(|n| NodeEntry { offset: n.offset + at, ..*n }));
            ready.push((at, block.bytes));
        }
        drop(state);
        self.moved.notify_all();
        for (at, bytes) in ready {
            if let Err(error) = self.file.write_all_at(&bytes, at) {
                self.fail();
                return Err(error.into());
            }
        }
        Ok(())
    }

    /// Lets go of all who wait; called when a thread fails and its block will
    /// never come.
    pub fn fail(&self) {
        self.state.lock().unwrap_or_else(|e| e.into_inner()).failed = true;
        self.moved.notify_all();
    }

    /// Makes the file last; gives all nodes and the file's length.
    pub fn finish(self) -> Result<(Vec<NodeEntry>, u64)> {
        self.file.sync()?;
        let state = self.state.into_inner().unwrap_or_else(|e| e.into_inner());
        if !state.waiting.is_empty() {
            return Err(StageError::Inconsistent(format!("block {} never came", state.next)));
        }
        Ok((state.nodes, state.end))
    }
}
