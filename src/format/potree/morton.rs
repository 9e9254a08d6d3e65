//! The Morton codes inside BROTLI octrees, and what viewers make of them.
//!
//! A position is two codes: one of the high 16 bits of (x, y, z), one of the
//! low 16 bits, x in bit 0, y in bit 1, z in bit 2 of each triple. The
//! coordinates are taken as the bit patterns of their 32-bit integers.

/// 16 bits, one in every third place.
fn spread(value: u16) -> u64 {
    let mut v = u64::from(value);
    v = (v | v << 16) & 0xff00_00ff;
    v = (v | v << 8) & 0x00f0_0f00_f00f;
    v = (v | v << 4) & 0x0c30_c30c_30c3;
    (v | v << 2) & 0x2492_4924_9249
}

/// Every third of 48 bits, closed up.
fn gather(code: u64) -> u16 {
    let mut v = code & 0x2492_4924_9249;
    v = (v | v >> 2) & 0x0c30_c30c_30c3;
    v = (v | v >> 4) & 0x00f0_0f00_f00f;
    v = (v | v >> 8) & 0xff00_00ff;
    (v | v >> 16) as u16
}

/// The 48-bit code of three 16-bit numbers.
pub fn encode([x, y, z]: [u16; 3]) -> u64 {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

pub fn decode(code: u64) -> [u16; 3] {
    [gather(code), gather(code >> 1), gather(code >> 2)]
}

/// The codes of a position: of its high halves, then of its low halves.
pub fn encode_position(position: [i32; 3]) -> (u64, u64) {
    let bits = position.map(|p| p as u32);
    (encode(bits.map(|b| (b >> 16) as u16)), encode(bits.map(|b| b as u16)))
}

pub fn decode_position(high: u64, low: u64) -> [i32; 3] {
    let (high, low) = (decode(high), decode(low));
    std::array::from_fn(|axis| ((u32::from(high[axis]) << 16) | u32::from(low[axis])) as i32)
}

// How the viewers' BROTLI decoder goes wrong. It takes the high code only where
// the low 32 bits of the high code or the high 32 bits of the low code have a
// bit set. Per axis those two words hold coordinate bits 11 to 26 (of z, which
// is a place higher in its triple, 10 to 25); what the decoder then leaves out
// are the bits above.

/// First bit of each axis that makes the decoder look at the high code.
const LOUD_FROM: [u32; 3] = [11, 11, 10];
/// First bit of each axis that is lost where it does not look.
const LOST_FROM: [u32; 3] = [27, 27, 26];

/// Whether the viewers' BROTLI decoder reads another position than was written:
/// none of the bits that make it look at the high code is set, but one of those
/// that it then loses is.
pub fn viewer_misreads(x: u32, y: u32, z: u32) -> bool {
    let position = [x, y, z];
    let quiet = (0..3).all(|a| position[a] >> LOUD_FROM[a] & ((1 << (LOST_FROM[a] - LOUD_FROM[a])) - 1) == 0);
    quiet && (0..3).any(|a| position[a] >> LOST_FROM[a] != 0)
}

/// Whether any position of a box (bounds included) would be misread. The axes
/// are independent: each must have a quiet value in its range, and one of them
/// a quiet value with a bit that is lost.
pub fn viewer_may_misread(min: [i64; 3], max: [i64; 3]) -> bool {
    let quiet: [Option<i64>; 3] = std::array::from_fn(|a| first_quiet(min[a], max[a], a));
    if quiet.iter().any(Option::is_none) {
        return false;
    }
    (0..3).any(|a| match quiet[a] {
        Some(first) if first >> LOST_FROM[a] != 0 => true,
        // The first quiet value has no bits to lose: does the next period start
        // within the range? It is quiet and has one.
        Some(_) => max[a] >= 1 << LOST_FROM[a],
        None => false,
    })
}

/// The smallest value of `min..=max` whose loud bits are all clear.
fn first_quiet(min: i64, max: i64, axis: usize) -> Option<i64> {
    let period = 1i64 << LOST_FROM[axis];
    let within = min.rem_euclid(period);
    let first = if within < 1 << LOUD_FROM[axis] { min } else { min - within + period };
    (min <= max && first <= max).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The viewers' decoder, bit by bit: what it makes of a position.
    fn as_a_viewer_reads(position: [i32; 3]) -> [i32; 3] {
        let (high, low) = encode_position(position);
        if high as u32 != 0 || (low >> 32) as u32 != 0 {
            decode_position(high, low)
        } else {
            decode_position(0, low)
        }
    }

    /// Numbers of few bits at all heights, where the decoder's cases meet.
    fn coordinate() -> impl Strategy<Value = i32> {
        prop_oneof![any::<i32>(), (0u32..32, 0i32..4096).prop_map(|(s, v)| v.wrapping_shl(s)), Just(0)]
    }

    proptest! {
        #[test]
        fn positions_come_back(p in [any::<i32>(), any::<i32>(), any::<i32>()]) {
            let (high, low) = encode_position(p);
            prop_assert_eq!(decode_position(high, low), p);
        }

        #[test]
        fn codes_are_the_bits_one_by_one(p in [any::<u16>(), any::<u16>(), any::<u16>()]) {
            let slow = (0..48).fold(0u64, |code, bit| {
                code | u64::from(p[bit % 3] >> (bit / 3) & 1) << bit
            });
            prop_assert_eq!(encode(p), slow);
        }

        #[test]
        fn misreads_are_the_decoders(p in [coordinate(), coordinate(), coordinate()]) {
            let [x, y, z] = p.map(|v| v as u32);
            prop_assert_eq!(viewer_misreads(x, y, z), as_a_viewer_reads(p) != p);
        }

        /// A box is said to be in danger exactly where a position of it is. The
        /// candidates hold, for every axis, the ends of the range and the first
        /// quiet values of every period that it touches.
        #[test]
        fn boxes_are_judged_by_their_positions(
            a in [coordinate(), coordinate(), coordinate()],
            b in [coordinate(), coordinate(), coordinate()],
        ) {
            let min: [i64; 3] = std::array::from_fn(|i| i64::from(a[i].min(b[i])));
            let max: [i64; 3] = std::array::from_fn(|i| i64::from(a[i].max(b[i])));
            let candidates: [Vec<u32>; 3] = std::array::from_fn(|i| {
                let step = 1i64 << LOST_FROM[i];
                let starts = (-(1i64 << 31)..1 << 31).step_by(step as usize);
                let inside = |v: &i64| (min[i]..=max[i]).contains(v);
                starts.chain([min[i], max[i], 0]).filter(inside).map(|v| v as u32).collect()
            });
            let mut found = false;
            for &x in &candidates[0] {
                for &y in &candidates[1] {
                    found |= candidates[2].iter().any(|&z| viewer_misreads(x, y, z));
                }
            }
            prop_assert_eq!(viewer_may_misread(min, max), found);
        }
    }

    #[test]
    fn a_point_at_two_to_the_27_is_misread() {
        assert!(viewer_misreads(1 << 27, 0, 0));
        assert!(viewer_misreads(0, 0, 1 << 26));
        assert!(!viewer_misreads(1 << 26, 0, 0));
        assert!(!viewer_misreads(1 << 27, 1 << 11, 0));
        assert!(viewer_may_misread([1 << 26, 0, 0], [1 << 27, 0, 0]));
        assert!(!viewer_may_misread([-5, -5, -5], [5, 5, 5]));
    }
}
