//! metadata.json: exactly the keys that viewers know, and four of our own that
//! they skip: `generator`, who made the octree and by which rule; `crs`, the whole
//! coordinate reference system; `gpsTimeOffset`, what GPS times count from where
//! that is unusual; and `valueType` of an attribute whose 64-bit integers are
//! declared in halves.
//!
//! Viewers have no reader for 64-bit integers: one such attribute makes their
//! decoder stop, and the whole cloud stays invisible. So it is declared as twice
//! as many uint32, low half first, which are the same bytes; `valueType` tells
//! our reader what they are.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::{PotreeError, Result};
use super::json;
use crate::octree::attribute::{Attribute, Scalar, Schema};
use crate::octree::statistics::AttributeStatistics;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Metadata {
    pub version: String,
    #[serde(default)]
    pub name: String,
    #[serde(default)]
    pub description: String,
    /// Points of the whole octree.
    pub points: u64,
    /// A proj4 string, for the horizontal part of the coordinate reference system;
    /// empty where there is none. Viewers hand it to a proj4.js that reads nothing
    /// else, on every frame.
    #[serde(default)]
    pub projection: String,
    /// The whole coordinate reference system: WKT, or what is known of it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub crs: String,
    /// GPS times are standard GPS time minus so many 10^6 seconds (LAS 1.5); 1000
    /// where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gps_time_offset: Option<u16>,
    pub hierarchy: HierarchyEntry,
    /// World = position × scale + offset.
    pub offset: [f64; 3],
    pub scale: [f64; 3],
    /// Spacing of the root, in world units; half as much each level down.
    pub spacing: f64,
    /// The root's cube, in world units.
    pub bounding_box: BoundingBox,
    pub encoding: PotreeEncoding,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub generator: Option<Generator>,
    pub attributes: Vec<MetadataAttribute>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct HierarchyEntry {
    /// Bytes.
    pub first_chunk_size: u64,
    /// Levels of a chunk.
    pub step_size: u32,
    /// Level of the deepest node.
    pub depth: u32,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoundingBox {
    pub min: [f64; 3],
    pub max: [f64; 3],
}

/// How points are stored in octree.bin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum PotreeEncoding {
    /// Records one behind the other.
    #[serde(alias = "UNCOMPRESSED")]
    Default,
    /// One brotli stream a node.
    Brotli,
}

/// Who made the octree, and what may be expected of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Generator {
    pub name: String,
    #[serde(default)]
    pub version: String,
    /// `poisson`, `shells`: no two points of an inner node closer than its spacing;
    /// `random`, `nearest`: at most one in each cell of an inner node's 128³ grid.
    #[serde(default)]
    pub sampling: String,
    /// `attribute`: the points of coarse levels have the mean of the colours that
    /// they stand for in `rgb average`; `average`: in `rgb`, and their own in `rgb
    /// original`. None: their own in `rgb`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lod_color: Option<String>,
    /// Attributes of the inputs that were left out on request.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct MetadataAttribute {
    pub name: String,
    #[serde(default)]
    pub description: String,
    /// Bytes a point.
    pub size: usize,
    pub num_elements: usize,
    /// Bytes an element.
    pub element_size: usize,
    #[serde(rename = "type")]
    pub kind: ScalarKind,
    /// `int64` or `uint64` where the elements are halves of such integers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value_type: Option<ScalarKind>,
    /// Points per value, of one-byte attributes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub histogram: Option<Vec<u64>>,
    /// Of `position` in world units; of all others as stored.
    pub min: Vec<f64>,
    pub max: Vec<f64>,
    #[serde(default)]
    pub scale: Vec<f64>,
    #[serde(default)]
    pub offset: Vec<f64>,
}

/// The names that metadata.json has for scalars.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ScalarKind {
    Int8,
    Int16,
    Int32,
    Int64,
    Uint8,
    Uint16,
    Uint32,
    Uint64,
    Float,
    Double,
}

impl From<Scalar> for ScalarKind {
    fn from(scalar: Scalar) -> ScalarKind {
        match scalar {
            Scalar::I8 => ScalarKind::Int8,
            Scalar::U8 => ScalarKind::Uint8,
            Scalar::I16 => ScalarKind::Int16,
            Scalar::U16 => ScalarKind::Uint16,
            Scalar::I32 => ScalarKind::Int32,
            Scalar::U32 => ScalarKind::Uint32,
            Scalar::I64 => ScalarKind::Int64,
            Scalar::U64 => ScalarKind::Uint64,
            Scalar::F32 => ScalarKind::Float,
            Scalar::F64 => ScalarKind::Double,
        }
    }
}

impl From<ScalarKind> for Scalar {
    fn from(kind: ScalarKind) -> Scalar {
        match kind {
            ScalarKind::Int8 => Scalar::I8,
            ScalarKind::Uint8 => Scalar::U8,
            ScalarKind::Int16 => Scalar::I16,
            ScalarKind::Uint16 => Scalar::U16,
            ScalarKind::Int32 => Scalar::I32,
            ScalarKind::Uint32 => Scalar::U32,
            ScalarKind::Int64 => Scalar::I64,
            ScalarKind::Uint64 => Scalar::U64,
            ScalarKind::Float => Scalar::F32,
            ScalarKind::Double => Scalar::F64,
        }
    }
}

/// Bytes of a point at most: a LAS record is at most 65535 bytes, and second colors
/// stand beside the first.
const MOST_RECORD: usize = 66_000;
/// Attributes of a point at most.
const MOST_ATTRIBUTES: usize = 4096;

impl Metadata {
    /// Reads metadata.json of an octree's folder.
    pub fn read(folder: &Path) -> Result<Metadata> {
        let text = super::files::metadata(folder)?;
        serde_json::from_slice(&text)
            .map_err(|source| PotreeError::Json { path: folder.join(super::METADATA), source })
    }

    /// Whether its numbers can be those of an octree: finite, and above 0 where
    /// they are lengths. Who computes with them asks before.
    pub fn check_numbers(&self) -> Result<()> {
        let (min, max) = (self.bounding_box.min, self.bounding_box.max);
        let is_length = |n: f64| n > 0.0 && n.is_finite();
        if !self.scale.iter().all(|&scale| is_length(scale)) {
            return Err(invalid("a scale is not a finite number above 0"));
        }
        if !is_length(self.spacing) {
            return Err(invalid(format!("a spacing of {} is not a finite number above 0", self.spacing)));
        }
        if !self.offset.iter().all(|n| n.is_finite()) || !(0..3).all(|a| is_length(max[a] - min[a])) {
            return Err(invalid("its bounding box has no extent, or an end that is not finite"));
        }
        Ok(())
    }

    /// The text of metadata.json. Floats that JSON has no way to write (NaN,
    /// infinity) come out as 0 or the largest finite one: always valid JSON.
    pub fn to_json(&self) -> String {
        let mut metadata = self.clone();
        let attributes = metadata.attributes.iter_mut();
        let lists = attributes.flat_map(|a| [&mut a.min, &mut a.max, &mut a.scale, &mut a.offset]);
        lists.flatten().for_each(|value| *value = finite(*value, f64::MAX));
        let bounds = &mut metadata.bounding_box;
        let corners = [&mut metadata.offset, &mut metadata.scale, &mut bounds.min, &mut bounds.max];
        corners.into_iter().flatten().for_each(|value| *value = finite(*value, f64::MAX));
        metadata.spacing = finite(metadata.spacing, f64::MAX);
        // A struct's keys are strings, so there is always a page.
        json::page(&metadata).unwrap_or_default()
    }

    /// The coordinate reference system in words: octrees of older versions, and of
    /// other converters, have it as their projection.
    pub fn crs(&self) -> &str {
        if self.crs.is_empty() { &self.projection } else { &self.crs }
    }

    /// The layout of a point record, with 64-bit integers whole again.
    pub fn schema(&self) -> Result<Schema> {
        // Before anything is made for them.
        let count = self.attributes.len();
        let sizes = self.attributes.iter().map(|attribute| attribute.size.max(attribute.num_elements));
        let bytes = sizes.fold(0usize, usize::saturating_add);
        if bytes > MOST_RECORD || count > MOST_ATTRIBUTES {
            return Err(invalid(format!("points of {bytes} bytes in {count} attributes are not believable")));
        }
        let attributes =
            self.attributes.iter().map(MetadataAttribute::attribute).collect::<Result<Vec<_>>>()?;
        match attributes.first() {
            Some(a) if a.name == "position" && a.scalar == Scalar::I32 && a.elements == 3 => {}
            _ => return Err(invalid("its first attribute is not 'position' of three int32")),
        }
        let schema = Schema { attributes };
        Ok(schema)
    }
}

impl MetadataAttribute {
    /// What a record holds under this entry.
    pub fn attribute(&self) -> Result<Attribute> {
        let declared = Scalar::from(self.kind);
        let (scalar, elements) = match self.value_type {
            None => (declared, self.num_elements),
            Some(ScalarKind::Int64 | ScalarKind::Uint64)
                if declared == Scalar::U32 && self.num_elements.is_multiple_of(2) =>
            {
                (
                    if self.value_type == Some(ScalarKind::Int64) { Scalar::I64 } else { Scalar::U64 },
                    self.num_elements / 2,
                )
            }
            Some(_) => {
                return Err(invalid(format!(
                    "attribute '{}' has a valueType that its type cannot hold",
                    self.name
                )));
            }
        };
        let whole = self.element_size.checked_mul(self.num_elements);
        // A LAS record is at most 65535 bytes; nothing larger is an attribute.
        if self.element_size != declared.size()
            || whole != Some(self.size)
            || !(1..=65535).contains(&self.size)
        {
            return Err(invalid(format!(
                "attribute '{}' is said to take {} bytes, as {} elements of {} bytes and type {:?}",
                self.name, self.size, self.num_elements, self.element_size, self.kind
            )));
        }
        let per_element = |list: &[f64], default: f64| match list.len() == self.num_elements {
            true => list.iter().copied().step_by(self.num_elements / elements).collect(),
            false => vec![default; elements],
        };
        // What `declare_halves` added is about the entry, not the attribute.
        let description = match self.value_type {
            Some(_) => self.description.strip_suffix(&halves_in_words(scalar)).unwrap_or(&self.description),
            None => &self.description,
        };
        Ok(Attribute {
            name: self.name.clone(),
            description: description.trim_end_matches("; ").to_string(),
            scalar,
            elements,
            scale: per_element(&self.scale, 1.0),
            offset: per_element(&self.offset, 0.0),
        })
    }
}

fn invalid(what: impl Into<String>) -> PotreeError {
    PotreeError::Metadata(what.into())
}

/// The entry of an attribute. Its statistics are of stored values; for
/// `position`, whose `scale` and `offset` must be the lattice's, they are turned
/// into world coordinates. Where there was no value, both bounds are 0; infinite
/// bounds become the largest finite value of the type.
pub fn attribute_entry(attribute: &Attribute, statistics: &AttributeStatistics) -> MetadataAttribute {
    let limit = if attribute.scalar == Scalar::F32 { f64::from(f32::MAX) } else { f64::MAX };
    let world = |value: f64, element: usize| match attribute.name == "position" {
        true => value * attribute.scale[element] + attribute.offset[element],
        false => value,
    };
    let bounds: Vec<(f64, f64)> = (0..attribute.elements)
        .map(|element| match (statistics.min.get(element), statistics.max.get(element)) {
            (Some(&min), Some(&max)) if min <= max => {
                (finite(world(min, element), limit), finite(world(max, element), limit))
            }
            _ => (0.0, 0.0),
        })
        .collect();
    let mut entry = MetadataAttribute {
        name: attribute.name.clone(),
        description: attribute.description.clone(),
        size: attribute.size(),
        num_elements: attribute.elements,
        element_size: attribute.scalar.size(),
        kind: attribute.scalar.into(),
        value_type: None,
        histogram: statistics.histogram.clone().filter(|_| attribute.size() == 1),
        min: bounds.iter().map(|b| b.0).collect(),
        max: bounds.iter().map(|b| b.1).collect(),
        scale: attribute.scale.clone(),
        offset: attribute.offset.clone(),
    };
    if matches!(attribute.scalar, Scalar::I64 | Scalar::U64) {
        declare_halves(&mut entry, &bounds);
    }
    entry
}

/// Declares 64-bit integers as pairs of uint32. Each half has the scale and
/// offset with which the two add up to the value of the whole.
fn declare_halves(entry: &mut MetadataAttribute, bounds: &[(f64, f64)]) {
    let separator = if entry.description.is_empty() { "" } else { "; " };
    entry.description = format!("{}{separator}{}", entry.description, halves_in_words(entry.kind.into()));
    entry.value_type = Some(entry.kind);
    entry.kind = ScalarKind::Uint32;
    entry.num_elements *= 2;
    entry.element_size = 4;
    entry.scale = entry.scale.iter().flat_map(|&scale| [scale, scale * HALF]).collect();
    entry.offset = entry.offset.iter().flat_map(|&offset| [offset, 0.0]).collect();
    let halves: Vec<(f64, f64)> = bounds.iter().flat_map(|&(min, max)| range_of_halves(min, max)).collect();
    entry.min = halves.iter().map(|h| h.0).collect();
    entry.max = halves.iter().map(|h| h.1).collect();
}

fn halves_in_words(scalar: Scalar) -> String {
    let sign = if scalar == Scalar::I64 { "signed" } else { "unsigned" };
    format!("{sign} 64-bit integers in two halves, the low one first")
}

/// What one of the high half is worth.
const HALF: f64 = 4_294_967_296.0;

/// What the low and the high half of numbers in a range can be, as uint32.
fn range_of_halves(min: f64, max: f64) -> [(f64, f64); 2] {
    const WHOLE: (f64, f64) = (0.0, HALF - 1.0);
    if min >= 0.0 && max < HALF {
        return [(min, max), (0.0, 0.0)];
    }
    // Two's complement: the high half of a negative number counts from 2^32. The
    // bounds are floats, and the largest of 64 bits round up to 2^64.
    let high = |value: f64| (value / HALF).floor().rem_euclid(HALF);
    let high_max = if max >= HALF * HALF { HALF - 1.0 } else { high(max) };
    [WHOLE, if (min < 0.0) == (max < 0.0) { (high(min), high_max) } else { WHOLE }]
}

/// A number that JSON can write.
fn finite(value: f64, limit: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value.clamp(-limit, limit) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn example() -> Metadata {
        let position = Attribute {
            scale: vec![0.001; 3],
            offset: vec![500000.1, 4.1e6, 0.0],
            ..Attribute::new("position", Scalar::I32, 3)
        };
        let stat = |min: f64, max: f64| AttributeStatistics {
            min: vec![min],
            max: vec![max],
            histogram: None,
            not_finite: 0,
        };
        let box_stat = AttributeStatistics {
            min: vec![0.0; 3],
            max: vec![7.0, 8.0, 9.0],
            histogram: None,
            not_finite: 0,
        };
        let wide = Attribute::new("wide", Scalar::U64, 1);
        let time = Attribute::new("gps-time", Scalar::F64, 1);
        Metadata {
            version: "2.0".into(),
            name: "a \"name\"".into(),
            description: String::new(),
            points: 3,
            projection: String::new(),
            crs: String::new(),
            gps_time_offset: None,
            hierarchy: HierarchyEntry { first_chunk_size: 22, step_size: 4, depth: 0 },
            offset: [500000.1, 4.1e6, 0.0],
            scale: [0.001; 3],
            spacing: 1.28 / 128.0,
            bounding_box: BoundingBox { min: [0.1, 0.2, 0.3], max: [1.1, 1.2, 1.3] },
            encoding: PotreeEncoding::Default,
            generator: None,
            attributes: vec![
                attribute_entry(&position, &box_stat),
                attribute_entry(&wide, &stat(0.0, 1.5e10)),
                attribute_entry(&time, &stat(f64::NEG_INFINITY, f64::INFINITY)),
                attribute_entry(&time, &stat(f64::INFINITY, f64::NEG_INFINITY)),
            ],
        }
    }

    #[test]
    fn what_is_written_is_read_back_to_the_last_bit() {
        let mut metadata = example();
        for (exponent, value) in
            [0.1, 1.0 / 3.0, 0.30000000000000004, 8.533333333333333e15].iter().enumerate()
        {
            metadata.offset = [value * 1.1, value / 7.0, value.powi(exponent as i32)];
            let folder = tempfile::tempdir().unwrap();
            fs::write(folder.path().join(super::super::METADATA), metadata.to_json()).unwrap();
            assert_eq!(Metadata::read(folder.path()).unwrap(), metadata);
        }
    }

    #[test]
    fn keys_are_those_of_the_format_and_in_its_order() {
        insta::assert_snapshot!(example().to_json());
    }

    #[test]
    fn infinities_are_valid_json() {
        let mut metadata = example();
        metadata.spacing = f64::NAN;
        metadata.attributes[1].max = vec![f64::INFINITY, f64::NAN];
        let value: serde_json::Value = serde_json::from_str(&metadata.to_json()).unwrap();
        assert_eq!(value["attributes"][1]["max"][0], f64::MAX);
        assert_eq!(value["spacing"], 0.0);
    }

    #[test]
    fn wide_integers_come_back_whole() {
        let schema = example().schema().unwrap();
        assert_eq!(schema.attributes[1], Attribute::new("wide", Scalar::U64, 1));
        assert_eq!(schema.record_size(), 12 + 8 + 8 + 8);
    }

    #[test]
    fn halves_have_the_ranges_of_their_words() {
        let full = (0.0, 4294967295.0);
        assert_eq!(range_of_halves(3.0, 9.0), [(3.0, 9.0), (0.0, 0.0)]);
        assert_eq!(range_of_halves(3.0, 8589934592.0), [full, (0.0, 2.0)]);
        assert_eq!(range_of_halves(-1.0, 9.0), [full, full]);
        assert_eq!(range_of_halves(-2.0, -1.0), [full, (4294967295.0, 4294967295.0)]);
        assert_eq!(range_of_halves(0.0, u64::MAX as f64), [full, full]);
    }

    #[test]
    fn attributes_that_contradict_themselves_are_refused() {
        for change in [
            |a: &mut MetadataAttribute| a.size = 7,
            |a: &mut MetadataAttribute| a.num_elements = usize::MAX,
            |a: &mut MetadataAttribute| a.element_size = 0,
            |a: &mut MetadataAttribute| a.value_type = Some(ScalarKind::Float),
        ] {
            let mut metadata = example();
            change(&mut metadata.attributes[1]);
            assert!(metadata.schema().is_err());
        }
    }
}
