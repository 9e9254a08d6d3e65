//! The standard fields of the point formats 6 to 10, in nine layers (LASzip 3; LAS
//! 1.4 R15, table 9). Each scanner channel has a context of its own.

use std::io::{self, Cursor, Read, Seek};

use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::las::selective::DecompressionSelection;
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::LayeredFieldDecompressor;

use super::median::Median;
use super::time::Times;
use crate::format::laz::predict::RETURNS_OF_4_BITS;

/// Bytes of the field.
const SIZE: usize = 30;
const LAYERS: usize = 9;
/// The layers, in their order in a chunk.
const XY: usize = 0;
const Z: usize = 1;
const CLASSIFICATION: usize = 2;
const FLAGS: usize = 3;
const INTENSITY: usize = 4;
const SCAN_ANGLE: usize = 5;
const USER_DATA: usize = 6;
const SOURCE: usize = 7;
const TIME: usize = 8;

type Layer = ArithmeticDecoder<Cursor<Vec<u8>>>;

pub struct Point14 {
    layers: [Layer; LAYERS],
    sizes: [usize; LAYERS],
    channel: usize,
    contexts: [Option<Box<Context>>; 4],
    /// Version 3 tells the fields behind this one of a channel only where it
    /// changes, by a mistake that its files depend on; version 4 always.
    tells_always: bool,
}

/// A point between two steps. The time is in [`Times`].
#[derive(Debug, Clone, Copy)]
struct Point {
    at: [i32; 3],
    intensity: u16,
    number: u8,
    returns: u8,
    /// The byte of classification flags, channel, direction and edge.
    flags: u8,
    classification: u8,
    user_data: u8,
    scan_angle: i16,
    source: u16,
    time: i64,
    time_changed: bool,
}

impl Point {
    fn of(bytes: &[u8; SIZE]) -> Point {
        let word = |at: usize| i32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let half = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Point {
            at: [word(0), word(4), word(8)],
            intensity: half(12),
            number: bytes[14] & 15,
            returns: bytes[14] >> 4,
            flags: bytes[15],
            classification: bytes[16],
            user_data: bytes[17],
            scan_angle: half(18) as i16,
            source: half(20),
            time: i64::from(word(26)) << 32 | i64::from(word(22) as u32),
            time_changed: false,
        }
    }

    fn put(&self, bytes: &mut [u8]) {
        for (place, c) in bytes.chunks_exact_mut(4).zip(self.at) {
            place.copy_from_slice(&c.to_le_bytes());
        }
        bytes[12..14].copy_from_slice(&self.intensity.to_le_bytes());
        bytes[14] = self.returns << 4 | self.number;
        bytes[15] = self.flags;
        bytes[16] = self.classification;
        bytes[17] = self.user_data;
        bytes[18..20].copy_from_slice(&self.scan_angle.to_le_bytes());
        bytes[20..22].copy_from_slice(&self.source.to_le_bytes());
        bytes[22..30].copy_from_slice(&self.time.to_le_bytes());
    }

    fn channel(&self) -> usize {
        usize::from(self.flags >> 4 & 3)
    }

    fn set_channel(&mut self, channel: usize) {
        self.flags = self.flags & !0x30 | (channel as u8 & 3) << 4;
    }
}

/// Models that are made when they are first needed; most never are.
struct Models {
    symbols: u32,
    models: Vec<Option<ArithmeticModel>>,
}

impl Models {
    fn new(count: usize, symbols: u32) -> Models {
        Models { symbols, models: (0..count).map(|_| None).collect() }
    }

    fn decode(&mut self, model: usize, from: &mut Layer) -> io::Result<u32> {
        let symbols = self.symbols;
        from.decode_symbol(
            self.models[model].get_or_insert_with(|| ArithmeticModelBuilder::new(symbols).build()),
        )
    }
}

/// What is known of a scanner channel.
struct Context {
    point: Point,
    intensities: [u16; 8],
    x_differences: [Median; 12],
    y_differences: [Median; 12],
    heights: [i32; 8],
    changed: Models,
    channel: ArithmeticModel,
    returns: Models,
    number: Models,
    number_at_same_time: ArithmeticModel,
    classification: Models,
    flags: Models,
    user_data: Models,
    x: IntegerDecompressor,
    y: IntegerDecompressor,
    z: IntegerDecompressor,
    intensity: IntegerDecompressor,
    scan_angle: IntegerDecompressor,
    source: IntegerDecompressor,
    times: Times,
}

impl Context {
    fn after(point: Point) -> Box<Context> {
        let numbers = |bits: u32, contexts: u32| {
            IntegerDecompressorBuilder::new().bits(bits).contexts(contexts).build_initialized()
        };
        Box::new(Context {
            point: Point { time_changed: false, ..point },
            intensities: [point.intensity; 8],
            x_differences: [Median::default(); 12],
            y_differences: [Median::default(); 12],
            heights: [point.at[2]; 8],
            changed: Models::new(8, 128),
            channel: ArithmeticModelBuilder::new(3).build(),
            returns: Models::new(16, 16),
            number: Models::new(16, 16),
            number_at_same_time: ArithmeticModelBuilder::new(13).build(),
            classification: Models::new(64, 256),
            flags: Models::new(64, 64),
            user_data: Models::new(64, 256),
            x: numbers(32, 2),
            y: numbers(32, 22),
            z: numbers(32, 20),
            intensity: numbers(16, 4),
            scan_angle: numbers(16, 2),
            source: numbers(16, 1),
            times: Times::new(point.time, false),
        })
    }

    /// What changed against the last point of the channel, one bit a field.
    fn changes(&mut self, from: &mut Layer) -> io::Result<u32> {
        let Point { number, returns, time_changed, .. } = self.point;
        let model =
            usize::from(number == 1) + 2 * usize::from(number >= returns) + 4 * usize::from(time_changed);
        self.changed.decode(model, from)
    }

    /// Decodes the rest of a point, from the layers that are not empty.
    fn step(
        &mut self,
        changes: u32,
        layers: &mut [Layer; LAYERS],
        sizes: &[usize; LAYERS],
    ) -> io::Result<()> {
        let is_set = |bit: u32| changes >> bit & 1 == 1;
        let (source_changed, time_changed, angle_changed) = (is_set(5), is_set(4), is_set(3));
        let same_time = u32::from(time_changed);
        if is_set(2) {
            let model = usize::from(self.point.returns);
            self.point.returns = self.returns.decode(model, &mut layers[XY])? as u8;
        }
        let last = self.point.number;
        self.point.number = match changes & 3 {
            0 => last,
            1 => (last + 1) % 16,
            2 => (last + 15) % 16,
            _ if time_changed => self.number.decode(usize::from(last), &mut layers[XY])? as u8,
            _ => {
                let more = layers[XY].decode_symbol(&mut self.number_at_same_time)? as u8;
                (last + more + 2) % 16
            }
        };
        let (n, r) = (self.point.returns, self.point.number);
        let single = u32::from(n == 1);
        // Of the pulse the first (2), the last (1), both (3), or neither.
        let place = 2 * u32::from(r == 1) + u32::from(r >= n);

        let model = usize::from(RETURNS_OF_4_BITS[usize::from(n)][usize::from(r)]) << 1 | same_time as usize;
        let median = &mut self.x_differences[model];
        let difference = self.x.decompress(&mut layers[XY], median.get(), single)?;
        median.add(difference);
        self.point.at[0] = self.point.at[0].wrapping_add(difference);
        let median = &mut self.y_differences[model];
        let context = single + (self.x.k() & !1).min(20);
        let difference = self.y.decompress(&mut layers[XY], median.get(), context)?;
        median.add(difference);
        self.point.at[1] = self.point.at[1].wrapping_add(difference);
        if sizes[Z] > 0 {
            let context = single + (((self.x.k() + self.y.k()) / 2) & !1).min(18);
            let height = &mut self.heights[usize::from(n.abs_diff(r).min(7))];
            *height = self.z.decompress(&mut layers[Z], *height, context)?;
            self.point.at[2] = *height;
        }

        if sizes[CLASSIFICATION] > 0 {
            let model = usize::from(self.point.classification & 31) << 1 | usize::from(place == 3);
            self.point.classification = self.classification.decode(model, &mut layers[CLASSIFICATION])? as u8;
        }
        if sizes[FLAGS] > 0 {
            let byte = self.point.flags;
            // Without the two bits of the channel, which lie in the middle.
            let model = usize::from(byte >> 2 & 0x30 | byte & 15);
            let flags = self.flags.decode(model, &mut layers[FLAGS])? as u8;
            self.point.flags = (flags & 0x30) << 2 | byte & 0x30 | flags & 15;
        }
        if sizes[INTENSITY] > 0 {
            let last = &mut self.intensities[(place << 1 | same_time) as usize];
            *last = self.intensity.decompress(&mut layers[INTENSITY], i32::from(*last), place)? as u16;
            self.point.intensity = *last;
        }
        if sizes[SCAN_ANGLE] > 0 && angle_changed {
            let last = i32::from(self.point.scan_angle);
            self.point.scan_angle =
                self.scan_angle.decompress(&mut layers[SCAN_ANGLE], last, same_time)? as i16;
        }
        if sizes[USER_DATA] > 0 {
            let model = usize::from(self.point.user_data / 4);
            self.point.user_data = self.user_data.decode(model, &mut layers[USER_DATA])? as u8;
        }
        if sizes[SOURCE] > 0 && source_changed {
            let last = i32::from(self.point.source);
            self.point.source = self.source.decompress(&mut layers[SOURCE], last, 0)? as u16;
        }
        if sizes[TIME] > 0 && time_changed {
            self.times.step(&mut layers[TIME])?;
            self.point.time = self.times.get();
        }
        self.point.time_changed = time_changed;
        Ok(())
    }
}

impl Point14 {
    pub fn of_version_3() -> Point14 {
        Point14::new(false)
    }

    pub fn of_version_4() -> Point14 {
        Point14::new(true)
    }

    fn new(tells_always: bool) -> Point14 {
        Point14 {
            layers: std::array::from_fn(|_| ArithmeticDecoder::new(Cursor::new(Vec::new()))),
            sizes: [0; LAYERS],
            channel: 0,
            contexts: [None, None, None, None],
            tells_always,
        }
    }

    /// Goes over to the channel that the stream names.
    fn change_channel(&mut self) -> io::Result<()> {
        let Some(context) = &mut self.contexts[self.channel] else {
            return Err(io::ErrorKind::InvalidData.into());
        };
        let further = self.layers[XY].decode_symbol(&mut context.channel)? as usize + 1;
        let point = context.point;
        self.channel = (self.channel + further) % 4;
        let channel = self.channel;
        self.contexts[channel].get_or_insert_with(|| Context::after(point)).point.set_channel(channel);
        Ok(())
    }
}

impl<R: Read + Seek> LayeredFieldDecompressor<R> for Point14 {
    fn size_of_field(&self) -> usize {
        SIZE
    }

    fn set_selection(&mut self, _: DecompressionSelection) {}

    fn init_first_point(&mut self, from: &mut R, record: &mut [u8], channel: &mut usize) -> io::Result<()> {
        let mut bytes = [0; SIZE];
        from.read_exact(&mut bytes)?;
        record.copy_from_slice(&bytes);
        let point = Point::of(&bytes);
        self.channel = point.channel();
        *channel = self.channel;
        self.contexts = [None, None, None, None];
        self.contexts[self.channel] = Some(Context::after(point));
        Ok(())
    }

    fn decompress_field_with(&mut self, record: &mut [u8], channel: &mut usize) -> io::Result<()> {
        let Some(context) = &mut self.contexts[self.channel] else {
            return Err(io::ErrorKind::InvalidData.into());
        };
        let changes = context.changes(&mut self.layers[XY])?;
        if changes >> 6 & 1 == 1 {
            self.change_channel()?;
            *channel = self.channel;
        }
        if self.tells_always {
            *channel = self.channel;
        }
        let Some(context) = &mut self.contexts[self.channel] else {
            return Err(io::ErrorKind::InvalidData.into());
        };
        context.step(changes, &mut self.layers, &self.sizes)?;
        context.point.put(record);
        Ok(())
    }

    fn read_layers_sizes(&mut self, from: &mut R) -> io::Result<()> {
        for size in &mut self.sizes {
            let mut bytes = [0; 4];
            from.read_exact(&mut bytes)?;
            *size = u32::from_le_bytes(bytes) as usize;
        }
        Ok(())
    }

    /// The sizes were held against the chunk's before.
    fn read_layers(&mut self, from: &mut R) -> io::Result<()> {
        for (layer, size) in self.layers.iter_mut().zip(self.sizes) {
            let mut bytes = vec![0; size];
            from.read_exact(&mut bytes)?;
            *layer = ArithmeticDecoder::new(Cursor::new(bytes));
            if size > 0 {
                layer.read_init_bytes()?;
            }
        }
        Ok(())
    }
}
