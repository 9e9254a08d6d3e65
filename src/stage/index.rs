//! Index: each chunk becomes an octree of its own ("Fast Out-of-Core Octree
//! Generation", 4.2). All nodes but the chunk's root are written; the root's
//! points wait for the levels above.

use std::sync::Mutex;

use super::context::{Context, Stage};
use super::distribute::{Part, Place, Runs};
use super::error::{Result, StageError};
use super::nodes::{NodeWriter, RawPoints, Records};
use super::options::{Options, Sampling};
use super::output::{Block, OctreeFile};
use super::receipt::{Built, Risen};
use super::scratch::Scratch;
use super::survey::{Survey, chunk_memory};
use super::workers;
use crate::cloud::node::NodeKey;
use crate::cloud::statistics::Statistics;
use crate::disk::DiskFile;
use crate::lod::poisson::PoissonDisk;
use crate::lod::random::RandomInGrid;
use crate::lod::sampler::{Item, Sampler};
use crate::lod::tree::{Builder, LEAF_LIMIT};

/// What rises from a chunk: its root's points, in the octree's layout.
pub struct Rising {
    pub node: NodeKey,
    pub has_children: bool,
    pub records: RisingRecords,
}

/// In memory, or out of core in the scratch.
pub enum RisingRecords {
    Memory(Vec<u8>),
    Scratch(Risen),
}

impl Rising {
    pub fn points(&self, survey: &Survey) -> u64 {
        let bytes = match &self.records {
            RisingRecords::Memory(records) => records.len() as u64,
            RisingRecords::Scratch(risen) => risen.bytes,
        };
        bytes / survey.unified.schema.record_size() as u64
    }
}

impl From<Risen> for Rising {
    fn from(risen: Risen) -> Rising {
        let Risen { node, has_children, .. } = risen;
        Rising { node, has_children, records: RisingRecords::Scratch(risen) }
    }
}

/// The chunks' roots, in the order of the plan, and what was counted so far.
pub struct Indexed {
    pub rising: Vec<Rising>,
    pub statistics: Statistics,
    /// Points in the nodes that were written.
    pub points: u64,
}

pub fn sampler(survey: &Survey, sampling: Sampling) -> Box<dyn Sampler> {
    match sampling {
        Sampling::Poisson => Box::new(PoissonDisk::with_slack(survey.cube.slack())),
        Sampling::Random => Box::new(RandomInGrid::default()),
    }
}

/// Indexes all chunks into the octree file.
pub fn index(
    survey: &Survey,
    runs: &Runs,
    octree: &OctreeFile,
    options: &Options,
    context: &Context,
) -> Result<Indexed> {
    context.progress.begin(Stage::Index, survey.points);
    let chunks = &survey.plan.chunks;
    let threads = threads_for_memory(survey, context)?;
    let rising: Vec<Mutex<Option<Rising>>> = chunks.iter().map(|_| Mutex::new(None)).collect();
    let total = Mutex::new((Statistics::empty(&survey.unified.schema), 0));
    let start = || Indexer::new(survey, options);
    workers::in_order(threads, chunks.len(), &context.cancel, start, |indexer, i| {
        let before = runs.scratch.as_ref().and_then(|scratch| scratch.past.built.get(&(i as u32)));
        let done = match before {
            Some(built) => resubmit(octree, i, built),
            None => indexer.chunk(survey, runs, octree, i, context),
        };
        let (root, statistics, points) = done.inspect_err(|_| octree.fail())?;
        *rising[i].lock().unwrap_or_else(|e| e.into_inner()) = Some(root);
        let mut total = total.lock().unwrap_or_else(|e| e.into_inner());
        total.0.merge(&statistics);
        total.1 += points;
        context.progress.advance(chunks[i].points);
        Ok(())
    })?;
    let rising =
        rising.into_iter().filter_map(|r| r.into_inner().unwrap_or_else(|e| e.into_inner())).collect();
    let (statistics, points) = total.into_inner().unwrap_or_else(|e| e.into_inner());
    Ok(Indexed { rising, statistics, points })
}

/// As many threads as there is memory for, by the largest chunk.
fn threads_for_memory(survey: &Survey, context: &Context) -> Result<usize> {
    if survey.in_core {
        return Ok(context.threads);
    }
    let largest = survey.plan.chunks.iter().map(|c| c.points).max().unwrap_or(0);
    let raw = survey.inputs.iter().map(|i| i.source.record_length).max().unwrap_or(0);
    let needed = chunk_memory(largest, raw as u64, survey.unified.schema.record_size() as u64);
    match context.memory_limit / needed {
        0 => Err(StageError::MemoryTooSmall { limit: context.memory_limit, needed }),
        fitting => Ok(context.threads.min(fitting as usize)),
    }
}

/// One worker's sampler and buffers.
struct Indexer<'o> {
    options: &'o Options,
    sampler: Box<dyn Sampler>,
    items: Vec<Item>,
    spare: Vec<Item>,
    raw: Vec<u8>,
}

impl<'o> Indexer<'o> {
    fn new(survey: &Survey, options: &'o Options) -> Indexer<'o> {
        let sampler = sampler(survey, options.sampling);
        Indexer { options, sampler, items: Vec::new(), spare: Vec::new(), raw: Vec::new() }
    }

    fn chunk(
        &mut self,
        survey: &Survey,
        runs: &Runs,
        octree: &OctreeFile,
        number: usize,
        context: &Context,
    ) -> Result<(Rising, Statistics, u64)> {
        let chunk = survey.plan.chunks[number];
        let parts = &runs.parts[number];
        if let Some(scratch) = &runs.scratch {
            load_parts(survey, runs, parts, &scratch.runs, &mut self.raw)?;
        }
        let points = raw_points(survey, runs, parts, &self.raw);
        points.items(&mut self.items)?;
        self.spare.resize(self.items.len(), Item::default());
        if context.cancel.is_cancelled() {
            return Err(StageError::Cancelled);
        }
        let writer = NodeWriter::new(survey, self.options.encoding, points);
        let mut builder = Builder::new(survey.cube.bits, LEAF_LIMIT, &mut *self.sampler, writer);
        let root = builder.build(chunk.node, &mut self.items, &mut self.spare)?;
        let writer = builder.emit;
        let mut records = Vec::new();
        let rising = root.items.iter().map(|i| i.index);
        writer.records.gather(rising, root.items.len(), &mut records);
        if writer.points + root.items.len() as u64 != chunk.points {
            return Err(StageError::Inconsistent(format!("chunk {} lost points", chunk.node)));
        }
        let NodeWriter { block, statistics, points, .. } = writer;
        let root = Rising {
            node: chunk.node,
            has_children: root.has_children,
            records: RisingRecords::Memory(records),
        };
        let root = hand_in(octree, number, block, root, (&statistics, points), runs.scratch.as_deref())?;
        Ok((root, statistics, points))
    }
}

/// Hands in a finished block and its topmost node: out of core with a receipt,
/// the node's records going to the scratch.
pub fn hand_in(
    octree: &OctreeFile,
    number: usize,
    block: Block,
    root: Rising,
    (statistics, points): (&Statistics, u64),
    scratch: Option<&Scratch>,
) -> Result<Rising> {
    let (Some(scratch), RisingRecords::Memory(records)) = (scratch, &root.records) else {
        octree.submit(number, block, None)?;
        return Ok(root);
    };
    let risen = scratch.keep(root.node, root.has_children, records)?;
    let built = Built {
        nodes: block.nodes.clone(),
        bytes: block.bytes.len() as u64,
        at: None,
        points,
        statistics: statistics.clone(),
        root: risen,
    };
    octree.submit(number, block, Some(built))?;
    Ok(risen.into())
}

/// Hands in what an earlier run built.
pub fn resubmit(octree: &OctreeFile, number: usize, built: &Built) -> Result<(Rising, Statistics, u64)> {
    octree.submit_again(number, built)?;
    Ok((built.root.into(), built.statistics.clone(), built.points))
}

/// Reads a chunk's parts of all runs, one behind the other.
fn load_parts(
    survey: &Survey,
    runs: &Runs,
    parts: &[Part],
    file: &DiskFile,
    raw: &mut Vec<u8>,
) -> Result<()> {
    let bytes_of = |part: &Part| {
        let length = survey.inputs[runs.runs[part.run as usize].input].source.record_length;
        (part.first as usize * length, part.points as usize * length)
    };
    raw.resize(parts.iter().map(|p| bytes_of(p).1).sum(), 0);
    let mut at = 0;
    for part in parts {
        let (skip, len) = bytes_of(part);
        if let Place::Scratch(start) = runs.runs[part.run as usize].place {
            file.read_exact_at(&mut raw[at..at + len], start + skip as u64)?;
        }
        at += len;
    }
    Ok(())
}

fn raw_points<'a>(survey: &'a Survey, runs: &'a Runs, parts: &'a [Part], raw: &'a [u8]) -> RawPoints<'a> {
    let mut rest = raw;
    RawPoints::new(
        survey,
        parts.iter().map(move |part| {
            let run = &runs.runs[part.run as usize];
            let length = survey.inputs[run.input].source.record_length;
            let len = part.points as usize * length;
            let bytes = match &run.place {
                Place::Memory(bytes) => &bytes[part.first as usize * length..][..len],
                Place::Scratch(_) => {
                    let (bytes, behind) = rest.split_at(len);
                    rest = behind;
                    bytes
                }
            };
            (run.input, bytes)
        }),
    )
}
