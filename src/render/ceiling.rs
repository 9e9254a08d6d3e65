//! Rooms have ceilings: from outside, a scan of an interior is a grey box. An
//! overview of one leaves the ceiling out, as the model of a house is shown
//! without its roof.
//!
//! A ceiling is a slab near the top of the cloud that holds much of its points
//! and lies over a floor of the same kind. A flat roof seen from outside has no
//! floor beneath it, a forest's crown is no slab, a solid block has no gap.

use super::sample::percentile;

/// Slabs that the height of a cloud is cut into.
const SLABS: usize = 40;
/// Share of all points that lie in a floor or ceiling; over few slabs, a
/// ceiling may have two levels.
const SHARE: f64 = 0.12;
/// Cells an axis of the ground plan.
const CELLS: usize = 24;

/// The height above which points are left out so that one can look in; `None`
/// where there is no ceiling.
pub fn ceiling(points: &[[f64; 3]]) -> Option<f64> {
    let bound = |axis: usize, share: f64| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        percentile(&mut values, share)
    };
    let (low, high): ([f64; 3], [f64; 3]) =
        (std::array::from_fn(|i| bound(i, 0.005)), std::array::from_fn(|i| bound(i, 0.995)));
    if points.len() < 1000 || (0..3).any(|i| high[i] <= low[i]) {
        return None;
    }
    let slab =
        |z: f64| ((z - low[2]) / (high[2] - low[2]) * SLABS as f64).clamp(0.0, SLABS as f64 - 1.0) as usize;
    let mut heights = [0usize; SLABS];
    points.iter().for_each(|p| heights[slab(p[2])] += 1);
    // Two slabs together, so that a ceiling on the border of two counts.
    let full =
        |slabs: &[usize; 2]| (heights[slabs[0]] + heights[slabs[1]]) as f64 >= SHARE * points.len() as f64;
    let top = (SLABS * 2 / 3..SLABS).rev().map(|s| [s, s - 1]).find(full)?;
    let floor = (0..SLABS / 3).map(|s| [s, s + 1]).find(full)?;
    let cell = |p: &[f64; 3]| {
        let at =
            |i: usize| ((p[i] - low[i]) / (high[i] - low[i]) * CELLS as f64).clamp(0.0, CELLS as f64 - 1.0);
        at(0) as usize * CELLS + at(1) as usize
    };
    let mut cells = [[false; 2]; CELLS * CELLS];
    for point in points {
        let at = slab(point[2]);
        cells[cell(point)][0] |= top.contains(&at);
        cells[cell(point)][1] |= floor.contains(&at);
    }
    let covered = cells.iter().filter(|cell| cell[0]).count();
    let over_floor = cells.iter().filter(|cell| cell[0] && cell[1]).count();
    // What lies between them is walls and furniture, not a filled volume.
    let between: usize = heights[floor[1] + 1..top[1]].iter().sum();
    let is_room = over_floor * 10 >= covered * 6 && between * 10 < points.len() * 7;
    // A slab's height below the slabs, so that no lamp hangs in the air.
    let cut = top[1] as f64 - 1.0;
    is_room.then(|| low[2] + cut / SLABS as f64 * (high[2] - low[2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a box's faces: floor, ceiling and walls, or only some of them.
    fn hall(floor: bool, ceiling: bool) -> Vec<[f64; 3]> {
        let mut points = Vec::new();
        for n in 0..4000u64 {
            let [a, b] = [(n * 617 % 4001) as f64 / 4001.0, (n * 1741 % 4001) as f64 / 4001.0];
            if floor {
                points.push([a * 20.0, b * 10.0, 0.01 * a]);
            }
            if ceiling {
                points.push([a * 20.0, b * 10.0, 3.0 - 0.01 * b]);
            }
            points.push([a * 20.0, if n % 2 == 0 { 0.0 } else { 10.0 }, b * 3.0]);
        }
        points
    }

    #[test]
    fn a_room_is_opened_below_its_ceiling() {
        let cut = ceiling(&hall(true, true)).unwrap();
        assert!((2.5..2.95).contains(&cut), "{cut}");
    }

    #[test]
    fn what_is_no_room_stays_whole() {
        assert_eq!(ceiling(&hall(true, false)), None, "a courtyard");
        assert_eq!(ceiling(&hall(false, true)), None, "a roof on walls");
        let block: Vec<[f64; 3]> =
            (0..8000u64).map(|n| [n % 20, n / 20 % 20, n / 400].map(|c| c as f64)).collect();
        assert_eq!(ceiling(&block), None, "a solid block");
        assert_eq!(ceiling(&vec![[1.0; 3]; 5000]), None, "a single place");
    }
}
