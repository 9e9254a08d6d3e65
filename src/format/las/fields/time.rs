//! GPS times as LASzip codes them: four sequences of times (overlapping flight
//! lines take turns), each with its last difference, of which the next is a
//! multiple, more or less.

use std::io::{self, Read};

use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::FieldDecompressor;

/// Multiples that have a code: up to this, and from -1 down to -10 behind it.
const MOST: i32 = 500;
const LEAST: i32 = -10;
/// Switches of sequence in front of one time. A writer makes one; damaged bytes
/// may go on for millions.
const MOST_SWITCHES: u32 = 16;
/// After so many extreme multiples in a row the last difference is replaced.
const MOST_EXTREMES: i32 = 3;

/// The state of a stream of times.
pub struct GpsTimeState {
    last: usize,
    next: usize,
    /// The bits of the last time of each sequence, as an integer.
    times: [i64; 4],
    differences: [i32; 4],
    extremes: [i32; 4],
    /// Whether there is a code for a time that is the last one again: the layered
    /// format tells that elsewhere.
    may_repeat: bool,
    after_none: ArithmeticModel,
    multiple: ArithmeticModel,
    numbers: IntegerDecompressor,
}

impl GpsTimeState {
    pub fn new(first: i64, may_repeat: bool) -> GpsTimeState {
        let more = u32::from(may_repeat);
        let multiples = (MOST - LEAST) as u32;
        GpsTimeState {
            last: 0,
            next: 0,
            times: [first, 0, 0, 0],
            differences: [0; 4],
            extremes: [0; 4],
            may_repeat,
            after_none: ArithmeticModelBuilder::new(5 + more).build(),
            multiple: ArithmeticModelBuilder::new(multiples + 5 + more).build(),
            numbers: IntegerDecompressorBuilder::new().bits(32).contexts(9).build_initialized(),
        }
    }

    /// The bits of the last time.
    pub fn get(&self) -> i64 {
        self.times[self.last]
    }

    /// Decodes the next time.
    pub fn step<R: Read>(&mut self, from: &mut ArithmeticDecoder<R>) -> io::Result<()> {
        for _ in 0..=MOST_SWITCHES {
            let repeats = i32::from(self.may_repeat);
            let switch = if self.differences[self.last] == 0 {
                match from.decode_symbol(&mut self.after_none)? as i32 - repeats {
                    -1 => return Ok(()),
                    0 => {
                        let difference = self.numbers.decompress(from, 0, 0)?;
                        self.differences[self.last] = difference;
                        self.extremes[self.last] = 0;
                        self.add(difference);
                        return Ok(());
                    }
                    1 => return self.far(from),
                    code => code - 1,
                }
            } else {
                let full = MOST - LEAST + 1 + repeats;
                match from.decode_symbol(&mut self.multiple)? as i32 {
                    code if code < full - repeats => return self.multiple_of_last(from, code),
                    code if code < full => return Ok(()),
                    code if code == full => return self.far(from),
                    code => code - full,
                }
            };
            self.last = (self.last + switch as usize) & 3;
        }
        Err(io::Error::new(io::ErrorKind::InvalidData, "its GPS times switch sequences without end"))
    }

    fn add(&mut self, difference: i32) {
        self.times[self.last] = self.times[self.last].wrapping_add(i64::from(difference));
    }

    fn multiple_of_last<R: Read>(&mut self, from: &mut ArithmeticDecoder<R>, code: i32) -> io::Result<()> {
        let last = self.differences[self.last];
        let (multiple, context, is_extreme) = match code {
            0 => (0, 7, true),
            1 => (1, 1, false),
            2..10 => (code, 2, false),
            10..MOST => (code, 3, false),
            MOST => (MOST, 4, true),
            _ if MOST - code > LEAST => (MOST - code, 5, false),
            _ => (LEAST, 6, true),
        };
        let difference = self.numbers.decompress(from, last.wrapping_mul(multiple), context)?;
        if code == 1 {
            self.extremes[self.last] = 0;
        }
        if is_extreme {
            self.extremes[self.last] += 1;
            if self.extremes[self.last] > MOST_EXTREMES {
                self.differences[self.last] = difference;
                self.extremes[self.last] = 0;
            }
        }
        self.add(difference);
        Ok(())
    }

    /// A time that no difference of 32 bits leads to begins a sequence.
    fn far<R: Read>(&mut self, from: &mut ArithmeticDecoder<R>) -> io::Result<()> {
        self.next = (self.next + 1) & 3;
        let above = (self.times[self.last] >> 32) as i32;
        let high = self.numbers.decompress(from, above, 8)?;
        self.times[self.next] = i64::from(high) << 32 | i64::from(from.read_int()?);
        self.last = self.next;
        self.differences[self.last] = 0;
        self.extremes[self.last] = 0;
        Ok(())
    }
}

/// The field of the point formats 1, 3, 4 and 5 (version 2 of LASzip).
pub struct GpsTime(GpsTimeState);

impl Default for GpsTime {
    fn default() -> GpsTime {
        GpsTime(GpsTimeState::new(0, true))
    }
}

impl<R: Read> FieldDecompressor<R> for GpsTime {
    fn size_of_field(&self) -> usize {
        8
    }

    fn decompress_first(&mut self, from: &mut R, record: &mut [u8]) -> io::Result<()> {
        let mut bytes = [0; 8];
        from.read_exact(&mut bytes)?;
        record.copy_from_slice(&bytes);
        self.0 = GpsTimeState::new(i64::from_le_bytes(bytes), true);
        Ok(())
    }

    fn decompress_with(&mut self, from: &mut ArithmeticDecoder<R>, record: &mut [u8]) -> io::Result<()> {
        self.0.step(from)?;
        record.copy_from_slice(&self.0.get().to_le_bytes());
        Ok(())
    }
}
