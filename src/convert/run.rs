//! Conducts one conversion: the stages in a row, each with what the one before
//! it made. Both `lodestone convert` and the daemon come through here.

use std::collections::BTreeMap;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use super::{notes, report};
use crate::convert::checkpoint::receipt::JournalEntry;
use crate::convert::checkpoint::scratch::{Scratch, units_done};
use crate::convert::context::{Context, Stage};
use crate::convert::distribute::distribute;
use crate::convert::error::StageError;
use crate::convert::index::index;
use crate::convert::merge::merge;
use crate::convert::options::{GuardMode, LodColor};
pub use crate::convert::outcome::ConversionOutcome;
use crate::convert::publish;
pub use crate::convert::request::ConversionRequest;
use crate::convert::set_aside;
use crate::convert::staging::Staging;
use crate::convert::survey::{self, OpenedInputs};
use crate::convert::values::finished_files::OctreeContents;
use crate::convert::values::record_range;
use crate::format::inputs;
use crate::format::las::LasError;
use crate::platform::disk::{self, DirLock, Disk};
use crate::platform::limits;

/// Why a conversion failed.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct ConductError(#[from] StageError);

impl ConductError {
    /// Whether the same job, tried again later, can succeed.
    pub fn retry_can_help(&self) -> bool {
        self.0.retry_can_help()
    }

    /// Whether something of ours is not there any more: somebody removed one of
    /// these folders, or what was in it, while we worked.
    pub fn lost_what_was_in(&self, folders: &[&Path]) -> bool {
        match &self.0 {
            StageError::Disk(error) => {
                error.source.kind() == io::ErrorKind::NotFound
                    && folders.iter().any(|folder| error.path.starts_with(folder))
            }
            _ => folders.iter().any(|folder| !folder.is_dir()),
        }
    }

    pub fn is_cancelled(&self) -> bool {
        matches!(self.0, StageError::Cancelled)
    }
}

/// Converts on the calling thread and `context.threads` others. Whatever
/// happens, what stood in the output's place before stays until the new octree
/// is complete. What a conversion out of core has done stays too when it is
/// stopped, or fails in a way that may pass: asked again, it goes on from there.
pub fn convert(request: &ConversionRequest, context: &Context) -> Result<ConversionOutcome, ConductError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(context.threads)
        .thread_name(|i| format!("convert-{i}"))
        .build()
        .map_err(|e| StageError::NoThreads(e.to_string()))?;
    // What is logged on the pool's threads is about the same job as on this one.
    let span = tracing::Span::current();
    let goes_on = units_done(&context.scratch) > 0;
    // Unwind safety: what a run leaves behind it clears when it is dropped, and its
    // progress and cancel flag are plain atomics.
    let run_in_pool = || pool.install(|| span.in_scope(|| run_once(request, context)));
    let run = || catch_unwind(AssertUnwindSafe(run_in_pool));
    let mut outcome = run();
    let in_vain = match &outcome {
        Ok(Err(EndedConversion { error, resumed: true })) => {
            matches!(error, StageError::Inconsistent(_) | StageError::InputChanged(_))
                .then(|| error.to_string())
        }
        Err(_) if goes_on => Some("it panicked".to_string()),
        _ => None,
    };
    if let Some(error) = in_vain {
        // What an earlier run left was not what its receipts said, though it
        // looked so, as after a disk that went away and came back. Its remains
        // are gone now; this time from the beginning.
        tracing::warn!(error, "could not go on from an earlier run; beginning anew");
        context.disk.remove_dir_all(&context.scratch).map_err(StageError::from)?;
        outcome = run();
    }
    Ok(outcome.unwrap_or_else(|panic| resume_unwind(panic)).map_err(|ended| ended.error)?)
}

struct EndedConversion {
    error: StageError,
    /// Whether it had gone on from an earlier run.
    resumed: bool,
}

fn run_once(request: &ConversionRequest, context: &Context) -> Result<ConversionOutcome, EndedConversion> {
    let mut traces = CleanupGuard::new(context);
    let result = run_stages(request, context, &mut traces);
    let resumed = traces.resumed;
    match &result {
        Ok(_) if request.keep_scratch => traces.folders.clear(),
        Ok(_) => {}
        Err(error) if may_go_on(error) && units_done(&context.scratch) > 0 => traces.folders.clear(),
        Err(_) => {}
    }
    result.map_err(|error| EndedConversion { error, resumed })
}

/// Whether what is done is of use to the next run.
fn may_go_on(error: &StageError) -> bool {
    match error {
        // A changed input is another conversion; one that is gone may come back,
        // as a mount does.
        StageError::InputChanged(_) => false,
        StageError::Las(LasError::Changed { path, .. }) => !path.exists(),
        error => error.retry_can_help(),
    }
}

/// What a conversion leaves behind if nobody takes it away; also when it panics.
struct CleanupGuard {
    disk: Disk,
    /// Staging until the octree has its name, and scratch; empty until they are ours.
    folders: Vec<PathBuf>,
    /// Whether receipts of an earlier run were taken up.
    resumed: bool,
    /// Held until all is taken away.
    locks: Vec<Arc<DirLock>>,
}

impl CleanupGuard {
    fn new(context: &Context) -> CleanupGuard {
        CleanupGuard { disk: context.disk.clone(), folders: Vec::new(), resumed: false, locks: Vec::new() }
    }

    fn are_ours(&mut self, staging: &Staging, scratch: Option<&Scratch>, context: &Context) {
        self.folders = vec![staging.folder.clone()];
        // Without a scratch folder of our own that name may be another's soon.
        self.folders.extend(scratch.map(|_| context.scratch.clone()));
        self.locks.push(staging.lock.clone());
        self.locks.extend(scratch.map(|scratch| scratch.lock.clone()));
    }
}

impl CleanupGuard {
    /// That name is free now for whoever converts to the same output next, and the
    /// octree for whoever replaces it.
    fn published(&mut self, staging: Staging) {
        self.folders.retain(|folder| *folder != staging.folder);
        self.locks.retain(|lock| !Arc::ptr_eq(lock, &staging.lock));
    }
}

impl Drop for CleanupGuard {
    fn drop(&mut self) {
        // By now another conversion may have a folder of that name.
        let ours = |folder: &&PathBuf| self.locks.iter().any(|lock| lock.is_at(folder));
        for folder in self.folders.iter().filter(ours) {
            if let Err(error) = self.disk.remove_dir_all(folder) {
                tracing::warn!(%error, "left something behind");
            }
        }
    }
}

fn run_stages(
    request: &ConversionRequest,
    context: &Context,
    traces: &mut CleanupGuard,
) -> Result<ConversionOutcome, StageError> {
    let (disk, options) = (&context.disk, &request.options);
    let mut times = StageTimes::default();
    limits::forget_peak_memory();
    let taken = request.output.exists() && !request.overwrite;
    if taken && !context.scratch.exists() {
        return Err(StageError::OutputExists(request.output.clone()));
    }
    let paths = inputs::expand(&request.inputs)?;
    if paths.is_empty() {
        return Err(StageError::NoInputs);
    }
    let mut opened = times.measure(Stage::Survey, || survey::open(&paths, options, context))?;
    let staging = Staging::open(disk, &request.output)?;
    let scratch = open_scratch(request, context, &opened, &staging)?;
    traces.are_ours(&staging, scratch.as_deref(), context);
    if let Some(outcome) = scratch.as_ref().and_then(|scratch| finished_before(request, scratch)) {
        context.progress.begin(Stage::Done, outcome.points_in);
        context.progress.advance(outcome.points_in);
        return Ok(outcome);
    }
    if taken {
        return Err(StageError::OutputExists(request.output.clone()));
    }
    let units_resumed = scratch.as_ref().map_or(0, |scratch| scratch.past.units);
    traces.resumed = units_resumed > 0;
    if units_resumed > 0 {
        tracing::info!(units = units_resumed, "going on from an earlier run");
        opened.notes.push(format!("went on from an earlier run that had done {units_resumed} units of work"));
    }

    let survey =
        times.measure(Stage::Survey, || survey::survey(opened, options, scratch.as_deref(), context))?;
    let files = staging.output_files(&survey, scratch.as_ref(), options, &request.output, context)?;
    let runs = times.measure(Stage::Distribute, || distribute(&survey, scratch.as_ref(), context))?;
    let mut indexed =
        times.measure(Stage::Index, || index(&survey, &runs, &files, scratch.as_ref(), options, context))?;
    let aside = [std::mem::take(&mut indexed.crowds), runs.outliers.clone()].concat();
    let files_aside = times.measure(Stage::Index, || {
        set_aside::write(&survey, &runs, &aside, options, &staging.folder, context)
    })?;
    drop(runs);
    let mut statistics = indexed.statistics.clone();
    let merged = times
        .measure(Stage::Merge, || merge(&survey, indexed, &files, scratch.as_ref(), options, context))?;
    statistics.merge(&merged.statistics);
    let set_aside = record_range::tally(&aside);
    let points_aside = set_aside.values().sum();
    let dropped = set_aside.iter().filter(|(reason, _)| reason.mode(options) == GuardMode::Drop);
    let points_dropped = dropped.map(|(_, points)| points).sum();
    let completed = times.measure(Stage::Publish, || {
        for input in &survey.inputs {
            input.las.check_unchanged()?;
        }
        let octree = OctreeContents {
            survey: &survey,
            files: &files.finish()?,
            statistics: &statistics,
            moments: &merged.moments,
            aside: points_aside,
        };
        publish::complete(&octree, &staging.folder, &request.output, options, context)
    })?;
    let mut notes = [survey.notes.as_slice(), &survey.lattice.notes()].concat();
    notes.extend(notes::odd_values(&survey.unified.schema, &statistics));
    notes.extend(survey.copc.as_ref().and_then(|_| notes::odd_returns(&survey.unified.schema, &statistics)));
    notes.extend(notes::kept_out(&set_aside, &files_aside, options));
    notes.extend((survey.missing > 0).then(|| {
        let promised = survey.points + survey.missing;
        format!("{} of the {promised} points that the input promises could not be read", survey.missing)
    }));
    let outcome = ConversionOutcome {
        files: paths.len() as u64,
        points_in: survey.points,
        points_out: merged.points,
        points_set_aside: points_aside,
        points_dropped,
        points_missing: survey.missing,
        set_aside,
        files_aside,
        nodes: completed.nodes,
        depth: completed.depth,
        chunks: survey.plan.chunks.len() as u64,
        output_bytes: completed.bytes,
        copc: completed.copc,
        scratch_bytes: scratch.as_ref().map_or(Ok(0), |scratch| scratch.bytes())?,
        exact: survey.lattice.is_exact(),
        max_error_units: survey.lattice.error_in_units(),
        max_error: std::array::from_fn(|axis| survey.lattice.error(axis)),
        units_resumed,
        seconds_by_stage: times.seconds,
        peak_bytes_by_stage: times.peaks,
        lod_color: LodColor::of(&survey.unified.schema),
        unused_attributes: survey.unified.unused.clone(),
        repairs: survey.repairs.clone(),
        notes,
    };
    report::write(&survey, &outcome, request, &staging.folder, disk)?;
    if let Some(scratch) = &scratch {
        let (inode, outcome) = (staging.inode()?, serde_json::to_string(&outcome).unwrap_or_default());
        scratch.receipt(&JournalEntry::Finished { inode, outcome })?;
        scratch.sync()?;
    }
    publish::swap_in(disk, &staging.folder, &request.output, request.overwrite)?;
    traces.published(staging);
    context.progress.begin(Stage::Done, survey.points);
    context.progress.advance(survey.points);
    Ok(outcome)
}

/// The scratch folder of a cloud that does not fit the memory, with what an
/// earlier run of the same conversion left there.
fn open_scratch(
    request: &ConversionRequest,
    context: &Context,
    opened: &OpenedInputs,
    staging: &Staging,
) -> Result<Option<Arc<Scratch>>, StageError> {
    if opened.in_core {
        context.disk.remove_dir_all(&context.scratch)?;
        return Ok(None);
    }
    let identity = opened.identity(&request.options, &request.output);
    let mut scratch = Scratch::open(&context.disk, context.scratch.clone(), identity)?;
    if !staging.holds(&scratch, &request.options, &request.output) {
        tracing::warn!(folder = %staging.folder.display(), "the octree in the making is gone or cut");
        scratch.past.built.clear();
    }
    Ok(Some(Arc::new(scratch)))
}

/// The outcome of an earlier run that died after it had given the octree its
/// name.
fn finished_before(request: &ConversionRequest, scratch: &Scratch) -> Option<ConversionOutcome> {
    let (inode, outcome) = scratch.past.finished.as_ref()?;
    if disk::inode(&request.output).ok() != Some(*inode) {
        return None;
    }
    serde_json::from_str(outcome).ok()
}

/// Wall time and memory by stage.
#[derive(Default)]
struct StageTimes {
    seconds: BTreeMap<Stage, f64>,
    peaks: BTreeMap<Stage, u64>,
}

impl StageTimes {
    fn measure<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        let seconds = start.elapsed().as_secs_f64();
        tracing::debug!(stage = stage.name(), seconds, "stage done");
        *self.seconds.entry(stage).or_default() += seconds;
        self.peaks.extend(limits::peak_memory().map(|peak| (stage, peak)));
        result
    }
}
