//! The files of points while they are written: octree.bin, the COPC file, or both.
//! Chunks come from several threads in any order; each gets its place as soon as all
//! chunks before it have theirs, so a file is the same whatever the threads did, has
//! no holes, and is never copied. (The design asks for regions of known size; but
//! what rises above a chunk, and what compression saves, is only known when the chunk
//! is done.)
//!
//! In core, blocks wait for their turn in memory. Out of core they wait in the
//! scratch, with their receipt: what is done is done, whose turn it may be.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use super::checkpoint::receipt::{JournalEntry, StoredUnit};
use super::checkpoint::scratch::Scratch;
use super::error::{Result, StageError};
use super::values::block::{Bytes, COPC, Each, NodeBlock, NodeEntry, OCTREE, lengths};
use super::values::finished_files::FinishedFile;
use crate::platform::disk::DiskFile;

/// What a unit of work made, waiting for its place in the files, or having just got
/// it.
enum Content {
    /// In memory; with the receipt to be given when it is written.
    Here(Each<Bytes>, Option<Box<StoredUnit>>),
    /// In the scratch, receipted.
    Spilled(Each<u64>),
    /// At these places already, since an earlier run.
    Written { at: Each<u64>, bytes: Each<u64> },
}

impl Content {
    fn bytes(&self) -> Each<u64> {
        match self {
            Content::Here(bytes, _) => [OCTREE, COPC].map(|file| bytes[file].len() as u64),
            Content::Spilled(bytes) | Content::Written { bytes, .. } => *bytes,
        }
    }
}

#[derive(Default)]
struct WriterState {
    /// The blocks that get the next places, and these places.
    next: usize,
    end: Each<u64>,
    /// Blocks that wait for their place.
    waiting: BTreeMap<usize, (Content, Each<Vec<NodeEntry>>)>,
    waiting_bytes: u64,
    nodes: Each<Vec<NodeEntry>>,
    failed: bool,
}

/// A file of points.
#[derive(Debug)]
pub struct PointFile {
    pub file: DiskFile,
    /// Where its points begin, in bytes.
    pub start: u64,
}

/// The files, and who writes where.
pub struct OutputFiles {
    files: Each<Option<Arc<DiskFile>>>,
    scratch: Option<Arc<Scratch>>,
    /// Bytes that may wait in memory before threads are held back.
    most_waiting: u64,
    state: Mutex<WriterState>,
    moved: Condvar,
    /// Memory of blocks that are written, for those to come.
    used: Each<Mutex<Vec<Bytes>>>,
}

/// Blocks whose memory is kept: one for each of a few threads.
const MOST_USED: usize = 4;

impl OutputFiles {
    pub fn new(
        targets: Each<Option<PointFile>>,
        scratch: Option<Arc<Scratch>>,
        most_waiting: u64,
    ) -> OutputFiles {
        let mut state = WriterState::default();
        let mut files = [None, None];
        for ((target, file), end) in targets.into_iter().zip(&mut files).zip(&mut state.end) {
            let Some(target) = target else { continue };
            *end = target.start;
            let opened = Arc::new(target.file);
            if let Some(scratch) = &scratch {
                scratch.vouch_for(opened.clone());
            }
            *file = Some(opened);
        }
        OutputFiles {
            files,
            scratch,
            most_waiting,
            state: Mutex::new(state),
            moved: Condvar::new(),
            used: Each::default(),
        }
    }

    /// Whether a file is written.
    pub fn has(&self, file: usize) -> bool {
        self.files[file].is_some()
    }

    /// An empty block for a file.
    pub fn block(&self, file: usize) -> NodeBlock {
        let bytes = self.used(file).pop().unwrap_or_default();
        NodeBlock { bytes, nodes: Vec::new() }
    }

    /// Hands in the blocks of a number; each number from 0 on comes once. With a
    /// receipt, it is given when the blocks are safe. Without a scratch, the caller
    /// is held back while too much waits, unless it brings what everybody waits for.
    pub fn submit(&self, number: usize, blocks: Each<NodeBlock>, receipt: Option<StoredUnit>) -> Result<()> {
        let is_next = self.state().next == number;
        let bytes = lengths(&blocks);
        let [a, b] = blocks;
        let nodes = [a.nodes, b.nodes];
        let content = match (&self.scratch, receipt) {
            (Some(scratch), Some(built)) if !is_next => {
                scratch.spill(number as u32, [&a.bytes, &b.bytes], built)?;
                Content::Spilled(bytes)
            }
            (_, receipt) => Content::Here([a.bytes, b.bytes], receipt.map(Box::new)),
        };
        self.place(number, content, nodes)
    }

    /// Hands in blocks that an earlier run made.
    pub fn submit_again(&self, number: usize, built: &StoredUnit) -> Result<()> {
        let content = match built.at {
            Some(at) => Content::Written { at, bytes: built.bytes },
            None => Content::Spilled(built.bytes),
        };
        self.place(number, content, built.nodes.clone())
    }

    fn place(&self, number: usize, content: Content, nodes: Each<Vec<NodeEntry>>) -> Result<()> {
        let mut state = self.state();
        if matches!(content, Content::Here(..)) {
            while number != state.next && state.waiting_bytes > self.most_waiting && !state.failed {
                state = self.moved.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
            state.waiting_bytes += content.bytes().iter().sum::<u64>();
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
            let bytes = content.bytes();
            if matches!(content, Content::Here(..)) {
                state.waiting_bytes -= bytes.iter().sum::<u64>();
            }
            for (file, nodes) in nodes.into_iter().enumerate() {
                state.end[file] += bytes[file];
                let entries = nodes.iter().map(|n| NodeEntry { offset: n.offset + at[file], ..*n });
                state.nodes[file].extend(entries);
            }
            ready.push((number as u32, at, content));
        }
        drop(state);
        self.moved.notify_all();
        ready
            .into_iter()
            .try_for_each(|(number, at, content)| self.write(number, at, content))
            .inspect_err(|_| self.fail())
    }

    fn write(&self, number: u32, at: Each<u64>, content: Content) -> Result<()> {
        match (content, &self.scratch) {
            (Content::Here(bytes, receipt), scratch) => {
                for file in [OCTREE, COPC] {
                    self.put(file, at[file], &bytes[file])?;
                }
                if let (Some(scratch), Some(built)) = (scratch, receipt) {
                    scratch.receipt(&JournalEntry::Built {
                        number,
                        built: StoredUnit { at: Some(at), ..*built },
                    })?;
                }
                for (file, bytes) in bytes.into_iter().enumerate() {
                    let mut used = self.used(file);
                    if used.len() < MOST_USED {
                        used.push(bytes.emptied());
                    }
                }
            }
            (Content::Spilled(bytes), Some(scratch)) => {
                let content = scratch.unspill(number, bytes.iter().sum())?;
                let (octree, copc) = content.split_at(bytes[OCTREE] as usize);
                self.put(OCTREE, at[OCTREE], octree)?;
                self.put(COPC, at[COPC], copc)?;
                scratch.placed(number, at)?;
            }
            (Content::Spilled(_), None) => {
                return Err(StageError::Inconsistent(format!("block {number} is nowhere")));
            }
            (Content::Written { at: before, .. }, _) if before != at => {
                return Err(StageError::Inconsistent(format!(
                    "block {number} lies at bytes {before:?} and belongs at {at:?}"
                )));
            }
            (Content::Written { .. }, _) => {}
        }
        Ok(())
    }

    fn put(&self, file: usize, at: u64, bytes: &[u8]) -> Result<()> {
        match &self.files[file] {
            Some(file) if !bytes.is_empty() => {
                file.write_all_at(bytes, at)?;
                file.begin_sync(at, bytes.len() as u64);
                Ok(())
            }
            None if !bytes.is_empty() => {
                Err(StageError::Inconsistent("points came for a file that is not written".into()))
            }
            _ => Ok(()),
        }
    }

    /// Lets go of all who wait; called when a thread fails and its block will
    /// never come.
    pub fn fail(&self) {
        self.state().failed = true;
        self.moved.notify_all();
    }

    /// The files with all their points; what an earlier run wrote behind these is
    /// gone. What comes behind the points is still to be written, and all of it to be
    /// made to last.
    pub fn finish(self) -> Result<Each<Option<FinishedFile>>> {
        let state = self.state.into_inner().unwrap_or_else(PoisonError::into_inner);
        if !state.waiting.is_empty() {
            return Err(StageError::Inconsistent(format!("block {} never came", state.next)));
        }
        let mut finished = [None, None];
        let all = self.files.into_iter().zip(state.nodes).zip(state.end);
        for (((file, nodes), end), finished) in all.zip(&mut finished) {
            let Some(file) = file else { continue };
            // An earlier run may have written more behind it.
            if file.length()? > end {
                file.cut_to(end)?;
            }
            *finished = Some(FinishedFile { file, nodes, end });
        }
        Ok(finished)
    }

    fn used(&self, file: usize) -> MutexGuard<'_, Vec<Bytes>> {
        self.used[file].lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn state(&self) -> MutexGuard<'_, WriterState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
