//! From chosen nodes to splats: positions from a centre, colours, and each
//! splat's radius from the spacing of the points around it.
//!
//! Points of a coarse node lie among those of finer ones, and are drawn as
//! small as they are (Schütz 2016, adaptive point sizes): each point belongs to
//! the deepest drawn node that it lies in, and that node's own density says how
//! far apart the points there are.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::color::Painter;
use super::error::Result;
use super::frame::{Splat, radius_code};
use super::node_selection::{Chosen, POISSON_DENSITY, bounds_of_points};
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

/// Strays are drawn at most as if they were so many times as far apart as most points.
const STRAY: f64 = 2.0;

/// What is drawn, in memory.
pub struct Scene {
    /// Node by node.
    pub splats: Vec<Splat>,
    /// What the splats' positions are counted from, in world units.
    pub centre: [f64; 3],
    /// Radius around the centre that holds every splat.
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
struct Region {
    points: u32,
    /// A bit for each of the 8³ cells of the node.
    occupied: [u64; CELLS],
}

impl Scene {
    /// Reads the chosen nodes, without what lies above `top`. Positions are
    /// counted from `centre`.
    pub fn load(
        octree: &Octree,
        chosen: &[Chosen],
        painter: &Painter,
        centre: [f64; 3],
        top: f64,
    ) -> Result<Scene> {
        let room = Room { octree, tight: bounds_of_points(octree) };
        let parts: Vec<(Vec<Splat>, Vec<u32>, Vec<u16>)> = (0..chosen.len() as u32)
            .into_par_iter()
            .map(|place| load_node(&room, chosen, place, painter, centre, top))
            .collect::<Result<_>>()?;
        let mut regions = vec![Region { points: 0, occupied: [0; CELLS] }; chosen.len()];
        for (_, places, cells) in &parts {
            for (&place, &cell) in places.iter().zip(cells) {
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
        let reach = splats.iter().map(square).fold(0.0, f64::max).sqrt();
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        Ok(Scene { splats, centre, reach, largest, id })
    }
}

/// The splats of a node, the region of each, and its cell there.
fn load_node(
    room: &Room,
    chosen: &[Chosen],
    place: u32,
    painter: &Painter,
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
    room: &Room,
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
    let cell: [u16; 3] = std::array::from_fn(|i| {
        (((position[i] - corner[i]) * (CELLS as f64 / side)) as u16).min(CELLS as u16 - 1)
    });
    (place, cell[0] << 6 | cell[1] << 3 | cell[2])
}

/// Where in an octree there can be points.
struct Room<'o> {
    octree: &'o Octree,
    /// The box of all points.
    tight: [[f64; 3]; 2],
}

impl Room<'_> {
    /// The cube within a node's space in which its points are counted: all of it; where
    /// axes have other units, that space is as wide as a country and as high as a house,
    /// and so the cube is around what the cloud takes of it.
    fn within(&self, corner: [f64; 3], sides: [f64; 3]) -> ([f64; 3], f64) {
        if self.octree.has_cubes() {
            return (corner, sides[0]);
        }
        let [low, high] = self.tight;
        let from: [f64; 3] = std::array::from_fn(|i| corner[i].max(low[i]));
        let reach = (0..3).map(|i| (corner[i] + sides[i]).min(high[i]) - from[i]).fold(0.0, f64::max);
        // Of points in one place there is nothing to count.
        (from, if reach > 0.0 { reach } else { sides[2] })
    }

    fn of(&self, name: NodeName) -> ([f64; 3], f64) {
        let (corner, sides) = self.octree.cube(name);
        self.within(corner, sides)
    }

    /// How far apart the points of a node are at least, where all axes count the same;
    /// else about as far as they would be.
    fn spacing(&self, name: NodeName) -> f64 {
        match self.octree.has_cubes() {
            true => self.octree.spacing(name.level()),
            false => self.of(name).1 / 128.0,
        }
    }
}

/// How far apart the points of each region are, in world units.
fn spacings(room: &Room, chosen: &[Chosen], regions: &[Region], all: u64) -> Vec<f64> {
    let mut spacings = Vec::with_capacity(regions.len());
    let mut usual = Vec::new();
    let mut stray = Vec::new();
    for (place, (chosen, region)) in chosen.iter().zip(regions).enumerate() {
        let (apart, is_stray) = spacing(room, chosen, region, all);
        match is_stray {
            true => stray.push(place),
            false => usual.push((apart, u64::from(region.points))),
        }
        spacings.push(apart);
    }
    // A cube that noise has made large says nothing of how large noise is to be drawn:
    // about as large as most points.
    usual.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = usual.iter().map(|(_, points)| points).sum::<u64>() / 2;
    let mut points = 0;
    let middle = usual.iter().find(|(_, count)| {
        points += count;
        points > half
    });
    if let Some((middle, _)) = middle {
        stray.into_iter().for_each(|place| spacings[place] = spacings[place].min(STRAY * middle));
    }
    spacings
}

/// How far apart the points of a region are, in world units, by a surface that passes
/// through so many cells and holds so many points; and whether they are strays, of which
/// that says nothing.
fn spacing(room: &Room, chosen: &Chosen, region: &Region, all: u64) -> (f64, bool) {
    let level = room.spacing(chosen.node.name);
    if region.points == 0 {
        return (level, false);
    }
    let cell = room.of(chosen.node.name).1 / CELLS as f64;
    let occupied: u32 = region.occupied.iter().map(|bits| bits.count_ones()).sum();
    let density = f64::from(region.points) / f64::from(occupied);
    let apart = cell * (POISSON_DENSITY / density).sqrt();
    // A few points in a large node are stragglers, not a surface of big splats. So are
    // those of which each has a cell to itself: noise, unless it is most of the cloud.
    let is_scattered = density < SCATTERED || occupied as usize > SURFACE && density < 2.0 * SCATTERED;
    let is_stray = is_scattered && u64::from(region.points) * 20 < all;
    let trusted = match is_stray {
        true => 1.0,
        false => 2.0 + f64::from(region.points.min(480)) / 16.0,
    };
    (apart.clamp(level / 16.0, level * trusted.min(CELLS as f64 * 2.0)), is_stray)
}
