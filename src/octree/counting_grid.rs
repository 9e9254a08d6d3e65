//! The census: how many points lie in which cell of a grid that covers the box
//! of the points, not their cube ("Fast Out-of-Core Octree Generation", 4.1;
//! the fitted grid is the dissertation's figure 2.12). Flat country then costs
//! little memory and can afford more levels.
//!
//! Cells are nodes of one octree level. Where a cell turns out too full (the
//! teapot in a stadium), a finer grid of its own is laid over it and the points
//! are counted again, as often as it takes.

use std::sync::atomic::{AtomicU64, Ordering};

use serde::{Deserialize, Serialize};

use super::node::NodeKey;

/// Levels that a refinement adds at once: 32³ cells.
const REFINEMENT_LEVELS: u32 = 5;

/// Counts on the cells of one octree level within a box of cells.
#[derive(Debug, Serialize, Deserialize)]
pub struct Grid {
    /// Level of the octree whose nodes are this grid's cells.
    pub level: u32,
    /// Right shift from tree coordinates to cell coordinates.
    pub shift: u32,
    /// First cell, and cells per axis.
    pub origin: [u32; 3],
    pub dims: [u32; 3],
    counts: Vec<AtomicU64>,
    /// What a cell leads to, as the user of the grid sees fit.
    #[serde(skip)]
    pub links: Vec<u32>,
}

impl Grid {
    fn new(bits: u32, level: u32, origin: [u32; 3], dims: [u32; 3]) -> Grid {
        let cells = dims.iter().map(|d| *d as usize).product();
        let mut counts = Vec::new();
        counts.resize_with(cells, AtomicU64::default);
        Grid { level, shift: bits - level, origin, dims, counts, links: Vec::new() }
    }

    /// The cell of tree coordinates, if the grid covers them.
    #[inline]
    pub fn cell(&self, tree: [u32; 3]) -> Option<usize> {
        let c: [u32; 3] = std::array::from_fn(|a| (tree[a] >> self.shift).wrapping_sub(self.origin[a]));
        if c[0] >= self.dims[0] || c[1] >= self.dims[1] || c[2] >= self.dims[2] {
            return None;
        }
        Some(self.index(c))
    }

    fn index(&self, c: [u32; 3]) -> usize {
        (c[2] as usize * self.dims[1] as usize + c[1] as usize) * self.dims[0] as usize + c[0] as usize
    }

    pub fn count(&self, cell: usize) -> u64 {
        self.counts[cell].load(Ordering::Relaxed)
    }

    #[inline]
    fn add(&self, cell: usize, points: u64) {
        self.counts[cell].fetch_add(points, Ordering::Relaxed);
    }

    /// The node that a cell is.
    fn node(&self, cell: usize) -> NodeKey {
        let (dx, dy) = (self.dims[0] as usize, self.dims[1] as usize);
        let c = [(cell % dx) as u32, (cell / dx % dy) as u32, (cell / dx / dy) as u32];
        NodeKey { level: self.level as u8, at: std::array::from_fn(|a| self.origin[a] + c[a]) }
    }
}

/// Cells that a tally has in hand.
const IN_HAND: usize = 1 << 10;

/// Counts of the cells that were last met, each at the place of its number's
/// last bits. Neighbours in the file are mostly neighbours in space, a scan
/// line returns to the cells of the line before: many points of one cell become
/// one atomic addition, the last of them when the tally is dropped.
pub struct CellCountBuffer<'a> {
    census: &'a CountingGrid,
    /// Grid, cell and points.
    in_hand: Vec<(u32, u32, u32)>,
}

impl CellCountBuffer<'_> {
    /// Counts points; in a refinement only those of the refined cells. Returns
    /// the number of points outside the grid.
    pub fn count(&mut self, points: impl Iterator<Item = [u32; 3]>) -> u64 {
        let census = self.census;
        let mut outside = 0;
        for tree in points {
            match census.find(tree) {
                None => outside += 1,
                Some((grid, _)) if grid < census.fresh => {}
                Some((grid, cell)) => self.add(grid, cell),
            }
        }
        outside
    }

    #[inline]
    fn add(&mut self, grid: usize, cell: usize) {
        let slot = &mut self.in_hand[cell % IN_HAND];
        let met = (grid as u32, cell as u32);
        if (slot.0, slot.1) != met {
            self.census.grids[slot.0 as usize].add(slot.1 as usize, u64::from(slot.2));
            *slot = (met.0, met.1, 0);
        }
        slot.2 += 1;
    }
}

impl Drop for CellCountBuffer<'_> {
    fn drop(&mut self) {
        for (grid, cell, points) in self.in_hand.iter().filter(|slot| slot.2 > 0) {
            self.census.grids[*grid as usize].add(*cell as usize, u64::from(*points));
        }
    }
}

/// A cell link that leads to a finer grid instead of where the plan said.
pub const REFINED: u32 = 1 << 31;
/// A cell without a link.
pub const NO_LINK: u32 = u32::MAX;

/// All counts of a cloud: the grid over its box first, then the refinements.
#[derive(Debug, Serialize, Deserialize)]
pub struct CountingGrid {
    bits: u32,
    pub grids: Vec<Grid>,
    /// Grids from here on are the newest refinement, still to be counted.
    fresh: usize,
}

impl CountingGrid {
    /// An empty census over the box from `min` to `max` (tree coordinates,
    /// inclusive) in a cube of 2^bits units, with at most `cells` cells.
    pub fn new(bits: u32, min: [u32; 3], max: [u32; 3], cells: u64) -> CountingGrid {
        let fits = |level: &u32| {
            let shift = bits - level;
            (0..3).map(|a| u64::from((max[a] >> shift) - (min[a] >> shift) + 1)).product::<u64>() <= cells
        };
        // Level 0 is one cell, which always fits.
        let level = (0..=bits).take_while(fits).last().unwrap_or(0);
        let shift = bits - level;
        let origin = min.map(|c| c >> shift);
        let dims = std::array::from_fn(|a| (max[a] >> shift) - origin[a] + 1);
        CountingGrid { bits, grids: vec![Grid::new(bits, level, origin, dims)], fresh: 0 }
    }

    pub fn bits(&self) -> u32 {
        self.bits
    }

    /// Counts points; returns the number of those outside the grid.
    pub fn count(&self, points: impl Iterator<Item = [u32; 3]>) -> u64 {
        self.tally().count(points)
    }

    /// Counts points of a slice; many threads can have one each.
    pub fn tally(&self) -> CellCountBuffer<'_> {
        CellCountBuffer { census: self, in_hand: vec![(0, 0, 0); IN_HAND] }
    }

    /// The finest grid and its cell that hold tree coordinates.
    #[inline]
    pub fn find(&self, tree: [u32; 3]) -> Option<(usize, usize)> {
        let mut grid = 0;
        loop {
            let g = &self.grids[grid];
            let cell = g.cell(tree)?;
            match g.links.get(cell) {
                Some(link) if link & REFINED != 0 && *link != NO_LINK => grid = (link & !REFINED) as usize,
                _ => return Some((grid, cell)),
            }
        }
    }

    /// Lays a finer grid over every cell of the newest grids that holds more
    /// than `limit` points and can still be divided. Returns whether there is
    /// anything to count again.
    pub fn refine(&mut self, limit: u64) -> bool {
        let first_new = self.grids.len();
        let mut laid = Vec::new();
        for grid in &mut self.grids[self.fresh..] {
            if grid.links.is_empty() {
                grid.links = vec![NO_LINK; grid.counts.len()];
            }
            let levels = REFINEMENT_LEVELS.min(self.bits - grid.level);
            if levels == 0 {
                continue;
            }
            for cell in 0..grid.counts.len() {
                if grid.count(cell) > limit {
                    grid.links[cell] = REFINED | (first_new + laid.len()) as u32;
                    let origin = grid.node(cell).at.map(|c| c << levels);
                    laid.push(Grid::new(self.bits, grid.level + levels, origin, [1 << levels; 3]));
                }
            }
        }
        self.fresh = first_new;
        self.grids.extend(laid);
        self.grids.len() > first_new
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_fits_the_box() {
        let census = CountingGrid::new(20, [0, 0, 0], [(1 << 20) - 1, (1 << 20) - 1, 999], 1 << 20);
        assert_eq!((census.grids[0].level, census.grids[0].dims), (10, [1024, 1024, 1]));
    }

    #[test]
    fn a_heavy_cell_is_refined_until_it_is_light_or_a_single_position() {
        let points: Vec<[u32; 3]> =
            (0..1000u32).map(|i| [i % 10, i / 10 % 10, 7]).chain((0..500).map(|_| [900, 900, 900])).collect();
        let mut census = CountingGrid::new(10, [0; 3], [1023; 3], 8);
        census.count(points.iter().copied());
        while census.refine(100) {
            census.count(points.iter().copied());
        }
        let (grid, cell) = census.find([900, 900, 900]).unwrap();
        assert_eq!((census.grids[grid].level, census.grids[grid].count(cell)), (10, 500));
        let total: u64 = points
            .iter()
            .map(|p| census.find(*p).unwrap())
            .collect::<std::collections::BTreeSet<_>>()
            .iter()
            .map(|(g, c)| census.grids[*g].count(*c))
            .sum();
        assert_eq!(total, 1500);
    }

    #[test]
    fn points_outside_are_told_not_lost_silently() {
        let census = CountingGrid::new(10, [0; 3], [511, 511, 0], 1 << 12);
        assert_eq!(census.count([[5, 5, 0], [5, 5, 900]].into_iter()), 1);
    }
}
