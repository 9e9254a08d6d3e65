//! Is an octree right? On its own: metadata, hierarchy, byte ranges, boxes, the
//! rule of its sampling, statistics. Beside its inputs: the same points with the
//! same attributes, to the last bit.
//!
//! The checks are independent of the conversion: nothing here uses `convert` or
//! `octree::sampling`, and the meaning of LAS records is written down a second time. Shared
//! with the converter is only what reads the formats.

mod color_attributes;
mod colors;
mod compare_inputs;
mod copc;
mod cube;
mod digest;
mod error;
mod inputs;
mod limits;
mod mapping;
mod octree;
mod point_pass;
mod promises;
mod recomputed_statistics;
mod report;
mod request;
mod spacing;
mod structure;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_support;
mod value;

use crate::format::finished::{self, Finished};
use crate::format::inputs::expand;
use crate::format::potree::{Metadata, PotreeError};
pub use error::VerifyError;
use octree::{OctreeUnderTest, OpenedOctree};
pub use report::{Check, CheckOutcome, Comparison, PositionError, VerifyReport};
pub use request::{SpacingRule, VerifyRequest};

/// Checks an octree, on the threads of the current rayon pool.
pub fn verify(request: &VerifyRequest) -> Result<VerifyReport, VerifyError> {
    let files = match request.against.is_empty() {
        true => Vec::new(),
        false => expand(&request.against)?,
    };
    let folder = match finished::find(&request.octree) {
        Finished::Copc(file) => return copc::verify(request, &file, &files),
        Finished::Octree(folder) => folder,
        Finished::Neither => request.octree.clone(),
    };
    let mut octree = match OctreeUnderTest::open(&folder, request.memory_limit) {
        OpenedOctree::Whole(octree) => octree,
        OpenedOctree::Nothing(error @ PotreeError::Read { .. }) => return Err(error.into()),
        OpenedOctree::Nothing(error) => return Ok(unreadable(request, None, &error)),
        OpenedOctree::Metadata(_, error @ PotreeError::Read { .. }) => return Err(error.into()),
        OpenedOctree::Metadata(metadata, error) => return Ok(unreadable(request, Some(&metadata), &error)),
    };
    let mut report = VerifyReport::empty(request, Some(&octree.metadata));
    report.nodes = octree.nodes.len() as u64;
    report.depth = octree::depth(&octree.nodes);
    report.points = octree::points(&octree.nodes);
    report.bytes = octree.bytes;
    report.checks.push(structure::metadata(&octree.metadata));
    if report.checks[0].outcome == CheckOutcome::Wrong {
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
fn unreadable(request: &VerifyRequest, metadata: Option<&Metadata>, error: &PotreeError) -> VerifyReport {
    let mut report = VerifyReport::empty(request, metadata);
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
