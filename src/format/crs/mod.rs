//! Coordinate reference systems as text: WKT 1 and 2, EPSG codes and proj4
//! strings; and from each to what viewers read, which is proj4 alone.
//!
//! Pure, and of bounded depth: the texts come from files.

pub mod epsg;
mod geographic;
mod horizontal;
mod methods;
mod proj4;
pub mod wkt;

pub use geographic::ToDegrees;
use horizontal::{horizontal, is_ellipsoidal};
pub use methods::geotiff_method;

/// The horizontal part of a coordinate reference system as a proj4 string, with
/// datum shift and units; nothing where it is not known well enough. `text` is
/// WKT, `EPSG:n` or a proj4 string.
pub fn proj4(text: &str) -> Option<String> {
    let text = text.trim();
    if text.starts_with('+') {
        return Some(proj4::for_viewers(text));
    }
    match code(text) {
        Some(code) => epsg::proj4(code).map(proj4::for_viewers),
        None => proj4::of_wkt(&wkt::parse(text)?),
    }
}

/// Whether coordinates are degrees of longitude and latitude.
pub fn is_geographic(text: &str) -> bool {
    let text = text.trim();
    if text.starts_with('+') {
        return text.contains("+proj=longlat") || text.contains("+proj=latlong");
    }
    match code(text) {
        Some(code) => epsg::proj4(code).is_some_and(is_geographic),
        None => wkt::parse(text).is_some_and(|root| horizontal(&root).is_some_and(is_ellipsoidal)),
    }
}

/// The WKT of what a person names: `EPSG:n`, a number alone, or WKT. Otherwise
/// why it cannot be taken.
pub fn named(text: &str) -> Result<String, String> {
    let text = text.trim();
    if let Some(code) = code(text).or_else(|| text.parse().ok()) {
        return epsg::wkt(code).map(str::to_string).ok_or_else(|| {
            format!("EPSG:{code} is not among the systems that are known here; give it as WKT")
        });
    }
    match wkt::parse(text).as_ref().and_then(horizontal) {
        Some(_) => Ok(text.to_string()),
        None => Err(format!("\"{text}\" is neither an EPSG code (EPSG:25832) nor WKT")),
    }
}

/// A projected system's WKT 1, counted in another unit; nothing if it counts in that
/// already.
pub fn in_other_units(text: &str, name: &str, meters: f64) -> Option<String> {
    let mut root = wkt::parse(text)?;
    proj4::count_in(&mut root, name, meters).then(|| root.to_string())
}

/// The code of `EPSG:n`.
fn code(text: &str) -> Option<u16> {
    let (authority, code) = text.split_once(':')?;
    authority.eq_ignore_ascii_case("epsg").then(|| code.trim().parse().ok())?
}

#[cfg(test)]
mod tests;
