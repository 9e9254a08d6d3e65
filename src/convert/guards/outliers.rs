//! Outliers: finds the few points that are so far away that the octree of all would be
//! levels deeper, and restricts the region that goes into it to the others.

use crate::convert::values::coordinate_frame::CoordinateFrame;
use crate::convert::values::inlier_region::{InlierRegion, Restriction};
use crate::format::las::LasFile;
use crate::octree::counting_grid::{CountingGrid, Grid};
use crate::octree::lattice::SourceGrid;
use crate::octree::outliers::{self, InlierBox};

/// Scales on which outliers are looked for: an outlier a thousand times as far
/// away hides one that is only a hundred times as far.
const MOST_ROUNDS: usize = 8;

impl InlierRegion {
    /// The outliers of what is inside so far, where it has some.
    pub fn next(&self, census: &CountingGrid, points: u64) -> Option<InlierBox> {
        let most = outliers::most(points).saturating_sub(self.outliers);
        if self.restrictions.len() >= MOST_ROUNDS || most == 0 {
            return None;
        }
        outliers::find(census.grids.first()?, most)
    }

    /// Leaves the outliers out; gives hints where in each file the rest lies.
    pub fn restrict(
        &mut self,
        base: CoordinateFrame,
        census: &CountingGrid,
        kept: InlierBox,
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
        let note = |sides| {
            InlierRegion { outliers: 6, sides: Some(sides), ..InlierRegion::default() }.note(1000).unwrap()
        };
        assert!(note((780_123.4, 512.3)).contains("780123 units instead of 512:"));
        assert!(note((12.3456, 0.00456789)).contains("12.3 units instead of 0.00457:"));
        assert!(note((1e9, 0.0)).contains("instead of 0.000000000000:"), "no panic at the least");
    }
}
