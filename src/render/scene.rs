//! From chosen nodes to splats: positions from a centre, colours, and each
//! splat's radius from the spacing of the points around it.
//!
//! Points of a coarse node lie among those of finer ones, and are drawn as
//! small as they are (Schütz 2016, adaptive point sizes): each point belongs to
//! the deepest drawn node that it lies in, and that node's own density says how
//! far apart the points there are.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::color::ColorMapper;
use super::error::Result;
use super::frame::{Splat, radius_code};
use super::node_selection::{Chosen, POISSON_DENSITY};
use super::octree::Octree;
use crate::format::potree::NodeName;

/// A disc of this many spacings around each point leaves hardly a gap between
/// points of a Poisson-disk set.
const COVER: f64 = 0.75;
/// Cells an axis in which a node's occupied space is counted.
const CELLS: usize = 8;

/// Points in an occupied cell below which they are no surface.
const SCATTERED: f64 = 1.5;
/// Cells that a surface through a node occupies at most, about.
const SURFACE: usize = 3 * CELLS * CELLS;

/// The points of a region that is a small part of the cloud are drawn at most as if they
/// were so many times as far apart as most points: so many times if there is one of them,
/// and twice as many with each [`WITNESSES`] more. Two or three strays that happen to be
/// near each other look, to a density, like a piece of a coarse surface.
const STRAY: f64 = 2.0;
const WITNESSES: f64 = 8.0;
/// A region is a small part if the cloud is more than so many times as many points.
const PARTS: u64 = 20;
/// A cell in which no point is counted: it lies beyond what is looked at.
const BEYOND: u16 = u16::MAX;

/// What is drawn, in memory.
pub struct Scene {
    /// Node by node.
    pub splats: Vec<Splat>,
    /// What the splats' positions are counted from, in world units.
    pub centre: [f64; 3],
    /// Radius around the centre that holds every splat of what is looked at.
    pub reach: f64,
    /// Radius of radius code 0, in world units.
    pub largest: f64,
    /// Of this scene alone, so that a renderer knows it again.
    pub id: u64,
}

/// The next scene's number.
static NEXT: AtomicU64 = AtomicU64::new(0);

/// The part of the space of a node that no drawn child covers, and what lies
/// in it.
#[derive(Clone, Copy)]
struct UncoveredRegion {
    points: u32,
    /// A bit for each of the 8³ cells of the node.
    occupied: [u64; CELLS],
}

impl Scene {
    /// Reads the chosen nodes, without what lies above `top`. Positions are
    /// counted from `centre`; `tight` is the box of what is looked at.
    pub fn load(
        octree: &Octree,
        chosen: &[Chosen],
        painter: &ColorMapper,
        centre: [f64; 3],
        top: f64,
        tight: [[f64; 3]; 2],
    ) -> Result<Scene> {
        let room = OccupiedSpace { octree, tight };
        let parts: Vec<(Vec<Splat>, Vec<u32>, Vec<u16>)> = (0..chosen.len() as u32)
            .into_par_iter()
            .map(|place| load_node(&room, chosen, place, painter, centre, top))
            .collect::<Result<_>>()?;
        let mut regions = vec![UncoveredRegion { points: 0, occupied: [0; CELLS] }; chosen.len()];
        for (_, places, cells) in &parts {
            for (&place, &cell) in places.iter().zip(cells).filter(|(_, cell)| **cell != BEYOND) {
                let region = &mut regions[place as usize];
                region.points += 1;
                region.occupied[usize::from(cell) / 64] |= 1 << (cell % 64);
            }
        }
        // No splat is larger than a leaf of a cloud of a few points asks for.
        let largest = room.spacing(NodeName::ROOT) * 32.0;
        let all: u64 = regions.iter().map(|region| u64::from(region.points)).sum();
        let spacings = spacings(&room, chosen, &regions, all);
        let codes: Vec<u8> =
            spacings.into_iter().map(|spacing| radius_code(COVER * spacing, largest)).collect();
        let mut splats = Vec::with_capacity(parts.iter().map(|part| part.0.len()).sum());
        for (part, places, _) in parts {
            let sized = part.into_iter().zip(places).map(|(mut splat, place)| {
                splat.paint |= u32::from(codes[place as usize]) << 24;
                splat
            });
            splats.extend(sized);
        }
        let square = |s: &Splat| s.position.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>();
        // What lies far beyond the box of what is looked at would take the depths from it.
        let corner =
            (0..3).map(|i| (tight[0][i] - centre[i]).abs().max((tight[1][i] - centre[i]).abs()).powi(2));
        let reach = splats.iter().map(square).fold(0.0, f64::max).min(corner.sum::<f64>()).sqrt();
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        Ok(Scene { splats, centre, reach, largest, id })
    }
}

/// The splats of a node, the region of each, and its cell there.
fn load_node(
    room: &OccupiedSpace,
    chosen: &[Chosen],
    place: u32,
    painter: &ColorMapper,
    centre: [f64; 3],
    top: f64,
) -> Result<(Vec<Splat>, Vec<u32>, Vec<u16>)> {
    let Chosen { node, take, .. } = &chosen[place as usize];
    if *take == 0 {
        return Ok(Default::default());
    }
    let octree = room.octree;
    let records = octree.records(node, *take)?;
    let record_size = octree.schema.record_size();
    let root = octree.cube(node.name);
    let mut splats = Vec::with_capacity(*take as usize);
    let (mut places, mut cells) = (Vec::with_capacity(*take as usize), Vec::with_capacity(*take as usize));
    for record in records.chunks_exact(record_size) {
        let position = octree.position(record);
        if !position.iter().all(|c| c.is_finite()) || position[2] > top {
            continue;
        }
        let [r, g, b] = painter.paint(record, position[2]).map(u32::from);
        splats.push(Splat {
            position: std::array::from_fn(|i| (position[i] - centre[i]) as f32),
            paint: r | g << 8 | b << 16,
        });
        let (place, cell) = region_of(room, chosen, place, root, position);
        places.push(place);
        cells.push(cell);
    }
    Ok((splats, places, cells))
}

/// The deepest drawn node that holds a point, down from one that does, and the
/// cell of that node's 8³.
fn region_of(
    room: &OccupiedSpace,
    chosen: &[Chosen],
    mut place: u32,
    cube: ([f64; 3], [f64; 3]),
    position: [f64; 3],
) -> (u32, u16) {
    let (mut corner, mut sides) = cube;
    loop {
        let half = sides.map(|side| side / 2.0);
        let upper: [bool; 3] = std::array::from_fn(|i| position[i] >= corner[i] + half[i]);
        let digit = usize::from(upper[0]) << 2 | usize::from(upper[1]) << 1 | usize::from(upper[2]);
        let Some(child) = chosen[place as usize].children[digit] else { break };
        (0..3).filter(|&i| upper[i]).for_each(|i| corner[i] += half[i]);
        (place, sides) = (child, half);
    }
    let (corner, side) = room.within(corner, sides);
    // On the far side of the box, by rounding, is in its last cell.
    let cell = [0, 1, 2].map(|i| (position[i] - corner[i]) * (CELLS as f64 / side));
    if !cell.iter().all(|at| (-1e-6..=CELLS as f64 + 1e-6).contains(at)) {
        return (place, BEYOND);
    }
    let [x, y, z] = cell.map(|at| (at as u16).min(CELLS as u16 - 1));
    (place, x << 6 | y << 3 | z)
}

/// Where in an octree the points are that are looked at.
struct OccupiedSpace<'o> {
    octree: &'o Octree,
    /// The box of these points.
    tight: [[f64; 3]; 2],
}

impl OccupiedSpace<'_> {
    /// The cube within a node's space in which its points are counted: all of it, unless
    /// what is looked at is a speck in it. That is so where axes have other units, for that
    /// space is as wide as a country and as high as a house; and where a point far away has
    /// made it large.
    fn within(&self, corner: [f64; 3], sides: [f64; 3]) -> ([f64; 3], f64) {
        let [low, high] = self.tight;
        let from: [f64; 3] = std::array::from_fn(|i| corner[i].max(low[i]));
        let reach = (0..3).map(|i| (corner[i] + sides[i]).min(high[i]) - from[i]).fold(0.0, f64::max);
        // Of points in one place there is nothing to count.
        let is_speck = reach > 0.0 && reach * (CELLS as f64) < sides[0];
        match (self.octree.has_cubes(), reach > 0.0) {
            (true, _) if !is_speck => (corner, sides[0]),
            (_, true) => (from, reach),
            (_, false) => (from, sides[2]),
        }
    }

    fn of(&self, name: NodeName) -> ([f64; 3], f64) {
        let (corner, sides) = self.octree.cube(name);
        self.within(corner, sides)
    }

    /// How far apart the points of a node are at least, where all axes count the same;
    /// else about as far as they would be.
    fn spacing(&self, name: NodeName) -> f64 {
        let side = self.of(name).1;
        match self.octree.has_cubes() && side == self.octree.cube(name).1[0] {
            true => self.octree.spacing(name.level()),
            false => side / 128.0,
        }
    }
}

/// How far apart the points of each region are, in world units.
fn spacings(room: &OccupiedSpace, chosen: &[Chosen], regions: &[UncoveredRegion], all: u64) -> Vec<f64> {
    let claims: Vec<(f64, f64)> =
        chosen.iter().zip(regions).map(|(chosen, region)| spacing(room, chosen, region)).collect();
    let is_small = |region: &UncoveredRegion| u64::from(region.points) * PARTS < all;
    let mut usual: Vec<(f64, u64)> = claims
        .iter()
        .zip(regions)
        .filter(|((_, trust), region)| *trust > 1.0 || !is_small(region))
        .map(|((apart, _), region)| (*apart, u64::from(region.points)))
        .collect();
    usual.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = usual.iter().map(|(_, points)| points).sum::<u64>() / 2;
    let mut points = 0;
    let middle = usual.iter().find(|(_, count)| {
        points += count;
        points > half
    });
    // A cube that noise has made large says nothing of how large noise is to be drawn.
    let most = middle.map_or(f64::INFINITY, |(middle, _)| STRAY * middle);
    let sized = claims.iter().zip(regions).map(|((apart, trust), region)| match is_small(region) {
        true => apart.min(most * trust),
        false => *apart,
    });
    sized.collect()
}

/// How far apart the points of a region are, in world units, by a surface that passes
/// through so many cells and holds so many points; and how many times as far apart as most
/// points that is to be believed, in units of [`STRAY`].
fn spacing(room: &OccupiedSpace, chosen: &Chosen, region: &UncoveredRegion) -> (f64, f64) {
    let level = room.spacing(chosen.node.name);
    if region.points == 0 {
        return (level, 1.0);
    }
    let cell = room.of(chosen.node.name).1 / CELLS as f64;
    let occupied: u32 = region.occupied.iter().map(|bits| bits.count_ones()).sum();
    let density = f64::from(region.points) / f64::from(occupied);
    let apart = cell * (POISSON_DENSITY / density).sqrt();
    // Of noise each point has a cell to itself; or hardly more, where the cells are more
    // than any surface passes through.
    let is_scattered = density < SCATTERED || occupied as usize > SURFACE && density < 2.0 * SCATTERED;
    let points = f64::from(region.points.min(480));
    let widest = level * (2.0 + points / 16.0).min(CELLS as f64 * 2.0);
    let trust = if is_scattered { 1.0 } else { (points / WITNESSES).exp2() };
    (apart.clamp(level / 16.0, widest), trust)
}
