//! Is an octree right? On its own: metadata, hierarchy, byte ranges, boxes, the
//! rule of its sampling, statistics. Beside its inputs: the same points with the
//! same attributes, to the last bit.
//!
//! The checks are independent of the conversion: nothing here uses `stage` or
//! `lod`, and the meaning of LAS records is written down a second time. Shared
//! with the converter is only what reads the formats.

mod colors;
mod compare_inputs;
mod copc;
mod cube;
mod digest;
mod inputs;
mod limits;
mod mapping;
mod octree;
mod point_pass;
mod promises;
mod recomputed_statistics;
mod report;
mod spacing;
mod structure;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_support;
mod value;

use std::path::PathBuf;

use crate::format::copc::{CopcError, is_copc};
use crate::format::inputs::{InputsError, expand};
use crate::format::las::LasError;
use crate::format::potree::{Metadata, PotreeError};
use octree::{Octree, Opened};
pub use point_pass::Spacing;
pub use report::{Check, Comparison, Outcome, PositionError, Report, grouped};

/// What is to be verified.
#[derive(Debug, Clone)]
pub struct Request {
    /// The octree's folder, or a COPC file.
    pub octree: PathBuf,
    /// The files that it was made of, folders of them, or lists (`@list`); none:
    /// the octree is checked on its own.
    pub against: Vec<PathBuf>,
    /// Whether they may be cut or damaged: then what can be read of them counts.
    pub damaged: bool,
    /// Bytes of memory that the comparison may take.
    pub memory_limit: u64,
    pub spacing: Spacing,
}

/// Why nothing could be verified. What is wrong with the octree is in the
/// report.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    #[error(transparent)]
    Octree(#[from] PotreeError),
    #[error(transparent)]
    Las(#[from] LasError),
    #[error(transparent)]
    Inputs(#[from] InputsError),
    #[error(transparent)]
    Copc(#[from] CopcError),
}

/// Checks an octree, on the threads of the current rayon pool.
pub fn verify(request: &Request) -> Result<Report, VerifyError> {
    let files = match request.against.is_empty() {
        true => Vec::new(),
        false => expand(&request.against)?,
    };
    if !request.octree.is_dir() && is_copc(&request.octree) {
        return copc::verify(request, &files);
    }
    let mut octree = match Octree::open(&request.octree, request.memory_limit) {
        Opened::Whole(octree) => octree,
        Opened::Nothing(error @ PotreeError::Read { .. }) => return Err(error.into()),
        Opened::Nothing(error) => return Ok(unreadable(request, None, &error)),
        Opened::Metadata(_, error @ PotreeError::Read { .. }) => return Err(error.into()),
        Opened::Metadata(metadata, error) => return Ok(unreadable(request, Some(&metadata), &error)),
    };
    let mut report = empty(request, Some(&octree.metadata));
    report.nodes = octree.nodes.len() as u64;
    report.depth = structure::depth(&octree.nodes);
    report.points = structure::points(&octree.nodes);
    report.bytes = octree.bytes;
    report.checks.push(structure::metadata(&octree.metadata));
    if report.checks[0].outcome == Outcome::Wrong {
        report.checks.push(Check::skipped("all else", "rests on metadata.json"));
        return Ok(report);
    }
    report.checks.push(structure::hierarchy(&octree));
    report.checks.push(structure::bytes(&octree));
    report.checks.push(structure::counts(&octree));
    if request.damaged {
        octree.readable = inputs::readable(&files, &octree.metadata)?;
    }
    let walk = point_pass::walk(&octree, !files.is_empty());
    if !files.is_empty() {
        report.against = Some(compare_inputs::compare(&octree, &walk.sum, &files, request)?);
    }
    report.checks.extend(walk.checks(&octree, request.spacing));
    report.judge();
    Ok(report)
}

/// The report on an octree whose files cannot be made sense of.
fn unreadable(request: &Request, metadata: Option<&Metadata>, error: &PotreeError) -> Report {
    let mut report = empty(request, metadata);
    report.checks.push(match metadata {
        Some(metadata) => structure::metadata(metadata),
        None => Check::wrong("metadata", error.to_string()),
    });
    if metadata.is_some() {
        report.checks.push(Check::wrong("hierarchy", error.to_string()));
    }
    report.checks.push(Check::skipped("all else", "rests on what cannot be read"));
    report
}

fn empty(request: &Request, metadata: Option<&Metadata>) -> Report {
    Report {
        octree: request.octree.clone(),
        ok: false,
        name: metadata.map_or(String::new(), |m| m.name.clone()),
        encoding: metadata.map_or("", |m| structure::encoding_in_words(m.encoding)).to_string(),
        points: 0,
        nodes: 0,
        depth: 0,
        bytes: 0,
        checks: Vec::new(),
        against: None,
        seconds: 0.0,
    }
}
