//! LAZ chunks to raw records and back, bit by bit as LASzip does it: the items of
//! version 2 of the point formats 0 to 3, and the layered ones of the versions 3 and 4
//! of the formats 6 to 8, all with extra bytes. `docs/laz.md` explains the format.
//!
//! All of it is safe code. Damaged bytes give an error or some points, the same as
//! LASzip's where they give any; they never cost more time than the points that were
//! asked for, nor more memory than a bound by the kind of points.

mod arithmetic;
mod color;
mod encode;
mod integer;
mod layered;
mod model;
mod point14;
mod pointwise;
mod predict;
mod time;

use std::fmt;

use encode::LayeredEncoder;
use layered::LayeredDecoder;
pub use point14::Point14Decoder;
use pointwise::PointwiseDecoder;

/// What the records of a chunk are made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordShape {
    /// In layers, one a field: the point formats 6 to 8. Otherwise 0 to 3.
    layered: bool,
    /// The layered ones of version 3 tell the fields behind the point of a scanner
    /// channel only where it changes, by a mistake that files depend on.
    version: u16,
    /// Of the formats 0 to 3; those above always have one.
    time: bool,
    color: bool,
    infrared: bool,
    extra: usize,
}

impl RecordShape {
    /// Of a point format with so many extra bytes, all items in one version: 2 of the
    /// formats 0 to 3, 3 or 4 of 6 to 8. `None` for what is not coded here.
    pub fn new(point_format: u8, extra: usize, version: u16) -> Option<RecordShape> {
        let layered = matches!((point_format, version), (6..=8, 3 | 4));
        let shape = RecordShape {
            layered,
            version,
            time: matches!(point_format, 1 | 3),
            color: matches!(point_format, 2 | 3 | 7 | 8),
            infrared: point_format == 8,
            extra,
        };
        (layered || matches!((point_format, version), (0..=3, 2))).then_some(shape)
    }

    /// Bytes of a record.
    pub fn record_length(&self) -> usize {
        let point = if self.layered { 30 } else { 20 + 8 * usize::from(self.time) };
        point + 6 * usize::from(self.color) + 2 * usize::from(self.infrared) + self.extra
    }

    /// Layers of a chunk: nine of the point, one each of color and infrared, one of every
    /// extra byte.
    fn layers(&self) -> usize {
        point14::LAYERS + usize::from(self.color) + usize::from(self.infrared) + self.extra
    }

    /// Bytes in front of a layered chunk's layers: the first record as it is, the number
    /// of points, the size of each layer.
    fn front(&self) -> usize {
        self.record_length() + 4 + 4 * self.layers()
    }
}

/// Why a chunk cannot be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LazError {
    /// It has too few bytes to begin with.
    TooShort(usize),
    /// Its bytes end before its points do.
    Ended,
    /// So many bytes are left when all points are there.
    LeftOver(usize),
    /// Bytes that its layers take, and those that it has.
    Layers(u64, u64),
    /// Points that it says it has, and those that were asked for.
    Points(u64, u64),
    /// A stream begins with the end of the coder's interval, which no encoder writes.
    Beginning,
    /// A time switches sequences more often than there are any.
    Switches,
}

impl fmt::Display for LazError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LazError::TooShort(bytes) => write!(f, "its {bytes} bytes are too few"),
            LazError::Ended => f.write_str("its bytes end before its points do"),
            LazError::LeftOver(bytes) => write!(f, "{bytes} of its bytes are left over"),
            LazError::Layers(said, bytes) => write!(f, "its layers take {said} bytes, it has {bytes}"),
            LazError::Points(said, points) => {
                write!(f, "it says that it has {said} points, the file says {points}")
            }
            LazError::Beginning => f.write_str("its bytes make no sense: no stream begins so"),
            LazError::Switches => {
                f.write_str("its bytes make no sense: its GPS times switch sequences without end")
            }
        }
    }
}

impl std::error::Error for LazError {}

/// Decodes chunks of one shape, one after the other. It keeps its memory between them.
#[derive(Debug)]
pub struct Decoder(DecoderKind);

#[derive(Debug)]
enum DecoderKind {
    Pointwise(Box<PointwiseDecoder>),
    Layered(Box<LayeredDecoder>),
}

impl Decoder {
    pub fn new(shape: RecordShape) -> Decoder {
        Decoder(match shape.layered {
            true => DecoderKind::Layered(Box::new(LayeredDecoder::new(shape))),
            false => DecoderKind::Pointwise(Box::new(PointwiseDecoder::new(shape))),
        })
    }

    /// Decodes a whole chunk into `records`, whose length says how many points it has. The
    /// bytes must be used up exactly: LAZ has no checksum, and this gives a damaged stream
    /// away. After an error `records` holds anything.
    pub fn decode(&mut self, chunk: &[u8], records: &mut [u8]) -> Result<(), LazError> {
        match &mut self.0 {
            DecoderKind::Pointwise(decoder) => decoder.decode(chunk, records),
            DecoderKind::Layered(decoder) => decoder.decode(chunk, records),
        }
    }
}

/// Encodes chunks of one shape, one after the other.
#[derive(Debug)]
pub struct Encoder(Box<LayeredEncoder>);

impl Encoder {
    /// `None` for the point formats 0 to 3, which are only decoded here.
    pub fn new(shape: RecordShape) -> Option<Encoder> {
        shape.layered.then(|| Encoder(Box::new(LayeredEncoder::new(shape))))
    }

    /// Appends one chunk of all these records to `chunk`; nothing, if there are none.
    pub fn encode(&mut self, records: &[u8], chunk: &mut Vec<u8>) {
        self.0.encode(records, chunk);
    }
}

/// The bytes of a field, at a place that is within what was checked before.
#[inline(always)]
fn field<const LENGTH: usize>(bytes: &[u8], at: usize) -> [u8; LENGTH] {
    let mut field = [0; LENGTH];
    field.copy_from_slice(&bytes[at..at + LENGTH]);
    field
}
