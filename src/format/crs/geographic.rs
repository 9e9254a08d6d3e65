//! Coordinates of a system as longitude and latitude of WGS 84.

use proj4rs::Proj;
use proj4rs::adaptors::transform_vertex_2d;

/// From one system to degrees of WGS 84 (EPSG:4326 as GeoJSON has it: longitude first).
#[derive(Debug)]
pub struct ToDegrees {
    from: Proj,
    to: Proj,
}

impl ToDegrees {
    /// From the system of a text, as [`super::proj4`] takes it; nothing if it is not known.
    pub fn new(text: &str) -> Option<ToDegrees> {
        let from = Proj::from_proj_string(&super::proj4(text)?).ok()?;
        let to = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok()?;
        Some(ToDegrees { from, to })
    }

    /// Longitude and latitude; nothing for what lies nowhere on Earth.
    pub fn apply(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        // The crate has angles in radians.
        let point = if self.from.is_latlong() { (x.to_radians(), y.to_radians()) } else { (x, y) };
        let (x, y) = transform_vertex_2d(&self.from, &self.to, point).ok()?;
        let degrees = [x.to_degrees(), y.to_degrees()];
        (degrees[0].is_finite() && degrees[0].abs() <= 180.0 && degrees[1].abs() <= 90.0).then_some(degrees)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(text: &str, from: [f64; 2], to: [f64; 2]) {
        let found = ToDegrees::new(text).unwrap().apply(from).unwrap();
        assert!((0..2).all(|i| (found[i] - to[i]).abs() < 1e-5), "{text}: {found:?}");
    }

    #[test]
    fn places_are_where_they_are() {
        near("EPSG:32633", [500_000.0, 0.0], [15.0, 0.0]);
        near("EPSG:4326", [-71.5, 42.25], [-71.5, 42.25]);
        near("EPSG:3857", [1_113_194.907_932_7, 0.0], [10.0, 0.0]);
        // The origin of Lambert-93, and of Oregon's GIC Lambert in international feet.
        near("EPSG:2154", [700_000.0, 6_600_000.0], [3.0, 46.5]);
        near("EPSG:2992", [1_312_335.958_005_249, 0.0], [-120.5, 41.75]);
        assert!(ToDegrees::new("LOCAL_CS[\"nowhere\"]").is_none());
        assert!(ToDegrees::new("EPSG:32633").unwrap().apply([1e30, f64::NAN]).is_none());
    }
}
