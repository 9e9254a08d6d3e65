//! Integers: how far one is from its prediction. First comes the number of bits that
//! the difference takes, in a context; then its upper bits by a model for that number
//! of bits, and the lower ones raw.

use std::hint::select_unpredictable;

use super::arithmetic::{ArithmeticDecoder, ArithmeticEncoder};
use super::model::{ByteModel, LazyModel, LengthModel, slots};

/// Bits of a difference that a model knows.
const MOST_MODELED: usize = 8;

/// Models of the integers of one field, in so many contexts. `BITS` is 16 or 32; of
/// those of 16 only the lower half of what comes out counts.
#[derive(Debug, Clone)]
pub struct Integer<const CONTEXTS: usize, const BITS: usize> {
    lengths: [LazyModel<LengthModel>; CONTEXTS],
    differences: [LazyModel<ByteModel>; 32],
}

impl<const CONTEXTS: usize, const BITS: usize> Default for Integer<CONTEXTS, BITS> {
    fn default() -> Self {
        Integer { lengths: slots(), differences: slots() }
    }
}

impl<const CONTEXTS: usize, const BITS: usize> Integer<CONTEXTS, BITS> {
    pub fn clear(&mut self) {
        self.lengths.iter_mut().for_each(LazyModel::clear);
        self.differences.iter_mut().for_each(LazyModel::clear);
    }

    /// The integer, and the bits of its difference, which choose contexts of others.
    #[inline(always)]
    pub fn decode(&mut self, from: &mut ArithmeticDecoder, context: usize, predicted: i32) -> (i32, usize) {
        decode(from, self.lengths[context].get(BITS + 1), &mut self.differences, predicted)
    }

    /// The same of a field that seldom changes, as a call.
    #[inline(always)]
    pub fn decode_apart(&mut self, from: &mut ArithmeticDecoder, context: usize, predicted: i32) -> i32 {
        decode_by_call(from, self.lengths[context].get(BITS + 1), &mut self.differences, predicted)
    }

    /// The bits of the difference.
    #[inline(always)]
    pub fn encode(
        &mut self,
        to: &mut ArithmeticEncoder,
        context: usize,
        predicted: i32,
        integer: i32,
    ) -> usize {
        let difference = integer.wrapping_sub(predicted);
        // The nearest way around.
        let difference = if BITS == 16 { i32::from(difference as i16) } else { difference };
        encode(to, self.lengths[context].get(BITS + 1), &mut self.differences, difference)
    }
}

/// Symbols of the model for differences of so many bits: 1 is a bit.
fn symbols(bits: usize) -> usize {
    1 << bits.min(MOST_MODELED)
}

#[inline(never)]
fn decode_by_call(
    from: &mut ArithmeticDecoder,
    lengths: &mut LengthModel,
    differences: &mut [LazyModel<ByteModel>; 32],
    predicted: i32,
) -> i32 {
    from.apart(|from| decode(from, lengths, differences, predicted)).0
}

#[inline(always)]
fn decode(
    from: &mut ArithmeticDecoder,
    lengths: &mut LengthModel,
    differences: &mut [LazyModel<ByteModel>; 32],
    predicted: i32,
) -> (i32, usize) {
    let bits = from.symbol(lengths);
    let upper = upper_bits(from, differences, bits);
    (predicted.wrapping_add(lower_bits(from, bits, upper)), bits)
}

/// Two integers of two streams, step by step in turns: the steps of one wait for each
/// other, and the processor does the other's meanwhile.
#[inline(always)]
pub fn decode_two<const C: usize, const B: usize, const D: usize, const E: usize>(
    one: (&mut Integer<C, B>, &mut ArithmeticDecoder, usize, i32),
    other: (&mut Integer<D, E>, &mut ArithmeticDecoder, usize, i32),
) -> ((i32, usize), i32) {
    let bits = one.1.symbol(one.0.lengths[one.2].get(B + 1));
    let other_bits = other.1.symbol(other.0.lengths[other.2].get(E + 1));
    let upper = upper_bits(one.1, &mut one.0.differences, bits);
    let other_upper = upper_bits(other.1, &mut other.0.differences, other_bits);
    let difference = lower_bits(one.1, bits, upper);
    let other_difference = lower_bits(other.1, other_bits, other_upper);
    ((one.3.wrapping_add(difference), bits), other.3.wrapping_add(other_difference))
}

/// The upper bits of a difference.
#[inline(always)]
fn upper_bits(
    from: &mut ArithmeticDecoder,
    differences: &mut [LazyModel<ByteModel>; 32],
    bits: usize,
) -> u32 {
    match differences.get_mut(bits) {
        Some(slot) => from.symbol_or_bit(slot.get(symbols(bits)), bits == 0) as u32,
        None => 0,
    }
}

/// The difference, with its lower bits. Those with `bits` are from `1 - 2^bits` to
/// `-2^(bits-1)` and from `2^(bits-1) + 1` to `2^bits`; with none 0 and 1, which the part
/// says.
#[inline(always)]
fn lower_bits(from: &mut ArithmeticDecoder, bits: usize, upper: u32) -> i32 {
    let mut part = upper;
    if bits > MOST_MODELED {
        if bits > 31 {
            return i32::MIN;
        }
        let raw = (bits - MOST_MODELED) as u32;
        part = part << raw | from.raw(raw);
    }
    let of = &HALVES[bits & 31];
    // Its sign is a toss of a coin: no branch.
    let shift = select_unpredictable(part >= of.begins, of.upper_shift, of.lower_shift);
    (part as i32).wrapping_add(shift)
}

/// From where on parts are those of positive differences, and what is to be added to either.
#[derive(Clone, Copy)]
struct Halves {
    begins: u32,
    lower_shift: i32,
    upper_shift: i32,
}

static HALVES: [Halves; 32] = {
    let mut halves = [Halves { begins: 0, lower_shift: 0, upper_shift: 0 }; 32];
    let mut bits = 1;
    while bits < 32 {
        let whole = 1u32 << bits;
        halves[bits] =
            Halves { begins: whole >> 1, lower_shift: 1i32.wrapping_sub(whole as i32), upper_shift: 1 };
        bits += 1;
    }
    halves
};

#[inline(never)]
fn encode(
    to: &mut ArithmeticEncoder,
    lengths: &mut LengthModel,
    differences: &mut [LazyModel<ByteModel>; 32],
    difference: i32,
) -> usize {
    let size = if difference > 0 { difference - 1 } else { difference.wrapping_neg() };
    let bits = 32 - size.leading_zeros() as usize;
    to.symbol(lengths, bits);
    let Some(slot) = differences.get_mut(bits) else { return bits };
    let part = match bits {
        0 => difference,
        _ if difference > 0 => difference - 1,
        _ => difference.wrapping_add((1i32 << bits).wrapping_sub(1)),
    } as u32;
    let model = slot.get(symbols(bits));
    if bits <= MOST_MODELED {
        to.symbol_or_bit(model, part as usize, bits == 0);
    } else {
        let raw = (bits - MOST_MODELED) as u32;
        to.symbol(model, (part >> raw) as usize);
        to.raw(raw, part & ((1 << raw) - 1));
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_integer() -> impl Strategy<Value = i32> {
        prop_oneof![any::<i32>(), -3..4i32, -70_000..70_000i32, Just(i32::MIN), Just(i32::MAX)]
    }

    proptest! {
        #[test]
        fn integers_come_out_as_they_went_in(
            values in prop::collection::vec((any_integer(), any_integer(), 0usize..3), 1..300)
        ) {
            let mut encoder = ArithmeticEncoder::default();
            let (mut wide, mut narrow) = (Integer::<3, 32>::default(), Integer::<3, 16>::default());
            let mut bits = Vec::new();
            for (value, predicted, context) in &values {
                bits.push(wide.encode(&mut encoder, *context, *predicted, *value));
                narrow.encode(&mut encoder, *context, i32::from(*predicted as u16), i32::from(*value as u16));
            }
            encoder.finish();
            wide.clear();
            narrow.clear();
            let mut decoder = ArithmeticDecoder::new(encoder.bytes()).unwrap();
            for ((value, predicted, context), bits) in values.iter().zip(bits) {
                prop_assert_eq!(wide.decode(&mut decoder, *context, *predicted), (*value, bits));
                let half = narrow.decode_apart(&mut decoder, *context, i32::from(*predicted as u16));
                prop_assert_eq!(half as u16, *value as u16);
            }
            prop_assert!(decoder.left() == 0 && !decoder.has_ended());
        }
    }
}
