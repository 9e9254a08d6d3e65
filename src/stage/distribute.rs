//! Distribute: each slice of the input becomes a run, its raw records bucketed
//! by chunk with one counting sort and written one behind the other ("Fast
//! Out-of-Core Octree Generation", 4.1, distributing; DESIGN.md, decision 4).
//!
//! A run lies in memory where the cloud fits it, else in one scratch file at a
//! place known beforehand: sequential writes, no appending to thousands of
//! files, and a rerun of a slice overwrites just its own run.

use std::sync::{Arc, Mutex};

use super::context::{Context, Stage};
use super::error::{Result, StageError};
use super::survey::Survey;
use super::workers;
use crate::cloud::record;
use crate::disk::DiskFile;

/// Where a run's records are.
pub enum Place {
    Memory(Vec<u8>),
    /// From this byte of the scratch file.
    Scratch(u64),
}

/// One slice's records, chunk by chunk.
pub struct Run {
    pub input: usize,
    pub place: Place,
}

/// A chunk's part of a run, in records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    pub run: u32,
    pub first: u32,
    pub points: u32,
}

/// All runs, and each chunk's parts in the order of the input.
pub struct Runs {
    pub runs: Vec<Run>,
    pub parts: Vec<Vec<Part>>,
    pub scratch: Option<Arc<DiskFile>>,
}

/// A run once it is made, with the points it holds of each chunk.
type Made = Mutex<Option<(Run, Vec<u32>)>>;

/// The scratch file's name in the job's scratch folder.
const RUNS_FILE: &str = "runs.bin";

/// Cuts the surveyed units into runs.
pub fn distribute(survey: &Survey, context: &Context) -> Result<Runs> {
    context.progress.begin(Stage::Distribute, survey.points);
    let scratch = if survey.in_core { None } else { Some(Arc::new(create_scratch(survey, context)?)) };
    let starts = run_starts(survey);
    let made: Vec<Made> = survey.units.iter().map(|_| Mutex::new(None)).collect();
    workers::in_order(
        context.threads,
        survey.units.len(),
        &context.cancel,
        Bucketer::default,
        |state, i| {
            let unit = &survey.units[i];
            let input = &survey.inputs[unit.input];
            let kept = unit.kept.lock().unwrap_or_else(|e| e.into_inner()).take();
            let records = match kept {
                Some(records) => records,
                None => {
                    let mut buffer = std::mem::take(&mut state.slice);
                    input.las.read(unit.slice, &mut buffer)?;
                    buffer
                }
            };
            let counts = state.bucket(survey, unit.input, &records)?;
            let place = match &scratch {
                None => Place::Memory(std::mem::replace(&mut state.run, records)),
                Some(file) => {
                    file.write_all_at(&state.run, starts[i])?;
                    state.slice = records;
                    Place::Scratch(starts[i])
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
    collect(survey, made, scratch)
}

/// Where each unit's run begins in the scratch file.
fn run_starts(survey: &Survey) -> Vec<u64> {
    let mut at = 0;
    survey
        .units
        .iter()
        .map(|unit| {
            let start = at;
            at += u64::from(unit.slice.points) * survey.inputs[unit.input].source.record_length as u64;
            start
        })
        .collect()
}

fn create_scratch(survey: &Survey, context: &Context) -> Result<DiskFile> {
    let needed: u64 =
        survey.inputs.iter().map(|i| i.las.header().points * i.source.record_length as u64).sum();
    let free = context.disk.free_space(&context.scratch)?;
    if free < needed {
        return Err(StageError::NoRoom { folder: context.scratch.clone(), needed, free });
    }
    context.disk.create_dir_all(&context.scratch)?;
    Ok(context.disk.create(&context.scratch.join(RUNS_FILE))?)
}

/// Turns per-run counts into per-chunk parts.
fn collect(survey: &Survey, made: Vec<Made>, scratch: Option<Arc<DiskFile>>) -> Result<Runs> {
    let mut parts: Vec<Vec<Part>> = vec![Vec::new(); survey.plan.chunks.len()];
    let mut runs = Vec::with_capacity(made.len());
    for slot in made {
        let Some((run, counts)) = slot.into_inner().unwrap_or_else(|e| e.into_inner()) else {
            return Err(StageError::Inconsistent("a slice was not distributed".into()));
        };
        let mut first = 0;
        for (chunk, points) in counts.into_iter().enumerate().filter(|(_, n)| *n > 0) {
            parts[chunk].push(Part { run: runs.len() as u32, first, points });
            first += points;
        }
        runs.push(run);
    }
    for (chunk, parts) in survey.plan.chunks.iter().zip(&parts) {
        let found: u64 = parts.iter().map(|p| u64::from(p.points)).sum();
        if found != chunk.points {
            // The census and the distribution read the same file twice.
            let input = parts.first().map_or(0, |p| runs[p.run as usize].input);
            return Err(StageError::InputChanged(survey.inputs[input].las.path().to_path_buf()));
        }
    }
    Ok(Runs { runs, parts, scratch })
}

/// One worker's buffers.
#[derive(Default)]
struct Bucketer {
    slice: Vec<u8>,
    run: Vec<u8>,
    chunks: Vec<u32>,
}

impl Bucketer {
    /// Sorts raw records by chunk into `self.run`, stable; returns how many
    /// each chunk got.
    fn bucket(&mut self, survey: &Survey, input: usize, records: &[u8]) -> Result<Vec<u32>> {
        let source = &survey.inputs[input];
        let length = source.source.record_length;
        let mut counts = vec![0u32; survey.plan.chunks.len()];
        if counts.len() == 1 {
            counts[0] = (records.len() / length) as u32;
            self.run.clear();
            self.run.extend_from_slice(records);
            return Ok(counts);
        }
        self.chunks.clear();
        for r in records.chunks_exact(length) {
            let tree = survey.cube.tree(source.requantise.stored(record::raw_position(r)));
            let Some(chunk) = survey.plan.chunk_of(tree) else {
                return Err(StageError::InputChanged(source.las.path().to_path_buf()));
            };
            counts[chunk as usize] += 1;
            self.chunks.push(chunk);
        }
        let mut next = Vec::with_capacity(counts.len());
        let mut at = 0;
        for count in &counts {
            next.push(at);
            at += *count as usize * length;
        }
        self.run.resize(records.len(), 0);
        for (r, chunk) in records.chunks_exact(length).zip(&self.chunks) {
            let to = &mut next[*chunk as usize];
            record::copy_record(r, &mut self.run[*to..*to + length]);
            *to += length;
        }
        Ok(counts)
    }
}
