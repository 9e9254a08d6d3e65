//! Which name an attribute of one file gets among those of all files, and in
//! which order they stand (FORMATS.md, the names that viewers know).

use super::attribute::{Attribute, RGB, RGB_AVERAGE, RGB_ORIGINAL};

/// Finds or adds an attribute among those of all sources. One of the same name
/// but another type, or a second one of the same file, gets a number.
pub(super) fn merge(
    merged: &mut Vec<(Attribute, bool)>,
    mut attribute: Attribute,
    used: bool,
    is_extra: bool,
    taken: &[usize],
) -> usize {
    let base = attribute.name.clone();
    let mut number = 1u64;
    loop {
        let found = merged.iter().position(|(m, _)| m.name == attribute.name);
        let reserved = is_extra && is_reserved(&attribute.name);
        match found {
            None if !reserved => {
                merged.push((attribute, used));
                return merged.len() - 1;
            }
            Some(i) if !reserved && !taken.contains(&i) && same_values(&merged[i].0, &attribute) => {
                merged[i].1 |= used;
                return i;
            }
            _ => number += 1,
        }
        attribute.name = format!("{base} ({number})");
    }
}

fn same_values(a: &Attribute, b: &Attribute) -> bool {
    (a.scalar, a.elements) == (b.scalar, b.elements) && a.scale == b.scale && a.offset == b.offset
}

/// The standard attributes behind the position, in the order viewers list them.
const ORDER: [&str; 24] = [
    "intensity",
    "return number",
    "number of returns",
    "classification flags",
    "classification",
    "scan angle rank",
    "scan angle",
    "user data",
    "point source id",
    "gps-time",
    RGB,
    RGB_AVERAGE,
    RGB_ORIGINAL,
    "nir",
    "scanner channel",
    "scan direction flag",
    "edge of flight line",
    "wave packet descriptor index",
    "byte offset to waveform data",
    "waveform packet size",
    "return point waveform location",
    "x(t)",
    "y(t)",
    "z(t)",
];

/// Names that Potree and potree-core look up in tables of their own, without the
/// blanks and in the letters of [`bare`]: the point attributes that their loaders
/// know (PointAttributes.js), those of their shaders (PotreeRenderer.js), what the
/// decoders in their workers treat apart, and the ways to color points that the
/// shader has (pointcloud.vs). A field of such a name is drawn as what it is not,
/// or the viewer stops at its size.
const VIEWER_NAMES: [&str; 34] = [
    "aextra",
    "classification",
    "color",
    "colorpacked",
    "composite",
    "depth",
    "elevation",
    "gpstime",
    "height",
    "indices",
    "intensity",
    "intensitygradient",
    "levelofdetail",
    "lod",
    "matcap",
    "normal",
    "normalfloats",
    "normaloct16",
    "normalspheremapped",
    "numberofreturns",
    "phong",
    "pointsourceid",
    "position",
    "positioncartesian",
    "returnnumber",
    "returns",
    "rgb",
    "rgba",
    "rgbandelevation",
    "rgbapacked",
    "rgbheight",
    "rgbpacked",
    "sourceid",
    "spacing",
];

/// What every object of JavaScript has: viewers keep attributes as members of
/// plain objects and would find these instead.
const OBJECT_MEMBERS: [&str; 12] = [
    "__defineGetter__",
    "__defineSetter__",
    "__lookupGetter__",
    "__lookupSetter__",
    "__proto__",
    "constructor",
    "hasOwnProperty",
    "isPrototypeOf",
    "propertyIsEnumerable",
    "toLocaleString",
    "toString",
    "valueOf",
];

/// Names that mean something to viewers and to whoever verifies: a field of extra
/// bytes never gets one of them, not even where the point format or the options
/// leave it free. Letter case and separators do not matter, since viewers have
/// several spellings and turn separators into underscores.
fn is_reserved(name: &str) -> bool {
    ORDER.iter().any(|standard| standard.eq_ignore_ascii_case(name))
        || OBJECT_MEMBERS.contains(&name)
        || VIEWER_NAMES.contains(&bare(name).as_str())
}

/// The name that a field of extra bytes had before it was numbered, if that is one that
/// no field can keep.
pub fn original_name(name: &str) -> &str {
    let base = name.strip_suffix(')').and_then(|rest| rest.rsplit_once(" ("));
    match base {
        Some((base, number)) if number.parse::<u64>().is_ok() && is_reserved(base) => base,
        _ => name,
    }
}

/// A name's letters and digits, in lower case.
fn bare(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}

/// Standard attributes in the order viewers list them, then the others in the
/// order in which they were met.
pub(super) fn viewing_order(merged: &[(Attribute, bool)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..merged.len()).collect();
    order.sort_by_key(|i| ORDER.iter().position(|name| *name == merged[*i].0.name).unwrap_or(ORDER.len()));
    order
}

#[cfg(test)]
mod tests {
    use super::super::attribute::Scalar;
    use super::*;

    #[test]
    fn extra_fields_never_take_a_viewer_s_name() {
        for name in
            ["RGBA", "color", "Color", "indices", "INDICES", "NORMAL", "return_number", "returnNumber"]
                .into_iter()
                .chain([
                    "gps-time",
                    "GPS_TIME",
                    "level of detail",
                    "source id",
                    "X(t)",
                    "constructor",
                    "__proto__",
                ])
        {
            let mut merged = Vec::new();
            merge(&mut merged, Attribute::new(name, Scalar::U32, 1), true, true, &[]);
            assert_eq!(merged[0].0.name, format!("{name} (2)"));
        }
        for name in ["confidence", "Colors", "NormalX", "xt", "normal curvature", "rgb (2)", "\u{212b}"] {
            let mut merged = Vec::new();
            merge(&mut merged, Attribute::new(name, Scalar::U32, 1), true, true, &[]);
            assert_eq!(merged[0].0.name, name);
        }
    }

    #[test]
    fn reserved_names_of_one_kind_are_shared_between_files() {
        let mut merged = Vec::new();
        let field = || Attribute::new("rgba", Scalar::U32, 1);
        assert_eq!(merge(&mut merged, field(), true, true, &[]), 0);
        assert_eq!(merge(&mut merged, field(), true, true, &[]), 0);
        assert_eq!(merge(&mut merged, field(), true, true, &[0]), 1);
        assert_eq!(merged[1].0.name, "rgba (3)");
    }
}
