//! The radial power spectrum of a set of points in a square: how much structure
//! it has at which distance (the dissertation's and the paper's blue noise:
//! little energy below the principal frequency, and no lines).

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// What a spectrum tells. Frequencies are waves a spacing; power is 1 for white
/// noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Spectrum {
    /// Mean power of each ring, from ring 0; ring r has frequency r / `spacings`.
    pub rings: Vec<f64>,
    /// Spacings along the square's side.
    pub spacings: u32,
    /// Most that a single frequency stands out of its ring, as a multiple of the
    /// ring's mean.
    pub line: f64,
    /// Mean power below a half of the frequency at which the spacing lies.
    pub low: f64,
}

/// Rings below this hold the window's own shape.
const FIRST: usize = 4;
/// Highest frequency, in waves a spacing.
const HIGHEST: f64 = 1.5;
/// Points that are gone through together.
const LANES: usize = 4;

/// The mean spectrum of several patterns, each of points in the unit square
/// that is `spacings` spacings wide.
///
/// A window that ends softly (Hann's) keeps the square's border out of it.
pub fn spectrum(patterns: &[Vec<[f64; 2]>], spacings: u32) -> Spectrum {
    let most = (f64::from(spacings) * HIGHEST) as usize;
    let mut power = vec![0.0; (2 * most + 1) * (most + 1)];
    for pattern in patterns {
        power.iter_mut().zip(periodogram(pattern, most)).for_each(|(sum, one)| *sum += one);
    }
    let count = patterns.len().max(1) as f64;
    power.iter_mut().for_each(|power| *power /= count);

    let ring = |place: usize| {
        let (x, y) = ((place % (2 * most + 1)) as f64 - most as f64, (place / (2 * most + 1)) as f64);
        x.hypot(y).round() as usize
    };
    let mut sums = vec![(0.0, 0u32); most + 1];
    for (place, power) in power.iter().enumerate() {
        if let Some((sum, count)) = sums.get_mut(ring(place)) {
            *sum += power;
            *count += 1;
        }
    }
    let rings: Vec<f64> = sums.iter().map(|(sum, count)| sum / f64::from((*count).max(1))).collect();
    let excess = power.iter().enumerate().filter_map(|(place, power)| {
        let ring = ring(place);
        let mean = rings.get(ring).filter(|_| ring >= FIRST)?;
        Some(power / mean.max(f64::MIN_POSITIVE))
    });
    let line = excess.fold(0.0, f64::max);
    let below = rings.get(FIRST..=spacings as usize / 2).unwrap_or_default();
    let low = below.iter().sum::<f64>() / below.len().max(1) as f64;
    Spectrum { rings, spacings, line, low }
}

/// Power of all frequencies (x from -most to most, y from 0 to most) of points
/// under the window. A sum over all points, by rows: exact for any positions,
/// where a fast transform would need them on a grid.
fn periodogram(points: &[[f64; 2]], most: usize) -> Vec<f64> {
    let window = |c: f64| 0.5 - 0.5 * (std::f64::consts::TAU * c).cos();
    let weights: Vec<f64> = points.iter().map(|[x, y]| window(*x) * window(*y)).collect();
    let energy: f64 = weights.iter().map(|w| w * w).sum();
    let width = 2 * most + 1;
    let mut power = vec![0.0; width * (most + 1)];
    power.par_chunks_mut(width).enumerate().for_each(|(fy, row)| {
        let mut sums = vec![[[0.0f64; LANES]; 2]; width];
        for (points, weights) in points.chunks(LANES).zip(weights.chunks(LANES)) {
            // Several waves side by side: one alone waits for itself at each step.
            let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
            let (mut cos, mut sin) = ([0.0; LANES], [0.0; LANES]);
            for (lane, ([x, y], weight)) in points.iter().zip(weights).enumerate() {
                let start = std::f64::consts::TAU * (fy as f64 * y - most as f64 * x);
                (re[lane], im[lane]) = (weight * start.cos(), weight * start.sin());
                (sin[lane], cos[lane]) = (std::f64::consts::TAU * x).sin_cos();
            }
            for [sum_re, sum_im] in &mut sums {
                for lane in 0..LANES {
                    sum_re[lane] += re[lane];
                    sum_im[lane] += im[lane];
                    let turned = re[lane] * cos[lane] - im[lane] * sin[lane];
                    im[lane] = re[lane] * sin[lane] + im[lane] * cos[lane];
                    re[lane] = turned;
                }
            }
        }
        for (power, sum) in row.iter_mut().zip(sums) {
            let [re, im] = sum.map(|lanes| lanes.iter().sum::<f64>());
            *power = (re * re + im * im) / energy.max(f64::MIN_POSITIVE);
        }
    });
    power
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPACINGS: u32 = 32;

    fn noise(seed: u64) -> impl Iterator<Item = f64> {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        std::iter::repeat_with(move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64
        })
    }

    fn white(seed: u64, points: usize) -> Vec<[f64; 2]> {
        let mut noise = noise(seed);
        (0..points).map(|_| std::array::from_fn(|_| noise.next().unwrap())).collect()
    }

    /// Darts thrown one by one, each kept where none is nearer than the spacing:
    /// a Poisson-disk set by its definition.
    fn darts(seed: u64) -> Vec<[f64; 2]> {
        let (mut kept, spacing): (Vec<[f64; 2]>, f64) = (Vec::new(), 1.0 / f64::from(SPACINGS));
        for dart in white(seed, 40_000) {
            let near = |other: &[f64; 2]| (dart[0] - other[0]).hypot(dart[1] - other[1]) < spacing;
            if !kept.iter().any(near) {
                kept.push(dart);
            }
        }
        kept
    }

    #[test]
    fn white_noise_is_flat() {
        let patterns: Vec<_> = (1..9).map(|seed| white(seed, 1000)).collect();
        let found = spectrum(&patterns, SPACINGS);
        let mean = found.rings[FIRST..].iter().sum::<f64>() / (found.rings.len() - FIRST) as f64;
        assert!((mean - 1.0).abs() < 0.05 && (found.low - 1.0).abs() < 0.15, "{mean} {found:?}");
        assert!(found.line < 5.0, "{}", found.line);
    }

    #[test]
    fn a_grid_is_a_line() {
        let side = SPACINGS;
        let at = |i: u32| [i % side, i / side].map(|c| (f64::from(c) + 0.5) / f64::from(side));
        let found = spectrum(&[(0..side * side).map(at).collect()], SPACINGS);
        // Most of the energy of a ring lies in its few lines, the first at one
        // wave a spacing.
        let strongest = (FIRST..found.rings.len()).max_by(|a, b| found.rings[*a].total_cmp(&found.rings[*b]));
        assert_eq!(strongest, Some(side as usize));
        assert!(found.line > 20.0 && found.low < 1e-3, "{} {}", found.line, found.low);
    }

    #[test]
    fn darts_are_blue() {
        let patterns: Vec<_> = (1..9).map(darts).collect();
        let found = spectrum(&patterns, SPACINGS);
        assert!(found.low < 0.2 && found.line < 5.0, "{} {}", found.low, found.line);
        let principal = (FIRST..found.rings.len()).max_by(|a, b| found.rings[*a].total_cmp(&found.rings[*b]));
        // Neighbours are a little farther apart than they must be.
        let waves = principal.unwrap() as f64 / f64::from(SPACINGS);
        assert!((0.8..1.0).contains(&waves), "{waves}");
    }
}
