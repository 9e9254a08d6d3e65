//! Conducts one conversion: the stages in a row, each with what the one before
//! it made. Both `lodestone convert` and the daemon come through here.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use crate::disk::Disk;
use crate::format::inputs;
use crate::format::potree;
use crate::stage::context::{Context, Stage};
use crate::stage::distribute::distribute;
use crate::stage::error::StageError;
use crate::stage::index::index;
use crate::stage::merge::merge;
use crate::stage::options::{Encoding, Options};
use crate::stage::output::OctreeFile;
use crate::stage::publish::{Octree, publish, staging_folder};
use crate::stage::survey::{Survey, survey};

/// What is to be converted into which folder.
#[derive(Debug, Clone)]
pub struct Request {
    /// Files, folders or `@list` files.
    pub inputs: Vec<PathBuf>,
    /// The octree's folder; made, or replaced in one step.
    pub output: PathBuf,
    pub overwrite: bool,
    pub options: Options,
}

/// How a conversion went.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    pub files: u64,
    pub points_in: u64,
    pub points_out: u64,
    pub points_set_aside: u64,
    pub nodes: u64,
    /// Level of the deepest node.
    pub depth: u32,
    pub chunks: u64,
    /// Bytes of the octree's three files.
    pub output_bytes: u64,
    /// Bytes of intermediate files.
    pub scratch_bytes: u64,
    /// Whether every position is exactly where the input has it.
    pub exact: bool,
    /// Most that a position can have moved, in units of the octree's scale.
    pub max_error_units: f64,
    /// Wall time by stage, in seconds.
    pub seconds_by_stage: BTreeMap<&'static str, f64>,
    /// Attributes that were left out because they are zero in every point.
    pub unused_attributes: Vec<String>,
    /// What was odd about the inputs.
    pub notes: Vec<String>,
}

/// Why a conversion failed.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct ConductError(#[from] StageError);

impl ConductError {
    /// Whether the same job, tried again later, can succeed.
    pub fn retry_can_help(&self) -> bool {
        self.0.retry_can_help()
    }

    pub fn is_cancelled(&self) -> bool {
        matches!(self.0, StageError::Cancelled)
    }
}

/// Converts on the calling thread and `context.threads` others. Whatever
/// happens, what stood in the output's place before stays until the new octree
/// is complete, and nothing half-made stays behind.
pub fn convert(request: &Request, context: &Context) -> Result<Outcome, ConductError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(context.threads)
        .thread_name(|i| format!("convert-{i}"))
        .build()
        .map_err(|e| StageError::Inconsistent(format!("no threads could be started: {e}")))?;
    let staging = staging_folder(&request.output);
    let clean = CleanUp { disk: context.disk.clone(), folders: [staging, context.scratch.clone()] };
    let outcome = pool.install(|| run_stages(request, context));
    drop(clean);
    outcome.map_err(ConductError)
}

/// Removes what a conversion leaves behind, also when it panics.
struct CleanUp {
    disk: Disk,
    folders: [PathBuf; 2],
}

impl Drop for CleanUp {
    fn drop(&mut self) {
        for folder in &self.folders {
            if let Err(error) = self.disk.remove_dir_all(folder) {
                tracing::warn!(%error, "left something behind");
            }
        }
    }
}

fn run_stages(request: &Request, context: &Context) -> Result<Outcome, StageError> {
    let mut times = Times::default();
    if request.output.exists() && !request.overwrite {
        return Err(StageError::OutputExists(request.output.clone()));
    }
    let paths = inputs::expand(&request.inputs)?;
    if paths.is_empty() {
        return Err(StageError::NoInputs);
    }
    let survey = times.measure(Stage::Survey, || survey(&paths, &request.options, context))?;
    let octree_file = create_octree_file(request, &survey, context)?;
    let written_before = context.disk.bytes_written();
    let runs = times.measure(Stage::Distribute, || distribute(&survey, context))?;
    let scratch_bytes = context.disk.bytes_written() - written_before;
    let indexed =
        times.measure(Stage::Index, || index(&survey, &runs, &octree_file, &request.options, context))?;
    drop(runs);
    let (statistics, points) =
        times.measure(Stage::Merge, || merge(&survey, indexed, &octree_file, &request.options, context))?;
    let published = times.measure(Stage::Publish, || {
        for input in &survey.inputs {
            input.las.check_unchanged()?;
        }
        let (nodes, length) = octree_file.finish()?;
        let octree = Octree { survey: &survey, nodes: &nodes, length, statistics: &statistics };
        publish(&octree, &request.output, request.overwrite, &request.options, context)
    })?;
    context.progress.begin(Stage::Done, survey.points);
    context.progress.advance(survey.points);
    Ok(Outcome {
        files: paths.len() as u64,
        points_in: survey.points,
        points_out: points,
        points_set_aside: 0,
        nodes: published.nodes,
        depth: published.depth,
        chunks: survey.plan.chunks.len() as u64,
        output_bytes: published.bytes,
        scratch_bytes,
        exact: survey.lattice.is_exact(),
        max_error_units: if survey.lattice.is_exact() { 0.0 } else { 0.5 },
        seconds_by_stage: times.0,
        unused_attributes: survey.unified.unused,
        notes: survey.notes,
    })
}

/// Makes the staging folder and the file for the points in it, if there is
/// room for them.
fn create_octree_file(
    request: &Request,
    survey: &Survey,
    context: &Context,
) -> Result<OctreeFile, StageError> {
    let staging = staging_folder(&request.output);
    let bytes = survey.points * survey.unified.schema.record_size() as u64;
    // Brotli needs at least a fifth of the plain bytes; less is not worth a try.
    let needed = match request.options.encoding {
        Encoding::Default => bytes,
        Encoding::Brotli => bytes / 5,
    };
    let free = context.disk.free_space(&staging)?;
    if free < needed {
        return Err(StageError::NoRoom { folder: staging, needed, free });
    }
    context.disk.remove_dir_all(&staging)?;
    context.disk.create_dir_all(&staging)?;
    let file = context.disk.create(&staging.join(potree::OCTREE))?;
    Ok(OctreeFile::new(file, context.memory_limit / 8))
}

/// Wall time by stage.
#[derive(Default)]
struct Times(BTreeMap<&'static str, f64>);

impl Times {
    fn measure<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        let seconds = start.elapsed().as_secs_f64();
        tracing::debug!(stage = stage.name(), seconds, "stage done");
        self.0.insert(stage.name(), seconds);
        result
    }
}
