//! Who stands near whom: points that have hardly a neighbor, and pairs of
//! neighbors, found on a grid as coarse as the cloud itself asks for.

use std::collections::{HashMap, HashSet};
use std::hash::{BuildHasherDefault, Hasher};

/// Points in a cell and around it, in the middle of all, on the grid that is used.
const CROWD: usize = 24;
/// A point with fewer around it than this, itself counted, is a lone one.
const FEW: usize = 4;
/// Fewer points than this have no usual distance that one could stand out of.
const LEAST: usize = 32;
/// A share of lone points beyond which they are the cloud.
const MOST: f64 = 0.2;
/// Grids that are tried: each has as many more cells along the box's longest side than the
/// one before as the third root of two says, a million at the most.
const DEEPEST: u32 = 60;

type GridCell = [i32; 3];
type CellTable = HashMap<u64, Vec<u32>, BuildHasherDefault<Mixed>>;

/// A cell in one number; coordinates reach from -1 to a million.
fn key([x, y, z]: GridCell) -> u64 {
    let part = |c: i32| (c + 1) as u64;
    part(x) | part(y) << 21 | part(z) << 42
}

/// One multiplication mixes well enough what no stranger chooses for its hash.
#[derive(Default)]
struct Mixed(u64);

impl Hasher for Mixed {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u64(u64::from(*byte)));
    }
    fn write_u64(&mut self, number: u64) {
        self.0 = (self.0 ^ number).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(26);
    }
}

/// A cloud on a grid whose cells a usual point shares with some others.
pub struct Neighborhood<'p> {
    points: &'p [[f64; 3]],
    cells: Vec<GridCell>,
    /// Points by cell.
    inside: CellTable,
}

impl<'p> Neighborhood<'p> {
    /// Finds the grid; nothing for too few points, or for points in one place.
    pub fn of(points: &'p [[f64; 3]]) -> Option<Neighborhood<'p>> {
        if points.len() < LEAST {
            return None;
        }
        let bound = |f: fn(f64, f64) -> f64, from: f64| -> [f64; 3] {
            points.iter().fold([from; 3], |m, p| std::array::from_fn(|i| f(m[i], p[i])))
        };
        let (low, high) = (bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY));
        let side = (0..3).map(|i| high[i] - low[i]).fold(0.0, f64::max);
        if !(side > 0.0 && side.is_finite()) {
            return None;
        }
        // From fine to coarse by halves of the search, for crowds only grow.
        let grid = |level: u32| {
            let scale = (f64::from(level) / 3.0).exp2() / side;
            let cell = |p: &[f64; 3]| std::array::from_fn(|i| ((p[i] - low[i]) * scale) as i32);
            let cells: Vec<GridCell> = points.iter().map(cell).collect();
            let mut inside = CellTable::default();
            for (n, cell) in (0u32..).zip(&cells) {
                inside.entry(key(*cell)).or_default().push(n);
            }
            Neighborhood { points, cells, inside }
        };
        let (mut fine, mut coarse) = (DEEPEST, 0);
        while fine - coarse > 1 {
            let middle = (fine + coarse) / 2;
            if grid(middle).usual() >= CROWD { coarse = middle } else { fine = middle }
        }
        Some(grid(coarse))
    }

    /// Points around the middle one of some.
    fn usual(&self) -> usize {
        let step = (self.points.len() / 500).max(1);
        let mut crowds: Vec<usize> = (0..self.points.len()).step_by(step).map(|n| self.crowd(n)).collect();
        let middle = crowds.len() / 2;
        *crowds.select_nth_unstable(middle).1
    }

    fn crowd(&self, point: usize) -> usize {
        self.around(point).map(|inside| inside.len()).sum()
    }

    /// The points of a point's cell and of those that touch it.
    fn around(&self, point: usize) -> impl Iterator<Item = &Vec<u32>> {
        let [x, y, z] = self.cells[point];
        (0..27).filter_map(move |n| self.inside.get(&key([x + n % 3 - 1, y + n / 3 % 3 - 1, z + n / 9 - 1])))
    }

    /// Which points stand alone; none where they are so many that they are the cloud.
    pub fn lone(&self) -> Vec<bool> {
        let lone: Vec<bool> = (0..self.points.len()).map(|n| self.crowd(n) < FEW).collect();
        let count = lone.iter().filter(|lone| **lone).count();
        if count as f64 > MOST * lone.len() as f64 { vec![false; lone.len()] } else { lone }
    }

    /// Some points, each with the one that is nearest to it.
    pub fn pairs(&self, most: usize) -> Vec<(usize, usize)> {
        let step = (self.points.len() / most.max(1)).max(1);
        let near = |n: usize| {
            let others = self.around(n).flatten().map(|m| *m as usize).filter(|m| *m != n);
            let apart =
                |m: &usize| -> f64 { (0..3).map(|i| (self.points[n][i] - self.points[*m][i]).powi(2)).sum() };
            others.min_by(|a, b| apart(a).total_cmp(&apart(b))).map(|m| (n, m))
        };
        (0..self.points.len()).step_by(step).filter_map(near).collect()
    }
}

/// The places of points that do not stand alone, each once however many points are there:
/// a crowd at one place is no more of the cloud's shape than a single point.
pub fn without_lone(points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut seen = HashSet::new();
    let places: Vec<[f64; 3]> =
        points.iter().filter(|point| seen.insert(point.map(f64::to_bits))).copied().collect();
    let Some(neighborhood) = Neighborhood::of(&places) else { return places };
    let lone = neighborhood.lone();
    let alone = lone.iter().filter(|lone| **lone).count();
    let together: Vec<[f64; 3]> =
        places.iter().zip(lone).filter(|(_, lone)| !lone).map(|(point, _)| *point).collect();
    // Where all others are nearly in one place, the lone ones are what there is to see, if
    // they are enough to show a shape.
    let is_speck = longest_side(&together) < SPECK * longest_side(&places);
    if is_speck && alone >= LEAST { places } else { together }
}

/// A cloud this small in what its lone points span is a place in it.
const SPECK: f64 = 1e-3;

fn longest_side(points: &[[f64; 3]]) -> f64 {
    let side = |axis: usize| {
        let along = points.iter().map(|point| point[axis]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    };
    (0..3).map(side).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ground(points: u64) -> Vec<[f64; 3]> {
        let share = |n: u64, by: u64| (n * by % 10_007) as f64 / 10_007.0;
        (0..points).map(|n| [share(n, 617) * 100.0, share(n, 1741) * 100.0, share(n, 3) * 0.2]).collect()
    }

    #[test]
    fn noise_in_the_sky_stands_alone() {
        let mut points = ground(9000);
        let noise: Vec<[f64; 3]> = ground(300).iter().map(|p| [p[0], p[1], 60.0 + p[2] * 300.0]).collect();
        points.extend(&noise);
        let kept = without_lone(&points);
        assert!(kept.iter().filter(|p| p[2] > 50.0).count() < 60);
        assert!(kept.iter().filter(|p| p[2] < 1.0).count() > 8900);
    }

    #[test]
    fn a_sparse_cloud_is_no_noise() {
        assert_eq!(without_lone(&ground(9000)).len(), 9000);
        assert_eq!(without_lone(&ground(50)).len(), 50);
        assert_eq!(without_lone(&vec![[7.0; 3]; 500]).len(), 1);
        // A crowd nearly at one place, and some points that are all the rest.
        let crowd: Vec<[f64; 3]> = ground(3000).iter().map(|p| p.map(|c| c * 1e-6)).collect();
        // Their first place is the same.
        assert_eq!(without_lone(&[crowd, ground(60)].concat()).len(), 3059);
        // A dense yard in wide country.
        let mut points = ground(6000);
        points.iter_mut().for_each(|p| *p = p.map(|c| c * 0.05));
        points.extend(ground(4000));
        assert!(without_lone(&points).len() > 9800);
    }

    #[test]
    fn a_crowd_at_one_place_is_one_point() {
        // Far away from the rest it is a lone one.
        for far in [1e5, -1e7] {
            let crowd = [vec![[far; 3]; 9000], ground(60)].concat();
            let kept = without_lone(&crowd);
            assert!(kept.len() == 60 && kept.iter().all(|p| p[0] >= 0.0 && p[0] <= 100.0), "{}", kept.len());
        }
        // Among the others it is as good as they are.
        let crowd = [vec![[50.0, 50.0, 0.1]; 9000], ground(600)].concat();
        assert_eq!(without_lone(&crowd).len(), 601);
    }

    #[test]
    fn pairs_are_of_the_nearest() {
        let points: Vec<[f64; 3]> =
            (0..400).map(|n| [f64::from(n % 20), f64::from(n / 20) * 3.0, 0.0]).collect();
        let neighborhood = Neighborhood::of(&points).expect("a grid");
        for (a, b) in neighborhood.pairs(1000) {
            assert_eq!((points[a][0] - points[b][0]).abs() + (points[a][1] - points[b][1]).abs(), 1.0);
        }
    }
}
