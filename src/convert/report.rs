//! `report.json`: what was made of what, and how. It lies beside the octree, so
//! that whoever has the octree has its story: the inputs, the options, the
//! lattice, what was counted, what was found odd, and what it cost.
//!
//! Octrees are served to the web, so files are told by their names, not by where
//! they lie on this machine.

use std::path::Path;

use serde::Serialize;

use crate::convert::error::StageError;
use crate::convert::options::{GuardMode, Options};
use crate::convert::outcome::ConversionOutcome;
use crate::convert::request::ConversionRequest;
use crate::convert::values::counted_inputs::Survey;
use crate::convert::values::record_range::SetAsideReason;
use crate::octree::lattice::Lattice;
use crate::octree::node::LEAF_LIMIT;
use crate::octree::outliers;
use crate::platform::disk::Disk;

/// The file's name in an octree's folder.
pub const REPORT: &str = "report.json";

#[derive(Serialize)]
struct ConversionReport<'a> {
    lodestone: &'static str,
    options: &'a Options,
    inputs: Vec<ReportedInput<'a>>,
    lattice: &'a Lattice,
    /// World length of the root cube's side, and of the root's spacing.
    cube: f64,
    spacing: f64,
    /// The coordinate reference system in words, and for viewers as a proj4 string.
    crs: &'a str,
    projection: &'a str,
    attributes: Vec<&'a str>,
    /// Attributes that were left out on request.
    left_out: &'a [String],
    guards: Vec<Guard>,
    #[serde(flatten)]
    outcome: &'a ConversionOutcome,
}

/// One file that has points.
#[derive(Serialize)]
struct ReportedInput<'a> {
    name: String,
    bytes: u64,
    /// Seconds since 1970.
    modified: &'a str,
    /// Of its content, where that was read for it: the daemon does, before a job.
    #[serde(skip_serializing_if = "Option::is_none")]
    blake3: Option<&'a str>,
    points: u64,
    version: String,
    point_format: u8,
    compressed: bool,
    software: &'a str,
}

/// One of those that look after points that no octree is the better for, whether
/// it found some or not.
#[derive(Serialize)]
struct Guard {
    name: &'static str,
    mode: GuardMode,
    /// Whether it looked at the points at all; where not, that it found none says nothing.
    looked: bool,
    /// Why it did not.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_looked_because: Option<&'static str>,
    /// What it looked for.
    threshold: String,
    points: u64,
}

impl Guard {
    fn new(reason: SetAsideReason, outcome: &ConversionOutcome, options: &Options) -> Guard {
        let threshold = match reason {
            SetAsideReason::Outlier => format!(
                "at most {} points, without which the longest side of the box is {} times shorter",
                outliers::most(outcome.points_in),
                outliers::SHRINK
            ),
            SetAsideReason::Duplicate => format!("beyond the first {LEAF_LIMIT} points at one position"),
            SetAsideReason::Twin => "beyond the first record of which all attributes are equal".to_string(),
        };
        let points = outcome.set_aside.get(&reason).copied().unwrap_or(0);
        let mode = reason.mode(options);
        let why_not = match reason {
            _ if mode == GuardMode::Keep => Some("it is switched off (`keep`)"),
            SetAsideReason::Outlier if outliers::most(outcome.points_in) == 0 => {
                Some("there are too few points for one of them to be an outlier")
            }
            SetAsideReason::Outlier | SetAsideReason::Duplicate | SetAsideReason::Twin => None,
        };
        let (name, looked) = (reason.name(), why_not.is_none());
        Guard { name, mode, looked, not_looked_because: why_not, threshold, points }
    }
}

/// Writes the report into the octree's folder.
pub fn write(
    survey: &Survey,
    outcome: &ConversionOutcome,
    request: &ConversionRequest,
    folder: &Path,
    disk: &Disk,
) -> Result<(), StageError> {
    let stamps: Vec<String> = survey.inputs.iter().map(|input| input.las.stamp()).collect();
    let inputs = survey.inputs.iter().zip(&stamps).map(|(input, stamp)| {
        let header = input.las.header();
        ReportedInput {
            name: input.las.path().file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            bytes: header.file_bytes,
            modified: stamp.split_once(' ').map_or("", |(_, modified)| modified),
            blake3: request.hashes.get(input.las.path()).map(String::as_str),
            points: header.points,
            version: format!("{}.{}", header.version.0, header.version.1),
            point_format: header.point_format,
            compressed: header.compressed,
            software: &header.software,
        }
    });
    let report = ConversionReport {
        lodestone: env!("CARGO_PKG_VERSION"),
        options: &request.options,
        inputs: inputs.collect(),
        lattice: &survey.lattice,
        cube: survey.cube.side(),
        spacing: survey.cube.spacing(),
        crs: &survey.crs,
        projection: &survey.projection,
        attributes: survey.unified.schema.attributes.iter().map(|a| a.name.as_str()).collect(),
        left_out: &survey.unified.left_out,
        guards: SetAsideReason::ALL
            .into_iter()
            .map(|reason| Guard::new(reason, outcome, &request.options))
            .collect(),
        outcome,
    };
    let json = serde_json::to_vec_pretty(&report)
        .map_err(|e| StageError::Inconsistent(format!("the report could not be written: {e}")))?;
    let file = disk.create(&folder.join(REPORT))?;
    file.write_all_at(&json, 0)?;
    Ok(file.sync()?)
}
