//! From sums to a surface: one colour and one depth a pixel.

use super::splat::{FRONT, HEAVIEST, Sums};
use crate::render::frame::{Frame, NO_DEPTH};

/// What a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Surface {
    /// Red, green, blue, and how much of the pixel is covered, a byte each from
    /// the lowest.
    pub color: u32,
    /// [`NO_DEPTH`] where only the fringe of a splat reaches.
    pub depth: u32,
}

impl Surface {
    pub const EMPTY: Surface = Surface { color: 0, depth: NO_DEPTH };

    pub fn is_covered(self) -> bool {
        self.depth != NO_DEPTH
    }
}

/// Divides the sums of a pixel by their weight.
pub fn resolve(frame: &Frame, front: u32, sums: &Sums) -> Surface {
    if sums.weight == 0 {
        return Surface::EMPTY;
    }
    let (weight, color, behind) = narrow(sums);
    let mean = |sum: u32| (sum + weight / 2) / weight;
    let [r, g, b] = color.map(mean);
    let coverage = match front {
        NO_DEPTH => (weight.min(HEAVIEST) * 255 / (HEAVIEST * 3 / 4)).min(255),
        _ => 255,
    };
    let depth = match front {
        NO_DEPTH => NO_DEPTH,
        _ => {
            // The mean of what was blended, not its front: what a single point
            // before the surface cannot shift.
            let sixteenths = mean(behind) as i32 - FRONT as i32;
            let offset = front as f32 * (sixteenths as f32 / (16.0 * frame.focal));
            (front as i32 + offset as i32).max(0) as u32
        }
    };
    Surface { color: r | g << 8 | b << 16 | coverage << 24, depth }
}

/// The sums in 31 bits each, all shifted alike where one needs more, so that
/// the shaders need no wider numbers to divide.
fn narrow(sums: &Sums) -> (u32, [u32; 3], u32) {
    let widest = sums.color.into_iter().chain([sums.weight, sums.behind]).fold(0, |all, sum| all | sum);
    let shift = (64 - widest.leading_zeros()).saturating_sub(31);
    let cut = |sum: u64| (sum >> shift) as u32;
    (cut(sums.weight).max(1), sums.color.map(cut), cut(sums.behind))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> Frame {
        let camera = crate::render::camera::OrbitCamera {
            target: [0.0; 3],
            azimuth: 0.0,
            elevation: 0.0,
            distance: 1.0,
        }
        .camera();
        crate::render::frame::Drawing::new(
            &camera,
            [64, 64],
            [0.0; 3],
            1.0,
            1.0,
            &Default::default(),
            crate::render::frame::Background::Transparent,
        )
        .frame
    }

    #[test]
    fn a_mean_is_a_mean_however_many_points_there_were() {
        for weight in [1u64, 3, 1 << 20, 1 << 40] {
            let sums = Sums {
                weight,
                color: [10 * weight, 200 * weight, 255 * weight],
                behind: u64::from(FRONT) * weight,
            };
            let surface = resolve(&frame(), 1000, &sums);
            assert_eq!(surface.color.to_le_bytes(), [10, 200, 255, 255], "{weight}");
            assert_eq!(surface.depth, 1000);
        }
    }

    #[test]
    fn an_untouched_pixel_is_empty() {
        assert_eq!(resolve(&frame(), NO_DEPTH, &Sums::default()), Surface::EMPTY);
    }
}
