//! What the engine asks of a conversion. A trait, so that the queue can be tried
//! with conversions that are slow, fail, panic or never end.

use std::path::PathBuf;

use crate::stage::context::Context;
use crate::stage::options::Options;

/// What is to be converted.
#[derive(Debug, Clone)]
pub struct Work {
    pub inputs: Vec<PathBuf>,
    /// The folder that the octree is to become.
    pub output: PathBuf,
    pub options: Options,
}

/// What came of it.
#[derive(Debug, Clone, Default)]
pub struct Report {
    pub points_in: u64,
    pub points_out: u64,
    pub points_set_aside: u64,
    pub output_bytes: u64,
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
    fn convert(&self, work: &Work, context: &Context) -> Result<Report, Failure>;
}

/// The real one.
#[derive(Debug, Clone, Copy, Default)]
pub struct Conduct;

impl Converter for Conduct {
    fn convert(&self, work: &Work, _context: &Context) -> Result<Report, Failure> {
        let message = format!("{:?}: conversion is not built into this version", work.inputs);
        Err(Failure { message, may_pass: false, panicked: false })
    }
}
