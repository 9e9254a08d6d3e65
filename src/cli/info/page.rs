//! The pages of `lodestone info`, as text.

use std::fmt::{self, Write};
use std::fs;
use std::path::Path;

use crate::format::las::Header;
use crate::format::potree::{self, Metadata, MetadataAttribute, Node};
use crate::octree::attribute::Scalar;
use crate::words::{self, Plain, grouped};

/// A page of lines, each with a title.
#[derive(Default)]
pub struct InfoPage(pub String);

impl InfoPage {
    pub fn line(&mut self, title: &str, text: impl fmt::Display) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "{title:<14} {}", Plain(text));
    }

    /// A text of several lines, under one title.
    pub fn block(&mut self, title: &str, text: &str) {
        for (index, line) in text.lines().enumerate() {
            self.line(if index == 0 { title } else { "" }, line);
        }
    }
}

pub fn octree_page(folder: &Path, metadata: &Metadata, nodes: &[Node]) -> String {
    let bytes = fs::metadata(folder.join(potree::OCTREE)).map_or(0, |file| file.len());
    let mut page = InfoPage::default();
    page.line("octree", folder.display());
    page.line("name", or_none(&metadata.name));
    if !metadata.description.is_empty() {
        page.block("description", &metadata.description);
    }
    if let Some(generator) = &metadata.generator {
        page.line(
            "made by",
            format!("{} {}, sampling {}", generator.name, generator.version, generator.sampling),
        );
        match generator.lod_color.as_deref() {
            None => {}
            Some("average") => {
                page.line("", "rgb holds averages on coarse levels, rgb original the points' own")
            }
            Some("attribute") => page.line("", "rgb average holds averages on coarse levels"),
            Some(other) => page.line("", format!("colours of coarse levels: {other}")),
        }
    }
    page.line("points", grouped(metadata.points));
    let encoding = match metadata.encoding {
        potree::PotreeEncoding::Default => "DEFAULT",
        potree::PotreeEncoding::Brotli => "BROTLI",
    };
    let each = bytes as f64 / metadata.points.max(1) as f64;
    page.line("points file", format!("{} bytes, {encoding}, {each:.1} bytes a point", grouped(bytes)));
    let position = metadata.attributes.iter().find(|attribute| attribute.name == "position");
    if let Some([min, max]) = position.and_then(tight_box) {
        extent(&mut page, min, max, metadata.scale);
    }
    let bounds = &metadata.bounding_box;
    let sides: [f64; 3] = std::array::from_fn(|axis| bounds.max[axis] - bounds.min[axis]);
    page.line("root cube", coordinates(sides, metadata.scale));
    page.line("", format!("from {}", coordinates(bounds.min, metadata.scale)));
    page.line("scale", join(metadata.scale));
    page.line("offset", join(metadata.offset));
    page.line("CRS", one_line(or_none(metadata.crs())));
    if !metadata.crs.is_empty() {
        page.line("projection", one_line(or_none(&metadata.projection)));
    }
    page.0.push('\n');
    let rows: Vec<(u8, bool, u32)> =
        nodes.iter().map(|node| (node.name.level(), node.child_mask == 0, node.points)).collect();
    levels(&mut page, metadata.spacing, &rows);
    page.0.push('\n');
    attributes(&mut page, metadata);
    page.0
}

fn tight_box(position: &MetadataAttribute) -> Option<[[f64; 3]; 2]> {
    Some([*position.min.first_chunk()?, *position.max.first_chunk()?])
}

/// A table of the levels: spacing, nodes, leaves, points. A node is its level, whether it is
/// a leaf, and its points.
pub fn levels(page: &mut InfoPage, spacing: f64, nodes: &[(u8, bool, u32)]) {
    let deepest = nodes.iter().map(|node| node.0).max().unwrap_or(0);
    page.line("level", format!("{:>12} {:>12} {:>12} {:>16}", "spacing", "nodes", "leaves", "points"));
    let row = |level: Option<u8>| {
        let of_level = nodes.iter().filter(move |node| level.is_none_or(|level| node.0 == level));
        let leaves = of_level.clone().filter(|node| node.1).count() as u64;
        let points = of_level.clone().map(|node| u64::from(node.2)).sum();
        (of_level.count() as u64, leaves, points)
    };
    for level in (0..=deepest).map(Some).chain([None]) {
        let (count, leaves, points) = row(level);
        let spacing = level.map_or(String::new(), |level| match spacing / f64::from(level).exp2() {
            spacing if spacing.abs() >= 1e9 => words::number(spacing),
            spacing => format!("{spacing:.6}"),
        });
        let title = level.map_or("all".to_string(), |level| level.to_string());
        let (count, leaves, points) = (grouped(count), grouped(leaves), grouped(points));
        page.line(&title, format!("{spacing:>12} {count:>12} {leaves:>12} {points:>16}"));
    }
}

fn attributes(page: &mut InfoPage, metadata: &Metadata) {
    let longest = metadata.attributes.iter().map(|a| a.name.chars().count()).max().unwrap_or(0);
    for (index, attribute) in metadata.attributes.iter().enumerate() {
        let kind = match attribute.value_type.unwrap_or(attribute.kind).into() {
            Scalar::F32 => "float".to_string(),
            Scalar::F64 => "double".to_string(),
            scalar => format!("{scalar:?}").to_lowercase().replace('i', "int").replace('u', "uint"),
        };
        let halves = if attribute.value_type.is_some() { 2 } else { 1 };
        let elements = match attribute.num_elements / halves {
            1 => kind,
            elements => format!("{kind} x{elements}"),
        };
        let end = |values: &[f64]| match (<[f64; 3]>::try_from(values), Scalar::from(attribute.kind)) {
            (Ok(place), _) if attribute.name == "position" => coordinates(place, metadata.scale),
            (_, Scalar::F32) => join_by(values, |value| words::number_32(value as f32)),
            _ => join(values),
        };
        // Halves say nothing of the range of the whole.
        let range = match attribute.value_type {
            Some(_) => String::new(),
            None => format!("{} to {}", end(&attribute.min), end(&attribute.max)),
        };
        let title = if index == 0 { "attributes" } else { "" };
        page.line(title, format!("{:<longest$}  {elements:<10}  {range}", attribute.name));
    }
}

pub fn las_page(path: &Path, header: &Header) -> String {
    let mut page = InfoPage::default();
    page.line("file", path.display());
    let kind = if header.compressed { "LAZ" } else { "LAS" };
    let (major, minor) = header.version;
    page.line("format", format!("{kind} {major}.{minor}, point format {}", header.point_format));
    page.line("size", format!("{} bytes, records of {}", grouped(header.file_bytes), header.record_length));
    page.line("points", grouped(header.points));
    extent(&mut page, header.min, header.max, header.scale);
    page.line("scale", join(header.scale));
    page.line("offset", join(header.offset));
    page.line("software", or_none(&header.software));
    page.line("system", or_none(&header.system));
    let created = header.created.map(|created| format!("day {} of {}", created.day, created.year));
    page.line("created", created.as_deref().unwrap_or("-"));
    match &header.crs {
        Some(crs) => {
            let source = if crs.source.name() == "WKT" { "WKT" } else { "keys" };
            page.line(&format!("CRS ({source})"), one_line(&crs.text));
        }
        None => page.line("CRS", "-"),
    }
    if !matches!(header.point_format, 0 | 2) {
        page.line("GPS times", header.gps_time.describe());
    }
    for (index, field) in header.extra.iter().enumerate() {
        let title = if index == 0 { "extra bytes" } else { "" };
        let text = format!("{}, {:?} x{} {}", field.name, field.scalar, field.elements, field.description);
        page.line(title, text.trim_end());
    }
    for (index, note) in header.notes.iter().enumerate() {
        page.line(if index == 0 { "notes" } else { "" }, note);
    }
    page.0
}

fn extent(page: &mut InfoPage, min: [f64; 3], max: [f64; 3], scale: [f64; 3]) {
    page.line("from", coordinates(min, scale));
    page.line("to", coordinates(max, scale));
    let size: [f64; 3] = std::array::from_fn(|axis| max[axis] - min[axis]);
    page.line("extent", coordinates(size, scale));
}

/// Coordinates with as many decimals as their unit has.
pub fn coordinates(values: [f64; 3], scale: [f64; 3]) -> String {
    let [x, y, z] = [0, 1, 2].map(|axis| words::coordinate(values[axis], scale[axis]));
    format!("{x} {y} {z}")
}

fn join(values: impl AsRef<[f64]>) -> String {
    join_by(values, words::number)
}

fn join_by(values: impl AsRef<[f64]>, text: impl Fn(f64) -> String) -> String {
    values.as_ref().iter().map(|value| text(*value)).collect::<Vec<_>>().join(" ")
}

/// A text of several lines, as WKT may be, on one.
fn one_line(text: &str) -> String {
    text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

fn or_none(text: &str) -> &str {
    if text.is_empty() { "-" } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_coordinate_has_the_decimals_of_its_axis() {
        assert_eq!(coordinates([1.23456, 2.0, 3.5], [0.01, 1e-7, 1.0]), "1.23 2.0000000 4");
        assert_eq!(join([f64::MIN, 0.5]), "-1.7976931348623157e308 0.5");
    }

    #[test]
    fn wkt_stands_on_one_line() {
        assert_eq!(one_line("PROJCS[\"a\",\r\n  GEOGCS[\n\"b\"]]\n"), "PROJCS[\"a\", GEOGCS[ \"b\"]]");
    }
}
