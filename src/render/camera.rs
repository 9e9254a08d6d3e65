//! Where the picture is taken from: a pinhole camera in world units, z up.

/// Tangent of half the angle that the shorter side of a picture spans: 40
/// degrees in all, long enough a lens that buildings stay upright.
const TAN_HALF: f64 = 0.364;

/// A camera on an orbit around what it looks at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrbitCamera {
    /// What lies in the middle of the picture, in world units.
    pub target: [f64; 3],
    /// Counted from east to north, in radians: where the eye stands, seen from
    /// the target.
    pub azimuth: f64,
    /// Above the horizon, in radians.
    pub elevation: f64,
    /// Between target and eye, in world units; never zero.
    pub distance: f64,
}

/// A pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    pub eye: [f64; 3],
    /// Unit vectors: to the right and up in the picture, and into it.
    pub right: [f64; 3],
    pub up: [f64; 3],
    pub forward: [f64; 3],
}

impl OrbitCamera {
    pub fn camera(&self) -> Camera {
        let outward = direction(self.azimuth, self.elevation);
        let eye = std::array::from_fn(|i| self.target[i] + outward[i] * self.distance);
        // Turned a little further than straight down it would have no right.
        let right = [-self.azimuth.sin(), self.azimuth.cos(), 0.0];
        let forward = outward.map(|c| -c);
        Camera { eye, right, up: cross(right, forward), forward }
    }

    /// The same shot, turned around the target by a share of a full circle.
    pub fn turned(&self, share: f64) -> OrbitCamera {
        OrbitCamera { azimuth: self.azimuth + share * std::f64::consts::TAU, ..*self }
    }
}

impl Camera {
    /// A point as the camera sees it: to the right, up, and away from the eye,
    /// in world units.
    pub fn view(&self, point: [f64; 3]) -> [f64; 3] {
        let d = std::array::from_fn(|i| point[i] - self.eye[i]);
        [dot(self.right, d), dot(self.up, d), dot(self.forward, d)]
    }
}

/// Pixels that a length of one covers at a distance of one.
pub fn focal(width: u32, height: u32) -> f64 {
    f64::from(width.min(height)) / 2.0 / TAN_HALF
}

/// The unit vector that points to an azimuth and an elevation.
pub fn direction(azimuth: f64, elevation: f64) -> [f64; 3] {
    [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin()]
}

pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_target_lies_ahead_and_up_is_up(
            azimuth in -7.0..7.0f64,
            elevation in -1.5..1.5f64,
            distance in 0.1..1e7f64,
            x in -1e7..1e7f64,
        ) {
            let shot = OrbitCamera { target: [x, -2.0 * x, 5.0], azimuth, elevation, distance };
            let camera = shot.camera();
            let [right, up, away] = camera.view(shot.target);
            prop_assert!(right.abs() < 1e-6 * distance.max(x.abs()));
            prop_assert!(up.abs() < 1e-6 * distance.max(x.abs()));
            prop_assert!((away / distance - 1.0).abs() < 1e-6 * (1.0 + x.abs() / distance));
            prop_assert!(camera.up[2] > 0.0 && camera.right[2] == 0.0);
            for (a, b) in [(camera.right, camera.up), (camera.up, camera.forward)] {
                prop_assert!(dot(a, b).abs() < 1e-12);
                prop_assert!((dot(a, a) - 1.0).abs() < 1e-12);
            }
        }
    }

    /// Seen from the south, east is to the right.
    #[test]
    fn the_world_is_not_mirrored() {
        let shot = OrbitCamera {
            target: [0.0; 3],
            azimuth: -std::f64::consts::FRAC_PI_2,
            elevation: 0.3,
            distance: 10.0,
        };
        assert!(shot.camera().view([1.0, 0.0, 0.0])[0] > 0.9);
        assert!(shot.camera().view([0.0, 0.0, 1.0])[1] > 0.9);
    }
}
