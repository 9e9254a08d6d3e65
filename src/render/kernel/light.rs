//! Eye-dome lighting: shape from depth alone, for clouds without normals
//! (Schütz' dissertation, 1.2.2, after Boucheny).
//!
//! A pixel is darker the more its neighbours stand before it. Differences are
//! counted in pixels at their distance, so that the look depends neither on the
//! size of the cloud nor on that of the picture, and each neighbour counts up
//! to a bound: an edge has the same line whether a wall or a valley is behind.

use super::resolve::Surface;
use crate::render::frame::Frame;

/// Pixels of depth by which a neighbour darkens at most.
const STEEPEST: f32 = 6.0;
/// The neighbours, and one over their distance.
const AROUND: [([i32; 2], f32); 8] = [
    ([-1, 0], 1.0),
    ([1, 0], 1.0),
    ([0, -1], 1.0),
    ([0, 1], 1.0),
    ([-1, -1], std::f32::consts::FRAC_1_SQRT_2),
    ([-1, 1], std::f32::consts::FRAC_1_SQRT_2),
    ([1, -1], std::f32::consts::FRAC_1_SQRT_2),
    ([1, 1], std::f32::consts::FRAC_1_SQRT_2),
];

/// The colour of a pixel, lit and laid over what is behind it; both are red,
/// green, blue and alpha. `at` gives the surface of a pixel.
pub fn light(frame: &Frame, at: impl Fn(i32, i32) -> Surface, x: i32, y: i32, behind: [u8; 4]) -> [u8; 4] {
    let here = at(x, y);
    if here == Surface::EMPTY {
        return behind;
    }
    let mut shadow = 0.0f32;
    if here.is_covered() {
        let depth = here.depth as f32;
        for ([dx, dy], closeness) in AROUND {
            let there = at(x + dx * frame.reach as i32, y + dy * frame.reach as i32);
            if there.is_covered() {
                let rise = (depth - there.depth as f32) / depth * frame.focal;
                shadow += (rise * closeness / frame.reach as f32).clamp(0.0, STEEPEST);
            }
        }
    }
    let lit = (-frame.edl * shadow / 8.0).exp();
    let [r, g, b, alpha] = here.color.to_le_bytes();
    let color = [r, g, b].map(|channel| (f32::from(channel) * lit + 0.5) as u32);
    let alpha = u32::from(alpha);
    if behind[3] == 0 {
        return [color[0] as u8, color[1] as u8, color[2] as u8, alpha as u8];
    }
    let over = |channel: usize| {
        ((color[channel] * alpha + u32::from(behind[channel]) * (255 - alpha) + 127) / 255) as u8
    };
    [over(0), over(1), over(2), 255]
}
