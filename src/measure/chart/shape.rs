//! What tells methods apart without colour: a shape for marks and a dash for lines.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use super::canvas::n;

/// So many looks there are; the next one begins anew.
pub(super) const LOOKS: usize = 8;

/// Dashes of `style::CSS` go by class; this is the class of a look's colour.
pub(super) fn class(look: usize) -> String {
    format!("l{}", look % LOOKS)
}

/// `stroke-dasharray` of a line.
pub(super) fn dash(look: usize) -> &'static str {
    ["none", "7 3", "2 3", "9 3 2 3", "4 2", "12 3", "6 2 2 2 2 2", "1 2"][look % LOOKS]
}

/// The path of a mark. Every shape has the area of the circle of this radius, so that
/// areas can be compared.
pub(super) fn path(look: usize, [x, y]: [f64; 2], radius: f64) -> String {
    let corners = match look % LOOKS {
        0 => {
            let (d, left) = (n(radius * 2.0), n(x - radius));
            let r = n(radius);
            return format!("M{left} {}a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0-{d} 0z", n(y));
        }
        1 => star(4, FRAC_PI_4, 1.0),
        2 => star(3, 0.0, 0.5),
        3 => star(4, 0.0, 0.75),
        4 => star(3, PI, 0.5),
        5 => cross(0.0),
        6 => star(5, 0.0, 0.5),
        _ => cross(FRAC_PI_4),
    };
    let scale = radius * (PI / area(&corners)).sqrt();
    let mut path = String::new();
    for (at, [dx, dy]) in corners.into_iter().enumerate() {
        path.push(if at == 0 { 'M' } else { 'L' });
        path.push_str(&format!("{} {}", n(x + dx * scale), n(y + dy * scale)));
    }
    path.push('z');
    path
}

/// How far a mark reaches from its middle.
pub(super) fn reach(look: usize, radius: f64) -> f64 {
    radius * [1.0, 1.26, 1.56, 1.45, 1.56, 1.28, 1.68, 1.28][look % LOOKS]
}

/// Corners on the unit circle, turned, with others between them at a share of the
/// distance from the centre (no more than where they would lie on the edge).
fn star(points: usize, turn: f64, inner: f64) -> Vec<[f64; 2]> {
    let edge = (PI / points as f64).cos();
    let corner = |k: usize| {
        let angle = TAU * k as f64 / (2 * points) as f64 + turn - FRAC_PI_2;
        let radius = if k % 2 == 0 { 1.0 } else { inner.min(edge) };
        [radius * angle.cos(), radius * angle.sin()]
    };
    (0..2 * points).map(corner).collect()
}

fn cross(turn: f64) -> Vec<[f64; 2]> {
    let (sin, cos) = turn.sin_cos();
    let arm = [[0.4, -1.0], [0.4, -0.4], [1.0, -0.4]];
    let quarters =
        (0..4).flat_map(|quarter| arm.map(|[x, y]| (0..quarter).fold([x, y], |[x, y], _| [-y, x])));
    quarters.map(|[x, y]| [x * cos - y * sin, x * sin + y * cos]).collect()
}

fn area(corners: &[[f64; 2]]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>().abs() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of a path, in pairs.
    fn corners(path: &str) -> Vec<[f64; 2]> {
        let numbers: Vec<f64> =
            path.split(|c: char| "MLz ".contains(c)).filter_map(|part| part.parse().ok()).collect();
        numbers.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect()
    }

    #[test]
    fn shapes_of_one_radius_are_as_large_and_reach_as_far_as_they_say() {
        for look in 1..LOOKS {
            let corners = corners(&path(look, [0.0, 0.0], 100.0));
            let circle = PI * 100.0 * 100.0;
            assert!((area(&corners) / circle - 1.0).abs() < 0.01, "{look}: {}", area(&corners));
            let far = corners.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
            let told = reach(look, 100.0);
            assert!(far <= told && told < far + 2.0, "{look}: {far} and not {told}");
        }
    }
}
