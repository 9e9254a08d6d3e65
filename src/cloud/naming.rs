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

/// Names that mean something to viewers and to whoever verifies: a field of extra
/// bytes never gets one of them, not even where the point format or the options
/// leave it free.
fn is_reserved(name: &str) -> bool {
    matches!(name, "position" | "rgba" | "POSITION_CARTESIAN") || ORDER.contains(&name)
}

/// Standard attributes in the order viewers list them, then the others in the
/// order in which they were met.
pub(super) fn viewing_order(merged: &[(Attribute, bool)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..merged.len()).collect();
    order.sort_by_key(|i| ORDER.iter().position(|name| *name == merged[*i].0.name).unwrap_or(ORDER.len()));
    order
}
