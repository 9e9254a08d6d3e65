//! A frame as data: everything that either renderer needs to draw it, before
//! any of them is asked. The GPU reads [`Frame`] as it lies in memory.

use bytemuck::{Pod, Zeroable};

use super::camera::{self, Camera};

/// One point, ready to be drawn by either renderer.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Splat {
    /// In world units, from the scene's centre.
    pub position: [f32; 3],
    /// Red, green, blue, and the code of the radius ([`radius_of`]), a byte
    /// each from the lowest.
    pub paint: u32,
}

/// Sixteen codes halve the radius, so that 256 of them span 2^16.
const CODES_AN_OCTAVE: f64 = 16.0;

/// The code of a radius; `largest` is that of code 0.
pub fn radius_code(radius: f64, largest: f64) -> u8 {
    ((largest / radius).log2() * CODES_AN_OCTAVE).round().clamp(0.0, 255.0) as u8
}

/// The radius of a code, in the unit of `largest`.
pub fn radius_of(code: u8, largest: f64) -> f64 {
    largest * (-f64::from(code) / CODES_AN_OCTAVE).exp2()
}

/// How splats become a surface. Lengths in pixels are for a picture of 512.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shading {
    /// Smallest and largest radius of a splat's core, in pixels. At least 1.5
    /// pixels across, as Botsch et al. ask for and UnityPIC 5 repeats.
    pub core: [f32; 2],
    /// How far a splat's colour reaches beyond its core, in pixels.
    pub fringe: f32,
    /// Blend depth = two radii + this share of the depth (after UnityPIC, eq. 5;
    /// two, because on a surface that falls away discs a spacing apart lie
    /// further behind each other than one).
    pub blend: f32,
    /// Darkening by eye-dome lighting; 0 for none.
    pub edl: f32,
    /// Rounds of hole filling; each closes holes of up to two pixels across.
    pub fill: u32,
    /// Whether the colours of all points within the blend depth are averaged
    /// (high-quality shading) or the front one is taken.
    pub blended: bool,
}

impl Default for Shading {
    fn default() -> Shading {
        Shading { core: [0.75, 8.0], fringe: 0.5, blend: 0.004, edl: 0.35, fill: 2, blended: true }
    }
}

/// What lies behind the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Background {
    /// From the colour at the top to the one at the bottom.
    Gradient([u8; 3], [u8; 3]),
    Transparent,
}

impl Background {
    /// Dark enough that pale scans stand out, blue enough that grey ones do.
    pub const CALM: Background = Background::Gradient([38, 44, 54], [74, 82, 94]);

    /// The colour of a row, as red, green, blue, alpha.
    pub fn row(self, y: u32, height: u32) -> [u8; 4] {
        match self {
            Background::Transparent => [0; 4],
            Background::Gradient(top, bottom) => {
                let last = height.saturating_sub(1).max(1);
                let mix =
                    |a: u8, b: u8| ((u32::from(a) * (last - y) + u32::from(b) * y + last / 2) / last) as u8;
                let [r, g, b] = std::array::from_fn(|i| mix(top[i], bottom[i]));
                [r, g, b, 255]
            }
        }
    }
}

/// Pixels that a surface may rise by from one pixel to the next and still be
/// one surface.
const SLOPE: f32 = 8.0;
/// Depths are whole numbers below this; see [`Frame::depth_scale`].
pub const DEPTHS: f32 = (1 << 24) as f32;
/// The depth of a pixel without a surface.
pub const NO_DEPTH: u32 = u32::MAX;
/// Parts of a pixel that positions and radii are counted in.
pub const SUBPIXELS: f32 = 16.0;

/// The figures of a frame, in the layout of the shaders' `Frame`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Frame {
    pub right: [f32; 3],
    /// Pixels that a length of one covers at a distance of one.
    pub focal: f32,
    pub up: [f32; 3],
    /// Points nearer than this are not drawn, in world units.
    pub near: f32,
    pub forward: [f32; 3],
    /// Depths a world unit.
    pub depth_scale: f32,
    /// From the scene's centre, in world units.
    pub eye: [f32; 3],
    /// Of the core of a splat, in pixels.
    pub smallest: f32,
    pub largest: f32,
    /// Beyond the core, in sixteenths of a pixel.
    pub fringe: u32,
    pub blend: f32,
    pub edl: f32,
    pub width: u32,
    pub height: u32,
    /// Distance of the neighbours that eye-dome lighting looks at, in pixels.
    pub reach: u32,
    /// 1: average what lies within the blend depth; 0: only the front.
    pub blended: u32,
    /// Sixteenths of a pixel a depth, at a distance of one.
    pub steepness: f32,
    /// Share of the depth within which neighbouring pixels are one surface.
    pub gap: f32,
    pub unused: [u32; 2],
}

/// A frame and what it needs beside the figures.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    pub frame: Frame,
    /// World radius of each radius code.
    pub radii: Vec<f32>,
    pub background: Background,
    pub fill: u32,
}

impl Drawing {
    /// `centre` is what the splats' positions are counted from, `reach` the
    /// radius around it that holds them, `largest` the radius of code 0. What lies
    /// farther away is drawn at the end of the depths.
    pub fn new(
        camera: &Camera,
        [width, height]: [u32; 2],
        centre: [f64; 3],
        reach: f64,
        largest: f64,
        shading: &Shading,
        background: Background,
    ) -> Drawing {
        let eye: [f64; 3] = std::array::from_fn(|i| camera.eye[i] - centre[i]);
        let far = camera::dot(eye, eye).sqrt() + reach;
        // A pixel is a pixel, but the look at 512 is the look at 1600.
        let zoom = (width.min(height) as f32 / 512.0).max(1.0);
        let frame = Frame {
            right: camera.right.map(|c| c as f32),
            focal: camera::focal(width, height) as f32,
            up: camera.up.map(|c| c as f32),
            near: (far * 1e-4) as f32,
            forward: camera.forward.map(|c| c as f32),
            depth_scale: DEPTHS / far as f32,
            eye: eye.map(|c| c as f32),
            smallest: shading.core[0],
            largest: (shading.core[1] * zoom).max(shading.core[0]),
            fringe: (shading.fringe * SUBPIXELS) as u32,
            blend: shading.blend,
            edl: shading.edl,
            width,
            height,
            reach: zoom.round() as u32,
            blended: u32::from(shading.blended),
            steepness: SUBPIXELS * far as f32 / DEPTHS,
            gap: shading.blend + SLOPE / camera::focal(width, height) as f32,
            unused: [0; 2],
        };
        let radii = (0..=255).map(|code| radius_of(code, largest) as f32).collect();
        Drawing { frame, radii, background, fill: shading.fill }
    }
}

/// A finished picture: red, green, blue, alpha, a byte each, from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    pub width: u32,
    pub height: u32,
    pub pixels: Vec<[u8; 4]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_come_back_to_within_a_code() {
        for radius in [1.0, 0.7, 0.01, 2.0f64.powi(-15)] {
            let back = radius_of(radius_code(radius, 1.0), 1.0);
            assert!((back / radius).log2().abs() <= 0.5 / CODES_AN_OCTAVE + 1e-9, "{radius}: {back}");
        }
        assert_eq!(radius_code(0.0, 1.0), 255);
        assert_eq!(radius_code(5.0, 1.0), 0);
    }

    #[test]
    fn a_gradient_ends_in_its_colours() {
        let sky = Background::Gradient([0, 10, 20], [100, 110, 120]);
        assert_eq!(sky.row(0, 101), [0, 10, 20, 255]);
        assert_eq!(sky.row(100, 101), [100, 110, 120, 255]);
        assert_eq!(sky.row(0, 1), [0, 10, 20, 255]);
    }
}
