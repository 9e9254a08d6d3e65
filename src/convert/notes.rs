//! What a conversion notes of its points for those who look at its result.

use std::collections::BTreeMap;

use crate::convert::options::{GuardMode, Options};
use crate::convert::values::record_range::SetAsideReason;
use crate::octree::attribute::{Attribute, Schema};
use crate::octree::statistics::Statistics;

/// Says which points are not in the octree, and where they are instead.
pub(super) fn kept_out(
    set_aside: &BTreeMap<SetAsideReason, u64>,
    files: &[String],
    options: &Options,
) -> Vec<String> {
    let told = set_aside.iter().filter(|(_, points)| **points > 0).map(|(reason, points)| {
        let (count, many) = (*points, if *points == 1 { "" } else { "s" });
        match reason.mode(options) {
            GuardMode::Drop => format!("{count} point{many} dropped as {}{many}, as asked", reason.name()),
            _ => format!("{count} point{many} set aside as {}{many}, in {}", reason.name(), files.join(", ")),
        }
    });
    told.collect()
}

/// Says of points that are no return that a COPC file's header does not count them among
/// its returns.
pub(super) fn odd_returns(schema: &Schema, statistics: &Statistics) -> Option<String> {
    let is_number = |attribute: &Attribute| attribute.name == "return number";
    let found = schema.attributes.iter().position(is_number).and_then(|at| statistics.attributes.get(at));
    let none = found?.histogram.as_ref()?.first().copied().filter(|count| *count > 0)?;
    Some(format!(
        "{none} points have return number 0, which LAS does not know: kept as they are, though validators of \
         COPC complain of it"
    ))
}

/// Says which attributes have values that are no numbers: they are kept as they
/// are, but no range or color tells of them.
pub(super) fn odd_values(schema: &Schema, statistics: &Statistics) -> Vec<String> {
    let all = schema.attributes.iter().zip(&statistics.attributes);
    let odd = all.filter(|(_, statistics)| statistics.not_finite > 0);
    odd.map(|(attribute, statistics)| {
        let (name, count) = (&attribute.name, statistics.not_finite);
        let values = if count == 1 { "value that is no number" } else { "values that are no numbers" };
        format!("`{name}` has {count} {values} (NaN or infinite), kept as they are")
    })
    .collect()
}
