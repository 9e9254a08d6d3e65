//! The item POINT14, the standard fields of the point formats 6 to 10, in nine layers.
//! Each scanner channel has models and predictions of its own.

mod alone;
mod encode;

use super::LazError;
use super::arithmetic::ArithmeticDecoder;
use super::field;
use super::integer::{Integer, decode_two};
use super::model::{ByteModel, LazyModel, slots};
use super::predict::{self, Median};
use super::time::Times;
pub use alone::Point14Decoder;

/// Layers, and their order in a chunk.
pub const LAYERS: usize = 9;
/// Also the scanner channel, and what changes, and the returns.
pub const XY: usize = 0;
pub const Z: usize = 1;
const CLASSIFICATION: usize = 2;
const FLAGS: usize = 3;
const INTENSITY: usize = 4;
const SCAN_ANGLE: usize = 5;
const USER_DATA: usize = 6;
const SOURCE: usize = 7;
const TIME: usize = 8;

/// The bits that say which fields of a point are others than those of the last point of
/// its channel. The lowest two are the return's: same, one more, one less, other.
const CHANNEL_CHANGES: usize = 1 << 6;
const SOURCE_CHANGES: usize = 1 << 5;
const TIME_CHANGES: usize = 1 << 4;
const ANGLE_CHANGES: usize = 1 << 3;
const RETURNS_CHANGE: usize = 1 << 2;

/// A point, as its record has it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Point14 {
    at: [i32; 3],
    intensity: u16,
    /// Return in the lower, number of returns in the upper half.
    returns: u8,
    /// Classification flags, scanner channel, direction and edge.
    flags: u8,
    classification: u8,
    user_data: u8,
    scan_angle: i16,
    source: u16,
    /// The bits of a time.
    time: i64,
}

impl Point14 {
    pub const SIZE: usize = 30;

    #[inline(always)]
    pub fn of(bytes: &[u8; Self::SIZE]) -> Point14 {
        Point14 {
            at: [0, 4, 8].map(|at| i32::from_le_bytes(field(bytes, at))),
            intensity: u16::from_le_bytes(field(bytes, 12)),
            returns: bytes[14],
            flags: bytes[15],
            classification: bytes[16],
            user_data: bytes[17],
            scan_angle: i16::from_le_bytes(field(bytes, 18)),
            source: u16::from_le_bytes(field(bytes, 20)),
            time: i64::from_le_bytes(field(bytes, 22)),
        }
    }

    #[inline(always)]
    pub fn put(&self, bytes: &mut [u8; Self::SIZE]) {
        bytes[0..4].copy_from_slice(&self.at[0].to_le_bytes());
        bytes[4..8].copy_from_slice(&self.at[1].to_le_bytes());
        bytes[8..12].copy_from_slice(&self.at[2].to_le_bytes());
        bytes[12..14].copy_from_slice(&self.intensity.to_le_bytes());
        bytes[14] = self.returns;
        bytes[15] = self.flags;
        bytes[16] = self.classification;
        bytes[17] = self.user_data;
        bytes[18..20].copy_from_slice(&self.scan_angle.to_le_bytes());
        bytes[20..22].copy_from_slice(&self.source.to_le_bytes());
        bytes[22..30].copy_from_slice(&self.time.to_le_bytes());
    }

    pub fn channel(&self) -> usize {
        usize::from(self.flags >> 4 & 3)
    }

    fn number(&self) -> usize {
        usize::from(self.returns & 15)
    }

    fn of_returns(&self) -> usize {
        usize::from(self.returns >> 4)
    }

    /// The flags without the two bits of the channel, which lie in the middle.
    fn plain_flags(&self) -> usize {
        usize::from(self.flags >> 2 & 0x30 | self.flags & 15)
    }
}

/// What a point's returns choose.
struct Returns {
    /// Of the differences in x and y; even, for the time to be added.
    differences: usize,
    height: usize,
    /// First, last, both or neither.
    place: usize,
    single: bool,
}

impl Returns {
    #[inline(always)]
    fn of(point: &Point14) -> Returns {
        let (number, returns) = (point.number(), point.of_returns());
        Returns {
            differences: usize::from(predict::RETURNS_OF_4_BITS[returns][number]) << 1,
            height: returns.abs_diff(number).min(7),
            place: usize::from(number == 1) << 1 | usize::from(number >= returns),
            single: returns == 1,
        }
    }
}

/// A scanner channel's models, and what is remembered of its points.
#[derive(Debug)]
pub struct Channel {
    pub point: Point14,
    /// Whether the last point's time was another than that before.
    time_changed: bool,
    intensities: [u16; 8],
    x_differences: [Median; 12],
    y_differences: [Median; 12],
    heights: [i32; 8],
    changes: [LazyModel<ByteModel>; 8],
    channel: LazyModel<ByteModel>,
    of_returns: [LazyModel<ByteModel>; 16],
    number: [LazyModel<ByteModel>; 16],
    number_at_same_time: LazyModel<ByteModel>,
    classification: [LazyModel<ByteModel>; 64],
    flags: [LazyModel<ByteModel>; 64],
    user_data: [LazyModel<ByteModel>; 64],
    x: Integer<2, 32>,
    y: Integer<22, 32>,
    z: Integer<20, 32>,
    intensity: Integer<4, 16>,
    scan_angle: Integer<2, 16>,
    source: Integer<1, 16>,
    times: Times<false>,
}

impl Channel {
    pub fn new() -> Box<Channel> {
        Box::new(Channel {
            point: Point14::default(),
            time_changed: false,
            intensities: [0; 8],
            x_differences: [Median::default(); 12],
            y_differences: [Median::default(); 12],
            heights: [0; 8],
            changes: slots(),
            channel: LazyModel::default(),
            of_returns: slots(),
            number: slots(),
            number_at_same_time: LazyModel::default(),
            classification: slots(),
            flags: slots(),
            user_data: slots(),
            x: Integer::default(),
            y: Integer::default(),
            z: Integer::default(),
            intensity: Integer::default(),
            scan_angle: Integer::default(),
            source: Integer::default(),
            times: Times::default(),
        })
    }

    /// As a chunk's first point, or that of another channel, leaves it.
    pub fn begin(&mut self, point: Point14) {
        self.point = point;
        self.time_changed = false;
        self.intensities = [point.intensity; 8];
        self.x_differences = [Median::default(); 12];
        self.y_differences = [Median::default(); 12];
        self.heights = [point.at[2]; 8];
        self.changes.iter_mut().for_each(LazyModel::clear);
        self.channel.clear();
        for models in [&mut self.of_returns, &mut self.number] {
            models.iter_mut().for_each(LazyModel::clear);
        }
        self.number_at_same_time.clear();
        for models in [&mut self.classification, &mut self.flags, &mut self.user_data] {
            models.iter_mut().for_each(LazyModel::clear);
        }
        self.x.clear();
        self.y.clear();
        self.z.clear();
        self.intensity.clear();
        self.scan_angle.clear();
        self.source.clear();
        self.times.begin(point.time);
    }

    /// What changes is told in the context of the last point of any channel.
    fn changes(&mut self) -> &mut ByteModel {
        let (number, returns) = (self.point.number(), self.point.of_returns());
        let context = usize::from(number == 1)
            | usize::from(number >= returns) << 1
            | usize::from(self.time_changed) << 2;
        self.changes[context].get(128)
    }
}

/// The channels of a chunk.
#[derive(Debug, Default)]
pub struct Channels {
    current: usize,
    channels: [Option<Box<Channel>>; 4],
    used: [bool; 4],
}

impl Channels {
    pub fn begin(&mut self, first: Point14) {
        self.used = [false; 4];
        self.current = first.channel();
        self.enter(first);
    }

    pub fn current(&self) -> usize {
        self.current
    }

    /// The current channel; at its first use it goes on from `point`.
    #[inline(always)]
    fn enter(&mut self, point: Point14) -> &mut Channel {
        let channel = self.channels[self.current & 3].get_or_insert_with(Channel::new);
        if !self.used[self.current & 3] {
            self.used[self.current & 3] = true;
            channel.begin(point);
        }
        channel
    }

    /// Decodes a point, and says whether its channel is another than the last one's.
    #[inline(always)]
    pub fn decode<'a>(
        &mut self,
        layers: &mut [ArithmeticDecoder<'a>; LAYERS],
        has: &[bool; LAYERS],
        bytes: &mut [u8; Point14::SIZE],
    ) -> Result<bool, LazError> {
        let mut channel = self.enter(Point14::default());
        let mut xy = layers[XY];
        let changes = xy.symbol(channel.changes());
        let switches = changes & CHANNEL_CHANGES != 0;
        if switches {
            let further = xy.symbol(channel.channel.get(3)) + 1;
            let point = channel.point;
            self.current = (self.current + further) & 3;
            let current = self.current;
            channel = self.enter(point);
            channel.point.flags = channel.point.flags & !0x30 | (current as u8) << 4;
        }
        channel.decode(changes, &mut xy, layers, has)?;
        layers[XY] = xy;
        channel.point.put(bytes);
        Ok(switches)
    }
}

impl Channel {
    #[inline(always)]
    fn decode(
        &mut self,
        changes: usize,
        xy: &mut ArithmeticDecoder,
        layers: &mut [ArithmeticDecoder; LAYERS],
        has: &[bool; LAYERS],
    ) -> Result<(), LazError> {
        let time_changes = changes & TIME_CHANGES != 0;
        let point = &mut self.point;
        if changes & 7 != 0 {
            let (last, of_last) = (point.number(), point.of_returns());
            let mut of = of_last;
            if changes & RETURNS_CHANGE != 0 {
                of = xy.symbol(self.of_returns[of_last].get(16)) & 15;
            }
            let number = match changes & 3 {
                0 => last,
                1 => last + 1,
                2 => last + 15,
                _ if time_changes => xy.symbol(self.number[last].get(16)),
                _ => last + xy.symbol(self.number_at_same_time.get(13)) + 2,
            };
            point.returns = (of << 4 | number & 15) as u8;
        }
        let returns = Returns::of(point);
        let context = returns.differences | usize::from(time_changes);

        // Layers wait for nothing but themselves, so the processor decodes those at the same
        // time that stand next to each other here; x, y and z are one long chain.
        if has[CLASSIFICATION] {
            let context = usize::from(point.classification & 31) << 1 | usize::from(returns.place == 3);
            let model = self.classification[context].get(256);
            point.classification = layers[CLASSIFICATION].symbol(model) as u8;
        }
        let median = &mut self.x_differences[context];
        let x_context = usize::from(returns.single);
        let (difference, x_bits) = if has[INTENSITY] {
            let last = &mut self.intensities[returns.place << 1 | usize::from(time_changes)];
            let decoder = &mut layers[INTENSITY];
            let mut copy = *decoder;
            let (x, intensity) = decode_two(
                (&mut self.x, xy, x_context, median.get()),
                (&mut self.intensity, &mut copy, returns.place, i32::from(*last)),
            );
            *decoder = copy;
            *last = intensity as u16;
            point.intensity = *last;
            x
        } else {
            self.x.decode(xy, x_context, median.get())
        };
        median.add(difference);
        point.at[0] = point.at[0].wrapping_add(difference);

        if has[FLAGS] {
            let flags = layers[FLAGS].symbol(self.flags[point.plain_flags()].get(64)) as u8;
            point.flags = (flags & 0x30) << 2 | point.flags & 0x30 | flags & 15;
        }
        let median = &mut self.y_differences[context];
        let y_context = predict::y_context(returns.single, x_bits);
        let (difference, y_bits) = if changes & ANGLE_CHANGES != 0 && has[SCAN_ANGLE] {
            let decoder = &mut layers[SCAN_ANGLE];
            let mut copy = *decoder;
            let (y, angle) = decode_two(
                (&mut self.y, xy, y_context, median.get()),
                (&mut self.scan_angle, &mut copy, usize::from(time_changes), i32::from(point.scan_angle)),
            );
            *decoder = copy;
            point.scan_angle = angle as i16;
            y
        } else {
            self.y.decode(xy, y_context, median.get())
        };
        median.add(difference);
        point.at[1] = point.at[1].wrapping_add(difference);

        if has[Z] {
            let height = &mut self.heights[returns.height];
            let context = predict::z_context(returns.single, x_bits, y_bits);
            (*height, _) = self.z.decode(&mut layers[Z], context, *height);
            point.at[2] = *height;
        }
        if has[USER_DATA] {
            let model = self.user_data[usize::from(point.user_data >> 2)].get(256);
            point.user_data = layers[USER_DATA].symbol(model) as u8;
        }
        if changes & SOURCE_CHANGES != 0 && has[SOURCE] {
            point.source = self.source.decode_apart(&mut layers[SOURCE], 0, i32::from(point.source)) as u16;
        }
        if time_changes && has[TIME] {
            point.time = self.times.decode(&mut layers[TIME])?;
        }
        self.time_changed = time_changes;
        Ok(())
    }
}
