//! Small worlds with one property each: a closed surface in shuffled order, a
//! regular grid, and clouds without extent on one, two or three axes.

use super::noise::{hash, signed, space, unit};
use super::point::{Point, paint};

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A stone of about this radius, metres, as photogrammetry sees it: dense,
    /// closed, and in no order at all.
    Object { radius: f64 },
    /// A grid of so many points along each axis, `step` metres apart.
    Volume { count: u64, step: f64 },
    /// A square of this side in one plane.
    Flat { side: f64 },
    /// A line of this length along x.
    Line { length: f64 },
    /// One position.
    Dot,
}

impl Shape {
    /// The `index`-th point.
    pub fn point(&self, seed: u64, index: u64) -> Point {
        let dice = hash(seed, index as i64, 0x5eed);
        let part = |n: i64| unit(hash(dice, n, 1));
        let place = match *self {
            Shape::Object { radius } => return stone(seed, dice, radius),
            Shape::Volume { count, step } => {
                [index % count, index / count % count, index / (count * count)].map(|i| i as f64 * step)
            }
            Shape::Flat { side } => [part(0) * side, part(1) * side, 12.5],
            Shape::Line { length } => [part(0) * length, 20.0, 12.5],
            Shape::Dot => [10.0, 20.0, 12.5],
        };
        Point {
            place,
            intensity: (dice >> 48) as u16,
            return_number: 1,
            returns: 1,
            class: 1,
            user_data: (dice >> 40) as u8,
            source: 1,
            time: 333_000_000.0 + index as f64 * 1e-6,
            rgb: paint([150, 150, 150], 0.5 + 0.5 * part(2), dice),
            nir: (dice >> 32) as u16,
            ..Point::default()
        }
    }
}

/// A point of the stone's surface, anywhere on it.
fn stone(seed: u64, dice: u64, radius: f64) -> Point {
    let way = direction(dice);
    let relief = |scale: f64, octave: u64| space(seed.wrapping_add(octave), way.map(|c| c * scale));
    let bumps =
        0.30 * relief(1.7, 1) + 0.10 * relief(4.1, 2) + 0.03 * relief(11.0, 3) + 0.008 * relief(37.0, 4);
    let vein = relief(6.0, 5).abs();
    let colour = if vein < 0.06 { [206, 198, 184] } else { [136, 122, 108] };
    // Hollows are dark, as under a cloudy sky.
    let light = (0.75 + bumps * 0.9).clamp(0.35, 1.0);
    Point {
        place: way.map(|c| c * radius * (1.0 + bumps)),
        return_number: 1,
        returns: 1,
        rgb: paint(colour, light, dice),
        ..Point::default()
    }
}

/// An even choice of direction: of places in a cube the first inside the ball.
fn direction(dice: u64) -> [f64; 3] {
    for again in 0..64 {
        let d = hash(dice, again, 2);
        let place = [signed(d), signed(hash(d, 1, 3)), signed(hash(d, 2, 3))];
        let square = place[0] * place[0] + place[1] * place[1] + place[2] * place[2];
        if square <= 1.0 && square > 1e-6 {
            let length = square.sqrt();
            return place.map(|c| c / length);
        }
    }
    [0.0, 0.0, 1.0] // one in 10²⁰
}
