//! What the engine asks of a conversion. A trait, so that the queue can be tried
//! with conversions that are slow, fail, panic or never end.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::convert::context::Context;
use crate::convert::options::Options;
use crate::convert::preview::{self, PreviewManifest};
use crate::convert::report::REPORT;
use crate::convert::run::{self, ConversionOutcome, ConversionRequest};
use crate::render;
use crate::serve::job::QueuedFile;

/// What is to be converted.
#[derive(Debug, Clone)]
pub struct Work {
    pub inputs: Vec<PathBuf>,
    /// BLAKE3 of their content, where it is known.
    pub hashes: HashMap<PathBuf, String>,
    /// The folder that the octree is to become.
    pub output: PathBuf,
    pub options: Options,
}

impl Work {
    pub(super) fn new(inputs: Vec<QueuedFile>, output: PathBuf, options: Options) -> Work {
        let known = inputs.iter().filter(|input| !input.hash.is_empty());
        let hashes = known.map(|input| (input.path.clone(), input.hash.clone())).collect();
        Work { inputs: inputs.into_iter().map(|input| input.path).collect(), hashes, output, options }
    }
}

/// What came of it.
#[derive(Debug, Clone, Default)]
pub struct ConversionResult {
    pub points_in: u64,
    pub points_out: u64,
    /// Points that the inputs promise and that could not be read.
    pub points_missing: u64,
    /// Points that were kept out, by reason.
    pub set_aside: Vec<(&'static str, u64)>,
    pub output_bytes: u64,
    /// Of them, those of the COPC file, where one was made.
    pub copc_bytes: Option<u64>,
    pub seconds_by_stage: Vec<(&'static str, f64)>,
    /// What was odd about the inputs, and what was done about it.
    pub warnings: Vec<String>,
    /// All of the conversion's report, for the job's record.
    pub json: serde_json::Value,
}

/// Why nothing came of it.
#[derive(Debug, Clone)]
pub struct Failure {
    pub message: String,
    /// Whether trying again with the same input can help.
    pub may_pass: bool,
    pub panicked: bool,
}

pub trait Converter: Send + Sync + 'static {
    /// Converts, taking as long as it takes; looks at `context.cancel`.
    fn convert(&self, work: &Work, context: &Context) -> Result<ConversionResult, Failure>;

    /// Draws the pictures of an octree into a folder. What stands in for
    /// conversions need not know how.
    fn preview(
        &self,
        octree: &Path,
        into: &Path,
        options: &preview::PreviewOptions,
        context: &Context,
    ) -> render::Result<PreviewManifest> {
        preview::preview(octree, into, options, context)
    }
}

/// The real one.
#[derive(Debug, Clone, Copy, Default)]
pub struct Conduct;

impl Converter for Conduct {
    fn convert(&self, work: &Work, context: &Context) -> Result<ConversionResult, Failure> {
        let request = ConversionRequest {
            inputs: work.inputs.clone(),
            output: work.output.clone(),
            // What an earlier attempt may have left.
            overwrite: true,
            // Until the queue knows that the octree is there.
            keep_scratch: true,
            options: work.options.clone(),
            hashes: work.hashes.clone(),
        };
        // Made again before the next attempt.
        let ours =
            [work.output.parent(), context.scratch.parent()].map(|folder| folder.unwrap_or(Path::new("")));
        let outcome = run::convert(&request, context).map_err(|error| Failure {
            may_pass: error.retry_can_help() || error.lost_what_was_in(&ours),
            message: error.to_string(),
            panicked: false,
        })?;
        Ok(ConversionResult {
            points_in: outcome.points_in,
            points_out: outcome.points_out,
            points_missing: outcome.points_missing,
            set_aside: outcome.set_aside.iter().map(|(reason, points)| (reason.name(), *points)).collect(),
            output_bytes: outcome.output_bytes,
            copc_bytes: outcome.copc.as_ref().map(|file| file.bytes),
            seconds_by_stage: outcome.seconds_by_stage.iter().map(|(stage, s)| (stage.name(), *s)).collect(),
            warnings: outcome.repairs.iter().chain(&outcome.notes).cloned().collect(),
            json: told(&work.output, &outcome),
        })
    }
}

/// What the report beside the octree says, but for the inputs: of these the job
/// has its own list, and there may be thousands. Where it cannot be read any more,
/// the outcome is most of it.
fn told(octree: &Path, outcome: &ConversionOutcome) -> serde_json::Value {
    let report = fs::read(octree.join(REPORT)).ok();
    match report.and_then(|bytes| serde_json::from_slice(&bytes).ok()) {
        Some(serde_json::Value::Object(mut report)) => {
            report.remove("inputs");
            report.into()
        }
        _ => serde_json::to_value(outcome).unwrap_or_default(),
    }
}
