//! A building of rooms behind each other, with doors between them: rays from a
//! scanner in each room go through the doors, so that views have many layers.

use super::noise::{hash, unit};
use super::scan::Hit;

/// A room with its half of the walls around it, metres.
const ROOM: [f64; 2] = [6.0, 5.0];
const HEIGHT: f64 = 2.8;
/// Half a wall's thickness, metres.
const WALL: f64 = 0.1;
/// Half a door's width, and its height, metres.
const DOOR: [f64; 2] = [0.5, 2.05];
/// Pieces of furniture a room.
const PIECES: i64 = 5;
/// Rooms that a ray passes before it is given up.
const PASSED: usize = 24;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Building {
    pub seed: u64,
    /// Rooms along x and along y.
    pub rooms: i64,
}

struct Box3 {
    min: [f64; 3],
    max: [f64; 3],
    colour: [u8; 3],
}

impl Building {
    /// Where the scanner of a room stands.
    pub fn eye(&self, number: u64) -> [f64; 3] {
        let room = [number as i64 % self.rooms, number as i64 / self.rooms];
        let dice = hash(self.seed ^ 0x71, room[0], room[1]);
        [
            (room[0] as f64 + 0.42 + 0.16 * unit(dice)) * ROOM[0],
            (room[1] as f64 + 0.42 + 0.16 * unit(dice.rotate_left(20))) * ROOM[1],
            1.6,
        ]
    }

    /// Follows a ray; `None` where it ends in a wall's thickness.
    pub fn cast(&self, eye: [f64; 3], way: [f64; 3]) -> Option<Hit> {
        let mut room = [0, 1].map(|axis| super::noise::floor(eye[axis] / ROOM[axis]));
        for _ in 0..PASSED {
            let corner = [0, 1].map(|axis| room[axis] as f64 * ROOM[axis]);
            let inner = Box3 {
                min: [corner[0] + WALL, corner[1] + WALL, 0.0],
                max: [corner[0] + ROOM[0] - WALL, corner[1] + ROOM[1] - WALL, HEIGHT],
                colour: [0; 3],
            };
            let (axis, range) = leave(&inner, eye, way);
            let furniture = (0..PIECES).filter_map(|n| meet(&self.piece(room, n), eye, way)).reduce(nearer);
            if let Some(hit) = furniture.filter(|hit| hit.range < range) {
                return Some(hit);
            }
            let at = [0, 1, 2].map(|a| eye[a] + way[a] * range);
            if axis == 2 || !self.is_door(room, axis, way[axis] > 0.0, at) {
                return Some(self.shell(room, axis, range, way, at));
            }
            room[axis] += if way[axis] > 0.0 { 1 } else { -1 };
            let entry = (room[axis] as f64 + if way[axis] > 0.0 { 0.0 } else { 1.0 }) * ROOM[axis]
                + if way[axis] > 0.0 { WALL } else { -WALL };
            let through = (entry - eye[axis]) / way[axis];
            if !self.is_opening(axis, [0, 1, 2].map(|a| eye[a] + way[a] * through)) {
                return None; // the door's frame, which the scanner sees too flatly
            }
        }
        None
    }

    fn is_door(&self, room: [i64; 2], axis: usize, onward: bool, at: [f64; 3]) -> bool {
        let next = room[axis] + if onward { 1 } else { -1 };
        (0..self.rooms).contains(&next) && self.is_opening(axis, at)
    }

    /// Whether a place on a wall across `axis` lies in its door.
    fn is_opening(&self, axis: usize, at: [f64; 3]) -> bool {
        let other = 1 - axis;
        let along = at[other] - super::noise::floor(at[other] / ROOM[other]) as f64 * ROOM[other];
        (along - ROOM[other] * 0.3).abs() < DOOR[0] && (0.0..DOOR[1]).contains(&at[2])
    }

    /// A floor, ceiling or wall.
    fn shell(&self, room: [i64; 2], axis: usize, range: f64, way: [f64; 3], at: [f64; 3]) -> Hit {
        let tint = hash(self.seed ^ 0x55, room[0], room[1]);
        let (class, colour, reflectance) = match (axis, way[2] > 0.0) {
            (2, true) => (0, [238, 238, 234], 0.8),
            (2, false) => {
                let board = super::noise::floor(at[1] * 8.0) & 3;
                (2, [[150, 112, 76], [138, 102, 68], [158, 122, 84], [144, 106, 74]][board as usize], 0.45)
            }
            _ => {
                let paints = [[224, 220, 208], [206, 214, 220], [214, 222, 204], [228, 210, 196]];
                (6, paints[(tint & 3) as usize], 0.7)
            }
        };
        Hit { range, slope: way[axis], class, colour, reflectance }
    }

    /// A cupboard, table or shelf, away from the doors and the tripod.
    fn piece(&self, room: [i64; 2], number: i64) -> Box3 {
        let dice = hash(hash(self.seed ^ 0x99, room[0], room[1]), number, 0);
        let part = |shift: u32| unit(dice.rotate_left(shift));
        let size = [0.4 + 0.5 * part(7), 0.4 + 0.4 * part(17), 0.45 + 1.5 * part(27) * part(37)];
        let place = [
            room[0] as f64 * ROOM[0] + ROOM[0] * (0.55 + 0.07 * number as f64),
            room[1] as f64 * ROOM[1] + ROOM[1] * if number & 1 == 0 { 0.72 } else { 0.06 } + 0.3 * part(47),
        ];
        let woods = [[112, 78, 50], [168, 134, 96], [84, 86, 92], [178, 172, 162]];
        Box3 {
            min: [place[0], place[1], 0.0],
            max: [place[0] + size[0], place[1] + size[1], size[2]],
            colour: woods[(dice >> 5 & 3) as usize],
        }
    }
}

/// The axis across which a ray from inside leaves a box, and after how far.
fn leave(inner: &Box3, eye: [f64; 3], way: [f64; 3]) -> (usize, f64) {
    let mut first = (0, f64::INFINITY);
    for axis in 0..3 {
        let face = if way[axis] > 0.0 { inner.max[axis] } else { inner.min[axis] };
        let range = (face - eye[axis]) / way[axis];
        if range < first.1 {
            first = (axis, range);
        }
    }
    first
}

fn nearer(one: Hit, other: Hit) -> Hit {
    if other.range < one.range { other } else { one }
}

/// Where a ray from outside meets a box.
fn meet(piece: &Box3, eye: [f64; 3], way: [f64; 3]) -> Option<Hit> {
    let (mut axis, mut enter, mut exit) = (0, 0.0, f64::INFINITY);
    for a in 0..3 {
        let (low, high) = ((piece.min[a] - eye[a]) / way[a], (piece.max[a] - eye[a]) / way[a]);
        let (near, far) = if low < high { (low, high) } else { (high, low) };
        if near > enter {
            (axis, enter) = (a, near);
        }
        exit = exit.min(far);
    }
    (enter > 0.0 && enter < exit).then_some(Hit {
        range: enter,
        slope: way[axis],
        class: 1,
        colour: piece.colour,
        reflectance: 0.4,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::synth::noise::circle;

    #[test]
    fn rays_stay_in_the_building_and_go_through_doors() {
        let building = Building { seed: 5, rooms: 3 };
        let eye = building.eye(4);
        let (mut hits, mut beyond) = (0, 0);
        for step in 0..4000 {
            let (cos, sin) = circle(f64::from(step) / 4000.0 + 1e-7);
            let (flat, up) = circle(f64::from(step % 37) / 200.0 - 0.09 + 1e-7);
            let way = [cos * flat, sin * flat, up];
            let Some(hit) = building.cast(eye, way) else { continue };
            let at = [0, 1, 2].map(|a| eye[a] + way[a] * hit.range);
            assert!((-1e-9..=HEIGHT + 1e-9).contains(&at[2]), "{at:?}");
            assert!(at[0] > 0.0 && at[0] < 18.0 && at[1] > 0.0 && at[1] < 15.0, "{at:?}");
            hits += 1;
            beyond += usize::from(!(6.0..12.0).contains(&at[0]) || !(5.0..10.0).contains(&at[1]));
        }
        assert!(hits > 3900 && beyond > 20 && beyond < 2000, "{hits} hits, {beyond} in other rooms");
    }
}
