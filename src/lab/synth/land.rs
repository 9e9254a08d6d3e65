//! A piece of country as a function of place: hills, water, fields, roads,
//! gabled houses and trees, the same whoever asks and in whatever order.
//!
//! Coordinates are metres from the scene's origin, which lies in a village.

use super::noise::{circle, floor, fractal, hash, signed, unit};

/// Side of a parcel, metres; one house stands on it at most.
pub const PARCEL: f64 = 26.0;
/// Every how many parcels a road runs along the border, each way.
const ROAD_EVERY: i64 = 4;
/// Half the width of a road, metres.
const ROAD: f64 = 3.4;
/// Side of the square that a tree has for itself, metres.
const TREE: f64 = 7.0;
/// Height of the water's surface, metres.
const WATER: f64 = -16.0;

/// The hash streams, so that no two things follow the same dice.
const HILLS: u64 = 0x10;
const USE: u64 = 0x20;
const HOUSES: u64 = 0x30;
const TREES: u64 = 0x40;
const FIELDS: u64 = 0x50;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Land {
    seed: u64,
    /// Metres around the origin in which the ground is level (a town's square,
    /// which a street-level scan needs); 0 for none.
    level: f64,
}

/// What is seen from above at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Height of the bare ground or water, metres.
    pub ground: f64,
    pub cover: Cover,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cover {
    Grass,
    /// A field and its number.
    Field(u64),
    Road {
        marking: bool,
    },
    Water,
    /// A roof: its height above sea, the light on its side, its house's number.
    Roof {
        top: f64,
        light: f64,
        house: u64,
    },
    /// A crown: the height of its surface and of its lower end above sea, its
    /// tree's number.
    Crown {
        top: f64,
        bottom: f64,
        tree: u64,
    },
}

/// A house: a rectangle with walls up to the eaves and a gable roof.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct House {
    pub centre: [f64; 2],
    /// Direction of the ridge as a unit vector.
    pub ridge: [f64; 2],
    /// Half the length along the ridge, half the width across it, metres.
    pub half: [f64; 2],
    /// Metres from the ground at its centre to the eaves.
    pub eaves: f64,
    pub number: u64,
}

impl House {
    /// A place or direction in the house's own axes: along the ridge, across.
    pub fn turned(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x * self.ridge[0] + y * self.ridge[1], y * self.ridge[0] - x * self.ridge[1]]
    }
}

impl Land {
    pub fn new(seed: u64, level: f64) -> Land {
        Land { seed: super::noise::mix(seed), level }
    }

    /// Height of the bare ground, metres.
    pub fn ground(&self, x: f64, y: f64) -> f64 {
        let hills = fractal(self.seed ^ HILLS, x, y, 900.0, 6, 0.45) * 34.0;
        if self.level == 0.0 {
            return hills.max(WATER);
        }
        let far = ((x * x + y * y).sqrt() / self.level - 1.0).clamp(0.0, 1.0);
        (hills * far).max(WATER)
    }

    /// How wild the country is: villages below 0, forest above 0.25.
    fn wildness(&self, x: f64, y: f64) -> f64 {
        let near = 1.0 - ((x * x + y * y) / (160.0 * 160.0)).min(1.0);
        fractal(self.seed ^ USE, x, y, 380.0, 2, 0.5) + 0.04 - 1.6 * near
    }

    /// The house on a parcel, if there is one.
    pub fn house(&self, parcel: [i64; 2]) -> Option<House> {
        let dice = hash(self.seed ^ HOUSES, parcel[0], parcel[1]);
        let middle = parcel.map(|p| (p as f64 + 0.5) * PARCEL);
        if dice & 7 == 0 || self.wildness(middle[0], middle[1]) > 0.0 {
            return None;
        }
        let part = |n: i64| unit(hash(dice, n, 0));
        // Most houses stand along the street, give or take a little.
        let turn = (part(1) * 4.0) as i64 as f64 * 0.25 + (part(2) - 0.5) * 0.05;
        let (cos, sin) = circle(turn);
        Some(House {
            centre: [middle[0] + part(3) - 0.5, middle[1] + part(4) - 0.5],
            ridge: [cos, sin],
            half: [5.0 + 2.5 * part(5), 3.6 + 1.6 * part(6)],
            eaves: 3.0 + 3.2 * part(7),
            number: dice,
        })
    }

    /// What is seen from above at a place.
    pub fn spot(&self, x: f64, y: f64) -> Spot {
        let ground = self.ground(x, y);
        let cover = if ground <= WATER { Cover::Water } else { self.cover(x, y, ground) };
        Spot { ground, cover }
    }

    fn cover(&self, x: f64, y: f64, ground: f64) -> Cover {
        if let Some(road) = road(x, y) {
            return road;
        }
        let parcel = [floor(x / PARCEL), floor(y / PARCEL)];
        let house = self.house(parcel);
        if let Some(roof) = house.and_then(|house| self.roof(&house, x, y)) {
            return roof;
        }
        let wildness = self.wildness(x, y);
        if let Some(crown) = self.crown(x, y, ground, wildness, house.is_some()) {
            return crown;
        }
        if wildness > 0.02 && wildness < 0.25 {
            return Cover::Field(hash(self.seed ^ FIELDS, parcel[0] >> 2, parcel[1] >> 1));
        }
        Cover::Grass
    }

    fn roof(&self, house: &House, x: f64, y: f64) -> Option<Cover> {
        let [along, across] = house.turned([x - house.centre[0], y - house.centre[1]]);
        if along.abs() > house.half[0] || across.abs() > house.half[1] {
            return None;
        }
        let base = self.ground(house.centre[0], house.centre[1]);
        let rise = (house.half[1] - across.abs()) * 0.8;
        // The sun stands in the south-west.
        let facing = if across > 0.0 { 1.0 } else { -1.0 };
        let sun = facing * (house.ridge[1] * 0.6 - house.ridge[0] * 0.8);
        Some(Cover::Roof { top: base + house.eaves + rise, light: 0.85 + 0.2 * sun, house: house.number })
    }

    fn crown(&self, x: f64, y: f64, ground: f64, wildness: f64, beside_house: bool) -> Option<Cover> {
        let cell = [floor(x / TREE), floor(y / TREE)];
        let tree = hash(self.seed ^ TREES, cell[0], cell[1]);
        let share = match () {
            () if wildness > 0.25 => 0.93,
            () if wildness > 0.0 => 0.03,
            () => 0.15,
        };
        if unit(tree) >= share {
            return None;
        }
        let radius = 1.5 + 1.9 * unit(hash(tree, 1, 0));
        let room = TREE * 0.5 - radius;
        let dx = x - (cell[0] as f64 + 0.5) * TREE - room * signed(hash(tree, 2, 0));
        let dy = y - (cell[1] as f64 + 0.5) * TREE - room * signed(hash(tree, 3, 0));
        let near = 1.0 - (dx * dx + dy * dy) / (radius * radius);
        if near <= 0.0 {
            return None;
        }
        let height = radius * (if beside_house { 1.8 } else { 3.0 } + 2.0 * unit(hash(tree, 4, 0)));
        let bottom = ground + height * 0.3;
        // Broad crowns are round, conifers are cones.
        let shape = if tree & 4 == 0 { near.sqrt() } else { 1.0 - (1.0 - near).sqrt() };
        Some(Cover::Crown { top: bottom + height * 0.7 * shape, bottom, tree })
    }
}

/// Roads run along the borders of parcels, with a broken line in the middle.
fn road(x: f64, y: f64) -> Option<Cover> {
    let every = PARCEL * ROAD_EVERY as f64;
    let off = |v: f64| v - (floor(v / every + 0.5) as f64) * every;
    let (dx, dy) = (off(x), off(y));
    if dx.abs() > ROAD && dy.abs() > ROAD {
        return None;
    }
    let (beside, along) = if dx.abs() <= ROAD { (dx, y) } else { (dy, x) };
    Some(Cover::Road { marking: beside.abs() < 0.1 && floor(along / 3.0) & 1 == 0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn houses_stay_on_their_parcel_and_off_the_road() {
        let land = Land::new(1, 0.0);
        let mut seen = 0;
        for i in -6..6 {
            for j in -6..6 {
                let Some(house) = land.house([i, j]) else { continue };
                seen += 1;
                let reach = (house.half[0] * house.half[0] + house.half[1] * house.half[1]).sqrt();
                let middle = [(i as f64 + 0.5) * PARCEL, (j as f64 + 0.5) * PARCEL];
                for (centre, middle) in house.centre.iter().zip(middle) {
                    let off = (centre - middle).abs() + reach;
                    assert!(off < PARCEL / 2.0 - ROAD, "parcel {i} {j}: {off}");
                }
            }
        }
        assert!(seen > 30, "a village of {seen} houses");
    }

    #[test]
    fn the_country_has_a_bit_of_everything() {
        let land = Land::new(3, 0.0);
        let mut counts = [0u32; 6];
        for i in -250..250 {
            for j in -250..250 {
                counts[match land.spot(f64::from(i) * 3.9, f64::from(j) * 3.9).cover {
                    Cover::Grass => 0,
                    Cover::Field(_) => 1,
                    Cover::Road { .. } => 2,
                    Cover::Water => 3,
                    Cover::Roof { .. } => 4,
                    Cover::Crown { .. } => 5,
                }] += 1;
            }
        }
        assert!(counts.iter().all(|&n| n > 500), "{counts:?}");
    }
}
