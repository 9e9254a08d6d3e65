//! A splat on the screen.

use crate::render::frame::{DEPTHS, Frame, SUBPIXELS, Splat};

/// A splat in whole numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Projected {
    /// Of its centre, in sixteenths of a pixel from the top left.
    pub x: i32,
    pub y: i32,
    /// See [`Frame::depth_scale`].
    pub depth: u32,
    /// How far behind the front it still counts, in depths.
    pub blend: u32,
    /// Radius of the core, in sixteenths of a pixel.
    pub core: i32,
    /// Sixteenths of a pixel a depth: what turns depths into pixels.
    pub steepness: f32,
    /// Red, green, blue, a byte each from the lowest.
    pub color: u32,
}

/// Projects a splat; `None` where it lies before or beside the picture.
///
/// Only additions, multiplications and one division, in this order: they are
/// exact to the bit on every processor that follows IEEE 754, and the shader
/// does the same.
#[inline(always)]
pub fn project(frame: &Frame, radii: &[f32], splat: &Splat) -> Option<Projected> {
    let d = [
        splat.position[0] - frame.eye[0],
        splat.position[1] - frame.eye[1],
        splat.position[2] - frame.eye[2],
    ];
    let along = |axis: &[f32; 3]| axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2];
    let away = along(&frame.forward);
    if away.is_nan() || away <= frame.near {
        return None;
    }
    let pixels = frame.focal / away;
    let x = along(&frame.right) * pixels + frame.width as f32 * 0.5;
    let y = frame.height as f32 * 0.5 - along(&frame.up) * pixels;
    let radius = radii[(splat.paint >> 24) as usize];
    let core = (radius * pixels).max(frame.smallest).min(frame.largest);
    let reach = core + frame.fringe as f32 / SUBPIXELS;
    let inside =
        x > -reach && y > -reach && x < frame.width as f32 + reach && y < frame.height as f32 + reach;
    if !inside {
        return None;
    }
    Some(Projected {
        x: (x * SUBPIXELS).floor() as i32,
        y: (y * SUBPIXELS).floor() as i32,
        depth: (away * frame.depth_scale).min(DEPTHS) as u32,
        blend: ((radius + radius + frame.blend * away) * frame.depth_scale).min(DEPTHS) as u32,
        core: (core * SUBPIXELS) as i32,
        steepness: pixels * frame.steepness,
        color: splat.paint & 0xff_ffff,
    })
}
