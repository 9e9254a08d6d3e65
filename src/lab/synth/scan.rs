//! What terrestrial scanners have in common: rays by columns and rows from a
//! tripod, so that density falls with the distance squared, and what a return
//! looks like.

use super::noise::{circle, hash, signed, unit};
use super::point::{Point, paint};

/// When the first scan begins (adjusted standard GPS seconds: 2022).
const START: f64 = 332_000_000.0;
/// Seconds a point and seconds from one set-up to the next.
const PULSE: f64 = 1e-6;
const SET_UP: f64 = 300.0;

/// One set-up of a scanner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tripod {
    pub seed: u64,
    pub number: u64,
    /// Metres from the scene's origin.
    pub eye: [f64; 3],
    /// Columns of a full turn and rows of a column.
    pub columns: u64,
    pub rows: u64,
    /// Lowest and highest elevation, turns.
    pub view: [f64; 2],
}

/// Where a ray ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Metres from the eye.
    pub range: f64,
    /// Cosine between the ray and the surface's normal.
    pub slope: f64,
    pub class: u8,
    pub colour: [u8; 3],
    pub reflectance: f64,
}

impl Tripod {
    /// Columns and rows of a scan of `points` over a view of so many turns of
    /// elevation: as far apart sideways as upward.
    pub fn raster(points: u64, view: [f64; 2]) -> (u64, u64) {
        let rows = (points.max(1) as f64 * (view[1] - view[0])).sqrt();
        let rows = ((rows * 0.5) as u64 * 2).clamp(2, 1 << 16);
        (points.div_ceil(rows).max(1), rows)
    }

    /// Appends the points of one column. `cast` follows a ray; where it meets
    /// nothing, another direction is tried, in the end straight down.
    pub fn column(
        &self,
        column: u64,
        cast: impl Fn([f64; 3], [f64; 3]) -> Option<Hit>,
        out: &mut Vec<Point>,
    ) {
        const TRIES: i64 = 12;
        for row in 0..self.rows {
            let dice = hash(self.seed, (self.number * self.columns + column) as i64, row as i64);
            let (way, hit, dice) = (0..TRIES)
                .find_map(|again| {
                    let dice = hash(dice, again, 0);
                    let way = self.direction(column, row, dice, again > 0);
                    cast(self.eye, way).map(|hit| (way, hit, dice))
                })
                .unwrap_or_else(|| ([0.0, 0.0, -1.0], self.below(), dice));
            out.push(self.point(column, row, way, hit, dice));
        }
    }

    fn direction(&self, column: u64, row: u64, dice: u64, anywhere: bool) -> [f64; 3] {
        let turn = (column as f64 + unit(dice)) / self.columns as f64;
        let rise = if anywhere {
            unit(dice.rotate_left(30))
        } else {
            (row as f64 + unit(dice.rotate_left(30))) / self.rows as f64
        };
        let (cos, sin) = circle(turn);
        let (flat, up) = circle(self.view[0] + (self.view[1] - self.view[0]) * rise);
        // Never exactly along an axis: the casters divide by each component.
        [cos * flat, sin * flat, up].map(|d| if d.abs() < 1e-9 { 1e-9 } else { d })
    }

    fn below(&self) -> Hit {
        Hit { range: self.eye[2], slope: 1.0, class: 2, colour: [110, 108, 104], reflectance: 0.3 }
    }

    fn point(&self, column: u64, row: u64, way: [f64; 3], hit: Hit, dice: u64) -> Point {
        let dice = hash(dice, 1, 1);
        // Two millimetres, and more on what is far and what is grazed.
        let noise = 0.002 * (1.0 + hit.range * 0.03) * (signed(dice) + signed(dice.rotate_left(24)));
        let range = hit.range + noise;
        let echo = hit.reflectance * hit.slope.abs().max(0.05) * 30.0 / (30.0 + hit.range);
        let light = 0.72 + 0.28 * hit.slope.abs();
        Point {
            place: [0, 1, 2].map(|axis| self.eye[axis] + way[axis] * range),
            intensity: (echo * (0.9 + 0.2 * unit(dice.rotate_left(9))) * 58_000.0) as u16,
            return_number: 1,
            returns: 1,
            forward: true,
            edge: row + 1 == self.rows,
            class: hit.class,
            angle: ((self.view[0] + (self.view[1] - self.view[0]) * row as f64 / self.rows as f64) * 60_000.0)
                as i16,
            source: (1000 + self.number) as u16,
            time: START
                + self.number as f64 * (SET_UP + (self.columns * self.rows) as f64 * PULSE)
                + (column * self.rows + row) as f64 * PULSE,
            rgb: paint(hit.colour, light, dice.rotate_left(40)),
            nir: (hit.reflectance * 40_000.0) as u16,
            ..Point::default()
        }
    }
}
