//! A scene: its parts one behind the other, the files they belong to, and what
//! is done to single points (duplicates, outliers) on the way.

use std::ops::Range;

use super::SceneKind;
use super::aerial::{Flight, side_for};
use super::interior::Building;
use super::land::{Land, PARCEL};
use super::noise::{hash, unit};
use super::point::{FileLattice, Point};
use super::scan::Tripod;
use super::shapes::Shape;
use super::source::PointSource;
use crate::format::las::record_length;

/// What a scene is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recipe {
    pub kind: SceneKind,
    pub points: u64,
    pub seed: u64,
    /// Share of the points of `duplicates` that lie at one position.
    pub share: f64,
    /// Make `duplicates` of pairs at one position each, instead of one crowd.
    pub twins: bool,
    /// Make the dense middle of `town` a stone of 1 cm, and the country around it
    /// 10 km wide: the teapot in the stadium, at its worst.
    pub teapot: bool,
    /// Side of the box that `outliers` span, in kilometres; where it is 0 they lie
    /// 200 to 700 km from the middle.
    pub span: f64,
}

impl Recipe {
    pub fn new(kind: SceneKind, points: u64, seed: u64) -> Recipe {
        Recipe { kind, points, seed, share: 0.2, twins: false, teapot: false, span: 0.0 }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error("a scene of 0 points cannot be made (ask for at least 1 with --points)")]
    Empty,
    #[error("the share of duplicates must lie between 0 and 1, not at {0} (see --share)")]
    Share(f64),
    #[error("the outliers' box may be 1 to {MOST_SPAN} km wide, not {0} (see --span)")]
    Span(f64),
    #[error("point format {0} does not exist (choose 0 to 10 with --format)")]
    Format(u8),
}

/// One file of a scene. Most scenes have one; `strips` has several.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFile {
    pub name: String,
    /// The points that lie in it, counted through the scene.
    pub points: Range<u64>,
    pub lattice: FileLattice,
}

/// What one generator gives, in one file's lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ScenePart {
    first: u64,
    points: u64,
    source: PointSource,
    tile: usize,
}

#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticScene {
    recipe: Recipe,
    parts: Vec<ScenePart>,
    tiles: Vec<SceneFile>,
    /// The scene's origin in the world, metres.
    origin: [f64; 3],
}

/// The origin of aerial scenes: UTM zone 32.
const UTM: [f64; 3] = [500_000.0, 5_400_000.0, 400.0];
/// Metres between points of an aerial scan (8 points a square metre).
const AERIAL: f64 = 0.354;
/// Points of the outliers scene that are outliers.
const OUTLIERS: u64 = 6;

/// Kilometres that outliers may span: what 32 bits of centimetres hold, less what
/// they may be off the middle.
const MOST_SPAN: f64 = 20_000.0;

/// Hash streams of what happens to single points.
const CROWD: u64 = 0xd0;
const STRAY: u64 = 0xd1;

impl SyntheticScene {
    pub fn new(recipe: Recipe) -> Result<SyntheticScene, SceneError> {
        if recipe.points == 0 {
            return Err(SceneError::Empty);
        }
        if !(0.0..=1.0).contains(&recipe.share) {
            return Err(SceneError::Share(recipe.share));
        }
        if recipe.span != 0.0 && !(1.0..=MOST_SPAN).contains(&recipe.span) {
            return Err(SceneError::Span(recipe.span));
        }
        let mut scene = SyntheticScene { recipe, parts: Vec::new(), tiles: Vec::new(), origin: [0.0; 3] };
        let Recipe { kind, points, seed, .. } = recipe;
        match kind {
            SceneKind::Terrain | SceneKind::Duplicates => {
                scene.aerial(0.01, Land::new(seed, 0.0), side_for(points, AERIAL))
            }
            SceneKind::Outliers => scene.aerial(0.01, Land::new(seed, 0.0), 400.0),
            SceneKind::Town if recipe.teapot => scene.teapot(),
            SceneKind::Town => scene.town(),
            SceneKind::Strips => scene.strips(),
            SceneKind::Far => scene.far(),
            SceneKind::Interior => scene.interior(),
            SceneKind::Object => {
                // Beyond this the surface would run out of lattice positions.
                let radius = (points as f64 / 2e8).sqrt().max(1.0);
                scene.shape(0.0001, Shape::Object { radius });
            }
            SceneKind::Volume => {
                let count = (1..).find(|n: &u64| n.pow(3) >= points).unwrap_or(1);
                scene.shape(0.001, Shape::Volume { count, step: 0.05 });
            }
            SceneKind::Flat => scene.shape(0.001, Shape::Flat { side: (points as f64).sqrt() * 0.05 }),
            SceneKind::Line => {
                scene.shape(0.001, Shape::Line { length: (points as f64 * 0.01).clamp(1.0, 1e6) })
            }
            SceneKind::Dot => scene.shape(0.001, Shape::Dot),
        }
        Ok(scene)
    }

    /// Points of the scene.
    pub fn points(&self) -> u64 {
        self.recipe.points
    }

    /// The files of the scene.
    pub fn tiles(&self) -> &[SceneFile] {
        &self.tiles
    }

    /// Whether the scene lies on the earth (in UTM zone 32) or in a frame of
    /// its own.
    pub fn is_on_earth(&self) -> bool {
        self.origin == UTM
    }

    /// The LAS records of the points `first..first + count` (fewer at the end).
    pub fn slice(&self, first: u64, count: u64, format: u8) -> Result<Vec<u8>, SceneError> {
        let record = record_length(format).ok_or(SceneError::Format(format))?;
        let wanted = first..first.saturating_add(count).min(self.points());
        let length = wanted.end.saturating_sub(first) as usize;
        let mut records = Vec::with_capacity(length * record);
        let mut block = Vec::new();
        let start = self.parts.partition_point(|part| part.first + part.points <= first);
        for part in self.parts[start..].iter().take_while(|part| part.first < wanted.end) {
            let SceneFile { lattice, .. } = self.tiles[part.tile];
            let shift = [0, 1, 2].map(|axis| lattice.offset[axis] - self.origin[axis]);
            let inside = wanted.start.max(part.first)..wanted.end.min(part.first + part.points);
            let step = part.source.block_length();
            for number in (inside.start - part.first) / step..(inside.end - part.first).div_ceil(step) {
                block.clear();
                part.source.block(number, &mut block);
                let at = part.first + number * step;
                self.change(at, &mut block);
                for (index, point) in (at..).zip(&block).filter(|(index, _)| inside.contains(index)) {
                    debug_assert!(index < self.points());
                    point.encode(lattice.scale, shift, format, &mut records);
                }
            }
        }
        Ok(records)
    }

    /// Makes the points of a block, which begins at number `at`, duplicates or
    /// outliers.
    fn change(&self, at: u64, block: &mut [Point]) {
        match self.recipe.kind {
            SceneKind::Duplicates if self.recipe.twins => {
                // Blocks are even and begin at even numbers: pairs stay whole.
                for pair in block.chunks_exact_mut(2) {
                    pair[1].place = pair[0].place;
                }
            }
            SceneKind::Duplicates => {
                for (index, point) in (at..).zip(block) {
                    if unit(hash(self.recipe.seed, index as i64, CROWD as i64)) < self.recipe.share {
                        point.place = [1.25, -0.75, 3.5];
                    }
                }
            }
            SceneKind::Outliers => {
                for (index, point) in (at..).zip(block) {
                    if let Some(place) = self.stray(index) {
                        point.place = place;
                        point.class = 7;
                    }
                }
            }
            _ => {}
        }
    }

    /// Where the outlier lies, if this point is one: each the middle of a sixth
    /// of the file.
    fn stray(&self, index: u64) -> Option<[f64; 3]> {
        let points = self.points();
        (0..OUTLIERS.min(points)).find(|n| (2 * n + 1) * points / (2 * OUTLIERS) == index).map(|n| {
            let dice = hash(self.recipe.seed, n as i64, STRAY as i64);
            let (far, most) = match self.recipe.span {
                0.0 => (200_000.0 + 500_000.0 * unit(dice), 90_000.0),
                span => (span * 500.0, span * 400.0),
            };
            let near = most * unit(dice.rotate_left(30));
            [[far, near, 900.0], [near, -far, 40.0], [-far, -near, -300.0]][(n % 3) as usize]
        })
    }

    fn tile(&mut self, name: &str, lattice: FileLattice) {
        let at = self.parts.last().map_or(0, |part| part.first + part.points);
        self.tiles.push(SceneFile { name: name.to_string(), points: at..at, lattice });
    }

    /// Adds a part behind the last, to the last tile.
    fn part(&mut self, points: u64, source: PointSource) {
        let tile = self.tiles.len() - 1;
        let first = self.tiles[tile].points.end;
        self.tiles[tile].points.end = first + points;
        if points > 0 {
            self.parts.push(ScenePart { first, points, source, tile });
        }
    }

    fn shape(&mut self, scale: f64, shape: Shape) {
        self.tile("shape", FileLattice::uniform(scale, [0.0; 3]));
        self.part(self.recipe.points, PointSource::Shape { shape, seed: self.recipe.seed });
    }

    fn aerial(&mut self, scale: f64, land: Land, side: f64) {
        self.origin = UTM;
        self.tile("flight", FileLattice::uniform(scale, UTM));
        let flight = Flight::new(land, self.recipe.seed, [0.0; 2], side, self.recipe.points, 1);
        self.part(self.recipe.points, PointSource::Aerial { flight, first_line: 0 });
    }

    /// Half of the points from the air, half from the square in the middle.
    fn town(&mut self) {
        const SCANS: u64 = 6;
        const VIEW: [f64; 2] = [-0.16, 0.11];
        let Recipe { points, seed, .. } = self.recipe;
        self.origin = UTM;
        self.tile("town", FileLattice::uniform(0.001, UTM));
        let land = Land::new(seed, 140.0);
        let aerial = points - points / 2;
        let flight = Flight::new(land, seed, [0.0; 2], side_for(aerial, AERIAL), aerial, 1);
        self.part(aerial, PointSource::Aerial { flight, first_line: 0 });
        for number in 0..SCANS {
            let share = points / 2 * (number + 1) / SCANS - points / 2 * number / SCANS;
            let (columns, rows) = Tripod::raster(share, VIEW);
            // Along the street that runs through the origin.
            let eye = [0.4, (number as f64 - 2.5) * 9.0, 1.8];
            let tripod = Tripod { seed, number, eye, columns, rows, view: VIEW };
            self.part(share, PointSource::Street { tripod, land });
        }
    }

    /// Half of the points on 10 km of country, half on a stone of 1 cm.
    fn teapot(&mut self) {
        const SIDE: f64 = 10_000.0;
        const RADIUS: f64 = 0.004;
        let Recipe { points, seed, .. } = self.recipe;
        self.origin = UTM;
        // As fine as 32 bits allow: the stone has a few thousand units.
        self.tile("town", FileLattice::uniform(0.000_002_5, UTM));
        let aerial = points - points / 2;
        let flight = Flight::new(Land::new(seed, 140.0), seed, [0.0; 2], SIDE, aerial, 1);
        self.part(aerial, PointSource::Aerial { flight, first_line: 0 });
        self.part(points / 2, PointSource::Shape { shape: Shape::Object { radius: RADIUS }, seed });
    }

    fn interior(&mut self) {
        const VIEW: [f64; 2] = [-0.17, 0.245];
        const A_SCAN: u64 = 2_000_000;
        let Recipe { points, seed, .. } = self.recipe;
        let rooms = (3..40).find(|n: &u64| n * n * A_SCAN >= points).unwrap_or(40);
        self.tile("interior", FileLattice::uniform(0.001, [0.0; 3]));
        let building = Building { seed, rooms: rooms as i64 };
        let scans = rooms * rooms;
        for number in 0..scans {
            let from = (u128::from(points) * u128::from(number) / u128::from(scans)) as u64;
            let to = (u128::from(points) * u128::from(number + 1) / u128::from(scans)) as u64;
            let (columns, rows) = Tripod::raster(to - from, VIEW);
            let tripod = Tripod { seed, number, eye: building.eye(number), columns, rows, view: VIEW };
            self.part(to - from, PointSource::Interior { tripod, building });
        }
    }

    /// Each flight strip a file. The lattices differ, yet one holds them all:
    /// half a millimetre with whole offsets.
    fn strips(&mut self) {
        let lattices = [
            FileLattice::uniform(0.01, UTM),
            FileLattice::uniform(0.001, [499_000.0, 5_399_000.0, 0.0]),
            FileLattice { scale: [0.005, 0.005, 0.001], offset: [500_100.005, 5_400_000.01, 400.0] },
            FileLattice { scale: [0.0005; 3], offset: [0.0, 5_000_000.0, 100.0] },
        ];
        let Recipe { points, seed, .. } = self.recipe;
        self.origin = UTM;
        let flight = Flight::new(Land::new(seed, 0.0), seed, [0.0; 2], side_for(points, AERIAL), points, 4);
        let a_strip = flight.lines * flight.slots;
        for strip in 0..flight.strips {
            let count = points.saturating_sub(strip * a_strip).min(a_strip);
            if count > 0 {
                self.tile(&format!("strip-{:03}", strip + 1), lattices[(strip % 4) as usize]);
                self.part(count, PointSource::Aerial { flight, first_line: strip * flight.lines });
            }
        }
    }

    /// Sixteen flights, as far apart as the lattice allows.
    fn far(&mut self) {
        const REACH: f64 = 214_748.0;
        const SIDE: u64 = 4;
        let Recipe { points, seed, .. } = self.recipe;
        self.origin = UTM;
        self.tile("far", FileLattice::uniform(0.0001, UTM));
        let a_flight = points.div_ceil(SIDE * SIDE);
        let side = side_for(a_flight, AERIAL).min(PARCEL * 2000.0);
        // Strips overlap by an eighth of a side at most, and lines lean.
        let inner = REACH - side * 0.75;
        for number in 0..SIDE * SIDE {
            let share = points.saturating_sub(number * a_flight).min(a_flight);
            let step = |n: u64| (n as f64 / (SIDE - 1) as f64 * 2.0 - 1.0) * inner;
            let centre = [step(number % SIDE), step(number / SIDE)];
            let flight = Flight::new(Land::new(seed, 0.0), seed ^ number, centre, side, a_flight, 1);
            self.part(share, PointSource::Aerial { flight, first_line: 0 });
        }
    }
}
