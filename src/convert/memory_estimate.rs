//! How much memory the steps take, told before they begin.

use super::copc;
use super::guards::exact_duplicates;
use super::options::{GuardMode, LodColor, Options};
use crate::octree::color_average;

/// Memory that indexing a chunk of so many points takes, in bytes: two arrays
/// of items and the finished records beside the raw ones.
pub fn chunk_memory(points: u64, raw: u64, record: u64, options: &Options) -> u64 {
    let averages = match options.lod_color {
        LodColor::Keep => 0,
        LodColor::Attribute | LodColor::Average => {
            color_average::MEMORY + points * color_average::MEMORY_A_CANDIDATE
        }
    };
    let twins = if options.twins == GuardMode::Keep { 0 } else { exact_duplicates::memory(points) };
    let copc = if options.format.copc { copc::memory(points, record, options) } else { 0 };
    points * (2 * 16 + 1 + raw + 2 * record) + (12 << 20) + averages + twins + copc
}
