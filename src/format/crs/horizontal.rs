//! The horizontal part of a system, and of what kind it is.

use super::wkt::{self, WktNode};

/// The part of a system that says where on Earth, not how high.
pub(super) fn horizontal(root: &WktNode) -> Option<&WktNode> {
    match root.keyword.as_str() {
        "COMPD_CS" | "COMPOUNDCRS" => root.children().find_map(horizontal),
        "BOUNDCRS" => root.child(&["SOURCECRS"])?.children().find_map(horizontal),
        _ if root.is(wkt::PROJECTED) || root.is(wkt::GEODETIC) || root.is(&["GEOCCS"]) => Some(root),
        _ => None,
    }
}

/// Degrees, rather than a projection or meters from the Earth's center.
pub(super) fn is_ellipsoidal(node: &WktNode) -> bool {
    node.is(wkt::GEODETIC) && !is_geocentric(node)
}

pub(super) fn is_geocentric(node: &WktNode) -> bool {
    let is_cartesian =
        |cs: &WktNode| cs.words().next().is_some_and(|word| word.eq_ignore_ascii_case("Cartesian"));
    node.is(&["GEOCCS"]) || node.is(wkt::GEODETIC) && node.child(&["CS"]).is_some_and(is_cartesian)
}
