//! octree.bin while it is written. Chunks come from several threads in any
//! order; each gets its place as soon as all chunks before it have theirs, so
//! the file is the same whatever the threads did, has no holes, and is never
//! copied. (The design asks for regions of known size; but what rises above a
//! chunk, and what brotli saves, is only known when the chunk is done.)
//!
//! In core, blocks wait for their turn in memory. Out of core they wait in the
//! scratch, with their receipt: what is done is done, whose turn it may be.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};

use super::error::{Result, StageError};
use super::receipt::{Built, Receipt};
use super::scratch::Scratch;
use crate::cloud::node::NodeKey;
use crate::disk::DiskFile;

/// A finished node: where its points are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
    pub bytes: Bytes,
    pub nodes: Vec<NodeEntry>,
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

/// A block that waits for its place, or has just got it.
enum Content {
    /// In memory; with the receipt to be given when it is written.
    Here(Bytes, Option<Built>),
    /// In the scratch, receipted.
    Spilled(u64),
    /// At this place already, since an earlier run.
    Written { at: u64, bytes: u64 },
}

impl Content {
    fn bytes(&self) -> u64 {
        match self {
            Content::Here(bytes, _) => bytes.len() as u64,
            Content::Spilled(bytes) | Content::Written { bytes, .. } => *bytes,
        }
    }
}

#[derive(Default)]
struct State {
    /// The block that gets the next place, and that place.
    next: usize,
    end: u64,
    /// Blocks that wait for their place.
    waiting: BTreeMap<usize, (Content, Vec<NodeEntry>)>,
    waiting_bytes: u64,
    nodes: Vec<NodeEntry>,
    failed: bool,
}

/// The file, and who writes where.
pub struct OctreeFile {
    file: Arc<DiskFile>,
    scratch: Option<Arc<Scratch>>,
    /// Bytes that may wait in memory before threads are held back.
    most_waiting: u64,
    state: Mutex<State>,
    moved: Condvar,
    /// Memory of blocks that are written, for those to come.
    used: Mutex<Vec<Bytes>>,
}

/// Blocks whose memory is kept: one for each of a few threads.
const MOST_USED: usize = 4;

impl OctreeFile {
    pub fn new(file: DiskFile, scratch: Option<Arc<Scratch>>, most_waiting: u64) -> OctreeFile {
        let file = Arc::new(file);
        if let Some(scratch) = &scratch {
            scratch.vouch_for(file.clone());
        }
        OctreeFile {
            file,
            scratch,
            most_waiting,
            state: Mutex::default(),
            moved: Condvar::new(),
            used: Mutex::default(),
        }
    }

    /// An empty block.
    pub fn block(&self) -> Block {
        let bytes = self.used().pop().unwrap_or_default();
        Block { bytes, nodes: Vec::new() }
    }

    /// Hands in the block of a number; each number from 0 on comes once. With a
    /// receipt, it is given when the block is safe. Without a scratch, the caller
    /// is held back while too much waits, unless it brings the block that
    /// everybody waits for.
    pub fn submit(&self, number: usize, block: Block, receipt: Option<Built>) -> Result<()> {
        let Block { bytes, nodes } = block;
        let is_next = self.state().next == number;
        let content = match (&self.scratch, receipt) {
            (Some(scratch), Some(built)) if !is_next => {
                scratch.spill(number as u32, &bytes, built)?;
                Content::Spilled(bytes.len() as u64)
            }
            (_, receipt) => Content::Here(bytes, receipt),
        };
        self.place(number, content, nodes)
    }

    /// Hands in a block that an earlier run made.
    pub fn submit_again(&self, number: usize, built: &Built) -> Result<()> {
        let content = match built.at {
            Some(at) => Content::Written { at, bytes: built.bytes },
            None => Content::Spilled(built.bytes),
        };
        self.place(number, content, built.nodes.clone())
    }

    fn place(&self, number: usize, content: Content, nodes: Vec<NodeEntry>) -> Result<()> {
        let mut state = self.state();
        if matches!(content, Content::Here(..)) {
            while number != state.next && state.waiting_bytes > self.most_waiting && !state.failed {
                state = self.moved.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
            state.waiting_bytes += content.bytes();
        }
        state.waiting.insert(number, (content, nodes));
        // Place what can be placed, write it outside the lock.
        let mut ready = Vec::new();
        while let Some((content, nodes)) = {
            let next = state.next;
            state.waiting.remove(&next)
        } {
            let (number, at) = (state.next, state.end);
            state.next += 1;
            state.end += content.bytes();
            if matches!(content, Content::Here(..)) {
                state.waiting_bytes -= content.bytes();
            }
            state.nodes.extend(nodes.iter().map(|n| NodeEntry { offset: n.offset + at, ..*n }));
            ready.push((number as u32, at, content));
        }
        drop(state);
        self.moved.notify_all();
        ready
            .into_iter()
            .try_for_each(|(number, at, content)| self.write(number, at, content))
            .inspect_err(|_| self.fail())
    }

    fn write(&self, number: u32, at: u64, content: Content) -> Result<()> {
        match (content, &self.scratch) {
            (Content::Here(bytes, receipt), scratch) => {
                self.file.write_all_at(&bytes, at)?;
                self.file.begin_sync(at, bytes.len() as u64);
                if let (Some(scratch), Some(built)) = (scratch, receipt) {
                    scratch.receipt(&Receipt::Built { number, built: Built { at: Some(at), ..built } })?;
                }
                let mut used = self.used();
                if used.len() < MOST_USED {
                    used.push(Bytes { end: 0, ..bytes });
                }
            }
            (Content::Spilled(bytes), Some(scratch)) => {
                self.file.write_all_at(&scratch.unspill(number, bytes)?, at)?;
                self.file.begin_sync(at, bytes);
                scratch.placed(number, at)?;
            }
            (Content::Spilled(_), None) => {
                return Err(StageError::Inconsistent(format!("block {number} is nowhere")));
            }
            (Content::Written { at: before, .. }, _) if before != at => {
                return Err(StageError::Inconsistent(format!(
                    "block {number} lies at byte {before} and belongs at {at}"
                )));
            }
            (Content::Written { .. }, _) => {}
        }
        Ok(())
    }

    /// Lets go of all who wait; called when a thread fails and its block will
    /// never come.
    pub fn fail(&self) {
        self.state().failed = true;
        self.moved.notify_all();
    }

    /// Makes the file last; gives all nodes and the file's length.
    pub fn finish(self) -> Result<(Vec<NodeEntry>, u64)> {
        let state = self.state.into_inner().unwrap_or_else(PoisonError::into_inner);
        if !state.waiting.is_empty() {
            return Err(StageError::Inconsistent(format!("block {} never came", state.next)));
        }
        // An earlier run may have written more behind it.
        if self.file.length()? > state.end {
            self.file.cut_to(state.end)?;
        }
        self.file.sync()?;
        Ok((state.nodes, state.end))
    }

    fn used(&self) -> MutexGuard<'_, Vec<Bytes>> {
        self.used.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
