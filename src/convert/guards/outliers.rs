//! The region: which part of the cloud goes into the octree when its outliers do
//! not. A point is inside if it lies in the kept cells of every census on which
//! outliers were found; integers decide, and each census could reach all points
//! that it was asked about.

use serde::{Deserialize, Serialize};

use crate::convert::counting::Base;
use crate::format::las::LasFile;
use crate::octree::counting_grid::{Census, Grid};
use crate::octree::lattice::SourceGrid;
use crate::octree::outliers::{self, Kept};
use crate::octree::record;

/// Scales on which outliers are looked for: an outlier a thousand times as far
/// away hides one that is only a hundred times as far.
const MOST_ROUNDS: usize = 8;

/// Everywhere, until it is restricted.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Region {
    restrictions: Vec<Restriction>,
    /// Points outside.
    pub outliers: u64,
    /// The longest sides of the box with and without them, as world lengths.
    sides: Option<(f64, f64)>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Restriction {
    base: Base,
    /// From tree coordinates to the cells of the bounds, inclusive.
    shift: u32,
    low: [u32; 3],
    high: [u32; 3],
}

impl Restriction {
    #[inline]
    fn holds(&self, input: usize, raw: [i32; 3]) -> bool {
        let tree = self.base.cube.tree(self.base.requantise[input].stored(raw));
        (0..3).all(|a| {
            let cell = tree[a] >> self.shift;
            self.low[a] <= cell && cell <= self.high[a]
        })
    }
}

impl Region {
    pub fn is_everywhere(&self) -> bool {
        self.restrictions.is_empty()
    }

    /// Whether a raw position of an input is inside.
    #[inline]
    pub fn holds(&self, input: usize, raw: [i32; 3]) -> bool {
        self.restrictions.iter().all(|restriction| restriction.holds(input, raw))
    }

    /// The records of a block that are inside; where some are not, the others are
    /// copied to `buffer`.
    pub fn of<'b>(&self, input: usize, block: &'b [u8], length: usize, buffer: &'b mut Vec<u8>) -> &'b [u8] {
        let inside = |r: &&[u8]| self.holds(input, record::raw_position(r));
        if self.is_everywhere() || block.chunks_exact(length).all(|r| inside(&r)) {
            return block;
        }
        buffer.clear();
        block.chunks_exact(length).filter(inside).for_each(|r| buffer.extend_from_slice(r));
        buffer
    }

    /// The outliers of what is inside so far, where it has some.
    pub fn next(&self, census: &Census, points: u64) -> Option<Kept> {
        let most = outliers::most(points).saturating_sub(self.outliers);
        if self.restrictions.len() >= MOST_ROUNDS || most == 0 {
            return None;
        }
        outliers::find(census.grids.first()?, most)
    }

    /// Leaves the outliers out; gives hints where in each file the rest lies.
    pub fn restrict(
        &mut self,
        base: Base,
        census: &Census,
        kept: Kept,
        files: &[LasFile],
    ) -> Vec<SourceGrid> {
        let Some(grid) = census.grids.first() else { return Vec::new() };
        let (low, high) = (cells(grid, kept.low), cells(grid, kept.high));
        let side = base.cube.unit * f64::from(1u32 << grid.shift);
        let corner = |cell: [u32; 3]| -> [f64; 3] {
            std::array::from_fn(|a| {
                base.lattice.world(a, i64::from(base.cube.corner[a])) + f64::from(cell[a]) * side
            })
        };
        let (world_low, world_high) = (corner(low), corner(high.map(|c| c + 1)));
        let hints = files.iter().map(|f| f.header());
        let hints = hints.map(|h| SourceGrid::around(h.scale, h.offset, world_low, world_high));
        let hints = hints.collect();
        let lattice = &base.lattice;
        let all =
            (0..3).map(|a| lattice.world(a, lattice.max[a].into()) - lattice.world(a, lattice.min[a].into()));
        let rest = (0..3).map(|a| world_high[a] - world_low[a]);
        let all = self.sides.map_or(all.fold(0.0, f64::max), |(all, _)| all);
        self.sides = Some((all, rest.fold(0.0, f64::max)));
        self.outliers += kept.outliers;
        self.restrictions.push(Restriction { base, shift: grid.shift, low, high });
        hints
    }

    /// Says how few, how far, and why.
    pub fn note(&self, points: u64) -> Option<String> {
        let (all, rest) = self.sides?;
        Some(format!(
            "{} of {points} points lie so far away that the cloud would measure {} units instead of {}: \
             outliers, for which {:.0} levels of the octree would be built that show nothing",
            self.outliers,
            told(all),
            told(rest),
            (all / rest).log2().max(1.0)
        ))
    }
}

/// A length with the digits that say something: whole units, and of few of them
/// (degrees, that is) three digits.
fn told(length: f64) -> String {
    let decimals = (2.0 - length.log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{length:.decimals$}")
}

fn cells(grid: &Grid, relative: [u32; 3]) -> [u32; 3] {
    std::array::from_fn(|a| grid.origin[a] + relative[a])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_note_tells_lengths_in_metres_and_in_degrees() {
        let note =
            |sides| Region { outliers: 6, sides: Some(sides), ..Region::default() }.note(1000).unwrap();
        assert!(note((780_123.4, 512.3)).contains("780123 units instead of 512:"));
        assert!(note((12.3456, 0.00456789)).contains("12.3 units instead of 0.00457:"));
        assert!(note((1e9, 0.0)).contains("instead of 0.000000000000:"), "no panic at the least");
    }
}
