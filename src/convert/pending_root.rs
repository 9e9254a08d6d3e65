//! Roots of chunks and of subtrees that wait until the levels above have been sampled,
//! and how finished units of work are handed in.

use super::borders::{self, BorderExchange, StoredBorder};
use super::checkpoint::receipt::{ByteRange, StoredRoot, StoredUnit};
use super::checkpoint::scratch::Scratch;
use super::error::{Result, StageError};
use super::octree_writer::OutputFiles;
use super::values::block::{self, COPC, Each, NodeBlock, OCTREE};
use super::values::counted_inputs::Survey;
use super::values::record_range::ExcludedRange;
use crate::octree::moments::Moments;
use crate::octree::node::NodeKey;
use crate::octree::statistics::Statistics;

/// What rises from a chunk: its root's points, in the octree's layout.
pub struct PendingRoot {
    pub node: NodeKey,
    pub has_children: bool,
    /// Whether it is the leaf of a crowd that was thinned.
    pub crowded: bool,
    pub records: RootRecords,
    /// The records of all nodes below, where these join it in the COPC file.
    pub below: Option<RootRecords>,
}

/// In memory, or out of core in the scratch.
pub enum RootRecords {
    Memory(Vec<u8>),
    Scratch(ByteRange),
}

impl RootRecords {
    /// The bytes, from wherever they are.
    pub fn fetch(self, scratch: Option<&Scratch>) -> Result<Vec<u8>> {
        match (self, scratch) {
            (RootRecords::Memory(records), _) => Ok(records),
            (RootRecords::Scratch(span), Some(scratch)) => scratch.fetch(span),
            (RootRecords::Scratch(_), None) => {
                Err(StageError::Inconsistent("the points of a node are nowhere".into()))
            }
        }
    }

    /// The same, in the scratch where there is one.
    fn keep(self, scratch: &Scratch) -> Result<ByteRange> {
        match self {
            RootRecords::Memory(records) => scratch.keep(&records),
            RootRecords::Scratch(span) => Ok(span),
        }
    }
}

impl PendingRoot {
    pub fn points(&self, survey: &Survey) -> u64 {
        let bytes = match &self.records {
            RootRecords::Memory(records) => records.len() as u64,
            RootRecords::Scratch(span) => span.bytes,
        };
        bytes / survey.unified.schema.record_size() as u64
    }
}

impl From<StoredRoot> for PendingRoot {
    fn from(risen: StoredRoot) -> PendingRoot {
        let StoredRoot { node, has_children, crowded, records, below } = risen;
        let below = below.map(RootRecords::Scratch);
        PendingRoot { node, has_children, crowded, records: RootRecords::Scratch(records), below }
    }
}

/// The chunks' roots, in the order of the plan, and what was counted.
pub struct Indexed {
    pub pending: Vec<PendingRoot>,
    /// Samples along the chunks' borders.
    pub halos: BorderExchange,
    /// Of all points, also of those that rise (but for averaged colours).
    pub statistics: Statistics,
    /// Of the points in the COPC file so far.
    pub moments: Moments,
    /// Points in the nodes that were written.
    pub points: u64,
    /// Points of crowds that were kept out, in the order of the plan.
    pub crowds: Vec<ExcludedRange>,
}

/// A chunk, or a step of the merge, when it is done.
pub struct FinishedUnit {
    pub root: PendingRoot,
    /// Of a chunk's points, wherever they end up; but the range of averaged colours
    /// is that of the nodes that were written, of a step of the merge too, which
    /// adds nothing else.
    pub statistics: Statistics,
    /// Of the points that were written to the COPC file.
    pub moments: Moments,
    /// Points in the nodes that were written.
    pub points: u64,
    pub aside: Vec<ExcludedRange>,
    /// Samples along the border.
    pub halo: StoredBorder,
}

/// Hands in finished blocks, their topmost node and its border: out of core with a
/// receipt, node and border going to the scratch.
pub fn hand_in(
    files: &OutputFiles,
    number: usize,
    blocks: Each<NodeBlock>,
    done: FinishedUnit,
    scratch: Option<&Scratch>,
) -> Result<FinishedUnit> {
    let Some(scratch) = scratch else {
        files.submit(number, blocks, None)?;
        return Ok(done);
    };
    let FinishedUnit { root, statistics, moments, points, aside, halo } = done;
    let PendingRoot { node, has_children, crowded, records, below } = root;
    let records = records.keep(scratch)?;
    let below = below.map(|below| below.keep(scratch)).transpose()?;
    let risen = StoredRoot { node, has_children, crowded, records, below };
    let halo = match halo {
        StoredBorder::Memory(rims) => scratch.keep(&borders::to_bytes(&rims))?,
        StoredBorder::Scratch(span) => span,
    };
    let built = StoredUnit {
        nodes: [OCTREE, COPC].map(|file| blocks[file].nodes.clone()),
        bytes: block::lengths(&blocks),
        at: None,
        points,
        moments: moments.clone(),
        statistics: statistics.clone(),
        root: risen,
        halo,
        aside: aside.clone(),
    };
    files.submit(number, blocks, Some(built))?;
    Ok(FinishedUnit {
        root: risen.into(),
        statistics,
        moments,
        points,
        aside,
        halo: StoredBorder::Scratch(halo),
    })
}

/// Hands in what an earlier run built.
pub fn resubmit(files: &OutputFiles, number: usize, built: &StoredUnit) -> Result<FinishedUnit> {
    files.submit_again(number, built)?;
    Ok(FinishedUnit {
        root: built.root.into(),
        statistics: built.statistics.clone(),
        moments: built.moments.clone(),
        points: built.points,
        aside: built.aside.clone(),
        halo: StoredBorder::Scratch(built.halo),
    })
}
