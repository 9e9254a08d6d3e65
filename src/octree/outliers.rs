//! Outliers: few points so far from all others that the root cube would be made
//! for them. Every doubling of the cube is a level of the octree above the cloud
//! that shows nothing, and costs one bit of what a position can resolve.
//!
//! They are found on the census, before a level is built: the shortest stretch
//! on each axis that holds all points but a few, grown again by what lies no
//! farther from it than its own length. What is still outside is an outlier, if
//! the box shrinks by a lot for it. Two clusters of any weight are none, nor are
//! birds above a field.
//!
//! "A few" are:
//!
//! - One point in ten thousand at most. That is less than a picture of the whole
//!   shows, while a scanner's echoes from nowhere are mostly rarer still.
//! - In small clouds that would be none: there it is one in fifty, so that a point
//!   of twenty is never one, but no more than sixteen, which are strays and no thing.
//! - In large clouds it would be whole buildings: there it is a leaf's worth. What
//!   fills a leaf of its own is a part of the cloud, however far from the rest.

use super::counting_grid::Grid;
use super::node::LEAF_LIMIT;

/// The box must become this many times shorter: four levels of the octree.
pub const SHRINK: u64 = 16;

/// The part of a cloud that holds all but its outliers, in cells of the census.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InlierBox {
    pub low: [u32; 3],
    pub high: [u32; 3],
    /// Points outside.
    pub outliers: u64,
}

/// Most points of a cloud that can be outliers: one in ten thousand, up to a leaf's
/// worth, and in small clouds one in fifty, up to sixteen.
pub fn most(points: u64) -> u64 {
    (points / 10_000).min(LEAF_LIMIT as u64).max((points / 50).min(16))
}

/// Finds the outliers of a cloud, at most `most` of them.
pub fn find(grid: &Grid, most: u64) -> Option<InlierBox> {
    let along = marginals(grid);
    let [Some(x), Some(y), Some(z)] = along.each_ref().map(|counts| stretch(counts, most)) else {
        return None;
    };
    let all = along.iter().map(|counts| extent(counts)).max()?;
    // Nearly always it ends here.
    if all < SHRINK * [x, y, z].map(length).into_iter().max()? {
        return None;
    }
    let cells = occupied(grid);
    let mut kept = InlierBox { low: [x.0, y.0, z.0], high: [x.1, y.1, z.1], outliers: 0 };
    while grow(&mut kept, &cells) {}
    kept.outliers = cells.iter().filter(|(at, _)| !holds(&kept, *at)).map(|(_, n)| n).sum();
    let rest = (0..3).map(|a| length((kept.low[a], kept.high[a]))).max()?;
    (kept.outliers > 0 && kept.outliers <= most && all >= SHRINK * rest).then_some(kept)
}

type WeightedCell = ([u32; 3], u64);

/// Points along each axis.
fn marginals(grid: &Grid) -> [Vec<u64>; 3] {
    let mut along = grid.dims.map(|d| vec![0; d as usize]);
    let mut cell = 0;
    for z in 0..grid.dims[2] as usize {
        for y in 0..grid.dims[1] as usize {
            for x in 0..grid.dims[0] as usize {
                let points = grid.count(cell);
                cell += 1;
                along[0][x] += points;
                along[1][y] += points;
                along[2][z] += points;
            }
        }
    }
    along
}

fn occupied(grid: &Grid) -> Vec<WeightedCell> {
    let [dx, dy, _] = grid.dims.map(|d| d as usize);
    let cells = grid.dims.iter().map(|d| *d as usize).product();
    (0..cells)
        .map(|c| ([(c % dx) as u32, (c / dx % dy) as u32, (c / dx / dy) as u32], grid.count(c)))
        .filter(|(_, points)| *points > 0)
        .collect()
}

/// The shortest stretch of an axis that holds all points but `most`.
fn stretch(counts: &[u64], most: u64) -> Option<(u32, u32)> {
    let needed = counts.iter().sum::<u64>().saturating_sub(most).max(1);
    let (mut low, mut held) = (0, 0);
    let mut best: Option<(u32, u32)> = None;
    for (high, points) in (0u32..).zip(counts) {
        held += points;
        while held - counts[low as usize] >= needed {
            held -= counts[low as usize];
            low += 1;
        }
        if held >= needed && best.is_none_or(|(a, b)| high - low < b - a) {
            best = Some((low, high));
        }
    }
    best
}

/// Takes in the cells that are no farther away than the box is long.
fn grow(kept: &mut InlierBox, cells: &[WeightedCell]) -> bool {
    let reach = (0..3).map(|a| length((kept.low[a], kept.high[a]))).max().unwrap_or(0) as u32;
    let before = *kept;
    for (at, _) in cells {
        let near = (0..3).all(|a| {
            at[a] >= before.low[a].saturating_sub(reach) && at[a] <= before.high[a].saturating_add(reach)
        });
        if near {
            for a in 0..3 {
                kept.low[a] = kept.low[a].min(at[a]);
                kept.high[a] = kept.high[a].max(at[a]);
            }
        }
    }
    *kept != before
}

fn holds(kept: &InlierBox, at: [u32; 3]) -> bool {
    (0..3).all(|a| kept.low[a] <= at[a] && at[a] <= kept.high[a])
}

/// Cells from the first that holds something to the last.
fn extent(counts: &[u64]) -> u64 {
    let first = counts.iter().position(|n| *n > 0).unwrap_or(0);
    let last = counts.iter().rposition(|n| *n > 0).unwrap_or(0);
    (last - first) as u64 + 1
}

fn length((low, high): (u32, u32)) -> u64 {
    u64::from(high - low) + 1
}

#[cfg(test)]
mod tests {
    use super::super::counting_grid::CountingGrid;
    use super::*;

    /// A census over everything, as the survey makes it.
    fn found(points: &[[u32; 3]]) -> Option<InlierBox> {
        found_of(points, most(points.len() as u64))
    }

    fn found_of(points: &[[u32; 3]], most: u64) -> Option<InlierBox> {
        let bound = |f: fn(u32, u32) -> u32, start| {
            points.iter().fold([start; 3], |m, p| std::array::from_fn(|a| f(m[a], p[a])))
        };
        let census = CountingGrid::new(31, bound(u32::min, u32::MAX), bound(u32::max, 0), 1 << 20);
        census.count(points.iter().copied());
        find(&census.grids[0], most)
    }

    fn cluster(at: u32, points: u32) -> Vec<[u32; 3]> {
        (0..points).map(|i| [at + i % 100 * 400, at + i / 100 % 100 * 400, at + i % 7]).collect()
    }

    const FAR: u32 = 1 << 30;

    #[test]
    fn six_points_hundreds_of_times_as_far_away_are_outliers() {
        let mut points = cluster(FAR, 10_000);
        for i in 0..6u32 {
            points.push([i * 300_000_000, (5 - i) * 200_000_000, i * 1000]);
        }
        assert_eq!(found(&points).map(|kept| kept.outliers), Some(6));
    }

    #[test]
    fn two_clusters_far_apart_are_a_cloud() {
        let points = [cluster(0, 10_000), cluster(FAR, 100)].concat();
        assert_eq!(found(&points), None);
        let points = [cluster(0, 10_000), cluster(FAR, 10_000)].concat();
        assert_eq!(found(&points), None);
    }

    #[test]
    fn what_fills_a_leaf_of_its_own_is_no_outlier_however_large_the_cloud() {
        let most = most(2_000_000_000);
        let cloud = |others: Vec<[u32; 3]>| [cluster(FAR, 300_000), others].concat();
        assert_eq!(found_of(&cloud(cluster(0, 20_000)), most), None);
        assert_eq!(found_of(&cloud(vec![[0; 3]; 9_000]), most).map(|kept| kept.outliers), Some(9_000));
        assert_eq!([1_000_000, 1_000, 100, 49].map(super::most), [100, 16, 2, 0]);
    }

    #[test]
    fn a_cloud_without_any_is_let_be() {
        assert_eq!(found(&cluster(5, 10_000)), None);
        // Birds, ten times as high as the field is wide.
        let mut points = cluster(0, 10_000);
        points.extend([[20_000, 20_000, 400_000], [30_000, 10_000, 380_000]]);
        assert_eq!(found(&points), None);
        // Nor is a point of two, or of twenty, an outlier.
        assert_eq!(found(&[[0; 3], [FAR; 3]]), None);
        assert_eq!(found(&[cluster(0, 19), vec![[FAR; 3]]].concat()), None);
        assert_eq!(found(&[[7; 3]]), None);
    }

    #[test]
    fn a_trail_that_leads_away_is_let_be_until_it_tears() {
        // Noise in the sky, each a step farther than the last, none farther than
        // all before it are long.
        let steps: Vec<u32> = (0..16).map(|i| 50_000 << i).collect();
        let ground = cluster(0, 1_000_000);
        let trail = |without: usize| {
            let left = steps.iter().enumerate().filter(move |(i, _)| *i != without);
            [ground.clone(), left.map(|(_, far)| [20_000, 20_000, *far]).collect()].concat()
        };
        assert_eq!(found(&trail(usize::MAX)), None);
        assert_eq!(found(&trail(11)).map(|kept| kept.outliers), Some(4));
    }

    #[test]
    fn a_line_and_a_flat_field_have_their_outliers_too() {
        let mut line: Vec<[u32; 3]> = (0..5000).map(|i| [i * 10, 5, 5]).collect();
        line.push([FAR, 5, 5]);
        assert_eq!(found(&line).map(|kept| kept.outliers), Some(1));
    }
}
