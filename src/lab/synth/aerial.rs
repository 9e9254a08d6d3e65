//! A laser scanner on an aeroplane: flight strips side by side with overlap,
//! scan line after scan line, several returns where a pulse meets a tree.
//!
//! A scan line has a fixed number of points, so that any line can be made
//! without those before it; a pulse with three returns takes three places of
//! its line, and fewer pulses follow, as in a scanner of fixed data rate.

use super::land::{Cover, Land, Spot};
use super::noise::{floor, hash, round, signed, unit};
use super::point::{Point, paint};

/// Metres from one strip's middle to the next one's.
const PITCH: f64 = 112.0;
/// A strip's width as a share of the pitch: a fifth of it overlaps.
const SWATH: f64 = 1.25;
/// Half the field of view, units of 0.006 degrees.
const VIEW: f64 = 3_300.0;
/// When the first flight begins (adjusted standard GPS seconds: 2022).
const TAKE_OFF: f64 = 331_000_000.0;
/// Seconds a point and seconds of a turn between strips.
const PULSE: f64 = 2e-6;
const TURN: f64 = 180.0;

/// One flight over a square of country.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flight {
    pub land: Land,
    pub seed: u64,
    /// Middle of the square and its side, metres.
    pub centre: [f64; 2],
    pub side: f64,
    pub strips: u64,
    /// Scan lines a strip and points a line.
    pub lines: u64,
    pub slots: u64,
}

/// The side of a square that `points` cover `spacing` metres apart.
pub fn side_for(points: u64, spacing: f64) -> f64 {
    (points.max(1) as f64 * spacing * spacing / SWATH).sqrt()
}

impl Flight {
    pub fn new(land: Land, seed: u64, centre: [f64; 2], side: f64, points: u64, strips: u64) -> Flight {
        let strips = strips.max(round(side / PITCH) as u64).max(1);
        let a_strip = points.div_ceil(strips);
        let width = side / strips as f64 * SWATH;
        // As far apart along the flight as across it; an even number, so that
        // twins of the duplicates scene share a line.
        let slots = ((a_strip as f64 * width / side).sqrt() * 0.5) as u64 * 2;
        let slots = slots.clamp(2, 1 << 16);
        Flight { land, seed, centre, side, strips, lines: a_strip.div_ceil(slots).max(1), slots }
    }

    /// Appends the `slots` points of a scan line, counted through all strips.
    pub fn line(&self, number: u64, out: &mut Vec<Point>) {
        let (strip, line) = (number / self.lines, number % self.lines);
        let mut slot = 0;
        while slot < self.slots {
            slot += self.pulse(number, strip, line, slot, out);
        }
        if let Some(last) = out.last_mut() {
            last.edge = true;
        }
    }

    /// Appends the returns of one pulse and says how many there were.
    fn pulse(&self, number: u64, strip: u64, line: u64, slot: u64, out: &mut Vec<Point>) -> u64 {
        let dice = hash(self.seed, number as i64, slot as i64);
        let width = self.side / self.strips as f64 * SWATH;
        let jitter = [signed(dice) * 0.4, signed(dice.rotate_left(21)) * 0.4];
        let way = (slot as f64 + 0.5 + jitter[0]) / self.slots as f64 - 0.5;
        // The mirror swings to and fro; every other strip is flown back.
        let across = if line & 1 == 0 { way } else { -way };
        let along = (line as f64 + 0.5 + jitter[1] * 0.5 + way * 0.5) / self.lines as f64 - 0.5;
        let back = if strip & 1 == 0 { 1.0 } else { -1.0 };
        let strip_middle = (strip as f64 + 0.5) / self.strips as f64 - 0.5;
        let x = self.centre[0] + strip_middle * self.side + across * back * width;
        let y = self.centre[1] + along * back * self.side;
        let angle = across * 2.0 * VIEW;
        let pulse = Pulse {
            x,
            y,
            dice,
            common: Point {
                forward: line & 1 == 0,
                overlap: across.abs() > 0.5 - (SWATH - 1.0) / SWATH && self.strips > 1,
                angle: angle as i16,
                source: (strip + 1) as u16,
                time: TAKE_OFF
                    + strip as f64 * (TURN + self.lines as f64 * self.slots as f64 * PULSE)
                    + (line as f64 * self.slots as f64 + slot as f64) * PULSE,
                ..Point::default()
            },
        };
        pulse.returns(self.land.spot(x, y), self.slots - slot, out)
    }
}

struct Pulse {
    x: f64,
    y: f64,
    dice: u64,
    /// What all returns share.
    common: Point,
}

/// What a return came from.
struct Target {
    /// Metres above sea.
    height: f64,
    class: u8,
    /// Shares of the light that comes back, at the laser's wavelength and in
    /// the near infrared.
    laser: f64,
    infrared: f64,
    rgb: [u16; 3],
}

impl Pulse {
    fn returns(&self, spot: Spot, room: u64, out: &mut Vec<Point>) -> u64 {
        let Cover::Crown { top, bottom, tree } = spot.cover else {
            out.push(self.point(self.surface(spot), 1, 1));
            return 1;
        };
        let depth = top - bottom;
        let through = self.dice >> 40 & 3; // of four pulses three reach the ground
        let returns = (1 + through.min(1 + u64::from(depth > 3.0) + (tree & 1))).min(room);
        for number in 1..=returns {
            let dice = hash(self.dice, number as i64, 1);
            let last = number == returns && returns > 1;
            let height = match number {
                1 => top - depth * 0.12 * unit(dice),
                // Of four pulses that come through one ends in the undergrowth.
                _ if last && dice >> 50 & 3 == 0 => spot.ground + 0.1 + 0.35 * unit(dice),
                _ if last => spot.ground,
                _ => top - depth * (number as f64 - 0.5 + 0.6 * signed(dice)) / returns as f64,
            };
            let target = leaf(height, spot.ground, top, tree, returns, dice);
            out.push(self.point(target, number as u8, returns as u8));
        }
        returns
    }

    fn surface(&self, spot: Spot) -> Target {
        let d = self.dice;
        let ground =
            |class, laser, infrared, rgb| Target { height: spot.ground, class, laser, infrared, rgb };
        match spot.cover {
            Cover::Grass => ground(2, 0.42, 0.7, paint([104, 122, 66], 1.0, d)),
            Cover::Field(field) => {
                let crops = [[150, 136, 84], [96, 128, 56], [122, 98, 70], [172, 160, 76]];
                let row = floor(self.x * 1.25) + (field & 1) as i64;
                let light = if row & 1 == 0 { 1.04 } else { 0.94 };
                let crop = ground(2, 0.38, 0.6, paint(crops[(field >> 7 & 3) as usize], light, d));
                Target { height: spot.ground + 0.05 * unit(d >> 3), ..crop }
            }
            Cover::Road { marking: true } => ground(11, 0.65, 0.3, paint([214, 212, 206], 1.0, d)),
            Cover::Road { marking: false } => ground(11, 0.13, 0.15, paint([92, 91, 93], 1.0, d)),
            Cover::Water => ground(9, 0.05, 0.05, paint([42, 62, 74], 1.0, d)),
            Cover::Roof { top, light, house } => {
                let tiles = [[158, 84, 62], [136, 72, 58], [98, 96, 100], [172, 104, 76]];
                let rgb = paint(tiles[(house >> 11 & 3) as usize], light, d);
                Target { height: top, ..ground(6, 0.33, 0.25, rgb) }
            }
            Cover::Crown { top, tree, .. } => leaf(top, spot.ground, top, tree, 1, d),
        }
    }

    fn point(&self, target: Target, number: u8, returns: u8) -> Point {
        let dice = hash(self.dice, i64::from(number), 2);
        // Two centimetres of ranging noise; a triangle is near enough a bell.
        let noise = 0.02 * (unit(dice) + unit(dice.rotate_left(32)) - 1.0);
        let slant = 1.0 - 0.12 * f64::from(self.common.angle).abs() / VIEW;
        let grain = 0.85 + 0.3 * unit(dice.rotate_left(11));
        Point {
            place: [self.x, self.y, target.height + noise],
            intensity: (target.laser * slant * grain * 52_000.0) as u16,
            return_number: number,
            returns,
            class: target.class,
            rgb: target.rgb,
            nir: (target.infrared * grain * 48_000.0) as u16,
            ..self.common
        }
    }
}

/// A return from a tree, or from what lies below it.
fn leaf(height: f64, ground: f64, top: f64, tree: u64, returns: u64, dice: u64) -> Target {
    let above = height - ground;
    let class = match () {
        () if above <= 0.0 => 2,
        () if above < 0.5 => 3,
        () if above < 2.5 => 4,
        () => 5,
    };
    let greens = [[52, 84, 38], [70, 96, 44], [38, 66, 40], [86, 104, 50]];
    let base = if class == 2 { [84, 88, 58] } else { greens[(tree >> 9 & 3) as usize] };
    let light = 0.6 + 0.4 * (above / (top - ground + 0.01)).clamp(0.0, 1.0);
    // What the first return took is not left for the last.
    let part = if returns > 1 { 0.75 / returns as f64 } else { 0.7 };
    Target { height, class, laser: 0.5 * part, infrared: 0.8, rgb: paint(base, light, dice) }
}
