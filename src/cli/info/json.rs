//! The same for other programs: an object with what the page tells, unrounded.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::format::crs;
use crate::format::las::Header;
use crate::format::potree::{self, Metadata, Node};

/// What a LAS or LAZ file says of itself.
pub(super) fn las(path: &Path, header: &Header) -> Value {
    let field = |field: &crate::octree::attribute::ExtraField| {
        json!({
            "name": field.name,
            "type": field.scalar,
            "elements": field.elements,
            "description": field.description,
        })
    };
    let has_times = !matches!(header.point_format, 0 | 2);
    json!({
        "kind": if header.compressed { "LAZ" } else { "LAS" },
        "path": path,
        "version": format!("{}.{}", header.version.0, header.version.1),
        "point_format": header.point_format,
        "compressed": header.compressed,
        "bytes": header.file_bytes,
        "record_bytes": header.record_length,
        "points": header.points,
        "points_missing": header.missing,
        "points_by_return": header.returns,
        "scale": header.scale,
        "offset": header.offset,
        "min": header.min,
        "max": header.max,
        "software": header.software,
        "system": header.system,
        "created": header.created.map(|created| json!({ "year": created.year, "day": created.day })),
        "crs": header.crs.as_ref().map(|found| json!({
            "source": found.source.name(),
            "text": found.text,
            "proj4": crs::proj4(&found.text),
        })),
        "gps_times": has_times.then(|| header.gps_time.describe()),
        "extra_bytes": header.extra.iter().map(field).collect::<Vec<_>>(),
        "notes": header.notes,
    })
}

/// What an octree's files say of it: its metadata, and its nodes by level.
pub(super) fn octree(folder: &Path, metadata: &Metadata, nodes: &[Node]) -> Value {
    let deepest = nodes.iter().map(|node| node.name.level()).max().unwrap_or(0);
    let level = |level: u8| {
        let of_level = nodes.iter().filter(move |node| node.name.level() == level);
        json!({
            "level": level,
            "spacing": metadata.spacing / f64::from(level).exp2(),
            "nodes": of_level.clone().count(),
            "leaves": of_level.clone().filter(|node| node.child_mask == 0).count(),
            "points": of_level.map(|node| u64::from(node.points)).sum::<u64>(),
        })
    };
    let bytes = fs::metadata(folder.join(potree::OCTREE)).map_or(0, |file| file.len());
    json!({
        "kind": "octree",
        "path": folder,
        "points": metadata.points,
        "octree_bytes": bytes,
        "nodes": nodes.len(),
        "levels": (0..=deepest).map(level).collect::<Vec<_>>(),
        "metadata": metadata,
    })
}

/// JSON as it is printed.
pub fn pretty(value: &serde_json::Value) -> String {
    format!("{value:#}\n")
}
