//! The arithmetic coder: a number in an interval that each symbol narrows to its part
//! (Said 2004). Bytes are taken in, or given out, as the interval gets short.

use super::model::{Bucket, Model};

/// Raw bits that are coded at once.
const MOST_RAW: u32 = 19;

/// By how much a length is shifted, in whole bytes, until it is at least `1 << 24`. It is
/// never 0; that the compiler can see so saves it a case.
#[inline(always)]
fn missing_bits(length: u32) -> u32 {
    (length | 1).leading_zeros() & 24
}

/// Takes symbols from a stream of bytes.
///
/// Between two operations `value < length` and `length >= 1 << 24`. [`Decoder::new`]
/// checks the first; every operation keeps both, whatever the bytes and whatever the
/// model, since a model's bounds rise strictly. So what a model is asked for is below
/// `(1 << 15) + 64`: `value / (length >> 15)`, where the shift rounds down by less than
/// a five hundredth.
///
/// Where the stream has ended, zeros come, and [`Decoder::has_ended`] says so; who
/// decodes asks it now and then.
#[derive(Debug, Clone, Copy)]
pub struct Decoder<'a> {
    rest: &'a [u8],
    value: u32,
    length: u32,
    ended: bool,
}

impl<'a> Decoder<'a> {
    /// `None` for what no encoder begins with: too few bytes, or the end of the interval.
    pub fn new(bytes: &'a [u8]) -> Option<Decoder<'a>> {
        let (first, rest) = bytes.split_first_chunk()?;
        let value = u32::from_be_bytes(*first);
        (value < u32::MAX).then_some(Decoder { rest, value, length: u32::MAX, ended: false })
    }

    /// Of a layer without bytes: its field never changes, so it is not asked, except the
    /// layer of x and y, which then ends at once.
    pub fn empty() -> Decoder<'static> {
        Decoder { rest: &[], value: 0, length: u32::MAX, ended: false }
    }

    /// Works with a copy, and takes its state over. A decoder that is lent to a function
    /// lies in memory wherever it is used; lending a copy keeps this one in registers.
    #[inline(always)]
    pub fn apart<T>(&mut self, work: impl FnOnce(&mut Decoder<'a>) -> T) -> T {
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
    pub fn symbol<U: Bucket, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
    ) -> usize {
        self.decode::<U, false, S, B, T, W>(model)
    }

    /// The same of a model that may be one of bits.
    #[inline(always)]
    pub fn symbol_or_bit<U: Bucket, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
    ) -> usize {
        self.decode::<U, true, S, B, T, W>(model)
    }

    #[inline(always)]
    fn decode<U: Bucket, const BITS: bool, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
    ) -> usize {
        let unit = self.length >> model.precision::<BITS>();
        let symbol = model.find(self.value / unit);
        let (from, to) = model.interval(symbol);
        let from = from * unit;
        let to = to.map_or(self.length, |to| to * unit);
        self.value -= from;
        self.length = to - from;
        self.take_bytes();
        model.count::<true>(symbol);
        symbol
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
        let bits = missing_bits(self.length);
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
pub struct Encoder {
    /// Longer than what was written, so that four bytes can be put down at once.
    bytes: Vec<u8>,
    written: usize,
    base: u32,
    length: u32,
}

impl Default for Encoder {
    fn default() -> Encoder {
        Encoder { bytes: Vec::new(), written: 0, base: 0, length: u32::MAX }
    }
}

impl Encoder {
    /// Begins a new stream in the same memory.
    pub fn clear(&mut self) {
        (self.written, self.base, self.length) = (0, 0, u32::MAX);
    }

    #[inline(always)]
    pub fn symbol<U: Bucket, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
        symbol: usize,
    ) {
        self.encode::<U, false, S, B, T, W>(model, symbol);
    }

    /// The same of a model that may be one of bits.
    #[inline(always)]
    pub fn symbol_or_bit<U: Bucket, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
        symbol: usize,
    ) {
        self.encode::<U, true, S, B, T, W>(model, symbol);
    }

    #[inline(always)]
    fn encode<U: Bucket, const BITS: bool, const S: usize, const B: usize, const T: usize, const W: u32>(
        &mut self,
        model: &mut Model<U, S, B, T, W>,
        symbol: usize,
    ) {
        let unit = self.length >> model.precision::<BITS>();
        let (from, to) = model.interval(symbol);
        let from = from * unit;
        self.narrow(from, to.map_or(self.length, |to| to * unit) - from);
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
        let (base, carries) = self.base.overflowing_add(from);
        if carries {
            self.carry();
        }
        let bits = missing_bits(length);
        let end = self.written + 4;
        if end > self.bytes.len() {
            self.grow();
        }
        if let Some(place) = self.bytes.get_mut(self.written..end) {
            place.copy_from_slice(&base.to_be_bytes());
        }
        self.written += (bits / 8) as usize;
        self.base = (u64::from(base) << bits) as u32;
        self.length = length << bits;
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self) {
        self.bytes.resize((2 * self.bytes.len()).max(256), 0);
    }

    /// Adds one to what was written.
    #[cold]
    #[inline(never)]
    fn carry(&mut self) {
        for byte in self.bytes[..self.written].iter_mut().rev() {
            *byte = byte.wrapping_add(1);
            if *byte != 0 {
                break;
            }
        }
    }

    /// Writes down a number within the interval, and zeros up to what a decoder takes in
    /// at once. The stream is then to be found by [`Encoder::bytes`].
    pub fn finish(&mut self) {
        let long = self.length > 2 << 24;
        if long {
            self.narrow(1 << 24, 1 << 23);
        } else {
            self.narrow(1 << 23, 1 << 15);
        }
        let zeros = if long { 3 } else { 2 };
        self.bytes.truncate(self.written);
        self.bytes.resize(self.written + zeros, 0);
        self.written = self.bytes.len();
    }

    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.written]
    }
}
