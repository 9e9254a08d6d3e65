//! Where chunks really end, when the chunk table has as many as there are but some of
//! their sizes wrong. Found by going through them from the front, once, and only after
//! one of them could not be decoded.

use std::sync::Arc;

use super::chunks::{ChunkLayout, PointChunk};
use super::coding::Coding;
use super::explore::{ExploredTo, Explorer};
use super::source::FileReader;

/// The same chunks with their true places; nothing if these cannot be told, or are the
/// ones that are known.
pub fn borders(source: &Arc<FileReader>, coding: &Coding, chunks: &[PointChunk]) -> Option<Vec<PointChunk>> {
    let (first, last) = (chunks.first()?, chunks.last()?);
    let end = last.at + last.bytes;
    let mut mended = Vec::with_capacity(chunks.len());
    let mut at = first.at;
    if coding.layered {
        let mut front = vec![0; coding.layered_front()];
        for chunk in chunks {
            if end.saturating_sub(at) < front.len() as u64 {
                return None;
            }
            source.read_exact_at(&mut front, at).ok()?;
            let (points, bytes) = coding.layered_extent(&front);
            if points != chunk.points || bytes > end - at {
                return None;
            }
            mended.push(PointChunk { at, bytes, ..*chunk });
            at += bytes;
        }
    } else {
        // A decoder starts anew every so many points: all but the last have as many.
        let each = first.points;
        if chunks.iter().rev().skip(1).any(|chunk| chunk.points != each) || last.points > each {
            return None;
        }
        let points = last.first + last.points - first.first;
        let chunk_points = Some(u32::try_from(each).ok()?);
        let layout = ChunkLayout::Stream { start: at, end, chunk_points, points, settled: true };
        let mut explorer = Explorer::new(source, coding, &layout, false).ok()?;
        for chunk in chunks {
            let explored = explorer.go_to(chunk.first - first.first + chunk.points, |_| {});
            if !matches!(explored.end, ExploredTo::Points) {
                return None;
            }
            mended.push(PointChunk { at, bytes: explored.at - at, ..*chunk });
            at = explored.at;
        }
    }
    (at == end && mended != chunks).then_some(mended)
}
