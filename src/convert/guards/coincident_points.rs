//! A crowd: a chunk of one position, which holds more points than a chunk may. A
//! leaf's worth of them stays in the octree, and the rest is never in memory at
//! once.

use super::exact_duplicates;
use crate::convert::context::Cancel;
use crate::convert::error::{Result, StageError};
use crate::convert::options::{GuardMode, Options};
use crate::convert::values::counted_inputs::Survey;
use crate::convert::values::record_range::{self, ExcludedRange, RunSegment, SetAsideReason};
use crate::convert::values::runs::Runs;
use crate::octree::chunk_plan::Chunk;
use crate::octree::node::LEAF_LIMIT;

/// Records that are looked at at once.
const BLOCK: u32 = 1 << 14;

/// Whether a chunk is one position that keeps a leaf's worth of its points.
pub fn is_crowd(survey: &Survey, options: &Options, chunk: &Chunk) -> bool {
    options.duplicates != GuardMode::Keep && u32::from(chunk.node.level) == survey.cube.bits
}

/// What stays of a crowd: its first points; where twins are set aside, the first
/// that differ. A twin is here what equals a point that stays. What differs from
/// those is a duplicate, be it twice there, so nothing else need be remembered.
pub fn thin(
    survey: &Survey,
    runs: &Runs,
    parts: &[RunSegment],
    options: &Options,
    cancel: &Cancel,
) -> Result<(Vec<RunSegment>, Vec<ExcludedRange>)> {
    if options.twins == GuardMode::Keep {
        // The rest need not even be read.
        return Ok(record_range::behind(parts, LEAF_LIMIT as u32, SetAsideReason::Duplicate));
    }
    let mut seen = exact_duplicates::hashes(LEAF_LIMIT);
    let (mut kept, mut aside) = (Vec::new(), Vec::new());
    let mut buffer = Vec::new();
    for block in parts.iter().copied().flat_map(blocks) {
        if cancel.is_cancelled() {
            return Err(StageError::Cancelled);
        }
        let run = &runs.runs[block.run as usize];
        let input = &survey.inputs[run.input];
        let length = input.source.record_length;
        let records = runs.records(block, length, &mut buffer)?.chunks_exact(length);
        for (at, record) in (block.first..).zip(records) {
            let one = RunSegment { first: at, points: 1, ..block };
            let hash = exact_duplicates::hash(input.layout, record);
            if seen.contains(&hash) {
                record_range::put(&mut aside, one, SetAsideReason::Twin);
            } else if seen.len() == LEAF_LIMIT {
                record_range::put(&mut aside, one, SetAsideReason::Duplicate);
            } else {
                seen.insert(hash);
                keep(&mut kept, one);
            }
        }
    }
    Ok((kept, aside))
}

/// A part, block by block.
fn blocks(part: RunSegment) -> impl Iterator<Item = RunSegment> {
    (0..part.points).step_by(BLOCK as usize).map(move |from| RunSegment {
        first: part.first + from,
        points: BLOCK.min(part.points - from),
        ..part
    })
}

/// Neighbours become one part.
fn keep(kept: &mut Vec<RunSegment>, one: RunSegment) {
    match kept.last_mut() {
        Some(last) if last.run == one.run && last.first + last.points == one.first => last.points += 1,
        _ => kept.push(one),
    }
}
