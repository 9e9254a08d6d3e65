//! Index: each chunk becomes an octree of its own ("Fast Out-of-Core Octree
//! Generation", 4.2). All nodes but the chunk's root are written; the root's
//! points wait for the levels above.

use std::sync::Mutex;

use super::context::{Context, Stage};
use super::crowd::{self, is_crowd};
use super::distribute::{Part, Place, Runs};
use super::error::{Result, StageError};
use super::halos::{self, Halos, Kept, Turn};
use super::nodes::{NodeWriter, RawPoints};
use super::options::{Encoding, Mode, Options};
use super::output::{Block, OctreeFile};
use super::receipt::{Built, Risen};
use super::scratch::Scratch;
use super::set_aside::{self, Range, Reason};
use super::survey::{Survey, chunk_memory};
use super::twins;
use super::workers;
use crate::cloud::attribute::Schema;
use crate::cloud::node::{LEAF_LIMIT, NodeKey};
use crate::cloud::plan::Chunk;
use crate::cloud::statistics::Statistics;
use crate::disk::DiskFile;
use crate::lod::sampler::{Item, Sampler};
use crate::lod::tree::Builder;

/// What rises from a chunk: its root's points, in the octree's layout.
pub struct Rising {
    pub node: NodeKey,
    pub has_children: bool,
    /// Whether it is the leaf of a crowd that was thinned.
    pub crowded: bool,
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
            RisingRecords::Scratch(risen) => risen.records.bytes,
        };
        bytes / survey.unified.schema.record_size() as u64
    }
}

impl From<Risen> for Rising {
    fn from(risen: Risen) -> Rising {
        let Risen { node, has_children, crowded, .. } = risen;
        Rising { node, has_children, crowded, records: RisingRecords::Scratch(risen) }
    }
}

/// The chunks' roots, in the order of the plan, and what was counted.
pub struct Indexed {
    pub rising: Vec<Rising>,
    /// Samples along the chunks' borders.
    pub halos: Halos,
    /// Of all points, also of those that rise (but for averaged colours).
    pub statistics: Statistics,
    /// Points in the nodes that were written.
    pub points: u64,
    /// Points of crowds that were kept out, in the order of the plan.
    pub crowds: Vec<Range>,
}

/// A chunk, or a step of the merge, when it is done.
pub struct Done {
    pub root: Rising,
    /// Of a chunk's points, wherever they end up; but the range of averaged colours
    /// is that of the nodes that were written, of a step of the merge too, which
    /// adds nothing else.
    pub statistics: Statistics,
    /// Points in the nodes that were written.
    pub points: u64,
    pub aside: Vec<Range>,
    /// Samples along the border.
    pub halo: Kept,
}

/// A chunk's root once it is there, and what was kept out.
type Slot = Mutex<Option<(Rising, Vec<Range>)>>;

/// Indexes all chunks into the octree file. Blocks are numbered in the order in
/// which the chunks take their turns (see [`halos`]).
pub fn index(
    survey: &Survey,
    runs: &Runs,
    octree: &OctreeFile,
    options: &Options,
    context: &Context,
) -> Result<Indexed> {
    context.progress.begin(Stage::Index, survey.points);
    let chunks = &survey.plan.chunks;
    let threads = threads_for_memory(survey, options, context)?;
    let rising: Vec<Slot> = chunks.iter().map(|_| Mutex::new(None)).collect();
    let total = Mutex::new((Statistics::empty(&survey.unified.schema), 0));
    let scratch = runs.scratch.as_deref();
    let nodes: Vec<NodeKey> = chunks.iter().map(|chunk| chunk.node).collect();
    let order = halos::order(&nodes);
    let mut halos = Halos::new(survey.cube.bits, runs.scratch.clone());
    halos.add(order.iter().map(|chunk| nodes[*chunk]));
    let start = || Indexer::new(survey, options);
    workers::in_order(threads, chunks.len(), &context.cancel, start, |indexer, unit| {
        let (chunk, turn) = (order[unit], halos.turn(unit));
        let done = match scratch.and_then(|scratch| scratch.past.built.get(&(unit as u32))) {
            Some(built) => resubmit(octree, unit, built),
            None => indexer.chunk(survey, runs, octree, (unit, chunk), &turn, context),
        };
        let Done { root, statistics, points, aside, halo } = done.inspect_err(|_| octree.fail())?;
        turn.done(halo);
        *rising[chunk].lock().unwrap_or_else(|e| e.into_inner()) = Some((root, aside));
        let mut total = total.lock().unwrap_or_else(|e| e.into_inner());
        total.0.merge(&statistics);
        total.1 += points;
        context.progress.advance(chunks[chunk].points);
        Ok(())
    })?;
    let done = rising.into_iter().filter_map(|r| r.into_inner().unwrap_or_else(|e| e.into_inner()));
    let (rising, crowds): (Vec<Rising>, Vec<Vec<Range>>) = done.unzip();
    let (statistics, points) = total.into_inner().unwrap_or_else(|e| e.into_inner());
    Ok(Indexed { rising, halos, statistics, points, crowds: crowds.concat() })
}

/// As many threads as there is memory for, by the largest chunk.
fn threads_for_memory(survey: &Survey, options: &Options, context: &Context) -> Result<usize> {
    if survey.in_core {
        return Ok(context.threads);
    }
    let in_hand =
        |chunk: &Chunk| if is_crowd(survey, options, chunk) { LEAF_LIMIT as u64 } else { chunk.points };
    let largest = survey.plan.chunks.iter().map(in_hand).max().unwrap_or(0);
    let raw = survey.inputs.iter().map(|i| i.source.record_length).max().unwrap_or(0);
    let size = survey.unified.schema.record_size() as u64;
    let needed = chunk_memory(largest, raw as u64, size, options);
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
    records: Vec<u8>,
}

impl<'o> Indexer<'o> {
    fn new(survey: &Survey, options: &'o Options) -> Indexer<'o> {
        let sampler = options.sampling.sampler(survey.cube.slack());
        let (items, spare) = (Vec::new(), Vec::new());
        Indexer { options, sampler, items, spare, raw: Vec::new(), records: Vec::new() }
    }

    fn chunk(
        &mut self,
        survey: &Survey,
        runs: &Runs,
        octree: &OctreeFile,
        (unit, number): (usize, usize),
        turn: &Turn,
        context: &Context,
    ) -> Result<Done> {
        let chunk = survey.plan.chunks[number];
        let mut parts = runs.parts[number].as_slice();
        let (kept, mut aside);
        if is_crowd(survey, self.options, &chunk) {
            (kept, aside) = crowd::thin(survey, runs, parts, self.options, &context.cancel)?;
            parts = &kept;
        } else {
            aside = Vec::new();
        }
        let is_thinned_crowd = !aside.is_empty();
        if let Some(scratch) = &runs.scratch {
            load_parts(survey, runs, parts, &scratch.runs, &mut self.raw)?;
        }
        let points = raw_points(survey, runs, parts, &self.raw);
        let statistics = points.unpack(&mut self.items, &mut self.records)?;
        let mut kept_out = Vec::new();
        if self.options.twins != Mode::Keep {
            let twins = twins::find(self.items.len(), points.records());
            let mut next = twins.iter().peekable();
            self.items.retain(|item| next.next_if_eq(&&item.index).is_none());
            aside.extend(set_aside::ranges(parts, &twins, Reason::Twin));
            kept_out = twins;
        }
        self.spare.resize(self.items.len(), Item::default());
        if context.cancel.is_cancelled() {
            return Err(StageError::Cancelled);
        }
        let mut writer = NodeWriter::new(survey, self.options.encoding);
        writer.records = std::mem::take(&mut self.records);
        writer.block = octree.block();
        if self.options.encoding == Encoding::Default {
            writer.block.bytes.reserve(writer.records.len());
        }
        let mut builder = Builder::new(survey.cube.bits, LEAF_LIMIT, &mut *self.sampler, writer);
        builder.thin_crowds = self.options.duplicates != Mode::Keep;
        // Asked for late: what is read and unpacked meanwhile need not wait.
        builder.around = turn.around(u8::MAX, &context.cancel)?;
        let root = builder.build(chunk.node, &mut self.items, &mut self.spare)?;
        builder.aside.sort_unstable();
        aside.extend(set_aside::ranges(parts, &builder.aside, Reason::Duplicate));
        let set_aside: u64 = set_aside::tally(&aside).values().sum();
        kept_out.append(&mut builder.aside);
        let schema = &survey.unified.schema;
        let mut records = vec![0; root.items.len() * schema.record_size()];
        builder.emit.gather(&root.items, 0..root.items.len(), &mut records);
        if builder.emit.points + root.items.len() as u64 + set_aside != chunk.points {
            return Err(StageError::Inconsistent(format!("chunk {} lost points", chunk.node)));
        }
        let NodeWriter { records: all, block, points, averages, .. } = builder.emit;
        let mut statistics = match kept_out.is_empty() {
            true => statistics,
            false => statistics_without(schema, &all, kept_out),
        };
        averages.iter().for_each(|averages| averages.tell(&mut statistics));
        self.records = all;
        let halo = Kept::Memory(root.rims);
        let root = Rising {
            node: chunk.node,
            has_children: root.has_children,
            // Of a crowd that is a chunk of its own, only a part was looked at.
            crowded: root.crowded || is_thinned_crowd,
            records: RisingRecords::Memory(records),
        };
        let done = Done { root, statistics, points, aside, halo };
        hand_in(octree, unit, block, done, runs.scratch.as_deref())
    }
}

/// Statistics of all records but some.
fn statistics_without(schema: &Schema, records: &[u8], mut without: Vec<u32>) -> Statistics {
    let size = schema.record_size();
    let mut statistics = Statistics::empty(schema);
    without.sort_unstable();
    let mut from = 0;
    for index in without {
        let at = index as usize * size;
        statistics.add(schema, &records[from..at]);
        from = at + size;
    }
    statistics.add(schema, &records[from..]);
    statistics
}

/// Hands in a finished block, its topmost node and its border: out of core with a
/// receipt, node and border going to the scratch.
pub fn hand_in(
    octree: &OctreeFile,
    number: usize,
    block: Block,
    done: Done,
    scratch: Option<&Scratch>,
) -> Result<Done> {
    let (Some(scratch), RisingRecords::Memory(records), Kept::Memory(rims)) =
        (scratch, &done.root.records, &done.halo)
    else {
        octree.submit(number, block, None)?;
        return Ok(done);
    };
    let Rising { node, has_children, crowded, .. } = done.root;
    let risen = Risen { node, has_children, crowded, records: scratch.keep(records)? };
    let halo = scratch.keep(&halos::to_bytes(rims))?;
    let built = Built {
        nodes: block.nodes.clone(),
        bytes: block.bytes.len() as u64,
        at: None,
        points: done.points,
        statistics: done.statistics.clone(),
        root: risen,
        halo,
        aside: done.aside.clone(),
    };
    octree.submit(number, block, Some(built))?;
    Ok(Done { root: risen.into(), halo: Kept::Scratch(halo), ..done })
}

/// Hands in what an earlier run built.
pub fn resubmit(octree: &OctreeFile, number: usize, built: &Built) -> Result<Done> {
    octree.submit_again(number, built)?;
    let (root, statistics) = (built.root.into(), built.statistics.clone());
    let halo = Kept::Scratch(built.halo);
    Ok(Done { root, statistics, points: built.points, aside: built.aside.clone(), halo })
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
