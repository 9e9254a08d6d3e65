//! A LAZ file as one stream of points, decoded from its front onward in portions
//! of any size.

use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::sync::Arc;

use laz::record::RecordDecompressor;

use super::chunks::{ChunkLayout, PointChunk};
use super::coding::{Coding, guard};
use super::source::FileReader;
use super::{chunk_table, fields};

/// Points that are decoded into nothing at a time.
pub const SKIP: u64 = 10_000;

/// Why decoding ended, and how many points came before.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Broken {
    /// Points that came out.
    pub readable: u64,
    /// Those of them that are right: where the bytes made no sense, what came
    /// out of the same chunk before may be wrong already.
    pub sound: u64,
    pub reason: String,
    /// The bytes ended, as in a file that was cut.
    pub ended: bool,
    /// The disk failed, or the file went away: it says nothing of its bytes.
    pub unread: bool,
}

/// A place in the stream of points.
pub struct PointStream {
    /// Points that came out so far.
    pub decoded: u64,
    /// The first point of the current chunk.
    chunk_first: u64,
    /// Points that are left in the current chunk.
    left: u64,
    /// The next entry of [`ChunkLayout::Chunks`].
    next_chunk: usize,
    source: Arc<FileReader>,
    state: StreamDecoder,
}

/// Between chunks there is only the window.
enum StreamDecoder {
    Idle(Window),
    Running(Box<dyn RecordDecompressor<Window> + Send>),
    /// Only while one becomes the other.
    Gone,
}

impl std::fmt::Debug for PointStream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Stream")
            .field("decoded", &self.decoded)
            .field("left", &self.left)
            .finish_non_exhaustive()
    }
}

impl PointStream {
    pub fn new(source: Arc<FileReader>, layout: &ChunkLayout) -> PointStream {
        let (position, end) = match layout {
            ChunkLayout::Chunks(chunks) => (
                chunks.first().map_or(0, |chunk| chunk.at),
                chunks.last().map_or(0, |chunk| chunk.at + chunk.bytes),
            ),
            ChunkLayout::Stream { start, end, .. } => (*start, *end),
        };
        let window = BufReader::with_capacity(
            1 << 16,
            ByteWindow { source: source.clone(), position, end, failed: false },
        );
        PointStream {
            decoded: 0,
            chunk_first: 0,
            left: 0,
            next_chunk: 0,
            source,
            state: StreamDecoder::Idle(window),
        }
    }

    pub fn decode(
        &mut self,
        coding: &Coding,
        layout: &ChunkLayout,
        records: &mut [u8],
    ) -> Result<(), Broken> {
        let mut rest = records;
        while !rest.is_empty() {
            if self.left == 0 {
                self.next(coding, layout).map_err(|reason| self.broken(reason))?;
            }
            let points = self.left.min((rest.len() / coding.record_length) as u64);
            let (now, later) = rest.split_at_mut(points as usize * coding.record_length);
            self.run(coding, now)?;
            rest = later;
        }
        if self.left == 0 {
            self.close(layout).map_err(|reason| self.broken(reason))?;
        }
        self.check_end(layout)
    }

    /// Where the next byte lies that no point has used.
    pub fn position(&mut self) -> u64 {
        let window = match &mut self.state {
            StreamDecoder::Running(decoder) => decoder.get_mut(),
            StreamDecoder::Idle(window) => window,
            StreamDecoder::Gone => return 0,
        };
        window.get_ref().position - window.buffer().len() as u64
    }

    /// Behind the last point nothing may be left that could be another.
    fn check_end(&mut self, layout: &ChunkLayout) -> Result<(), Broken> {
        let ChunkLayout::Stream { end, chunk_points, points, settled: false, .. } = layout else {
            return Ok(());
        };
        if self.decoded != *points {
            return Ok(());
        }
        let at = self.position();
        let chunks = chunk_points.map_or(0, |each| points.div_ceil(u64::from(each)));
        match chunk_table::is_end(&self.source, at, *end, chunks, None) {
            Ok(false) => {
                let reason = format!("{} bytes are left behind the last of its {points} points", end - at);
                let (readable, sound) = (self.decoded, self.decoded);
                Err(Broken { readable, sound, reason, ended: false, unread: false })
            }
            Err(error) => Err(Broken { unread: true, ..self.broken(error.to_string()) }),
            Ok(true) => Ok(()),
        }
    }

    /// Decodes within the current chunk.
    fn run(&mut self, coding: &Coding, records: &mut [u8]) -> Result<(), Broken> {
        let StreamDecoder::Running(decoder) = &mut self.state else {
            return Err(self.broken("its decoder is gone".to_string()));
        };
        let mut done = 0;
        let result = guard(|| {
            for record in records.chunks_exact_mut(coding.record_length) {
                decoder.decompress_next(record)?;
                done += 1;
            }
            Ok(())
        });
        self.decoded += done;
        self.left -= done;
        result.map_err(|reason| self.broken(reason))
    }

    /// Starts the next chunk's decoder.
    fn next(&mut self, coding: &Coding, layout: &ChunkLayout) -> Result<(), String> {
        self.close(layout)?;
        self.chunk_first = self.decoded;
        let StreamDecoder::Idle(mut window) = std::mem::replace(&mut self.state, StreamDecoder::Gone) else {
            return Err("its decoder is gone".to_string());
        };
        match layout {
            ChunkLayout::Chunks(chunks) => {
                let chunk = chunks.get(self.next_chunk).ok_or("it has no further chunk")?;
                self.next_chunk += 1;
                if let Err(reason) = check_layers(window.get_mut(), coding, chunk) {
                    self.state = StreamDecoder::Idle(window);
                    return Err(reason);
                }
                window.seek(SeekFrom::Start(chunk.at)).map_err(|e| e.to_string())?;
                self.left = chunk.points;
            }
            // Nobody has held the sizes of its layers against the file.
            ChunkLayout::Stream { .. } if coding.layered => return Err("layers lie in chunks".to_string()),
            ChunkLayout::Stream { chunk_points, .. } => {
                self.left = chunk_points.map_or(u64::MAX, u64::from);
            }
        }
        let decoder = guard(|| {
            Ok(if coding.layered {
                Box::new(fields::layered(&coding.items, window)?)
                    as Box<dyn RecordDecompressor<Window> + Send>
            } else {
                Box::new(fields::sequential(&coding.items, window)?)
            })
        })?;
        self.state = StreamDecoder::Running(decoder);
        Ok(())
    }

    /// Ends the current chunk's decoder; what it left over gives damage away.
    fn close(&mut self, layout: &ChunkLayout) -> Result<(), String> {
        match std::mem::replace(&mut self.state, StreamDecoder::Gone) {
            StreamDecoder::Running(decoder) => {
                let window = decoder.box_into_inner();
                let at = window.get_ref().position - window.buffer().len() as u64;
                self.state = StreamDecoder::Idle(window);
                if let ChunkLayout::Chunks(chunks) = layout
                    && let Some(chunk) = self.next_chunk.checked_sub(1).and_then(|i| chunks.get(i))
                    && at != chunk.at + chunk.bytes
                {
                    return Err("its bytes and its points do not end together".to_string());
                }
            }
            other => self.state = other,
        }
        Ok(())
    }

    fn broken(&mut self, reason: String) -> Broken {
        let (ended, unread) = match &mut self.state {
            StreamDecoder::Running(decoder) => {
                let window = decoder.get_mut();
                let ended = window.fill_buf().is_ok_and(<[u8]>::is_empty);
                (ended, window.get_ref().failed)
            }
            StreamDecoder::Idle(window) => (false, window.get_ref().failed),
            StreamDecoder::Gone => (false, false),
        };
        let sound = if ended { self.decoded } else { self.chunk_first };
        Broken { readable: self.decoded, sound, reason, ended: ended && !unread, unread }
    }
}

/// As in [`Coding::decode`]: the layers must be those of the chunk before
/// `laz` makes room for them.
fn check_layers(range: &mut ByteWindow, coding: &Coding, chunk: &PointChunk) -> Result<(), String> {
    if !coding.layered {
        return Ok(());
    }
    let mut front = vec![0; coding.layered_front()];
    if chunk.bytes < front.len() as u64 {
        return Err(format!("its {} bytes are too few", chunk.bytes));
    }
    range.source.read_exact_at(&mut front, chunk.at).map_err(|e| {
        range.failed = true;
        e.to_string()
    })?;
    match coding.layered_extent(&front) {
        extent if extent == (chunk.points, chunk.bytes) => Ok(()),
        (points, bytes) => Err(format!(
            "it says {points} points in {bytes} bytes, the file says {} in {}",
            chunk.points, chunk.bytes
        )),
    }
}

type Window = BufReader<ByteWindow>;

/// A part of the file as a stream.
struct ByteWindow {
    source: Arc<FileReader>,
    position: u64,
    end: u64,
    /// A read failed; the decoder tells no more of that than of broken bytes.
    failed: bool,
}

impl Read for ByteWindow {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let most = bytes.len().min(self.end.saturating_sub(self.position) as usize);
        let read = self.source.read_at(&mut bytes[..most], self.position);
        self.failed |= read.is_err();
        let read = read?;
        self.position += read as u64;
        Ok(read)
    }
}

impl Seek for ByteWindow {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let target = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.position.checked_add_signed(by),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
        };
        self.position = target.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.position)
    }
}
