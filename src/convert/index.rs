//! Index: each chunk becomes an octree of its own ("Fast Out-of-Core Octree
//! Generation", 4.2). All nodes but the chunk's root are written; the root's
//! points wait for the levels above.

use std::sync::{Arc, Mutex};

use super::borders::{self, BorderExchange, StoredBorder, UnitBorder};
use super::checkpoint::scratch::Scratch;
use super::context::{Context, Stage};
use super::copc::CopcWriter;
use super::error::{Result, StageError};
use super::guards::coincident_points::{self, is_crowd};
use super::guards::exact_duplicates;
use super::memory_estimate::chunk_memory;
use super::node_writer::{NodeWriter, RawPoints, Written};
use super::octree_writer::OutputFiles;
use super::options::{GuardMode, Options};
use super::pending_root::{FinishedUnit, Indexed, PendingRoot, RootRecords, hand_in, resubmit};
use super::values::block::{COPC, OCTREE};
use super::values::counted_inputs::Survey;
use super::values::record_range::{self, ExcludedRange, RunSegment, SetAsideReason};
use super::values::runs::{RunStorage, Runs};
use super::workers;
use crate::octree::attribute::Schema;
use crate::octree::chunk_plan::Chunk;
use crate::octree::local_octree::LocalOctreeBuilder;
use crate::octree::moments::Moments;
use crate::octree::node::{LEAF_LIMIT, NodeKey};
use crate::octree::sampling::sampler::{IndexedPoint, Sampler};
use crate::octree::statistics::Statistics;
use crate::platform::disk::DiskFile;

/// A chunk's root once it is there, what was kept out, and the moments of what was
/// written.
type RootSlot = Mutex<Option<(PendingRoot, (Vec<ExcludedRange>, Moments))>>;

/// Indexes all chunks into the octree file. Blocks are numbered in the order in
/// which the chunks take their turns (see [`halos`]).
pub fn index(
    survey: &Survey,
    runs: &Runs,
    files: &OutputFiles,
    scratch: Option<&Arc<Scratch>>,
    options: &Options,
    context: &Context,
) -> Result<Indexed> {
    context.progress.begin(Stage::Index, survey.points);
    let chunks = &survey.plan.chunks;
    let threads = threads_for_memory(survey, options, context)?;
    let pending: Vec<RootSlot> = chunks.iter().map(|_| Mutex::new(None)).collect();
    let total = Mutex::new((Statistics::empty(&survey.unified.schema), 0));
    let nodes: Vec<NodeKey> = chunks.iter().map(|chunk| chunk.node).collect();
    let order = borders::order(&nodes);
    let mut halos = BorderExchange::new(survey.cube.bits, scratch.cloned());
    let scratch = scratch.map(|scratch| &**scratch);
    halos.add(order.iter().map(|chunk| nodes[*chunk]));
    let start = || Indexer::new(survey, options, scratch);
    workers::in_order(threads, chunks.len(), &context.cancel, start, |indexer, unit| {
        let (chunk, turn) = (order[unit], halos.turn(unit));
        let done = match scratch.and_then(|scratch| scratch.past.built.get(&(unit as u32))) {
            Some(built) => resubmit(files, unit, built),
            None => indexer.chunk(survey, runs, files, (unit, chunk), &turn, context),
        };
        let FinishedUnit { root, statistics, moments, points, aside, halo } =
            done.inspect_err(|_| files.fail())?;
        turn.done(halo);
        *pending[chunk].lock().unwrap_or_else(|e| e.into_inner()) = Some((root, (aside, moments)));
        let mut total = total.lock().unwrap_or_else(|e| e.into_inner());
        total.0.merge(&statistics);
        total.1 += points;
        context.progress.advance(chunks[chunk].points);
        Ok(())
    })?;
    let done = pending.into_iter().filter_map(|r| r.into_inner().unwrap_or_else(|e| e.into_inner()));
    let (pending, rest): (Vec<PendingRoot>, Vec<(Vec<ExcludedRange>, Moments)>) = done.unzip();
    let (crowds, of_chunks): (Vec<Vec<ExcludedRange>>, Vec<Moments>) = rest.into_iter().unzip();
    let mut moments = Moments::empty(&survey.unified.schema);
    of_chunks.iter().for_each(|more| moments.merge(more));
    let (statistics, points) = total.into_inner().unwrap_or_else(|e| e.into_inner());
    Ok(Indexed { pending, halos, statistics, moments, points, crowds: crowds.concat() })
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
    scratch: Option<&'o Scratch>,
    sampler: Box<dyn Sampler>,
    /// Where a COPC file is written; it keeps its encoder's memory.
    copc: Option<CopcWriter<'o>>,
    items: Vec<IndexedPoint>,
    spare: Vec<IndexedPoint>,
    raw: Vec<u8>,
    records: Vec<u8>,
}

impl<'o> Indexer<'o> {
    fn new(survey: &'o Survey, options: &'o Options, scratch: Option<&'o Scratch>) -> Indexer<'o> {
        let sampler = options.sampling.sampler(survey.cube.slack());
        let (items, spare) = (Vec::new(), Vec::new());
        let copc = CopcWriter::new(survey);
        Indexer { options, scratch, sampler, copc, items, spare, raw: Vec::new(), records: Vec::new() }
    }

    fn chunk(
        &mut self,
        survey: &'o Survey,
        runs: &Runs,
        files: &OutputFiles,
        (unit, number): (usize, usize),
        turn: &UnitBorder,
        context: &Context,
    ) -> Result<FinishedUnit> {
        let chunk = survey.plan.chunks[number];
        let mut parts = runs.parts[number].as_slice();
        let (kept, mut aside);
        if is_crowd(survey, self.options, &chunk) {
            (kept, aside) = coincident_points::thin(survey, runs, parts, self.options, &context.cancel)?;
            parts = &kept;
        } else {
            aside = Vec::new();
        }
        let is_thinned_crowd = !aside.is_empty();
        if let Some(file) = &runs.file {
            load_parts(survey, runs, parts, file, &mut self.raw)?;
        }
        let points = raw_points(survey, runs, parts, &self.raw);
        let statistics = points.unpack(&mut self.items, &mut self.records)?;
        let mut kept_out = Vec::new();
        if self.options.twins != GuardMode::Keep {
            let twins = exact_duplicates::find(self.items.len(), points.records());
            let mut next = twins.iter().peekable();
            self.items.retain(|item| next.next_if_eq(&&item.index).is_none());
            aside.extend(record_range::ranges(parts, &twins, SetAsideReason::Twin));
            kept_out = twins;
        }
        self.spare.resize(self.items.len(), IndexedPoint::default());
        if context.cancel.is_cancelled() {
            return Err(StageError::Cancelled);
        }
        let mut writer = NodeWriter::new(survey, self.options);
        writer.records = std::mem::take(&mut self.records);
        writer.block = files.block(OCTREE);
        writer.reserve(self.items.len());
        writer.copc = self.copc.take().map(|copc| copc.with_block(files.block(COPC)));
        let mut builder = LocalOctreeBuilder::new(survey.cube.bits, LEAF_LIMIT, &mut *self.sampler, writer);
        builder.thin_crowds = self.options.duplicates != GuardMode::Keep;
        // Asked for late: what is read and unpacked meanwhile need not wait.
        builder.around = turn.around(u8::MAX, &context.cancel)?;
        let root = builder.build(chunk.node, &mut self.items, &mut self.spare)?;
        builder.aside.sort_unstable();
        aside.extend(record_range::ranges(parts, &builder.aside, SetAsideReason::Duplicate));
        let set_aside: u64 = record_range::tally(&aside).values().sum();
        kept_out.append(&mut builder.aside);
        let schema = &survey.unified.schema;
        let mut records = vec![0; root.items.len() * schema.record_size()];
        builder.emit.gather(&root.items, 0..root.items.len(), &mut records);
        let mut below = None;
        if let Some(copc) = &mut builder.emit.copc {
            below = copc.end(&builder.emit.records, chunk.node, root.items.len())?;
        }
        if builder.emit.points + root.items.len() as u64 + set_aside != chunk.points {
            return Err(StageError::Inconsistent(format!("chunk {} lost points", chunk.node)));
        }
        let Written { records: all, blocks, points, averages, moments, copc } = builder.emit.finish();
        self.copc = copc;
        let mut statistics = match kept_out.is_empty() {
            true => statistics,
            false => statistics_without(schema, &all, kept_out),
        };
        averages.iter().for_each(|averages| averages.tell(&mut statistics));
        self.records = all;
        let halo = StoredBorder::Memory(root.rims);
        let root = PendingRoot {
            node: chunk.node,
            has_children: root.has_children,
            // Of a crowd that is a chunk of its own, only a part was looked at.
            crowded: root.crowded || is_thinned_crowd,
            records: RootRecords::Memory(records),
            below: below.map(RootRecords::Memory),
        };
        let done = FinishedUnit { root, statistics, moments, points, aside, halo };
        hand_in(files, unit, blocks, done, self.scratch)
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

/// Reads a chunk's parts of all runs, one behind the other.
fn load_parts(
    survey: &Survey,
    runs: &Runs,
    parts: &[RunSegment],
    file: &DiskFile,
    raw: &mut Vec<u8>,
) -> Result<()> {
    let bytes_of = |part: &RunSegment| {
        let length = survey.inputs[runs.runs[part.run as usize].input].source.record_length;
        (part.first as usize * length, part.points as usize * length)
    };
    raw.resize(parts.iter().map(|p| bytes_of(p).1).sum(), 0);
    let mut at = 0;
    for part in parts {
        let (skip, len) = bytes_of(part);
        if let RunStorage::Scratch(start) = runs.runs[part.run as usize].place {
            file.read_exact_at(&mut raw[at..at + len], start + skip as u64)?;
        }
        at += len;
    }
    Ok(())
}

fn raw_points<'a>(
    survey: &'a Survey,
    runs: &'a Runs,
    parts: &'a [RunSegment],
    raw: &'a [u8],
) -> RawPoints<'a> {
    let mut rest = raw;
    RawPoints::new(
        survey,
        parts.iter().map(move |part| {
            let run = &runs.runs[part.run as usize];
            let length = survey.inputs[run.input].source.record_length;
            let len = part.points as usize * length;
            let bytes = match &run.place {
                RunStorage::Memory(bytes) => &bytes[part.first as usize * length..][..len],
                RunStorage::Scratch(_) => {
                    let (bytes, behind) = rest.split_at(len);
                    rest = behind;
                    bytes
                }
            };
            (run.input, bytes)
        }),
    )
}
