//! Distribute: each slice of the input becomes a run, its raw records bucketed
//! by chunk with one counting sort and written one behind the other ("Fast
//! Out-of-Core Octree Generation", 4.1, distributing; DESIGN.md, decision 4).
//!
//! A run lies in memory where the cloud fits it, else in one scratch file at a
//! place known beforehand: sequential writes, no appending to thousands of
//! files, and a rerun of a slice overwrites just its own run.

use std::sync::{Arc, Mutex};

use super::checkpoint::receipt::JournalEntry;
use super::checkpoint::scratch::Scratch;
use super::context::{Context, Stage};
use super::error::{Result, StageError};
use super::values::counted_inputs::Survey;
use super::values::input_slice::{CachedRecords, InputSlice};
use super::values::record_range::{self, ExcludedRange, RunSegment, SetAsideReason};
use super::values::runs::{Run, RunStorage, Runs};
use super::workers;
use crate::octree::record;
use crate::platform::disk::DiskFile;

/// A run once it is made, with the points it holds of each chunk.
type RunSlot = Mutex<Option<(Run, Vec<u32>)>>;

/// Cuts the surveyed units into runs.
pub fn distribute(survey: &Survey, scratch: Option<&Arc<Scratch>>, context: &Context) -> Result<Runs> {
    context.progress.begin(Stage::Distribute, survey.points);
    let buckets = buckets(survey);
    let made: Vec<RunSlot> = survey.units.iter().map(|_| Mutex::new(None)).collect();
    workers::in_order(
        context.threads,
        survey.units.len(),
        &context.cancel,
        Bucketer::default,
        |state, i| {
            let unit = &survey.units[i];
            let (place, counts) = match scratch {
                None => state.run_in_memory(survey, unit)?,
                Some(scratch) => {
                    let counts = match scratch.past.bucketed.get(&(i as u32)) {
                        Some(counts) => spread(counts, buckets)?,
                        None => state.run_in_scratch(survey, unit, i as u32, scratch)?,
                    };
                    (RunStorage::Scratch(unit.at), counts)
                }
            };
            let run = Run { input: unit.input, place };
            *made[i].lock().unwrap_or_else(|e| e.into_inner()) = Some((run, counts));
            context.progress.advance(u64::from(unit.slice.points));
            Ok(())
        },
    )?;
    for input in &survey.inputs {
        input.las.check_unchanged()?;
    }
    collect(survey, made, scratch.map(|scratch| scratch.runs.clone()))
}

/// Counts of the chunks that have some, as counts of all.
fn spread(held: &[(u32, u32)], chunks: usize) -> Result<Vec<u32>> {
    let mut counts = vec![0; chunks];
    for (chunk, points) in held {
        let Some(count) = counts.get_mut(*chunk as usize) else {
            return Err(StageError::Inconsistent(format!("a receipt names chunk {chunk} of {chunks}")));
        };
        *count = *points;
    }
    Ok(counts)
}

/// One for each chunk, and one for what goes into none.
fn buckets(survey: &Survey) -> usize {
    survey.plan.chunks.len() + usize::from(!survey.region.is_everywhere())
}

/// Turns per-run counts into per-chunk parts.
fn collect(survey: &Survey, made: Vec<RunSlot>, file: Option<Arc<DiskFile>>) -> Result<Runs> {
    let mut parts: Vec<Vec<RunSegment>> = vec![Vec::new(); buckets(survey)];
    let mut runs = Vec::with_capacity(made.len());
    for slot in made {
        let Some((run, counts)) = slot.into_inner().unwrap_or_else(|e| e.into_inner()) else {
            return Err(StageError::Inconsistent("a slice was not distributed".into()));
        };
        let mut first = 0;
        for (chunk, points) in counts.into_iter().enumerate().filter(|(_, n)| *n > 0) {
            parts[chunk].push(RunSegment { run: runs.len() as u32, first, points });
            first += points;
        }
        runs.push(run);
    }
    for (chunk, parts) in survey.plan.chunks.iter().zip(&parts) {
        let found: u64 = parts.iter().map(|p| u64::from(p.points)).sum();
        if found != chunk.points {
            // The census and the distribution read the same file twice.
            let input = parts.first().map_or(0, |p| runs[p.run as usize].input);
            return Err(StageError::changed(&survey.inputs[input].las));
        }
    }
    let outside = parts.split_off(survey.plan.chunks.len()).into_iter().flatten();
    let outliers: Vec<ExcludedRange> = outside
        .map(|RunSegment { run, first, points }| ExcludedRange {
            run,
            first,
            points,
            reason: SetAsideReason::Outlier,
        })
        .collect();
    if record_range::tally(&outliers).get(&SetAsideReason::Outlier).copied().unwrap_or(0)
        != survey.region.outliers
    {
        return Err(StageError::changed(&survey.inputs[0].las));
    }
    Ok(Runs { runs, parts, outliers, file })
}

/// One worker's buffers.
#[derive(Default)]
struct Bucketer {
    slice: Vec<u8>,
    run: Vec<u8>,
    /// Chunks of the slice's points: how many of one come one behind the other.
    rows: Vec<(u32, u32)>,
}

impl Bucketer {
    /// Makes a slice's run in memory.
    fn run_in_memory(&mut self, survey: &Survey, unit: &InputSlice) -> Result<(RunStorage, Vec<u32>)> {
        let records = match std::mem::replace(&mut *unit.kept(), CachedRecords::Nowhere) {
            CachedRecords::Memory(records) => records,
            CachedRecords::Nowhere | CachedRecords::Scratch => {
                let mut records = Vec::new();
                survey.inputs[unit.input].las.read(unit.slice, &mut records)?;
                records
            }
        };
        let counts = self.bucket(survey, unit.input, &records)?;
        Ok((RunStorage::Memory(std::mem::replace(&mut self.run, records)), counts))
    }

    /// Makes a slice's run in the scratch, at the place where the slice itself may
    /// lie.
    fn run_in_scratch(
        &mut self,
        survey: &Survey,
        unit: &InputSlice,
        number: u32,
        scratch: &Scratch,
    ) -> Result<Vec<u32>> {
        let input = &survey.inputs[unit.input];
        let mut records = std::mem::take(&mut self.slice);
        if matches!(*unit.kept(), CachedRecords::Scratch) {
            records.resize(unit.slice.points as usize * input.source.record_length, 0);
            scratch.runs.read_exact_at(&mut records, unit.at)?;
            scratch.receipt(&JournalEntry::Bucketing { unit: number })?;
        } else {
            input.las.read(unit.slice, &mut records)?;
        }
        let counts = self.bucket(survey, unit.input, &records)?;
        self.slice = records;
        scratch.runs.write_all_at(&self.run, unit.at)?;
        let held = (0..).zip(&counts).filter(|(_, n)| **n > 0).map(|(chunk, n)| (chunk, *n)).collect();
        let end = unit.at + self.run.len() as u64;
        scratch.receipt(&JournalEntry::Bucketed { unit: number, end, counts: held })?;
        Ok(counts)
    }

    /// Sorts raw records by chunk into `self.run`, stable; returns how many
    /// each chunk got.
    fn bucket(&mut self, survey: &Survey, input: usize, records: &[u8]) -> Result<Vec<u32>> {
        let source = &survey.inputs[input];
        let length = source.source.record_length;
        let mut counts = vec![0u32; buckets(survey)];
        let outside = (counts.len() - 1) as u32;
        if counts.len() == 1 {
            counts[0] = (records.len() / length) as u32;
            self.run.clear();
            self.run.extend_from_slice(records);
            return Ok(counts);
        }
        self.rows.clear();
        for r in records.chunks_exact(length) {
            let raw = record::raw_position(r);
            let chunk = if survey.region.holds(input, raw) {
                let tree = survey.cube.tree(source.requantise.stored(raw));
                let chunk = survey.plan.chunk_of(tree);
                chunk.ok_or_else(|| StageError::changed(&source.las))?
            } else {
                outside
            };
            match self.rows.last_mut() {
                Some((last, points)) if *last == chunk => *points += 1,
                _ => self.rows.push((chunk, 1)),
            }
        }
        for (chunk, points) in &self.rows {
            counts[*chunk as usize] += points;
        }
        let mut next = Vec::with_capacity(counts.len());
        let mut at = 0;
        for count in &counts {
            next.push(at);
            at += *count as usize * length;
        }
        self.run.resize(records.len(), 0);
        let mut rest = records;
        for (chunk, points) in &self.rows {
            let (row, behind) = rest.split_at(*points as usize * length);
            let to = &mut next[*chunk as usize];
            let into = &mut self.run[*to..*to + row.len()];
            // Most rows are long; in a cloud without any order they are single
            // records, for which a call costs more than the copying.
            if *points == 1 {
                record::copy_record(row, into)
            } else {
                into.copy_from_slice(row)
            }
            *to += row.len();
            rest = behind;
        }
        Ok(counts)
    }
}
