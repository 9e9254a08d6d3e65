//! The arithmetic coder: a number in an interval that each symbol narrows to its part
//! (Said 2004). Bytes are taken in, or given out, as the interval gets short.

use super::LazError;
use super::model::{BucketIndex, Model, precision};

/// Raw bits that are coded at once.
const MOST_RAW: u32 = 19;

/// Leading zeros of a length, which is at least 32: the coder's invariant and [`MOST_RAW`]
/// give so. Shifted by as many of them as make whole bytes, it is at least `1 << 24`. It is
/// never 0; that the compiler can see so saves it a case.
#[inline(always)]
fn leading_zeros(length: u32) -> u32 {
    (length | 1).leading_zeros()
}

/// Bits of a length that say by what to multiply, where one would divide by it.
const INDEX_BITS: u32 = 11;

/// Of each length in the interval that its upper bits say, shifted until its first bit is set,
/// what 2^47 is over it, or up to a thousandth less.
static RECIPROCALS: [u16; 1 << INDEX_BITS] = {
    let mut reciprocals = [0; 1 << INDEX_BITS];
    let mut index = 1 << (INDEX_BITS - 1);
    while index < 1 << INDEX_BITS {
        reciprocals[index] = ((1u32 << 26) / (index as u32 + 1)) as u16;
        index += 1;
    }
    reciprocals
};

/// Takes symbols from a stream of bytes.
///
/// Between two operations `value < length` and `length >= 1 << 24`. [`ArithmeticDecoder::new`]
/// checks the first; every operation keeps both, whatever the bytes and whatever the
/// model, since a model's bounds rise strictly.
///
/// Where the stream has ended, zeros come, and [`ArithmeticDecoder::has_ended`] says so; who
/// decodes asks it now and then.
#[derive(Debug, Clone, Copy)]
pub struct ArithmeticDecoder<'a> {
    rest: &'a [u8],
    value: u32,
    length: u32,
    /// Leading zeros of the length, and the length shifted by them: known before the length is.
    zeros: u32,
    shifted: u32,
    ended: bool,
}

impl<'a> ArithmeticDecoder<'a> {
    /// `None` for what no encoder begins with: too few bytes, or the end of the interval.
    pub fn new(bytes: &'a [u8]) -> Option<ArithmeticDecoder<'a>> {
        let (first, rest) = bytes.split_first_chunk()?;
        let value = u32::from_be_bytes(*first);
        let begin = ArithmeticDecoder { rest, value, ..ArithmeticDecoder::empty() };
        (value < begin.length).then_some(begin)
    }

    /// Of a layer without bytes: its field never changes, so it is not asked, except the
    /// layer of x and y, which then ends at once.
    pub fn empty() -> ArithmeticDecoder<'static> {
        ArithmeticDecoder { rest: &[], value: 0, length: u32::MAX, zeros: 0, shifted: u32::MAX, ended: false }
    }

    /// Of a layer, if it has bytes.
    pub fn of_layer(layer: &'a [u8]) -> Result<Option<ArithmeticDecoder<'a>>, LazError> {
        match layer.len() {
            0 => Ok(None),
            1..4 => Err(LazError::Ended),
            _ => ArithmeticDecoder::new(layer).map(Some).ok_or(LazError::Beginning),
        }
    }

    /// The same decoder where the rest of its bytes is found at another place.
    pub fn over<'b>(&self, rest: &'b [u8]) -> ArithmeticDecoder<'b> {
        ArithmeticDecoder { rest, ..*self }
    }

    /// Works with a copy, and takes its state over. A decoder that is lent to a function
    /// lies in memory wherever it is used; lending a copy keeps this one in registers.
    #[inline(always)]
    pub fn apart<T>(&mut self, work: impl FnOnce(&mut ArithmeticDecoder<'a>) -> T) -> T {
        let mut copy = *self;
        let made = work(&mut copy);
        *self = copy;
        made
    }

    /// Whether more bytes were taken than there are.
    pub fn has_ended(&self) -> bool {
        self.ended
    }

    /// Bytes that were not taken.
    pub fn left(&self) -> usize {
        self.rest.len()
    }

    #[inline(always)]
    pub fn symbol<U: BucketIndex, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
    ) -> usize {
        self.symbol_or_bit(model, false)
    }

    /// The same of a model that may be one of a bit. The caller says so, since it knows
    /// before the model is read, and the division has to wait for it.
    #[inline(always)]
    pub fn symbol_or_bit<U: BucketIndex, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
        is_bit: bool,
    ) -> usize {
        let unit = self.length >> precision(is_bit);
        let (symbol, from, to) = model.find(self.place(), is_bit, self.value, unit, self.length);
        self.value -= from;
        self.length = to - from;
        self.take_bytes();
        model.count::<true>(symbol);
        symbol
    }

    /// Where the value lies in the interval, of 2^32, or up to a thousandth less. A division
    /// would say it exactly, but every symbol would wait for it longer than for all else.
    #[inline(always)]
    fn place(&self) -> u32 {
        let reciprocal = RECIPROCALS[(self.shifted >> (32 - INDEX_BITS)) as usize];
        ((u64::from(self.value << self.zeros) * u64::from(reciprocal)) >> 15) as u32
    }

    /// Bits that are all equally probable; of a damaged stream it may be a greater number
    /// than they can make.
    #[inline(always)]
    pub fn raw(&mut self, bits: u32) -> u32 {
        if bits <= MOST_RAW {
            return self.few_raw(bits);
        }
        let low = self.few_raw(16) & 0xFFFF;
        self.few_raw(bits - 16) << 16 | low
    }

    /// 32 of them.
    pub fn raw_word(&mut self) -> u32 {
        let low = self.few_raw(16) & 0xFFFF;
        (self.few_raw(16) & 0xFFFF) << 16 | low
    }

    #[inline(always)]
    fn few_raw(&mut self, bits: u32) -> u32 {
        self.length >>= bits;
        let number = self.value / self.length;
        self.value -= self.length * number;
        self.take_bytes();
        number
    }

    /// Takes bytes in until the interval is long again.
    #[inline(always)]
    fn take_bytes(&mut self) {
        let zeros = leading_zeros(self.length);
        let bits = zeros & 24;
        self.shifted = self.length << zeros;
        self.zeros = zeros & 7;
        let next = match self.rest.first_chunk() {
            Some(next) => {
                self.rest = &self.rest[(bits / 8) as usize..];
                u32::from_be_bytes(*next)
            }
            None => {
                let (next, rest, ended) = last_bytes(self.rest, (bits / 8) as usize);
                self.rest = rest;
                self.ended |= ended;
                next
            }
        };
        self.value = ((u64::from(self.value) << 32 | u64::from(next)) << bits >> 32) as u32;
        self.length <<= bits;
    }
}

/// The next four bytes where there are fewer, what is left when `used` are taken, and
/// whether those are more than there are. No method, for a decoder whose place in memory
/// nobody knows stays in registers.
#[cold]
#[inline(never)]
fn last_bytes(rest: &[u8], used: usize) -> (u32, &[u8], bool) {
    let mut next = [0; 4];
    for (to, from) in next.iter_mut().zip(rest) {
        *to = *from;
    }
    (u32::from_be_bytes(next), rest.get(used..).unwrap_or_default(), used > rest.len())
}

/// Makes a stream of bytes of symbols.
#[derive(Debug, Clone)]
pub struct ArithmeticEncoder {
    /// Four bytes in front of the stream, the stream, and some room behind it.
    bytes: Vec<u8>,
    /// Where the last four bytes lie that were given out.
    last: usize,
    /// Those four, and the interval's bottom: one that is carried mostly ends in them.
    base: u64,
    length: u32,
}

/// Bytes in front of a stream, as if they had been given out.
const FRONT: usize = 4;

impl Default for ArithmeticEncoder {
    fn default() -> ArithmeticEncoder {
        ArithmeticEncoder { bytes: Vec::new(), last: 0, base: 0, length: u32::MAX }
    }
}

impl ArithmeticEncoder {
    /// Begins a new stream in the same memory.
    pub fn clear(&mut self) {
        (self.last, self.base, self.length) = (0, 0, u32::MAX);
    }

    #[inline(always)]
    pub fn symbol<U: BucketIndex, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
        symbol: usize,
    ) {
        self.symbol_or_bit(model, symbol, false);
    }

    /// The same of a model that may be one of a bit.
    #[inline(always)]
    pub fn symbol_or_bit<U: BucketIndex, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
        symbol: usize,
        is_bit: bool,
    ) {
        let unit = self.length >> precision(is_bit);
        let (from, to) = model.part(symbol, unit, self.length);
        self.narrow(from, to - from);
        model.count::<false>(symbol);
    }

    /// Bits that are all equally probable.
    pub fn raw(&mut self, bits: u32, number: u32) {
        let (mut bits, mut number) = (bits, number);
        if bits > MOST_RAW {
            let length = self.length >> 16;
            self.narrow((number & 0xFFFF) * length, length);
            (bits, number) = (bits - 16, number >> 16);
        }
        let length = self.length >> bits;
        self.narrow(number * length, length);
    }

    /// 32 of them.
    pub fn raw_word(&mut self, number: u32) {
        for half in [number & 0xFFFF, number >> 16] {
            let length = self.length >> 16;
            self.narrow(half * length, length);
        }
    }

    /// Goes over to the part of the interval that begins at `from`.
    #[inline(always)]
    fn narrow(&mut self, from: u32, length: u32) {
        let (base, carries) = self.base.overflowing_add(u64::from(from));
        if carries {
            self.carry();
        }
        let bits = leading_zeros(length) & 24;
        match self.bytes.get_mut(self.last..self.last + 8) {
            Some(place) => place.copy_from_slice(&base.to_be_bytes()),
            None => self.grow(base),
        }
        self.last += (bits / 8) as usize;
        self.base = base << bits;
        self.length = length << bits;
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self, base: u64) {
        self.bytes.resize((2 * self.bytes.len()).max(256), 0);
        self.bytes[self.last..self.last + 8].copy_from_slice(&base.to_be_bytes());
    }

    /// Adds one to what was given out before the last four bytes.
    #[cold]
    #[inline(never)]
    fn carry(&mut self) {
        for byte in self.bytes[..self.last].iter_mut().rev() {
            *byte = byte.wrapping_add(1);
            if *byte != 0 {
                break;
            }
        }
    }

    /// Writes down a number within the interval, and zeros up to what a decoder takes in
    /// at once. The stream is then to be found by [`ArithmeticEncoder::bytes`].
    pub fn finish(&mut self) {
        let long = self.length > 2 << 24;
        if long {
            self.narrow(1 << 24, 1 << 23);
        } else {
            self.narrow(1 << 23, 1 << 15);
        }
        let zeros = if long { 3 } else { 2 };
        let end = self.last + FRONT;
        self.bytes.truncate(end);
        self.bytes.resize(end + zeros, 0);
    }

    pub fn bytes(&self) -> &[u8] {
        &self.bytes[FRONT..]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decoder(value: u32, length: u32) -> ArithmeticDecoder<'static> {
        let zeros = length.leading_zeros();
        ArithmeticDecoder { value, length, zeros, shifted: length << zeros, ..ArithmeticDecoder::empty() }
    }

    /// The tables behind a model are found by it, so it must never be too great.
    #[test]
    fn places_are_a_little_early_never_late() {
        let lengths = (1 << 24..=u32::MAX).step_by(999_983).chain([u32::MAX]);
        for length in
            lengths.chain((24..32).flat_map(|bit| [1u32 << bit, (1 << bit) + 1, u32::MAX >> (31 - bit)]))
        {
            for value in [0, 1, length / 1000, length / 2, length - 2, length - 1] {
                let place = u64::from(decoder(value, length).place());
                let exact = (u64::from(value) << 32) / u64::from(length);
                assert!(
                    place <= exact && exact <= place + (place >> 9) + 2,
                    "{value} of {length}: {place}, {exact}"
                );
            }
        }
    }

    #[test]
    fn a_carry_goes_as_far_as_needed() {
        for ones in [0, 1, 3, 4, 5, 30] {
            let mut encoder = ArithmeticEncoder::default();
            // A seven, and then the interval's bottom is nothing but ones, as are its bytes.
            encoder.narrow(0x07FF_FFFF, 1 << 16);
            (0..ones).for_each(|_| encoder.narrow(0xFF, 1 << 16));
            encoder.narrow(0x100, 1 << 16);
            encoder.finish();
            let mut wanted = vec![8];
            wanted.extend(vec![0; ones + 1]);
            assert_eq!(&encoder.bytes()[..ones + 2], &wanted, "{ones}");
        }
    }

    proptest! {
        #[test]
        fn raw_bits_come_out_as_they_went_in(numbers in prop::collection::vec((1u32..32, any::<u32>()), 1..200)) {
            let mut encoder = ArithmeticEncoder::default();
            for (bits, number) in &numbers {
                encoder.raw(*bits, number & ((1 << bits) - 1));
                encoder.raw_word(*number);
            }
            encoder.finish();
            let mut decoder = ArithmeticDecoder::new(encoder.bytes()).unwrap();
            for (bits, number) in &numbers {
                prop_assert_eq!(decoder.raw(*bits), number & ((1 << bits) - 1));
                prop_assert_eq!(decoder.raw_word(), *number);
            }
            prop_assert!(decoder.left() == 0 && !decoder.has_ended());
        }
    }
}
