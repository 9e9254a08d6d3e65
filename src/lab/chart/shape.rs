//! What tells methods apart without colour: a shape for marks and a dash for lines.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use super::canvas::{n, through};

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
    let Some(corners) = corners(look, radius) else {
        let (r, d) = (n(radius), n(radius * 2.0));
        return format!("M{} {}a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0-{d} 0z", n(x - radius), n(y));
    };
    let places: Vec<[f64; 2]> = corners.into_iter().map(|[dx, dy]| [x + dx, y + dy]).collect();
    through(&places) + "z"
}

/// How far a mark reaches from its middle.
pub(super) fn reach(look: usize, radius: f64) -> f64 {
    corners(look, radius).iter().flatten().map(|[x, y]| x.hypot(*y)).fold(radius, f64::max)
}

/// Around the origin; a circle has none.
fn corners(look: usize, radius: f64) -> Option<Vec<[f64; 2]>> {
    let corners = match look % LOOKS {
        0 => return None,
        1 => star(4, FRAC_PI_4, 1.0),
        2 => star(3, 0.0, 1.0),
        3 => star(4, 0.0, 1.0),
        4 => star(3, PI, 1.0),
        5 => cross(0.0),
        6 => star(5, 0.0, 0.5),
        _ => cross(FRAC_PI_4),
    };
    let scale = radius * (PI / area(&corners)).sqrt();
    Some(corners.into_iter().map(|[x, y]| [x * scale, y * scale]).collect())
}

/// Corners on the unit circle, turned, with others between them at a share of the
/// distance from the centre (no more than where they would lie on the edge).
fn star(points: usize, turn: f64, inner: f64) -> Vec<[f64; 2]> {
    let edge = (PI / points as f64).cos();
    let corner = |k: usize| {
        let angle = TAU * k as f64 / (2 * points) as f64 + turn - FRAC_PI_2;
        let radius = if k.is_multiple_of(2) { 1.0 } else { inner.min(edge) };
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

    #[test]
    fn shapes_of_one_radius_are_as_large() {
        let circle = PI * 100.0 * 100.0;
        for corners in (1..LOOKS).filter_map(|look| corners(look, 100.0)) {
            assert!((area(&corners) / circle - 1.0).abs() < 1e-9, "{corners:?}");
        }
    }

    #[test]
    fn marks_reach_as_far_as_they_say() {
        assert_eq!(reach(0, 5.0), 5.0);
        let [square, star] = [1, 6].map(|look| reach(look, 10.0));
        assert!((square - 10.0 * (PI / 2.0).sqrt()).abs() < 1e-9 && star > square);
        assert_eq!(
            path(1, [10.0, 20.0], 10.0),
            "M18.9 11.1L18.9 20L18.9 28.9L10 28.9L1.1 28.9L1.1 20L1.1 11.1L10 11.1z"
        );
    }
}
