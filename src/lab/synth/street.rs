//! A dense scan at street level in a village of [`Land`], where the ground is
//! level: rays meet the ground and the walls of houses.

use super::land::{House, Land, PARCEL};
use super::noise::{floor, mix};
use super::scan::Hit;

/// How far a scanner sees, metres.
const REACH: f64 = 70.0;

/// Follows a ray; `None` where it ends in the sky.
pub fn cast(land: &Land, eye: [f64; 3], way: [f64; 3]) -> Option<Hit> {
    let ground = if way[2] < 0.0 { eye[2] / -way[2] } else { f64::INFINITY };
    let limit = ground.min(REACH);
    let wall = along_parcels(eye, way, limit, |parcel| {
        land.house(parcel).and_then(|house| meet(&house, eye, way)).filter(|hit| hit.range < limit)
    });
    if wall.is_some() {
        return wall;
    }
    (ground < REACH).then(|| pavement(eye, way, ground))
}

fn pavement(eye: [f64; 3], way: [f64; 3], range: f64) -> Hit {
    let slab = [0, 1].map(|axis| floor((eye[axis] + way[axis] * range) * 1.6));
    let dark = (slab[0] ^ slab[1]) & 1 == 0;
    let colour = if dark { [118, 116, 112] } else { [132, 130, 124] };
    Hit { range, slope: way[2], class: 2, colour, reflectance: 0.28 }
}

/// Asks parcel after parcel along the ray until one answers or `limit` metres
/// are passed (Amanatides and Woo's walk on a grid).
fn along_parcels(
    eye: [f64; 3],
    way: [f64; 3],
    limit: f64,
    ask: impl Fn([i64; 2]) -> Option<Hit>,
) -> Option<Hit> {
    let mut parcel = [floor(eye[0] / PARCEL), floor(eye[1] / PARCEL)];
    let step = [0, 1].map(|axis| if way[axis] > 0.0 { 1 } else { -1 });
    let mut border = [0, 1].map(|axis| {
        let next = parcel[axis] + i64::from(way[axis] > 0.0);
        (next as f64 * PARCEL - eye[axis]) / way[axis]
    });
    let mut passed = 0.0;
    while passed < limit {
        if let Some(hit) = ask(parcel) {
            return Some(hit);
        }
        let axis = usize::from(border[1] < border[0]);
        passed = border[axis];
        border[axis] += PARCEL / way[axis].abs();
        parcel[axis] += step[axis];
    }
    None
}

/// Where a ray from outside meets a house's walls below the eaves.
fn meet(house: &House, eye: [f64; 3], way: [f64; 3]) -> Option<Hit> {
    let from = house.turned([eye[0] - house.centre[0], eye[1] - house.centre[1]]);
    let to = house.turned([way[0], way[1]]).map(|d| if d.abs() < 1e-9 { 1e-9 } else { d });
    let near = [0, 1].map(|axis| (-house.half[axis] * to[axis].signum() - from[axis]) / to[axis]);
    let far = [0, 1].map(|axis| (house.half[axis] * to[axis].signum() - from[axis]) / to[axis]);
    let side = usize::from(near[1] > near[0]);
    let range = near[side];
    let height = eye[2] + way[2] * range;
    if range <= 0.0 || range >= far[0].min(far[1]) || height < 0.0 || height > house.eaves {
        return None;
    }
    let along = from[1 - side] + to[1 - side] * range;
    let (colour, reflectance) = facade(house, along, height);
    Some(Hit { range, slope: to[side], class: 6, colour, reflectance })
}

/// Windows in a plastered wall.
fn facade(house: &House, along: f64, height: f64) -> ([u8; 3], f64) {
    let across = along - (floor(along / 2.4) as f64) * 2.4;
    let up = height - (floor(height / 2.8) as f64) * 2.8;
    if (0.7..1.7).contains(&across) && (0.9..2.2).contains(&up) {
        return ([46, 54, 62], 0.08);
    }
    let plaster = [[222, 214, 196], [204, 190, 160], [196, 176, 168], [226, 226, 222]];
    (plaster[(mix(house.number) >> 60 & 3) as usize], 0.6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_end_on_the_ground_or_on_a_wall() {
        let land = Land::new(1, 120.0);
        let eye = [0.0, 9.0, 1.7];
        let down = cast(&land, eye, [0.6, 1e-9, -0.8]).unwrap();
        assert!((down.range - 1.7 / 0.8).abs() < 1e-9 && down.class == 2);
        let mut walls = 0;
        for step in 0..360 {
            let (cos, sin) = super::super::noise::circle(f64::from(step) / 360.0 + 1e-6);
            let Some(hit) = cast(&land, eye, [cos, sin, 1e-9]) else { continue };
            assert_eq!(hit.class, 6);
            assert!(hit.range > 0.0 && hit.range < REACH);
            walls += 1;
        }
        assert!(walls > 90, "{walls} of 360 level rays meet a wall");
        assert_eq!(cast(&land, eye, [1e-9, 0.6, 0.8]), None);
    }
}
