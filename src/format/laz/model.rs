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

/// What a bucket says a symbol with.
pub trait Bucket: Copy + Into<usize> {
    fn of(symbol: usize) -> Self;
}

impl Bucket for u8 {
    fn of(symbol: usize) -> u8 {
        symbol as u8
    }
}

impl Bucket for u16 {
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
    precision: u16,
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

impl<U: Bucket, const SYMBOLS: usize, const BOUNDS: usize, const BUCKETS: usize, const WIDTH: u32>
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
            precision: PRECISION as u16,
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
        model.precision = BIT_PRECISION as u16;
        (model.left, model.cycle, model.total) = (4, 4, 2);
        model.bounds[1] = 1 << (BIT_PRECISION - 1);
        model.fill_buckets();
        model
    }

    /// How far an interval's length is shifted to be multiplied by bounds; of bits it is
    /// another number than of all other models.
    #[inline(always)]
    pub fn precision<const BITS: bool>(&self) -> u32 {
        if BITS { u32::from(self.precision) & 31 } else { PRECISION }
    }

    /// The symbol whose probabilities `at` lies in; the last one if it lies behind all.
    /// `at` is below `(1 << 15) + 64`, which every decoder's invariant gives.
    #[inline(always)]
    pub fn find(&self, at: u32) -> usize {
        let mut symbol: usize = self.buckets[(at >> WIDTH) as usize].into();
        // The last bound is END, so it ends there at the latest.
        while u32::from(self.bounds[Self::within(symbol) + 1]) <= at {
            symbol += 1;
        }
        symbol
    }

    /// Where a symbol's probabilities begin and end; `None` for the end of the last.
    #[inline(always)]
    pub fn interval(&self, symbol: usize) -> (u32, Option<u32>) {
        let symbol = Self::within(symbol);
        let end = self.bounds[symbol + 1];
        (u32::from(self.bounds[symbol]), (end != END).then_some(u32::from(end)))
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
        let longest = if u32::from(self.precision) == BIT_PRECISION {
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
        let all = (1usize << self.precision) >> WIDTH;
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

/// What a [`Slot`] can hold: it can be put into the state in which streams begin.
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
pub struct Slot<M> {
    model: Option<Box<M>>,
    spare: Option<Box<M>>,
}

impl<M> Default for Slot<M> {
    fn default() -> Slot<M> {
        Slot { model: None, spare: None }
    }
}

impl<M: Fresh> Slot<M> {
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
pub fn slots<M, const COUNT: usize>() -> [Slot<M>; COUNT] {
    std::array::from_fn(|_| Slot::default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The symbol by a search from the front.
    fn searched<U: Bucket, const S: usize, const B: usize, const T: usize, const W: u32>(
        model: &Model<U, S, B, T, W>,
        at: u32,
    ) -> usize {
        let bounds = &model.bounds[..usize::from(model.symbols)];
        bounds.iter().rposition(|bound| u32::from(*bound) <= at).unwrap()
    }

    fn check<U: Bucket, const S: usize, const B: usize, const T: usize, const W: u32>(
        model: &mut Model<U, S, B, T, W>,
        symbols: &[u16],
    ) {
        for symbol in symbols {
            let symbol = usize::from(*symbol) % usize::from(model.symbols);
            model.count::<true>(symbol);
        }
        let top = 1 << model.precision;
        let places = (0..=top + 63).step_by(7).chain([top - 1, top, top + 63]);
        for at in places.chain(model.bounds.iter().map(|b| u32::from(*b)).filter(|b| *b < top)) {
            let found = model.find(at);
            assert_eq!(found, searched(model, at), "at {at}");
            let (from, to) = model.interval(found);
            assert!(from <= at && to.is_none_or(|to| at < to && from < to), "{from} {at} {to:?}");
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
            let mut slot = Slot::<ByteModel>::default();
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
