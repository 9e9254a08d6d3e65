//! How many points the last chunk of a file of the formats 0 to 5 really has, where the
//! header's count does not fit its bytes: a writer that died counted fewer, or more.
//!
//! A damaged chunk does not end with its points either, and decoded it goes on to give
//! points that look like its others. What tells the two apart: points encoded anew
//! become the very bytes that they were decoded from, to the last, only if they are
//! those that somebody encoded, all of them and none invented behind their end.

use super::chunks::{ChunkLayout, PointChunk};
use super::coding::Coding;
use super::explore::{ExploredTo, Explorer};
use super::points::PointBody;
use super::source::FileReader;
use super::{LasError, LasFile, Slice};

/// A decoder that goes on behind the last point comes to the end of the bytes within
/// about one more, and invents it; more often only where points take next to no bytes.
const MOST_TRIED: u64 = 16;

impl LasFile {
    /// The last chunk as it is known, and the points that it really has, if others.
    pub(super) fn last_recounted(&self) -> Option<(PointChunk, u64)> {
        let PointBody::Chunks { coding, chunks } = &self.body else { return None };
        let chunk = chunks.last()?;
        let most = self.most_in_last?.min(self.most_slice / coding.record_length as u64);
        let points = points_of(&self.source, coding, chunk, most)?;
        (points != chunk.points).then_some((*chunk, points))
    }

    /// The error of a slice that cannot be decoded; where that is because the header
    /// counts other than the last chunk holds, one with both numbers.
    pub(super) fn recounted(&self, slice: Slice, error: LasError) -> LasError {
        if slice.first + u64::from(slice.points) != self.header.points {
            return error;
        }
        let Some((chunk, points)) = self.last_recounted() else { return error };
        let (said, there) = (self.header.points, chunk.first + points);
        let path = self.path().to_path_buf();
        let reason = format!("its last LAZ chunk holds {points}, the header leaves {} to it", chunk.points);
        match there < said {
            true => LasError::Cut { path, readable: there, points: said, reason },
            false => LasError::Contradiction { path, said, there, reason },
        }
    }
}

/// The points of a chunk that has at most `most`; nothing where its bytes are no proof.
pub fn points_of(source: &FileReader, coding: &Coding, chunk: &PointChunk, most: u64) -> Option<u64> {
    let PointChunk { at, bytes, .. } = *chunk;
    let end = at.checked_add(bytes)?;
    let layout = ChunkLayout::Stream { start: at, end, chunk_points: None, points: most, settled: true };
    let mut records = Vec::new();
    let explored = Explorer::new(source, coding, &layout, false)
        .ok()?
        .go_to(most, |block| records.extend_from_slice(block));
    let ended = match &explored.end {
        ExploredTo::Points => true,
        ExploredTo::Broken(broken) => broken.ended,
        ExploredTo::Bound => false,
    };
    if !ended || explored.at != end {
        return None;
    }
    let mut chunk = vec![0; usize::try_from(bytes).ok()?];
    source.read_exact_at(&mut chunk, at).ok()?;
    let fewest = explored.points.saturating_sub(MOST_TRIED).max(1);
    let is_it = |points: &u64| {
        let records = &records[..*points as usize * coding.record_length];
        coding.encode(records).is_ok_and(|encoded| encoded == chunk)
    };
    (fewest..=explored.points).rev().find(is_it)
}
