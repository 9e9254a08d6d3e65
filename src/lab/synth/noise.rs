//! Randomness as a function of place: integer hashes and the noise made of them.
//!
//! Everything here is integer arithmetic or + − × ÷ and square roots of doubles,
//! which IEEE 754 rounds alike on every machine; no `sin`, `pow` or `exp` of a
//! system's library, whose last bit differs from one to the next. So a scene's
//! bytes are the same wherever it is made.

/// Scrambles 64 bits: each bit of the result depends on each bit of `value`.
pub fn mix(mut value: u64) -> u64 {
    value ^= value >> 32;
    value = value.wrapping_mul(0xd6e8_feb8_6659_fd93);
    value ^= value >> 32;
    value = value.wrapping_mul(0xd6e8_feb8_6659_fd93);
    value ^ (value >> 32)
}

/// A hash of a lattice place under a seed.
pub fn hash(seed: u64, a: i64, b: i64) -> u64 {
    let a = (a as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let b = (b as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    mix(seed.wrapping_add(a).wrapping_add(b.rotate_left(29)))
}

/// A hash as a number in [0, 1).
pub fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// A hash as a number in [−1, 1).
pub fn signed(hash: u64) -> f64 {
    unit(hash) * 2.0 - 1.0
}

/// The largest integer not above `value`, without a call where the processor
/// has no instruction for it.
pub fn floor(value: f64) -> i64 {
    let whole = value as i64;
    whole - i64::from((whole as f64) > value)
}

/// The whole number nearest to `value`; halves go up.
pub fn round(value: f64) -> i64 {
    floor(value + 0.5)
}

fn ease(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// Value noise on the plane, in [−1, 1], with features of size 1.
pub fn plane(seed: u64, x: f64, y: f64) -> f64 {
    let (ix, iy) = (floor(x), floor(y));
    let (u, v) = (ease(x - ix as f64), ease(y - iy as f64));
    let corner = |dx, dy| signed(hash(seed, ix + dx, iy + dy));
    let low = corner(0, 0) * (1.0 - u) + corner(1, 0) * u;
    let high = corner(0, 1) * (1.0 - u) + corner(1, 1) * u;
    low * (1.0 - v) + high * v
}

/// Value noise in space, in [−1, 1], with features of size 1.
pub fn space(seed: u64, [x, y, z]: [f64; 3]) -> f64 {
    let iz = floor(z);
    let w = ease(z - iz as f64);
    let layer = |iz: i64| plane(mix(seed ^ iz as u64), x, y);
    layer(iz) * (1.0 - w) + layer(iz + 1) * w
}

/// Fractal noise on the plane: `octaves` of value noise, each half as wide as
/// the one before and `gain` times as high; the first has features of
/// `wavelength` and a height of 1.
pub fn fractal(seed: u64, x: f64, y: f64, wavelength: f64, octaves: u32, gain: f64) -> f64 {
    let (mut sum, mut height, mut frequency) = (0.0, 1.0, 1.0 / wavelength);
    for octave in 0..octaves {
        sum += height * plane(seed.wrapping_add(u64::from(octave)), x * frequency, y * frequency);
        height *= gain;
        frequency *= 2.0;
    }
    sum
}

/// Cosine and sine of an angle in turns, by polynomials (error below 1e-8).
pub fn circle(turn: f64) -> (f64, f64) {
    let quarter = round(turn * 4.0);
    let r = (turn - quarter as f64 * 0.25) * (2.0 * std::f64::consts::PI);
    let q = r * r;
    let sin = r * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0))));
    let cos = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0))));
    match quarter.rem_euclid(4) {
        0 => (cos, sin),
        1 => (-sin, cos),
        2 => (-cos, -sin),
        _ => (sin, -cos),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circles_are_round() {
        for step in -1000..1000 {
            let turn = f64::from(step) / 317.0;
            let (cos, sin) = circle(turn);
            let angle = turn * std::f64::consts::TAU;
            assert!((cos - angle.cos()).abs() < 1e-8 && (sin - angle.sin()).abs() < 1e-8, "{turn}");
        }
    }

    #[test]
    fn floors_and_rounds_like_the_library() {
        for step in -4000..4000 {
            let value = f64::from(step) / 16.0;
            assert_eq!(floor(value), value.floor() as i64, "{value}");
            assert_eq!(round(value), (value + 0.5).floor() as i64, "{value}");
        }
    }

    #[test]
    fn noise_is_continuous_and_keeps_its_range() {
        for step in 0..20_000 {
            let x = f64::from(step) * 0.01 - 100.0;
            let here = plane(7, x, 3.3);
            assert!(here.abs() <= 1.0);
            assert!((plane(7, x + 0.01, 3.3) - here).abs() < 0.05, "a step at {x}");
            assert!((space(7, [x + 0.01, 1.0, x]) - space(7, [x, 1.0, x])).abs() < 0.05);
        }
    }

    #[test]
    fn hashes_are_evenly_spread() {
        let mut bins = [0u32; 16];
        for i in 0..1000i64 {
            for j in 0..64i64 {
                bins[(unit(hash(1, i, j)) * 16.0) as usize] += 1;
            }
        }
        assert!(bins.iter().all(|&n| (3700..4300).contains(&n)), "{bins:?}");
    }
}
