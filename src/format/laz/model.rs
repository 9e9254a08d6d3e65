//! Adaptive models: how probable each symbol is, by how often it came. Probabilities
//! are renewed now and then, at intervals that grow, as FastAC does it (Said 2004).

use std::sync::LazyLock;

/// Bits of the sum of a model's probabilities, and of one that decides a single bit.
const PRECISION: u32 = 15;
const BIT_PRECISION: u32 = 13;
/// Counts are halved when their sum is more.
const MOST_COUNTED: u32 = 1 << PRECISION;
const MOST_BITS_COUNTED: u32 = 1 << BIT_PRECISION;
/// Behind the bound of the last symbol: greater than anything that is looked for.
const END: u16 = u16::MAX;
/// Buckets are written so many at once, which is one instruction.
const STRIDE: usize = 16;

/// How far an interval's length is shifted to be multiplied by bounds.
#[inline(always)]
pub fn precision(of_bit: bool) -> u32 {
    if of_bit { BIT_PRECISION } else { PRECISION }
}

/// What a bucket says a symbol with.
pub trait BucketIndex: Copy + Into<usize> {
    fn of(symbol: usize) -> Self;
}

impl BucketIndex for u8 {
    fn of(symbol: usize) -> u8 {
        symbol as u8
    }
}

impl BucketIndex for u16 {
    fn of(symbol: usize) -> u16 {
        symbol as u16
    }
}

/// A model of at most `SYMBOLS` symbols; `BOUNDS` is one more. A decoder finds the
/// symbol by a table of buckets `1 << WIDTH` wide, which says the symbol that a bucket
/// begins in. So narrow are the buckets that this mostly is the symbol: one comparison
/// that goes one way, where a bisection is several that go either. `BUCKETS` is two
/// strides more than cover all probabilities.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Model<U, const SYMBOLS: usize, const BOUNDS: usize, const BUCKETS: usize, const WIDTH: u32> {
    /// Symbols until the probabilities are renewed, and the length of such a cycle.
    left: u32,
    cycle: u32,
    total: u32,
    symbols: u16,
    is_bit: bool,
    /// Where each symbol's probabilities begin; from the number of symbols on, [`END`].
    bounds: [u16; BOUNDS],
    buckets: [U; BUCKETS],
    counts: [u16; SYMBOLS],
}

/// For symbols that fit a byte, and for single bits.
pub type ByteModel = Model<u8, 256, 257, 544, 6>;
/// For the number of bits of an integer.
pub type LengthModel = Model<u8, 64, 65, 160, 8>;
/// For the multiples of GPS times.
pub type MultipleModel = Model<u16, 516, 517, 544, 6>;

impl<U: BucketIndex, const SYMBOLS: usize, const BOUNDS: usize, const BUCKETS: usize, const WIDTH: u32>
    Model<U, SYMBOLS, BOUNDS, BUCKETS, WIDTH>
{
    /// A model in which all symbols are alike.
    fn even(symbols: usize) -> Self {
        let symbols = symbols.clamp(2, SYMBOLS);
        let mut model = Self {
            left: 0,
            cycle: symbols as u32,
            total: 0,
            symbols: symbols as u16,
            is_bit: false,
            bounds: [END; BOUNDS],
            buckets: [U::of(0); BUCKETS],
            counts: [0; SYMBOLS],
        };
        model.counts[..symbols].fill(1);
        model.renew(true);
        model.cycle = (symbols as u32 + 6) >> 1;
        model.left = model.cycle;
        model
    }

    /// A model of single bits. It has rules of its own.
    fn bit() -> Self {
        let mut model = Self::even(2);
        model.is_bit = true;
        (model.left, model.cycle, model.total) = (4, 4, 2);
        model.bounds[1] = 1 << (BIT_PRECISION - 1);
        model.fill_buckets();
        model
    }

    /// The symbol whose part of an interval of `length` a value lies in, and where that part
    /// begins and ends. A `unit` is what the length is for one of all probabilities. `at` says
    /// how far into the interval the value lies, of 2^32, or less: then the search is longer.
    #[inline(always)]
    pub fn find(&self, at: u32, is_bit: bool, value: u32, unit: u32, length: u32) -> (usize, u32, u32) {
        let bucket = at >> (32 - precision(is_bit) + WIDTH);
        let mut symbol: usize = self.buckets[bucket as usize].into();
        let mut end = self.end(symbol, unit);
        // The last bound is END, which no value lies behind, so it ends there at the latest.
        while end <= u64::from(value) {
            symbol += 1;
            end = self.end(symbol, unit);
        }
        let from = u32::from(self.bounds[Self::within(symbol)]) * unit;
        (symbol, from, end.min(u64::from(length)) as u32)
    }

    #[inline(always)]
    fn end(&self, symbol: usize, unit: u32) -> u64 {
        u64::from(self.bounds[Self::within(symbol) + 1]) * u64::from(unit)
    }

    /// The part of an interval of `length` that is a symbol's: where it begins, and ends.
    #[inline(always)]
    pub fn part(&self, symbol: usize, unit: u32, length: u32) -> (u32, u32) {
        let from = u32::from(self.bounds[Self::within(symbol)]) * unit;
        // The last one's end is that of the interval, which END lies behind.
        (from, self.end(symbol, unit).min(u64::from(length)) as u32)
    }

    /// Counts a symbol. Only decoders need the buckets.
    #[inline(always)]
    pub fn count<const DECODES: bool>(&mut self, symbol: usize) {
        let count = &mut self.counts[Self::within(symbol)];
        *count = count.wrapping_add(1);
        self.left -= 1;
        if self.left == 0 {
            self.renew(DECODES);
        }
    }

    /// The same number: it lets the compiler leave out checks.
    #[inline(always)]
    fn within(symbol: usize) -> usize {
        symbol & (SYMBOLS.next_power_of_two() - 1)
    }

    /// Probabilities anew from the counts.
    #[cold]
    #[inline(never)]
    fn renew(&mut self, buckets: bool) {
        self.total += self.cycle;
        let longest = if self.is_bit {
            self.renew_bit();
            64
        } else {
            self.renew_bounds();
            (u32::from(self.symbols) + 6) << 3
        };
        if buckets {
            self.fill_buckets();
        }
        self.cycle = ((5 * self.cycle) >> 2).min(longest);
        self.left = self.cycle;
    }

    fn renew_bounds(&mut self) {
        let symbols = usize::from(self.symbols).min(SYMBOLS);
        let counts = &mut self.counts[..symbols];
        if self.total > MOST_COUNTED {
            self.total = 0;
            for count in &mut *counts {
                *count = (*count + 1) >> 1;
                self.total += u32::from(*count);
            }
        }
        let scale = (1 << 31) / self.total;
        let mut sum = 0;
        for (bound, count) in self.bounds.iter_mut().zip(counts) {
            *bound = ((scale * sum) >> (31 - PRECISION)) as u16;
            sum += u32::from(*count);
        }
    }

    /// Only zeros are counted.
    fn renew_bit(&mut self) {
        let mut zeros = u32::from(self.counts[0]);
        if self.total > MOST_BITS_COUNTED {
            self.total = (self.total + 1) >> 1;
            zeros = (zeros + 1) >> 1;
            self.counts[0] = zeros as u16;
            if zeros == self.total {
                self.total += 1;
            }
        }
        self.bounds[1] = ((zeros * ((1 << 31) / self.total)) >> (31 - BIT_PRECISION)) as u16;
    }

    /// A symbol's buckets are those that begin within its probabilities. Each is written
    /// a stride at once, and the next symbol overwrites what is too much.
    fn fill_buckets(&mut self) {
        let all = (1usize << precision(self.is_bit)) >> WIDTH;
        let mut fill = |from: usize, symbol: usize| {
            self.buckets[from..from + STRIDE].copy_from_slice(&[U::of(symbol); STRIDE]);
            from + STRIDE
        };
        let mut done = 0;
        for (symbol, bound) in self.bounds[..usize::from(self.symbols)].iter().enumerate() {
            let first = usize::from(*bound).div_ceil(1 << WIDTH).min(all);
            while done < first {
                done = fill(done, symbol - 1);
            }
            done = fill(first, symbol);
        }
        let last = usize::from(self.symbols) - 1;
        while done <= all {
            done = fill(done, last);
        }
    }
}

/// What a [`LazyModel`] can hold: it can be put into the state in which streams begin.
pub trait Fresh: Clone {
    /// `symbols` is the number of them; 1 means bits.
    fn fresh(symbols: usize) -> Box<Self>;

    fn refresh(&mut self, symbols: usize) {
        *self = *Self::fresh(symbols);
    }
}

/// The models of 1, 2, 4 … 256 symbols are copied, which is quicker than making them.
static BYTE_MODELS: LazyLock<[ByteModel; 9]> = LazyLock::new(|| {
    std::array::from_fn(|log| if log == 0 { ByteModel::bit() } else { ByteModel::even(1 << log) })
});

impl Fresh for ByteModel {
    fn fresh(symbols: usize) -> Box<Self> {
        match BYTE_MODELS.get(symbols.trailing_zeros() as usize) {
            Some(model) if symbols.is_power_of_two() => Box::new(model.clone()),
            _ => Box::new(ByteModel::even(symbols)),
        }
    }

    fn refresh(&mut self, symbols: usize) {
        match BYTE_MODELS.get(symbols.trailing_zeros() as usize) {
            Some(model) if symbols.is_power_of_two() => self.clone_from(model),
            _ => *self = ByteModel::even(symbols),
        }
    }
}

static LENGTH_MODELS: LazyLock<[LengthModel; 2]> =
    LazyLock::new(|| [LengthModel::even(17), LengthModel::even(33)]);

impl Fresh for LengthModel {
    fn fresh(symbols: usize) -> Box<Self> {
        Box::new(LENGTH_MODELS[usize::from(symbols > 17)].clone())
    }
}

impl Fresh for MultipleModel {
    fn fresh(symbols: usize) -> Box<Self> {
        Box::new(MultipleModel::even(symbols))
    }
}

/// A model that is made when it is first needed; most never are. Its memory waits for
/// the next chunk.
#[derive(Debug, Clone)]
pub struct LazyModel<M> {
    model: Option<Box<M>>,
    spare: Option<Box<M>>,
}

impl<M> Default for LazyModel<M> {
    fn default() -> LazyModel<M> {
        LazyModel { model: None, spare: None }
    }
}

impl<M: Fresh> LazyModel<M> {
    /// The model; it always has to be asked for with the same number of symbols.
    #[inline(always)]
    pub fn get(&mut self, symbols: usize) -> &mut M {
        let spare = &mut self.spare;
        self.model.get_or_insert_with(|| make(spare, symbols))
    }

    /// At the end of a chunk.
    pub fn clear(&mut self) {
        if let Some(model) = self.model.take() {
            self.spare = Some(model);
        }
    }
}

#[cold]
#[inline(never)]
fn make<M: Fresh>(spare: &mut Option<Box<M>>, symbols: usize) -> Box<M> {
    match spare.take() {
        Some(mut model) => {
            model.refresh(symbols);
            model
        }
        None => M::fresh(symbols),
    }
}

/// Slots in an array.
pub fn slots<M, const COUNT: usize>() -> [LazyModel<M>; COUNT] {
    std::array::from_fn(|_| LazyModel::default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The symbol by a search from the front.
    fn searched<U: BucketIndex, const S: usize, const B: usize, const T: usize, const W: u32>(
        model: &Model<U, S, B, T, W>,
        at: u32,
    ) -> usize {
        let bounds = &model.bounds[..usize::from(model.symbols)];
        bounds.iter().rposition(|bound| u32::from(*bound) <= at).unwrap()
    }

    fn check<U: BucketIndex, const S: usize, const B: usize, const T: usize, const W: u32>(
        model: &mut Model<U, S, B, T, W>,
        symbols: &[u16],
    ) {
        for symbol in symbols {
            let symbol = usize::from(*symbol) % usize::from(model.symbols);
            model.count::<true>(symbol);
        }
        let precision = precision(model.is_bit);
        let top = 1 << precision;
        let places = (0..top).step_by(7).chain([top - 1]);
        let places = places.chain(model.bounds.iter().map(|b| u32::from(*b)).filter(|b| *b < top));
        for at in places {
            for (length, beyond) in [(1 << 24, 0), ((1 << 24) + 77, 500), (u32::MAX, (1 << 15) - 1)] {
                let unit = length >> precision;
                let value = (at * unit + beyond).min(length - 1);
                let estimate = (u64::from(value) << 32) / u64::from(length);
                for early in [0, estimate / 700, estimate / 3] {
                    let (symbol, from, to) =
                        model.find((estimate - early) as u32, model.is_bit, value, unit, length);
                    assert_eq!(symbol, searched(model, value / unit), "at {at} of {length}");
                    assert_eq!((from, to), model.part(symbol, unit, length));
                    assert!(from <= value && value < to && to <= length, "{from} {value} {to}");
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn the_table_finds_what_a_search_finds(
            symbols in 2usize..=256,
            common in any::<u16>(),
            rare in prop::collection::vec(any::<u16>(), 0..3000),
            times in 0usize..6000,
        ) {
            let mut stream = vec![common; times];
            stream.extend(rare);
            check(&mut ByteModel::even(symbols), &stream);
            check(&mut LengthModel::even(symbols.min(33)), &stream);
            check(&mut MultipleModel::even(symbols + 260), &stream);
            check(&mut ByteModel::bit(), &stream);
        }
    }

    #[test]
    fn a_slot_begins_anew_in_each_chunk() {
        for symbols in [1, 2, 13, 128, 256] {
            let mut slot = LazyModel::<ByteModel>::default();
            let before = slot.get(symbols).bounds;
            for _ in 0..500 {
                slot.get(symbols).count::<true>(0);
            }
            assert_ne!(slot.get(symbols).bounds, before);
            slot.clear();
            assert_eq!(slot.get(symbols).bounds, before);
        }
    }
}
