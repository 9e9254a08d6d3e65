//! Where to stand so that a cloud is seen well: decided from its shape alone,
//! and from the bulk of it, so that a few leftovers far out do not make it
//! small.

use std::f64::consts::{FRAC_PI_2, PI};

use super::camera::{OrbitCamera, dot, focal};
use super::plane::{self, PlaneView};
use super::sample::percentile;

/// A way of looking at a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum View {
    /// All of it, from an angle that suits its shape.
    #[default]
    Overview,
    /// All of it, from straight above, north up.
    Top,
    /// Along the ground.
    Grazing,
    /// A part of it, from near.
    Close,
    /// From within, at the height of the middle.
    Inside,
}

/// Points beyond these shares on either side are leftovers, where they lie far
/// from the others.
const TAIL: f64 = 0.002;
/// How far out, in shares of the extent of the others, a leftover is no part of
/// the whole any more.
const FAR_OUT: f64 = 0.25;
/// Room left around the cloud.
const MARGIN: f64 = 0.94;

/// The bulk of a cloud.
struct Bulk {
    points: Vec<[f64; 3]>,
    low: [f64; 3],
    high: [f64; 3],
}

/// The shot of a view for a picture of a size; `all_around` where it must hold
/// the cloud from every azimuth.
pub fn frame(points: &[[f64; 3]], view: View, [width, height]: [u32; 2], all_around: bool) -> OrbitCamera {
    let bulk = bulk(points);
    let (azimuth, elevation) = direction_of(&bulk, view);
    let middle = std::array::from_fn(|i| (bulk.low[i] + bulk.high[i]) / 2.0);
    let mut shot = OrbitCamera { target: middle, azimuth, elevation, distance: 1.0 };
    let focal = focal(width, height);
    let slopes = [f64::from(width), f64::from(height)].map(|side| side / 2.0 / focal * MARGIN);
    let azimuths: Vec<f64> = match all_around {
        true => (0..24).map(|step| f64::from(step) * PI / 12.0).collect(),
        false => vec![azimuth],
    };
    let smallest = smallest_extent(&bulk);
    for _ in 0..6 {
        let mut distance = 0.0f64;
        let mut shift = [0.0; 3];
        for &azimuth in &azimuths {
            let (needed, centred) = fit(&bulk.points, &OrbitCamera { azimuth, ..shot }, slopes);
            distance = distance.max(needed);
            // A turntable turns around its axis: only up and down.
            let moved = if all_around { [0.0, 0.0, centred[2]] } else { centred };
            shift = std::array::from_fn(|i| shift[i] + moved[i] / azimuths.len() as f64);
        }
        shot.distance = distance.max(smallest);
        shot.target = std::array::from_fn(|i| shot.target[i] + shift[i]);
    }
    match view {
        View::Overview | View::Top => {}
        View::Grazing => shot.distance *= 0.75,
        View::Close => shot.distance *= 0.3,
        View::Inside => {
            shot.target = middle;
            shot.distance = (largest_extent(&bulk) * 0.02).max(smallest);
        }
    }
    shot
}

/// How far away all points fit, and how far the target must move, in world
/// units, so that they lie around the middle.
fn fit(points: &[[f64; 3]], shot: &OrbitCamera, slopes: [f64; 2]) -> (f64, [f64; 3]) {
    let camera = OrbitCamera { distance: 1.0, ..*shot }.camera();
    let mut needed = 0.0f64;
    // Positions as seen from the target, not from the eye.
    let seen = |point: &[f64; 3]| {
        let d = std::array::from_fn(|i| point[i] - shot.target[i]);
        [dot(camera.right, d), dot(camera.up, d), dot(camera.forward, d)]
    };
    for point in points {
        let at = seen(point);
        for axis in 0..2 {
            needed = needed.max(at[axis].abs() / slopes[axis] - at[2]);
        }
    }
    // Where the points lie in the picture from there.
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for point in points {
        let at = seen(point);
        let away = (needed + at[2]).max(needed * 1e-3).max(f64::MIN_POSITIVE);
        for axis in 0..2 {
            low[axis] = low[axis].min(at[axis] / away);
            high[axis] = high[axis].max(at[axis] / away);
        }
    }
    let off: [f64; 2] = std::array::from_fn(|axis| (low[axis] + high[axis]) / 2.0 * needed);
    let shift = std::array::from_fn(|i| camera.right[i] * off[0] + camera.up[i] * off[1]);
    (needed, shift)
}

/// From where a shape is seen well: azimuth and elevation, in radians.
fn direction_of(bulk: &Bulk, view: View) -> (f64, f64) {
    let extent: [f64; 3] = std::array::from_fn(|i| bulk.high[i] - bulk.low[i]);
    if let (View::Overview, Some(PlaneView { azimuth, elevation })) = (view, plane::facing(&bulk.points)) {
        return (azimuth, elevation);
    }
    let across = extent[0].hypot(extent[1]).max(f64::MIN_POSITIVE);
    let (longest, share) = main_axis(&bulk.points);
    // A wall is seen from the front, turned a little so that it has depth; what
    // is as deep as wide, over a corner.
    let turn = if share < 0.3 { 0.35 } else { 0.6 };
    // Of the two sides, the one nearer to the south: maps have north at the top.
    let mut azimuth = longest + FRAC_PI_2 + turn;
    if azimuth.sin() > 0.0 {
        azimuth += PI;
    }
    let steep = extent[2] / across;
    let elevation = match steep {
        // Country: from an aeroplane.
        s if s < 0.15 => 0.85,
        // Blocks of houses, trees.
        s if s < 0.6 => 0.85 - (s - 0.15) / 0.45 * 0.45,
        // Towers and statues: from a little above.
        _ => 0.3,
    };
    match view {
        View::Overview | View::Close => (azimuth, elevation),
        View::Top => (-FRAC_PI_2, FRAC_PI_2),
        View::Grazing => (azimuth, 0.12),
        View::Inside => (longest + PI, 0.05),
    }
}

/// The direction in which the points lie longest on the ground, in radians, and
/// how wide they are across it, as a share of that length.
fn main_axis(points: &[[f64; 3]]) -> (f64, f64) {
    let count = points.len() as f64;
    let mean: [f64; 2] = std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f64>() / count);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in points {
        let (x, y) = (point[0] - mean[0], point[1] - mean[1]);
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    let spread = ((xx - yy) / 2.0).hypot(xy);
    let (major, minor) = ((xx + yy) / 2.0 + spread, (xx + yy) / 2.0 - spread);
    // What is about square has no longest direction worth the name.
    let angle = if minor > 0.8 * major || major <= 0.0 { 0.0 } else { (2.0 * xy).atan2(xx - yy) / 2.0 };
    (angle, if major > 0.0 { (minor.max(0.0) / major).sqrt() } else { 1.0 })
}

/// The points without leftovers far out.
fn bulk(points: &[[f64; 3]]) -> Bulk {
    let mut bounds = [[0.0; 3]; 2];
    for axis in 0..3 {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        let (low, high) = (percentile(&mut values, TAIL), percentile(&mut values, 1.0 - TAIL));
        let far_out = (high - low) * FAR_OUT;
        let kept = |value: &&f64| (low - far_out..=high + far_out).contains(*value);
        bounds[0][axis] = values.iter().filter(kept).copied().fold(low, f64::min);
        bounds[1][axis] = values.iter().filter(kept).copied().fold(high, f64::max);
    }
    let [low, high] = bounds;
    let within = |p: &&[f64; 3]| (0..3).all(|i| (low[i]..=high[i]).contains(&p[i]));
    let mut kept: Vec<[f64; 3]> = points.iter().filter(within).copied().collect();
    if kept.is_empty() {
        kept.push(std::array::from_fn(|i| (low[i] + high[i]) / 2.0));
    }
    Bulk { points: kept, low, high }
}

fn largest_extent(bulk: &Bulk) -> f64 {
    (0..3).map(|i| bulk.high[i] - bulk.low[i]).fold(0.0, f64::max)
}

/// A distance that is still one where all points are in one place: a millionth
/// of the coordinates, and of nothing at least a metre's thousandth.
fn smallest_extent(bulk: &Bulk) -> f64 {
    let farthest = (0..3).map(|i| bulk.low[i].abs().max(bulk.high[i].abs())).fold(0.0, f64::max);
    let away = farthest * 1e-6;
    away.max(largest_extent(bulk) * 0.05).max(1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn screen(shot: &OrbitCamera, point: [f64; 3], [w, h]: [u32; 2]) -> [f64; 2] {
        let [x, y, z] = shot.camera().view(point);
        let f = focal(w, h);
        [f64::from(w) / 2.0 + x / z * f, f64::from(h) / 2.0 - y / z * f]
    }

    proptest! {
        /// The bulk is in the picture and fills it, wherever it lies and
        /// whatever its shape, and leftovers far out do not change that.
        #[test]
        fn the_cloud_fills_the_picture(
            extent in [0.1..1000.0f64, 0.1..1000.0f64, 0.1..1000.0f64],
            corner in [-1e7..1e7f64, -1e7..1e7f64, -100.0..100.0f64],
            all_around in any::<bool>(),
            leftover in any::<bool>(),
            size in prop_oneof![Just([512u32, 512]), Just([1600, 900]), Just([300, 900])],
        ) {
            let mut points: Vec<[f64; 3]> = (0..2000u64)
                .map(|n| std::array::from_fn(|i| {
                    let share = (n * [617, 1109, 1741][i] % 2003) as f64 / 2003.0;
                    corner[i] + share * extent[i]
                }))
                .collect();
            let cloud = points.clone();
            if leftover {
                points.push([corner[0] + 1e6, corner[1], 9e5]);
            }
            let shot = frame(&points, View::Overview, size, all_around);
            let at: Vec<[f64; 2]> = cloud.iter().map(|p| screen(&shot, *p, size)).collect();
            let share = |axis: usize| {
                let side = f64::from(size[axis]);
                let low = at.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min) / side;
                let high = at.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max) / side;
                (low, high)
            };
            let (x, y) = (share(0), share(1));
            prop_assert!(x.0 > 0.0 && x.1 < 1.0 && y.0 > 0.0 && y.1 < 1.0, "{x:?} {y:?} {shot:?}");
            if !all_around {
                prop_assert!((x.1 - x.0).max(y.1 - y.0) > 0.85, "{x:?} {y:?}");
            }
        }
    }

    #[test]
    fn a_cloud_of_one_place_has_a_shot() {
        for points in [vec![[1e7, 1e7, 0.0]; 5], vec![[0.0; 3]]] {
            for view in [View::Overview, View::Top, View::Grazing, View::Close, View::Inside] {
                let shot = frame(&points, view, [512, 512], true);
                assert!(shot.distance > 0.0 && shot.target == points[0], "{shot:?}");
            }
        }
    }

    #[test]
    fn flat_country_is_seen_from_above_and_towers_from_the_side() {
        let box_of = |e: [f64; 3]| -> Vec<[f64; 3]> {
            (0..1000u64)
                .map(|n| std::array::from_fn(|i| (n * [7, 11, 13][i] % 101) as f64 / 101.0 * e[i]))
                .collect()
        };
        let elevation = |e| frame(&box_of(e), View::Overview, [512, 512], false).elevation;
        assert!(elevation([1000.0, 1000.0, 30.0]) > 0.7);
        assert!(elevation([5.0, 5.0, 30.0]) < 0.4);
    }
}
