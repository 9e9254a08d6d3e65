//! Receipts: what a conversion that works out of core knows it has done. A unit
//! of work (one slice of the survey or of distribution, one chunk, one step of
//! the merge) writes its data first and its receipt after; a unit that has its
//! receipt is never done again.
//!
//! Here are only the receipts and what follows from a row of them; the file they
//! stand in is [`super::journal`], the data they vouch for [`super::scratch`].

use std::collections::{HashMap, HashSet};

use serde::{Deserialize, Serialize};

use crate::convert::values::block::{COPC, Each, NodeEntry, OCTREE};
use crate::convert::values::counting_result::CountingResult;
use crate::convert::values::record_range::ExcludedRange;
use crate::octree::moments::Moments;
use crate::octree::node::NodeKey;
use crate::octree::statistics::Statistics;

/// Changes whenever receipts, or the data behind them, are to be read otherwise
/// than before: what an older program left is then cleared.
pub const FORMAT: &str = concat!("lodestone receipts 7, program ", env!("CARGO_PKG_VERSION"));

/// What makes a conversion the same as the one that left receipts: the hash of
/// program, options, inputs and output.
pub type ConversionKey = [u8; 32];

#[derive(Debug, Serialize, Deserialize)]
pub enum JournalEntry {
    /// A run of the program begins (or goes on); `boot` names the boot of the
    /// machine, empty where it cannot be told.
    Begun { identity: ConversionKey, boot: String },
    /// Everything that receipts before byte `upto` of the journal vouch for has
    /// reached the disk.
    Synced { upto: u64 },
    /// A slice's decoded records lie at its place in the scratch, up to byte `end`.
    Spooled { unit: u32, end: u64 },
    /// The survey is over. Synced before anything else is done.
    Surveyed(CountingResult),
    /// From here on the slice's place may hold anything.
    Bucketing { unit: u32 },
    /// The slice's run lies at its place, up to byte `end`; points by chunk, in
    /// their order.
    Bucketed { unit: u32, end: u64, counts: Vec<(u32, u32)> },
    /// A chunk or a step of the merge is done.
    Built { number: u32, built: StoredUnit },
    /// Blocks that had to wait have their place in their files now.
    Placed { number: u32, at: Each<u64> },
    /// The octree is whole, in the folder of this inode; only its name is left to
    /// be given.
    Finished { inode: u64, outcome: String },
}

/// What a chunk, or a step of the merge, came to.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StoredUnit {
    /// Its finished nodes in each file; offsets count from the start of its block.
    pub nodes: Each<Vec<NodeEntry>>,
    /// Lengths of the blocks, in bytes.
    pub bytes: Each<u64>,
    /// Where the blocks lie in their files; none while they wait for their turn.
    pub at: Option<Each<u64>>,
    /// Points in the finished nodes of the octree.
    pub points: u64,
    /// Of the points in the finished nodes of the COPC file.
    pub moments: Moments,
    /// Of all of a chunk's points; of a step of the merge, empty but for averaged
    /// colours.
    pub statistics: Statistics,
    /// Its topmost node, which waits for the levels above.
    pub root: StoredRoot,
    /// Samples along its border, for those that touch it.
    pub halo: ByteRange,
    /// What was kept out of the octree.
    pub aside: Vec<ExcludedRange>,
}

/// A node whose points lie in the scratch until its parent has chosen from them.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct StoredRoot {
    pub node: NodeKey,
    pub has_children: bool,
    pub crowded: bool,
    /// Its records.
    pub records: ByteRange,
    /// The records of all nodes below, where these join it in the COPC file.
    pub below: Option<ByteRange>,
}

/// Where something lies in the scratch, in bytes.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct ByteRange {
    pub offset: u64,
    pub bytes: u64,
}

impl ByteRange {
    fn end(self) -> u64 {
        self.offset + self.bytes
    }
}

/// What earlier runs have done.
#[derive(Debug, Default)]
pub struct ResumeState {
    spooled: HashSet<u32>,
    bucketing: HashSet<u32>,
    runs_end: u64,
    pub surveyed: Option<CountingResult>,
    pub bucketed: HashMap<u32, Vec<(u32, u32)>>,
    pub built: HashMap<u32, StoredUnit>,
    /// Inode of the whole octree, and the outcome as JSON.
    pub finished: Option<(u64, String)>,
    /// Units that are done, of every kind.
    pub units: u64,
}

impl ResumeState {
    /// Sums up receipts. `same_boot` says whether the machine has run on since
    /// they were written: else what was overwritten in place cannot be trusted.
    pub fn of(receipts: Vec<JournalEntry>, same_boot: bool) -> ResumeState {
        let mut past = ResumeState { units: units_in(&receipts), ..ResumeState::default() };
        let mut placed = HashMap::new();
        for receipt in receipts {
            match receipt {
                JournalEntry::Begun { .. } | JournalEntry::Synced { .. } => {}
                JournalEntry::Spooled { unit, end } => {
                    past.runs_end = past.runs_end.max(end);
                    past.spooled.insert(unit);
                    past.bucketing.remove(&unit);
                }
                JournalEntry::Surveyed(findings) => past.surveyed = Some(findings),
                JournalEntry::Bucketing { unit } => {
                    past.bucketing.insert(unit);
                }
                JournalEntry::Bucketed { unit, end, counts } => {
                    past.runs_end = past.runs_end.max(end);
                    past.bucketed.insert(unit, counts);
                }
                JournalEntry::Built { number, built } => {
                    past.built.insert(number, built);
                }
                JournalEntry::Placed { number, at } => {
                    placed.insert(number, at);
                }
                JournalEntry::Finished { inode, outcome } => past.finished = Some((inode, outcome)),
            }
        }
        // Whoever places a block may be quicker than the one who brings it.
        for (number, at) in placed {
            if let Some(built) = past.built.get_mut(&number) {
                built.at = Some(at);
            }
        }
        if !same_boot && past.surveyed.is_some() {
            past.spooled.clear();
        }
        past
    }

    /// Whether a slice's records, in whatever order, lie at its place.
    pub fn has_records(&self, unit: u32) -> bool {
        self.bucketed.contains_key(&unit) || (self.spooled.contains(&unit) && !self.bucketing.contains(&unit))
    }

    /// How long the files must be at least to hold what is vouched for.
    pub fn ends(&self) -> RequiredLengths {
        let end_of = |file: usize| {
            self.built
                .values()
                .filter_map(|b| Some(b.at?[file] + b.bytes[file]).filter(|_| b.bytes[file] > 0))
                .max()
        };
        let kept = |b: &StoredUnit| {
            let below = b.root.below.map_or(0, ByteRange::end);
            b.root.records.end().max(b.halo.end()).max(below)
        };
        let risen = self.built.values().map(kept).max();
        let files = [OCTREE, COPC].map(|file| end_of(file).unwrap_or(0));
        RequiredLengths { runs: self.runs_end, files, risen: risen.unwrap_or(0) }
    }
}

/// Lengths in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RequiredLengths {
    pub runs: u64,
    /// Of octree.bin, and of the points in the COPC file.
    pub files: Each<u64>,
    pub risen: u64,
}

/// How many units of work these receipts stand for.
pub fn units_in(receipts: &[JournalEntry]) -> u64 {
    receipts.iter().filter_map(JournalEntry::unit).count() as u64
}

/// A unit of work by its kind and, where there are several of that kind, number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum WorkUnit {
    Spooled(u32),
    Surveyed,
    Bucketed(u32),
    Built(u32),
}

impl JournalEntry {
    /// The work that it stands for; none where it only notes a stage on the way.
    pub fn unit(&self) -> Option<WorkUnit> {
        match self {
            JournalEntry::Spooled { unit, .. } => Some(WorkUnit::Spooled(*unit)),
            JournalEntry::Surveyed(_) => Some(WorkUnit::Surveyed),
            JournalEntry::Bucketed { unit, .. } => Some(WorkUnit::Bucketed(*unit)),
            JournalEntry::Built { number, .. } => Some(WorkUnit::Built(*number)),
            // A kill between it and the rename has the end written once more: it
            // vouches for a folder, not for work that would be saved.
            JournalEntry::Finished { .. }
            | JournalEntry::Begun { .. }
            | JournalEntry::Synced { .. }
            | JournalEntry::Bucketing { .. }
            | JournalEntry::Placed { .. } => None,
        }
    }
}
