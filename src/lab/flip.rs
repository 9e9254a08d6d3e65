//! ꟻLIP: how different two pictures look when one flips between them
//! (Andersson et al. 2020), for pictures of eight bits.
//!
//! Colours are blurred as the eye blurs them at a distance, compared in a space
//! where distances are even, and weighed by whether an edge or a dot appears.
//! Written after the paper; the tests hold it against figures of the authors'
//! own program.

use rayon::prelude::*;

/// Pixels a degree: a 0.7 m wide screen of 3840 pixels seen from 0.7 m.
const PIXELS_A_DEGREE: f64 = 67.020_643_276_582_25;
/// Exponent of colour differences, and where the scale bends.
const QC: f64 = 0.7;
const PC: f64 = 0.4;
const PT: f64 = 0.95;
/// Exponent of feature differences, and width of a feature in degrees.
const QF: f64 = 0.5;
const FEATURE: f64 = 0.082;

/// Red, green and blue in linear light to CIE XYZ, over the white of D65.
const XYZ: [[f64; 3]; 3] = [
    [10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0],
    [2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0],
    [1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0],
];
const WHITE: [f64; 3] = [0.950428545, 1.0, 1.088900371];

/// A picture, as others are held against it.
pub struct ReferencePicture {
    size: [usize; 2],
    seen: Vec<[f64; 3]>,
    features: Vec<[f64; 2]>,
    largest: f64,
}

/// The mean ꟻLIP error of two pictures of one size, from 0 to 1. Pixels are
/// red, green, blue and alpha, which is not looked at.
pub fn mean(width: usize, reference: &[[u8; 4]], test: &[[u8; 4]]) -> f64 {
    ReferencePicture::new(width, reference).mean(test)
}

impl ReferencePicture {
    pub fn new(width: usize, pixels: &[[u8; 4]]) -> ReferencePicture {
        let size = [width, pixels.len() / width.max(1)];
        let plane = Plane3::opponent(size, pixels);
        let largest = hyab(hunt([0.0, 1.0, 0.0]), hunt([0.0, 0.0, 1.0])).powf(QC);
        ReferencePicture { size, seen: plane.seen(size), features: features(&plane.0[0], size), largest }
    }

    /// The mean ꟻLIP error of another picture of that size.
    pub fn mean(&self, test: &[[u8; 4]]) -> f64 {
        let plane = Plane3::opponent(self.size, test);
        let (seen, features) = (plane.seen(self.size), features(&plane.0[0], self.size));
        let ours = self.seen.iter().zip(&self.features);
        let sum: f64 = ours
            .zip(seen.iter().zip(&features))
            .map(|((seen, [edge, dot]), (other, [other_edge, other_dot]))| {
                let color = redistribute(hyab(*seen, *other).powf(QC), self.largest);
                let feature = (edge - other_edge).abs().max((dot - other_dot).abs());
                color.powf(1.0 - (feature * std::f64::consts::FRAC_1_SQRT_2).powf(QF))
            })
            .sum();
        sum / self.seen.len().max(1) as f64
    }
}

/// The mean difference of two pictures over pixels and channels, of 255
/// (UnityPIC, eq. 6).
pub fn pixel_error(reference: &[[u8; 4]], test: &[[u8; 4]]) -> f64 {
    let channels = |pair: (&[u8; 4], &[u8; 4])| -> f64 {
        (0..3).map(|i| f64::from(pair.0[i].abs_diff(pair.1[i]))).sum()
    };
    let sum: f64 = reference.iter().zip(test).map(channels).sum();
    sum / (3 * reference.len().max(1)) as f64
}

type Channel = Vec<f64>;

/// A picture in three channels: lightness, red to green, blue to yellow.
struct Plane3([Channel; 3]);

impl Plane3 {
    fn opponent(size: [usize; 2], pixels: &[[u8; 4]]) -> Plane3 {
        let mut planes: [Channel; 3] = std::array::from_fn(|_| Vec::with_capacity(size[0] * size[1]));
        let linear: Vec<f64> = (0..=255u8).map(linear).collect();
        for pixel in pixels {
            let rgb = std::array::from_fn(|i| linear[usize::from(pixel[i])]);
            let [x, y, z] = xyz(rgb);
            let values = [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)];
            planes.iter_mut().zip(values).for_each(|(plane, value)| plane.push(value));
        }
        Plane3(planes)
    }

    /// What the eye makes of it: blurred by the contrast sensitivity of each
    /// channel, in Hunt-adjusted L*a*b*.
    fn seen(&self, size: [usize; 2]) -> Vec<[f64; 3]> {
        // Weights and widths of one or two bells a channel.
        let bells: [&[[f64; 2]]; 3] = [&[[1.0, 0.0047]], &[[1.0, 0.0053]], &[[34.1, 0.04], [13.5, 0.025]]];
        let radius = (3.0 * (0.04 / (2.0 * PI2)).sqrt() * PIXELS_A_DEGREE).ceil() as i64;
        let blurred: [Channel; 3] = std::array::from_fn(|channel| {
            let mut sum = vec![0.0; self.0[channel].len()];
            let mut total = 0.0;
            for &[weight, width] in bells[channel] {
                let bell: Channel = (-radius..=radius)
                    .map(|x| (-PI2 * (x as f64 / PIXELS_A_DEGREE).powi(2) / width).exp())
                    .collect();
                let weight = weight * (std::f64::consts::PI / width).sqrt();
                total += weight * bell.iter().sum::<f64>().powi(2);
                let part = convolve(&self.0[channel], size, &bell, &bell);
                sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += weight * part);
            }
            sum.iter_mut().for_each(|value| *value /= total);
            sum
        });
        let back = inverse(XYZ);
        (0..size[0] * size[1])
            .into_par_iter()
            .map(|i| {
                let y = (blurred[0][i] + 16.0) / 116.0;
                let relative = [blurred[1][i] / 500.0 + y, y, y - blurred[2][i] / 200.0];
                let absolute = std::array::from_fn(|c| relative[c] * WHITE[c]);
                hunt(times(back, absolute).map(|c| c.clamp(0.0, 1.0)))
            })
            .collect()
    }
}

const PI2: f64 = std::f64::consts::PI * std::f64::consts::PI;

/// How much of an edge and of a dot each pixel is.
fn features(lightness: &Channel, size: [usize; 2]) -> Vec<[f64; 2]> {
    let grey: Channel = lightness.iter().map(|l| (l + 16.0) / 116.0).collect();
    let deviation = 0.5 * FEATURE * PIXELS_A_DEGREE;
    let radius = (3.0 * deviation).ceil() as i64;
    let bell: Channel =
        (-radius..=radius).map(|x| (-(x * x) as f64 / (2.0 * deviation * deviation)).exp()).collect();
    let derived = |order: u32| -> Channel {
        let value = |x: i64| match order {
            1 => -x as f64,
            _ => (x * x) as f64 / (deviation * deviation) - 1.0,
        };
        let mut weights: Channel = (-radius..=radius).zip(&bell).map(|(x, g)| value(x) * g).collect();
        // Both signs sum to one over the square kernel.
        let across: f64 = bell.iter().sum();
        let side = |sign: f64| weights.iter().map(|w| (w * sign).max(0.0)).sum::<f64>() * across;
        let (minus, plus) = (side(-1.0), side(1.0));
        weights.iter_mut().for_each(|w| *w /= if *w < 0.0 { minus } else { plus });
        weights
    };
    let strength = |order: u32| -> Channel {
        let weights = derived(order);
        let x = convolve(&grey, size, &weights, &bell);
        let y = convolve(&grey, size, &bell, &weights);
        x.into_iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
    };
    strength(1).into_iter().zip(strength(2)).map(|(edge, dot)| [edge, dot]).collect()
}

/// Along the rows, then along the columns; the border goes on as it ends. Both
/// add whole rows, a weight at a time.
fn convolve(plane: &Channel, [width, _]: [usize; 2], across: &[f64], down: &[f64]) -> Channel {
    let add = |row: &mut [f64], other: &[f64], weight: f64| {
        row.iter_mut().zip(other).for_each(|(sum, value)| *sum += weight * value);
    };
    if plane.is_empty() || width == 0 {
        return Channel::new();
    }
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(row, from)| {
        let radius = across.len() / 2;
        let (first, last) = (from[0], from[width - 1]);
        let ends = |value: f64| std::iter::repeat_n(value, radius);
        let longer: Channel = ends(first).chain(from.iter().copied()).chain(ends(last)).collect();
        across.iter().enumerate().for_each(|(k, weight)| add(row, &longer[k..], *weight));
    });
    let height = plane.len() / width;
    let mut sums = vec![0.0; plane.len()];
    sums.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (k, weight) in down.iter().enumerate() {
            let from = (y + k).saturating_sub(down.len() / 2).min(height - 1);
            add(row, &rows[from * width..][..width], *weight);
        }
    });
    sums
}

fn linear(value: u8) -> f64 {
    let value = f64::from(value) / 255.0;
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Relative to white.
fn xyz(rgb: [f64; 3]) -> [f64; 3] {
    let absolute = times(XYZ, rgb);
    std::array::from_fn(|i| absolute[i] / WHITE[i])
}

/// L*a*b* of linear light, with less colour where it is dark.
fn hunt(rgb: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = xyz(rgb).map(|t| {
        let bend = 6.0f64 / 29.0;
        if t > bend.powi(3) { t.cbrt() } else { t / (3.0 * bend * bend) + 4.0 / 29.0 }
    });
    let light = 116.0 * y - 16.0;
    [light, 0.01 * light * 500.0 * (x - y), 0.01 * light * 200.0 * (y - z)]
}

/// A distance for large differences of colour.
fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

fn redistribute(error: f64, largest: f64) -> f64 {
    let bend = PC * largest;
    match error < bend {
        true => PT / bend * error,
        false => PT + (error - bend) / (largest - bend) * (1.0 - PT),
    }
}

fn times(matrix: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn inverse(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let minor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
    std::array::from_fn(|r| std::array::from_fn(|c| minor(c, r) / determinant))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two pictures that anyone can make again: a chequered ramp, and the same
    /// with a shifted, tinted square in it.
    fn pair() -> (usize, Vec<[u8; 4]>, Vec<[u8; 4]>) {
        let (width, height) = (96usize, 64usize);
        let make = |test: bool| -> Vec<[u8; 4]> {
            (0..width * height)
                .map(|i| {
                    let (x, y) = (i % width, i / width);
                    let check = (x / 8 + y / 8) % 2 * 60;
                    let mut pixel =
                        [(x * 2 + check) as u8, (y * 3) as u8, (255 - x * 2 - check / 2) as u8, 255];
                    if test && (20..50).contains(&x) && (10..40).contains(&y) {
                        pixel = [pixel[1], pixel[0], pixel[2] / 2, 255];
                    }
                    if test && x % 16 == 3 && y % 16 == 5 {
                        pixel = [255, 255, 255, 255];
                    }
                    pixel
                })
                .collect()
        };
        (width, make(false), make(true))
    }

    #[test]
    fn the_same_picture_does_not_flip() {
        let (width, a, _) = pair();
        assert_eq!(mean(width, &a, &a), 0.0);
    }

    /// The figure that the authors' program (flip-evaluator 1.7) gives for this
    /// pair.
    #[test]
    fn the_mean_is_that_of_the_authors() {
        let (width, a, b) = pair();
        let error = mean(width, &a, &b);
        assert!((error - 0.143_402_5).abs() < 1e-4, "{error}");
    }

    #[test]
    fn pixel_error_by_hand() {
        assert_eq!(
            pixel_error(&[[0, 0, 0, 255], [10, 20, 30, 255]], &[[255, 0, 0, 255], [10, 23, 30, 255]]),
            43.0
        );
    }
}
