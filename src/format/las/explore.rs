//! Decoding LAZ only to find out how many points there are: where no chunk table says
//! it, and the header's count is doubtful.

use std::sync::Arc;

use super::LasError;
use super::chunks::ChunkLayout;
use super::coding::Coding;
use super::source::FileReader;
use super::stream::{Broken, PointStream, SKIP};

/// Compressed bytes that are decoded only to say how many points a cut file
/// still has; that takes a few seconds.
const MOST_TO_COUNT: u64 = 64 << 20;
/// And chunks: a decoder takes up to a millisecond to set up, be its chunk of a
/// single point. Where all of these are sound, only reading can tell about the rest.
pub const MOST_CHUNKS_TO_COUNT: u64 = 1_000;

/// What decoding a stream came to, as far as it was gone through.
#[derive(Debug)]
pub struct Explored {
    /// Points that are right.
    pub points: u64,
    /// Where the first byte behind them lies.
    pub at: u64,
    pub end: ExploredTo,
}

#[derive(Debug)]
pub enum ExploredTo {
    /// As many points as were asked for.
    Points,
    /// Bytes that are no more points, or none.
    Broken(Broken),
    /// It would have taken too long.
    Bound,
}

/// A stream that is decoded to find out how many points it has.
pub struct Explorer<'a> {
    coding: &'a Coding,
    layout: ChunkLayout,
    stream: PointStream,
    /// The last byte and the last point to go to.
    most: (u64, u64),
    block: Vec<u8>,
}

impl<'a> Explorer<'a> {
    /// `bounded` ones look only at the front of a large file, and at the first of
    /// many chunks.
    pub fn new(
        source: &FileReader,
        coding: &'a Coding,
        layout: &ChunkLayout,
        bounded: bool,
    ) -> Result<Explorer<'a>, LasError> {
        let source = Arc::new(source.reopen()?);
        let (start, chunk_points) = match layout {
            ChunkLayout::Stream { start, chunk_points, .. } => (*start, *chunk_points),
            ChunkLayout::Chunks(_) => (0, None),
        };
        let most = match (bounded, chunk_points) {
            (false, _) => (u64::MAX, u64::MAX),
            (true, None) => (start.saturating_add(MOST_TO_COUNT), u64::MAX),
            (true, Some(each)) => {
                (start.saturating_add(MOST_TO_COUNT), u64::from(each) * MOST_CHUNKS_TO_COUNT)
            }
        };
        let stream = PointStream::new(source, layout);
        Ok(Explorer { coding, layout: layout.clone(), stream, most, block: Vec::new() })
    }

    /// Goes on to the point `until`, and hands over the records on the way.
    pub fn go_to(&mut self, until: u64, mut each: impl FnMut(&[u8])) -> Explored {
        let ChunkLayout::Stream { chunk_points, .. } = &self.layout else {
            return Explored { points: 0, at: 0, end: ExploredTo::Points };
        };
        let chunk_points = chunk_points.map(u64::from);
        while self.stream.decoded < until {
            if self.stream.position() > self.most.0 || self.stream.decoded >= self.most.1 {
                return self.explored(self.stream.decoded, ExploredTo::Bound);
            }
            // Never across a chunk's end, so that what is sound is known by blocks.
            let left = chunk_points.map_or(SKIP, |each| each - self.stream.decoded % each);
            let points = (until - self.stream.decoded).min(SKIP).min(left);
            self.block.resize(points as usize * self.coding.record_length, 0);
            let before = self.stream.decoded;
            match self.stream.decode(self.coding, &self.layout, &mut self.block) {
                Ok(()) => each(&self.block),
                Err(broken) => {
                    let came = broken.sound.saturating_sub(before) as usize * self.coding.record_length;
                    each(&self.block[..came]);
                    return self.explored(broken.sound, ExploredTo::Broken(broken));
                }
            }
        }
        self.explored(self.stream.decoded, ExploredTo::Points)
    }

    fn explored(&mut self, points: u64, end: ExploredTo) -> Explored {
        Explored { points, at: self.stream.position(), end }
    }
}
