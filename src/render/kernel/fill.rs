//! Holes between the splats of one surface, closed from what surrounds them.
//!
//! A pixel is a hole of a surface where neighbours on opposite sides of it lie
//! on that surface and the pixel shows nothing, or something far behind. The
//! gap between two surfaces, and the outline of one, stay as they are.

use super::resolve::Surface;
use crate::render::frame::{Frame, NO_DEPTH};

/// The eight neighbours, each followed by the one opposite.
const PAIRS: [[[i32; 2]; 2]; 4] =
    [[[-1, 0], [1, 0]], [[0, -1], [0, 1]], [[-1, -1], [1, 1]], [[-1, 1], [1, -1]]];

/// What a pixel shows after a round of filling; `at` gives the surface of a
/// pixel before it, [`Surface::EMPTY`] outside the picture.
pub fn fill(frame: &Frame, at: impl Fn(i32, i32) -> Surface, x: i32, y: i32) -> Surface {
    let here = at(x, y);
    let near = |depth: u32| depth + (depth as f32 * frame.gap) as u32;
    let mut neighbours = [[Surface::EMPTY; 2]; 4];
    for (pair, places) in neighbours.iter_mut().zip(PAIRS) {
        *pair = [at(x + places[0][0], y + places[0][1]), at(x + places[1][0], y + places[1][1])];
    }
    // Most pixels have nothing around them, or nothing that is before them:
    // what follows would leave them as they are.
    let nearest = neighbours.as_flattened().iter().fold(NO_DEPTH, |depth, surface| depth.min(surface.depth));
    if nearest == NO_DEPTH || (here.is_covered() && here.depth <= near(near(nearest))) {
        return here;
    }
    let (mut covered, mut front) = (0, u32::MAX);
    for pair in &neighbours {
        covered += pair.iter().filter(|surface| surface.is_covered()).count();
        if is_across(pair, near) {
            front = front.min(pair[0].depth.min(pair[1].depth));
        }
    }
    // Nothing lies across, or it is not before what is seen here.
    if front == u32::MAX || (here.is_covered() && here.depth <= near(near(front))) {
        return here;
    }
    let (mut pairs, mut sums, mut depth) = (0, [0; 3], 0);
    for pair in &neighbours {
        if is_across(pair, near) && pair[0].depth.max(pair[1].depth) <= near(near(front)) {
            pairs += 1;
            for surface in pair {
                let color = surface.color.to_le_bytes();
                (0..3).for_each(|channel| sums[channel] += u32::from(color[channel]));
                depth += surface.depth;
            }
        }
    }
    let is_hole = if here.is_covered() { pairs >= 3 } else { pairs >= 1 && covered >= 5 };
    if !is_hole {
        return here;
    }
    let count = 2 * pairs;
    let [r, g, b] = sums.map(|sum| (sum + count / 2) / count);
    Surface { color: r | g << 8 | b << 16 | 255 << 24, depth: depth / count }
}

/// Whether both of a pair lie on one surface.
fn is_across(pair: &[Surface; 2], near: impl Fn(u32) -> u32) -> bool {
    let [a, b] = pair;
    a.is_covered() && b.is_covered() && a.depth <= near(b.depth) && b.depth <= near(a.depth)
}
