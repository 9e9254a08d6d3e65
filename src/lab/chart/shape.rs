//! What tells methods apart without color: the shapes of their marks.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::canvas::{n, through};

/// So many looks there are; the next one begins anew.
const LOOKS: usize = 8;

/// The class of a look's color, in the style sheet.
pub(super) fn class(look: usize) -> String {
    format!("l{}", look % LOOKS)
}

/// The path of a mark. Every shape has the area of the circle of this radius, so that
/// areas can be compared.
pub(super) fn path(look: usize, [x, y]: [f64; 2], radius: f64) -> String {
    let corners = corners(look, radius);
    if corners.is_empty() {
        let (r, d) = (n(radius), n(radius * 2.0));
        return format!("M{} {}a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0-{d} 0z", n(x - radius), n(y));
    }
    let places: Vec<[f64; 2]> = corners.into_iter().map(|[dx, dy]| [x + dx, y + dy]).collect();
    through(&places) + "z"
}

/// How far a mark reaches from its middle.
pub(super) fn reach(look: usize, radius: f64) -> f64 {
    corners(look, radius).iter().map(|[x, y]| x.hypot(*y)).fold(radius, f64::max)
}

/// Around the origin; a circle has none. A star has points of 1 and corners between
/// them nearer to the center; with none between it is a regular polygon.
fn corners(look: usize, radius: f64) -> Vec<[f64; 2]> {
    let star = |points: usize, inner: f64, turn: f64| -> Vec<[f64; 2]> {
        let corner = |k: usize| {
            let angle = TAU * (k as f64 + turn) / points as f64 - FRAC_PI_2;
            let radius = if inner > 0.0 && k % 2 == 1 { inner } else { 1.0 };
            [radius * angle.cos(), radius * angle.sin()]
        };
        (0..points).map(corner).collect()
    };
    let cross = |angle: f64| -> Vec<[f64; 2]> {
        let arm = |quarter: usize| {
            let (sin, cos) = (FRAC_PI_2 * quarter as f64 + angle).sin_cos();
            [[-0.4, -1.0], [0.4, -1.0], [0.4, -0.4]].map(|[x, y]| [x * cos - y * sin, x * sin + y * cos])
        };
        (0..4).flat_map(arm).collect()
    };
    let corners = match look % LOOKS {
        0 => Vec::new(),
        1 => star(4, 0.0, 0.5),
        2 => star(3, 0.0, 0.0),
        3 => star(4, 0.0, 0.0),
        4 => star(3, 0.0, 0.5),
        5 => cross(0.0),
        6 => star(10, 0.5, 0.0),
        _ => cross(FRAC_PI_2 / 2.0),
    };
    let scale = radius * (PI / area(&corners).max(1e-9)).sqrt();
    corners.into_iter().map(|[x, y]| [x * scale, y * scale]).collect()
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
        for look in 1..LOOKS {
            let corners = corners(look, 10.0);
            assert!((area(&corners) / (PI * 100.0) - 1.0).abs() < 1e-9, "{corners:?}");
            assert!(corners.iter().all(|[x, y]| x.hypot(*y) <= reach(look, 10.0)));
        }
        assert_eq!(reach(0, 5.0), 5.0);
    }
}
