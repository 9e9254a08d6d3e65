//! Chunks of the point formats 0 to 3: the first record as it is, then one stream of
//! all fields of all others, point by point.

use super::arithmetic::ArithmeticDecoder;
use super::color::{Color, ColorModels};
use super::integer::Integer;
use super::model::{ByteModel, LazyModel, slots};
use super::predict::{self, Median};
use super::time::Times;
use super::{LazError, RecordShape, field};

/// The item POINT10.
#[derive(Debug, Clone, Copy, Default)]
struct Point10 {
    at: [i32; 3],
    intensity: u16,
    /// Return, number of returns, direction and edge.
    returns: u8,
    classification: u8,
    scan_angle: u8,
    user_data: u8,
    source: u16,
}

impl Point10 {
    const SIZE: usize = 20;

    fn of(bytes: &[u8; Self::SIZE]) -> Point10 {
        Point10 {
            at: [0, 4, 8].map(|at| i32::from_le_bytes(field(bytes, at))),
            intensity: u16::from_le_bytes(field(bytes, 12)),
            returns: bytes[14],
            classification: bytes[15],
            scan_angle: bytes[16],
            user_data: bytes[17],
            source: u16::from_le_bytes(field(bytes, 18)),
        }
    }

    #[inline(always)]
    fn put(&self, bytes: &mut [u8; Self::SIZE]) {
        bytes[0..4].copy_from_slice(&self.at[0].to_le_bytes());
        bytes[4..8].copy_from_slice(&self.at[1].to_le_bytes());
        bytes[8..12].copy_from_slice(&self.at[2].to_le_bytes());
        bytes[12..14].copy_from_slice(&self.intensity.to_le_bytes());
        bytes[14] = self.returns;
        bytes[15] = self.classification;
        bytes[16] = self.scan_angle;
        bytes[17] = self.user_data;
        bytes[18..20].copy_from_slice(&self.source.to_le_bytes());
    }
}

/// The bits that say which fields of a point are others than the last point's.
const RETURNS: usize = 1 << 5;
const INTENSITY: usize = 1 << 4;
const CLASSIFICATION: usize = 1 << 3;
const SCAN_ANGLE: usize = 1 << 2;
const USER_DATA: usize = 1 << 1;
const SOURCE: usize = 1 << 0;

/// Models of the item POINT10 in version 2, and what is remembered of earlier points.
#[derive(Debug)]
struct Point10Models {
    last: Point10,
    intensities: [u16; 16],
    x_differences: [Median; 16],
    y_differences: [Median; 16],
    heights: [i32; 8],
    changes: LazyModel<ByteModel>,
    returns: [LazyModel<ByteModel>; 256],
    classification: [LazyModel<ByteModel>; 256],
    user_data: [LazyModel<ByteModel>; 256],
    scan_angle: [LazyModel<ByteModel>; 2],
    intensity: Integer<4, 16>,
    source: Integer<1, 16>,
    x: Integer<2, 32>,
    y: Integer<22, 32>,
    z: Integer<20, 32>,
}

impl Point10Models {
    fn new() -> Point10Models {
        Point10Models {
            last: Point10::default(),
            intensities: [0; 16],
            x_differences: [Median::default(); 16],
            y_differences: [Median::default(); 16],
            heights: [0; 8],
            changes: LazyModel::default(),
            returns: slots(),
            classification: slots(),
            user_data: slots(),
            scan_angle: slots(),
            intensity: Integer::default(),
            source: Integer::default(),
            x: Integer::default(),
            y: Integer::default(),
            z: Integer::default(),
        }
    }

    fn begin(&mut self, first: Point10) {
        self.last = Point10 { intensity: 0, ..first };
        self.intensities = [0; 16];
        self.x_differences = [Median::default(); 16];
        self.y_differences = [Median::default(); 16];
        self.heights = [0; 8];
        self.changes.clear();
        for models in [&mut self.returns, &mut self.classification, &mut self.user_data] {
            models.iter_mut().for_each(LazyModel::clear);
        }
        self.scan_angle.iter_mut().for_each(LazyModel::clear);
        self.intensity.clear();
        self.source.clear();
        self.x.clear();
        self.y.clear();
        self.z.clear();
    }

    #[inline(always)]
    fn decode(&mut self, from: &mut ArithmeticDecoder) {
        let point = &mut self.last;
        let changes = from.symbol(self.changes.get(64));
        if changes & RETURNS != 0 {
            point.returns = from.symbol(self.returns[usize::from(point.returns)].get(256)) as u8;
        }
        let (number, returns) = (usize::from(point.returns & 7), usize::from(point.returns >> 3 & 7));
        let context = usize::from(predict::RETURNS_OF_3_BITS[returns][number]) & 15;
        if changes != 0 {
            let last = &mut self.intensities[context];
            if changes & INTENSITY != 0 {
                let (intensity, _) = self.intensity.decode(from, context.min(3), i32::from(*last));
                *last = intensity as u16;
            }
            point.intensity = *last;
            if changes & CLASSIFICATION != 0 {
                let model = &mut self.classification[usize::from(point.classification)];
                point.classification = from.symbol(model.get(256)) as u8;
            }
            if changes & SCAN_ANGLE != 0 {
                let model = &mut self.scan_angle[usize::from(point.returns >> 6 & 1)];
                point.scan_angle = point.scan_angle.wrapping_add(from.symbol(model.get(256)) as u8);
            }
            if changes & USER_DATA != 0 {
                let model = &mut self.user_data[usize::from(point.user_data)];
                point.user_data = from.symbol(model.get(256)) as u8;
            }
            if changes & SOURCE != 0 {
                let last = i32::from(point.source);
                point.source = from.apart(|from| self.source.decode_apart(from, 0, last)) as u16;
            }
        }
        let single = returns == 1;
        let median = &mut self.x_differences[context];
        let (difference, x_bits) = self.x.decode(from, usize::from(single), median.get());
        median.add(difference);
        point.at[0] = point.at[0].wrapping_add(difference);

        let median = &mut self.y_differences[context];
        let (difference, y_bits) = self.y.decode(from, predict::y_context(single, x_bits), median.get());
        median.add(difference);
        point.at[1] = point.at[1].wrapping_add(difference);

        let height = &mut self.heights[returns.abs_diff(number) & 7];
        (*height, _) = self.z.decode(from, predict::z_context(single, x_bits, y_bits), *height);
        point.at[2] = *height;
    }
}

#[derive(Debug)]
pub struct PointwiseDecoder {
    shape: RecordShape,
    points: Point10Models,
    times: Times<true>,
    color: ColorModels,
    last_color: Color,
    extra: Vec<LazyModel<ByteModel>>,
    last_extra: Vec<u8>,
}

impl PointwiseDecoder {
    pub fn new(shape: RecordShape) -> PointwiseDecoder {
        PointwiseDecoder {
            shape,
            points: Point10Models::new(),
            times: Times::default(),
            color: ColorModels::default(),
            last_color: [0; 3],
            extra: vec![LazyModel::default(); shape.extra],
            last_extra: vec![0; shape.extra],
        }
    }

    pub fn decode(&mut self, chunk: &[u8], records: &mut [u8]) -> Result<(), LazError> {
        let length = self.shape.record_length();
        if records.len() < length {
            return if chunk.is_empty() { Ok(()) } else { Err(LazError::LeftOver(chunk.len())) };
        }
        let (first, rest) = chunk.split_at_checked(length).ok_or(LazError::TooShort(chunk.len()))?;
        if rest.len() < 4 {
            return Err(LazError::TooShort(chunk.len()));
        }
        self.begin(first);
        let (record, records) = records.split_at_mut(length);
        record.copy_from_slice(first);
        let mut decoder = ArithmeticDecoder::new(rest).ok_or(LazError::Beginning)?;
        match (self.shape.time, self.shape.color) {
            (false, false) => self.run::<false, false>(&mut decoder, records),
            (true, false) => self.run::<true, false>(&mut decoder, records),
            (false, true) => self.run::<false, true>(&mut decoder, records),
            (true, true) => self.run::<true, true>(&mut decoder, records),
        }?;
        match decoder.left() {
            0 => Ok(()),
            left => Err(LazError::LeftOver(left)),
        }
    }

    fn begin(&mut self, first: &[u8]) {
        self.points.begin(Point10::of(&field(first, 0)));
        let mut at = Point10::SIZE;
        if self.shape.time {
            self.times.begin(i64::from_le_bytes(field(first, at)));
            at += 8;
        }
        if self.shape.color {
            self.color.clear();
            self.last_color = [0, 2, 4].map(|channel| u16::from_le_bytes(field(first, at + channel)));
            at += 6;
        }
        self.extra.iter_mut().for_each(LazyModel::clear);
        self.last_extra.copy_from_slice(&first[at..]);
    }

    fn run<const TIME: bool, const COLOR: bool>(
        &mut self,
        from: &mut ArithmeticDecoder,
        records: &mut [u8],
    ) -> Result<(), LazError> {
        let mut decoder = *from;
        for record in records.chunks_exact_mut(self.shape.record_length()) {
            self.points.decode(&mut decoder);
            let Some((bytes, mut rest)) = record.split_first_chunk_mut() else { break };
            self.points.last.put(bytes);
            if TIME {
                let time = self.times.decode_inline(&mut decoder)?;
                let Some((bytes, behind)) = rest.split_first_chunk_mut() else { break };
                *bytes = time.to_le_bytes();
                rest = behind;
            }
            if COLOR {
                self.last_color = self.color.decode_inline(&mut decoder, self.last_color);
                let Some((bytes, behind)) = rest.split_first_chunk_mut::<6>() else { break };
                for (bytes, channel) in bytes.chunks_exact_mut(2).zip(self.last_color) {
                    bytes.copy_from_slice(&channel.to_le_bytes());
                }
                rest = behind;
            }
            for ((byte, last), model) in rest.iter_mut().zip(&mut self.last_extra).zip(&mut self.extra) {
                *last = last.wrapping_add(decoder.symbol(model.get(256)) as u8);
                *byte = *last;
            }
            if decoder.has_ended() {
                return Err(LazError::Ended);
            }
        }
        *from = decoder;
        Ok(())
    }
}
