//! A lone plane (a wall, a roof, a field as level as a table) is seen from the side to
//! which it shows its face, or it would be a line in the picture.

use std::f64::consts::{FRAC_PI_2, PI};

/// From where a plane is seen well, in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneView {
    pub azimuth: f64,
    pub elevation: f64,
}

/// A level plane is at most this thick, as a share of how wide it is across: country is
/// seen from an aeroplane.
const THIN: f64 = 0.005;
/// Any other one has the noise of its scanner, or tiles.
const ROUGH: f64 = 0.03;
/// How far the view is turned out of the plane's normal, so that it has depth.
const TURN: f64 = 0.3;
/// A plane whose normal rises more steeply than this is as good as level.
const LEVEL: f64 = 1.4;
/// As steep as one looks down at all.
const STEEPEST: f64 = 1.1;

/// From where to look at points that lie in a plane; nothing for any other cloud.
pub fn facing(points: &[[f64; 3]]) -> Option<PlaneView> {
    let (values, axes) = principal(points)?;
    let [long, across, thin] = values.map(|value| value.max(0.0).sqrt());
    // A line has no face.
    if across <= 0.01 * long || thin > ROUGH * across {
        return None;
    }
    let normal = axes[2];
    // Upward; of a wall, the side nearer to the south: maps have north at the top.
    let upright = normal[2].abs() < 0.05;
    let away = if upright { normal[1] > 0.0 } else { normal[2] < 0.0 };
    let normal = if away { normal.map(|c| -c) } else { normal };
    let slope = normal[2].clamp(-1.0, 1.0).asin();
    if slope > LEVEL && thin > THIN * across {
        return None;
    }
    if slope > LEVEL {
        // As good as level: its length lies across the picture.
        let mut azimuth = axes[0][1].atan2(axes[0][0]) + FRAC_PI_2;
        if azimuth.sin() > 0.0 {
            azimuth += PI;
        }
        return Some(PlaneView { azimuth: azimuth + TURN / 2.0, elevation: STEEPEST });
    }
    let azimuth = normal[1].atan2(normal[0]) + TURN;
    Some(PlaneView { azimuth, elevation: (slope + TURN / 2.0).min(STEEPEST) })
}

/// Variances along the principal axes, the largest first, and these axes.
fn principal(points: &[[f64; 3]]) -> Option<([f64; 3], [[f64; 3]; 3])> {
    if points.len() < 16 {
        return None;
    }
    let count = points.len() as f64;
    let mean: [f64; 3] = std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f64>() / count);
    let mut matrix = [[0.0; 3]; 3];
    for point in points {
        let d: [f64; 3] = std::array::from_fn(|i| point[i] - mean[i]);
        for (row, a) in matrix.iter_mut().zip(d) {
            row.iter_mut().zip(d).for_each(|(cell, b)| *cell += a * b / count);
        }
    }
    if !matrix.iter().flatten().all(|cell| cell.is_finite()) {
        return None;
    }
    let (values, columns) = eigen(matrix);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    Some((order.map(|i| values[i]), order.map(|i| std::array::from_fn(|row| columns[row][i]))))
}

/// Eigenvalues and, in the columns, eigenvectors of a symmetric matrix: Jacobi's
/// rotations, each of which makes an element beside the diagonal zero.
fn eigen(mut matrix: [[f64; 3]; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut vectors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..32 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if matrix[p][q] == 0.0 {
                continue;
            }
            let angle = (2.0 * matrix[p][q]).atan2(matrix[q][q] - matrix[p][p]) / 2.0;
            let (sin, cos) = angle.sin_cos();
            for row in &mut matrix {
                (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
            }
            for column in 0..3 {
                let (a, b) = (matrix[p][column], matrix[q][column]);
                (matrix[p][column], matrix[q][column]) = (cos * a - sin * b, sin * a + cos * b);
            }
            for row in &mut vectors {
                (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
            }
        }
    }
    (std::array::from_fn(|i| matrix[i][i]), vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a plane through the origin that is spanned by two directions.
    fn plane(a: [f64; 3], b: [f64; 3]) -> Vec<[f64; 3]> {
        (0..2000u64)
            .map(|n| {
                let (s, t) =
                    ((n * 617 % 2003) as f64 / 2003.0 - 0.5, (n * 1109 % 2003) as f64 / 2003.0 - 0.5);
                std::array::from_fn(|i| a[i] * s + b[i] * t + 1000.0)
            })
            .collect()
    }

    /// A plane as a scanner sees it, with noise along its normal.
    fn rough(a: [f64; 3], b: [f64; 3], noise: f64) -> Vec<[f64; 3]> {
        let mut points = plane(a, b);
        let normal = across(a, b);
        points.iter_mut().zip(0u64..).for_each(|(point, n)| {
            let off = ((n * 7919 % 1009) as f64 / 1009.0 - 0.5) * noise;
            (0..3).for_each(|i| point[i] += normal[i] * off);
        });
        points
    }

    /// The unit vector across two directions.
    fn across(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
        let normal: [f64; 3] = std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            a[j] * b[k] - a[k] * b[j]
        });
        let length = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
        normal.map(|c| c / length)
    }

    /// The cosine of the angle between the view and the plane's normal.
    fn faced(a: [f64; 3], b: [f64; 3], noise: f64) -> f64 {
        let PlaneView { azimuth, elevation } = facing(&rough(a, b, noise)).expect("a plane");
        let view = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin()];
        (0..3).map(|i| view[i] * across(a, b)[i]).sum::<f64>().abs()
    }

    #[test]
    fn planes_are_seen_from_their_face() {
        for (a, b) in [
            ([100.0, 0.0, 0.0], [0.0, 100.0, 0.0]),
            ([200.0, 0.0, 0.0], [0.0, 20.0, 0.0]),
            ([0.0, 0.0, 100.0], [0.0, 50.0, 0.0]),
            ([0.0, 0.0, 100.0], [100.0, 100.0, 0.0]),
            ([100.0, 0.0, 120.0], [0.0, 100.0, 80.0]),
            ([100.0, 0.0, 0.0], [0.0, 100.0, -120.0]),
        ] {
            assert!(faced(a, b, 0.0) > 0.8, "{a:?} {b:?}: {}", faced(a, b, 0.0));
        }
        // Roofs and walls with some centimeters of noise, whichever way they look.
        for (a, b, noise) in [
            ([10.0, 0.0, 0.0], [0.0, 9.2, -3.9], 0.2),
            ([0.0, 10.0, 0.0], [8.7, 0.0, -5.0], 0.2),
            ([10.0, 0.0, 0.0], [0.0, 3.4, -9.4], 0.2),
            ([7.0, 7.0, 0.0], [0.0, 0.0, 3.0], 0.08),
        ] {
            assert!(faced(a, b, noise) > 0.8, "{a:?} {b:?}: {}", faced(a, b, noise));
        }
        assert_eq!(facing(&rough([100.0, 0.0, 0.0], [0.0, 100.0, 0.0], 2.0)), None, "flat country");
    }

    #[test]
    fn what_is_no_plane_has_no_face() {
        assert_eq!(facing(&plane([100.0, 0.0, 0.0], [0.0, 0.5, 0.0])), None, "a line");
        assert_eq!(facing(&vec![[5.0; 3]; 100]), None, "a place");
        let mut hills = plane([100.0, 0.0, 0.0], [0.0, 100.0, 0.0]);
        hills.iter_mut().for_each(|p| p[2] += (p[0] / 9.0).sin() * 2.0);
        assert_eq!(facing(&hills), None, "hills");
    }
}
