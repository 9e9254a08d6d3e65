//! GPS times: four sequences of times (overlapping flight lines take turns), each with
//! its last difference, of which the next one is a multiple, more or less. Times are
//! taken as integers of the same bits.

use super::LazError;
use super::arithmetic::{ArithmeticDecoder, ArithmeticEncoder};
use super::integer::Integer;
use super::model::{ByteModel, LazyModel, MultipleModel};

/// Multiples that have a code: up to this, and from -1 down to -10 behind it.
const MOST: i32 = 500;
const LEAST: i32 = -10;
/// Switches of sequence in front of one time. A writer makes one; damaged bytes may go
/// on for millions.
const MOST_SWITCHES: u32 = 16;
/// After so many extreme multiples in a row the last difference is replaced.
const MOST_EXTREMES: u8 = 3;

/// The state of a stream of times. Where `REPEATS`, there is a code for a time that is
/// the last one again; the layered format tells that elsewhere.
#[derive(Debug, Clone, Default)]
pub struct Times<const REPEATS: bool> {
    last: usize,
    next: usize,
    times: [i64; 4],
    differences: [i32; 4],
    extremes: [u8; 4],
    after_none: LazyModel<ByteModel>,
    multiple: LazyModel<MultipleModel>,
    numbers: Integer<9, 32>,
}

/// Context, factor, and whether it is an extreme one, of a multiple's code.
fn multiple_of(code: i32) -> (usize, i32, bool) {
    match code {
        0 => (7, 0, true),
        1 => (1, 1, false),
        2..10 => (2, code, false),
        10..MOST => (3, code, false),
        MOST => (4, MOST, true),
        _ if MOST - code > LEAST => (5, MOST - code, false),
        _ => (6, LEAST, true),
    }
}

impl<const REPEATS: bool> Times<REPEATS> {
    /// Symbols for one more.
    const MORE: usize = REPEATS as usize;
    /// Symbols of the model of multiples.
    const MULTIPLES: usize = (MOST - LEAST) as usize + 5 + Self::MORE;
    /// The code of a time that no sequence leads to; behind it are the other sequences.
    const FAR: usize = (MOST - LEAST) as usize + 1 + Self::MORE;

    pub fn begin(&mut self, first: i64) {
        (self.last, self.next) = (0, 0);
        self.times = [first, 0, 0, 0];
        self.differences = [0; 4];
        self.extremes = [0; 4];
        self.after_none.clear();
        self.multiple.clear();
        self.numbers.clear();
    }

    #[inline(never)]
    pub fn decode(&mut self, from: &mut ArithmeticDecoder) -> Result<i64, LazError> {
        from.apart(|from| self.decode_inline(from))
    }

    #[inline(always)]
    pub fn decode_inline(&mut self, from: &mut ArithmeticDecoder) -> Result<i64, LazError> {
        for _ in 0..=MOST_SWITCHES {
            let last = self.last & 3;
            let switch = if self.differences[last] == 0 {
                let code = from.symbol(self.after_none.get(5 + Self::MORE));
                match code + 1 - Self::MORE {
                    0 => return Ok(self.times[last]),
                    1 => {
                        let difference = from.apart(|from| self.numbers.decode_apart(from, 0, 0));
                        self.differences[last] = difference;
                        self.extremes[last] = 0;
                        return Ok(self.add(difference));
                    }
                    2 => return Ok(from.apart(|from| self.decode_far(from))),
                    code => code - 2,
                }
            } else {
                match from.symbol(self.multiple.get(Self::MULTIPLES)) {
                    code if code < Self::FAR - Self::MORE => {
                        let (context, factor, extreme) = multiple_of(code as i32);
                        let predicted = self.differences[last].wrapping_mul(factor);
                        let (difference, _) = self.numbers.decode(from, context, predicted);
                        self.note(context, extreme, difference);
                        return Ok(self.add(difference));
                    }
                    code if code < Self::FAR => return Ok(self.times[last]),
                    code if code == Self::FAR => return Ok(from.apart(|from| self.decode_far(from))),
                    code => code - Self::FAR,
                }
            };
            self.last = (last + switch) & 3;
        }
        Err(LazError::Switches)
    }

    fn add(&mut self, difference: i32) -> i64 {
        let time = &mut self.times[self.last & 3];
        *time = time.wrapping_add(i64::from(difference));
        *time
    }

    /// What a difference that was a multiple of the last one changes.
    fn note(&mut self, context: usize, extreme: bool, difference: i32) {
        let last = self.last & 3;
        if context == 1 {
            self.extremes[last] = 0;
        }
        if extreme {
            self.extremes[last] += 1;
            if self.extremes[last] > MOST_EXTREMES {
                self.extremes[last] = 0;
                self.differences[last] = difference;
            }
        }
    }

    /// A time that no difference of 32 bits leads to begins a sequence.
    #[inline(never)]
    fn decode_far(&mut self, from: &mut ArithmeticDecoder) -> i64 {
        let above = (self.times[self.last & 3] >> 32) as i32;
        let high = self.numbers.decode_apart(from, 8, above);
        let time = i64::from(high) << 32 | i64::from(from.raw_word());
        self.begin_sequence(time);
        time
    }

    fn begin_sequence(&mut self, time: i64) {
        self.next = (self.next + 1) & 3;
        self.last = self.next;
        self.times[self.last] = time;
        self.differences[self.last] = 0;
        self.extremes[self.last] = 0;
    }
}

impl Times<false> {
    /// Encodes a time, which mostly is another than the last.
    pub fn encode(&mut self, to: &mut ArithmeticEncoder, time: i64) {
        // At most once around: in a sequence that was chosen the difference fits.
        loop {
            let last = self.last & 3;
            let none = self.differences[last] == 0;
            if let Some(difference) = self.difference(last, time) {
                if none {
                    to.symbol(self.after_none.get(5), 0);
                    self.numbers.encode(to, 0, 0, difference);
                    self.differences[last] = difference;
                    self.extremes[last] = 0;
                } else {
                    self.encode_multiple(to, difference);
                }
                self.times[last] = time;
                return;
            }
            let other = (1..4).find(|further| self.difference((last + further) & 3, time).is_some());
            let code = other.unwrap_or(0);
            if none {
                to.symbol(self.after_none.get(5), 1 + code);
            } else {
                to.symbol(self.multiple.get(Self::MULTIPLES), Self::FAR + code);
            }
            let Some(further) = other else {
                let above = (self.times[last] >> 32) as i32;
                self.numbers.encode(to, 8, above, (time >> 32) as i32);
                to.raw_word(time as u32);
                return self.begin_sequence(time);
            };
            self.last = (last + further) & 3;
        }
    }

    /// From the last time of a sequence, if it fits into 32 bits.
    fn difference(&self, sequence: usize, time: i64) -> Option<i32> {
        i32::try_from(time.wrapping_sub(self.times[sequence])).ok()
    }

    fn encode_multiple(&mut self, to: &mut ArithmeticEncoder, difference: i32) {
        let last = self.differences[self.last & 3];
        let ratio = difference as f32 / last as f32;
        let multiple = if ratio >= 0.0 { (ratio + 0.5) as i32 } else { (ratio - 0.5) as i32 };
        let code = match multiple {
            0.. => multiple.min(MOST),
            _ => MOST - multiple.max(LEAST),
        };
        let (context, factor, extreme) = multiple_of(code);
        to.symbol(self.multiple.get(Self::MULTIPLES), code as usize);
        self.numbers.encode(to, context, last.wrapping_mul(factor), difference);
        self.note(context, extreme, difference);
    }
}
