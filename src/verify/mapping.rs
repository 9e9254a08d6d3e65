//! From a LAS record to the record that an octree should hold for it: the
//! bits of each attribute by the tables of LAS 1.4 R15 (7 to 17), written down
//! here once more, independent of the converter's own.

use crate::format::las::Header;
use crate::octree::attribute::{Attribute, ExtraField, Scalar, Schema};

use super::octree::OctreeUnderTest;
use super::report::PositionError;

/// Where an attribute's value stands in a LAS record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FieldSource {
    Bytes {
        at: usize,
        length: usize,
    },
    Bits {
        at: usize,
        shift: u8,
        mask: u8,
    },
    /// Whole degrees, which become units of 0.006.
    Degrees {
        at: usize,
    },
}

impl FieldSource {
    fn is_zero(self, record: &[u8]) -> bool {
        match self {
            FieldSource::Bytes { at, length } => record[at..at + length].iter().all(|&byte| byte == 0),
            FieldSource::Bits { at, shift, mask } => record[at] >> shift & mask == 0,
            FieldSource::Degrees { at } => record[at] == 0,
        }
    }

    fn copy(self, record: &[u8], to: &mut [u8]) {
        match self {
            FieldSource::Bytes { at, length } => to[..length].copy_from_slice(&record[at..at + length]),
            FieldSource::Bits { at, shift, mask } => to[0] = record[at] >> shift & mask,
            FieldSource::Degrees { at } => {
                let angle = (f64::from(record[at] as i8) / 0.006).round() as i16;
                to[..2].copy_from_slice(&angle.to_le_bytes());
            }
        }
    }
}

/// A standard attribute: its name, type and place.
struct StandardAttribute(&'static str, Scalar, usize, FieldSource);

const fn bits(at: usize, shift: u8, width: u8) -> FieldSource {
    FieldSource::Bits { at, shift, mask: ((1u16 << width) - 1) as u8 }
}

const fn bytes(at: usize, length: usize) -> FieldSource {
    FieldSource::Bytes { at, length }
}

/// The names that mean the standard's own fields, or averages of them, wherever
/// they occur; an extra field of such a name is stored under another.
const STANDARD: [&str; 27] = [
    "position",
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
    "rgb",
    "rgb average",
    "rgb original",
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
    "rgba",
    "POSITION_CARTESIAN",
];

/// The standard fields of a point format, but for the position.
fn standard_fields(format: u8) -> Vec<StandardAttribute> {
    let mut fields = vec![StandardAttribute("intensity", Scalar::U16, 1, bytes(12, 2))];
    let (gps_time, rgb, nir, waveform) = if format < 6 {
        fields.extend([
            StandardAttribute("return number", Scalar::U8, 1, bits(14, 0, 3)),
            StandardAttribute("number of returns", Scalar::U8, 1, bits(14, 3, 3)),
            StandardAttribute("scan direction flag", Scalar::U8, 1, bits(14, 6, 1)),
            StandardAttribute("edge of flight line", Scalar::U8, 1, bits(14, 7, 1)),
            StandardAttribute("classification", Scalar::U8, 1, bits(15, 0, 5)),
            StandardAttribute("classification flags", Scalar::U8, 1, bits(15, 5, 3)),
            StandardAttribute("scan angle rank", Scalar::U8, 1, bytes(16, 1)),
            StandardAttribute("user data", Scalar::U8, 1, bytes(17, 1)),
            StandardAttribute("point source id", Scalar::U16, 1, bytes(18, 2)),
        ]);
        match format {
            1 => (Some(20), None, None, None),
            2 => (None, Some(20), None, None),
            3 => (Some(20), Some(28), None, None),
            4 => (Some(20), None, None, Some(28)),
            5 => (Some(20), Some(28), None, Some(34)),
            _ => (None, None, None, None),
        }
    } else {
        fields.extend([
            StandardAttribute("return number", Scalar::U8, 1, bits(14, 0, 4)),
            StandardAttribute("number of returns", Scalar::U8, 1, bits(14, 4, 4)),
            StandardAttribute("classification flags", Scalar::U8, 1, bits(15, 0, 4)),
            StandardAttribute("scanner channel", Scalar::U8, 1, bits(15, 4, 2)),
            StandardAttribute("scan direction flag", Scalar::U8, 1, bits(15, 6, 1)),
            StandardAttribute("edge of flight line", Scalar::U8, 1, bits(15, 7, 1)),
            StandardAttribute("classification", Scalar::U8, 1, bytes(16, 1)),
            StandardAttribute("user data", Scalar::U8, 1, bytes(17, 1)),
            StandardAttribute("scan angle", Scalar::I16, 1, bytes(18, 2)),
            StandardAttribute("point source id", Scalar::U16, 1, bytes(20, 2)),
        ]);
        match format {
            7 => (Some(22), Some(30), None, None),
            8 => (Some(22), Some(30), Some(36), None),
            9 => (Some(22), None, None, Some(30)),
            10 => (Some(22), Some(30), Some(36), Some(38)),
            _ => (Some(22), None, None, None),
        }
    };
    fields.extend(gps_time.map(|at| StandardAttribute("gps-time", Scalar::F64, 1, bytes(at, 8))));
    fields.extend(rgb.map(|at| StandardAttribute("rgb", Scalar::U16, 3, bytes(at, 6))));
    fields.extend(nir.map(|at| StandardAttribute("nir", Scalar::U16, 1, bytes(at, 2))));
    if let Some(at) = waveform {
        fields.extend([
            StandardAttribute("wave packet descriptor index", Scalar::U8, 1, bytes(at, 1)),
            StandardAttribute("byte offset to waveform data", Scalar::U64, 1, bytes(at + 1, 8)),
            StandardAttribute("waveform packet size", Scalar::U32, 1, bytes(at + 9, 4)),
            StandardAttribute("return point waveform location", Scalar::F32, 1, bytes(at + 13, 4)),
            StandardAttribute("x(t)", Scalar::F32, 1, bytes(at + 17, 4)),
            StandardAttribute("y(t)", Scalar::F32, 1, bytes(at + 21, 4)),
            StandardAttribute("z(t)", Scalar::F32, 1, bytes(at + 25, 4)),
        ]);
    }
    fields
}

/// How positions of a file come onto the octree's lattice, on one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
enum PositionMapping {
    /// Whole numbers of units in whole numbers of units.
    Exact { factor: i64, shift: i64 },
    /// Through world coordinates, to the nearest unit.
    Rounded { scale: f64, offset: f64, to_scale: f64, to_offset: f64 },
}

impl PositionMapping {
    fn new(scale: f64, offset: f64, to_scale: f64, to_offset: f64) -> PositionMapping {
        let (factor, shift) = (scale / to_scale, (offset - to_offset) / to_scale);
        // The noise of decimal fractions as floats; it grows with the offsets.
        let noise = 1e-6 + 4.0 * f64::EPSILON * (offset.abs() + to_offset.abs()) / to_scale;
        let drift = (factor - factor.round()).abs() * f64::from(i32::MAX);
        let is_exact = factor.round().abs() >= 1.0
            && factor.abs() < 2e9
            && drift < 1e-3
            && noise < 0.05
            && shift.abs() < 1e17
            && (shift - shift.round()).abs() <= noise;
        match is_exact {
            true => PositionMapping::Exact { factor: factor.round() as i64, shift: shift.round() as i64 },
            false => PositionMapping::Rounded { scale, offset, to_scale, to_offset },
        }
    }

    /// The lattice index, and how many units it lies beside the true place.
    fn index(self, position: i32) -> (f64, f64) {
        match self {
            PositionMapping::Exact { factor, shift } => ((i64::from(position) * factor + shift) as f64, 0.0),
            PositionMapping::Rounded { scale, offset, to_scale, to_offset } => {
                let exact = (f64::from(position) * scale + offset - to_offset) / to_scale;
                (exact.round(), (exact - exact.round()).abs())
            }
        }
    }
}

/// How the records of one file become records of the octree.
#[derive(Debug)]
pub struct Mapping {
    axes: [PositionMapping; 3],
    scale: [f64; 3],
    to_scale: [f64; 3],
    /// Where a value comes from and goes to.
    steps: Vec<(FieldSource, usize)>,
    /// Fields of the file for which the octree has no attribute.
    pub left: Vec<(String, LeftOut)>,
    /// Standard attributes that the octree has in another type.
    pub mistyped: Vec<String>,
    record_length: usize,
    record_size: usize,
}

/// A field that the octree does not have: it may only be zero.
#[derive(Debug, Clone, Copy)]
pub struct LeftOut(FieldSource);

/// What became of a slice's points beside their records.
#[derive(Debug, Clone, Default)]
pub struct Converted {
    pub position: PositionError,
    /// Positions that no 32-bit lattice index reaches.
    pub unreachable: u64,
    /// Points in which a field without an attribute is not zero, in the order
    /// of [`Mapping::left`].
    pub lost: Vec<u64>,
}

impl Mapping {
    pub fn new(header: &Header, octree: &OctreeUnderTest) -> Mapping {
        let OctreeUnderTest { metadata, schema, colors, .. } = octree;
        let axis = |a: usize| {
            PositionMapping::new(header.scale[a], header.offset[a], metadata.scale[a], metadata.offset[a])
        };
        let mut mapping = Mapping {
            axes: [axis(0), axis(1), axis(2)],
            // A negative scale only mirrors the integers.
            scale: header.scale.map(f64::abs),
            to_scale: metadata.scale,
            steps: Vec::new(),
            left: Vec::new(),
            mistyped: Vec::new(),
            record_length: header.record_length,
            record_size: schema.record_size(),
        };
        for StandardAttribute(name, scalar, elements, source) in standard_fields(header.point_format) {
            let name = colors.as_ref().filter(|_| name == "rgb").map_or(name, |colors| colors.own);
            match schema.attributes.iter().find(|a| a.name == name) {
                Some(a) if (a.scalar, a.elements) == (scalar, elements) => mapping.take(schema, name, source),
                Some(_) => mapping.mistyped.push(name.to_string()),
                // COPC of other programs has no place for whole degrees.
                None if name == "scan angle rank" && has_angle(octree) => {
                    mapping.take(schema, "scan angle", FieldSource::Degrees { at: 16 });
                }
                None => mapping.left.push((name.to_string(), LeftOut(source))),
            }
        }
        let mut taken = Vec::new();
        for field in &header.extra {
            let source = bytes(field.position, field.scalar.size() * field.elements);
            match attribute_of(field, schema, &taken) {
                Some(name) => {
                    taken.push(name);
                    mapping.take(schema, name, source);
                }
                None => mapping.left.push((field.name.clone(), LeftOut(source))),
            }
        }
        mapping
    }

    fn take(&mut self, schema: &Schema, name: &str, source: FieldSource) {
        self.steps.extend(schema.offset_of(name).map(|to| (source, to)));
    }

    /// Turns raw records into the octree's; what was in `out` is replaced.
    pub fn convert(&self, raw: &[u8], out: &mut Vec<u8>) -> Converted {
        let mut converted = Converted { lost: vec![0; self.left.len()], ..Converted::default() };
        out.clear();
        out.resize(raw.len() / self.record_length * self.record_size, 0);
        let mut worst = [0.0f64; 3];
        for (raw, record) in raw.chunks_exact(self.record_length).zip(out.chunks_exact_mut(self.record_size))
        {
            for axis in 0..3 {
                let place = raw[4 * axis..].first_chunk().map_or(0, |b| i32::from_le_bytes(*b));
                let (index, error) = self.axes[axis].index(place);
                worst[axis] = worst[axis].max(error);
                // Saturates: an unreachable position stays one that is not there.
                converted.unreachable += u64::from(f64::from(index as i32) != index);
                record[4 * axis..4 * axis + 4].copy_from_slice(&(index as i32).to_le_bytes());
            }
            for &(source, to) in &self.steps {
                source.copy(raw, &mut record[to..]);
            }
            for (count, (_, LeftOut(source))) in converted.lost.iter_mut().zip(&self.left) {
                *count += u64::from(!source.is_zero(raw));
            }
        }
        converted.position = self.position_error(worst);
        converted
    }

    /// Errors in units of the octree as errors in all units. What the rounding
    /// of floats makes is none.
    fn position_error(&self, worst: [f64; 3]) -> PositionError {
        let mut error = PositionError::default();
        for (axis, &units) in worst.iter().enumerate() {
            if units > 1e-6 {
                let world = units * self.to_scale[axis];
                error.world[axis] = world;
                error.octree_units = error.octree_units.max(units);
                error.input_units = error.input_units.max(world / self.scale[axis]);
            }
        }
        error
    }
}

impl PositionError {
    pub fn merge(&mut self, other: PositionError) {
        self.world.iter_mut().zip(other.world).for_each(|(a, b)| *a = a.max(b));
        self.octree_units = self.octree_units.max(other.octree_units);
        self.input_units = self.input_units.max(other.input_units);
    }
}

fn has_angle(octree: &OctreeUnderTest) -> bool {
    let is_angle = |a: &Attribute| (a.name.as_str(), a.scalar) == ("scan angle", Scalar::I16);
    octree.copc().is_some() && octree.schema.attributes.iter().any(is_angle)
}

/// The attribute under which an extra field is stored: of its type, and called
/// like it, or like it with a number in brackets where the name was taken. Of
/// several the one with the field's own scale and offset.
fn attribute_of<'a>(field: &ExtraField, schema: &'a Schema, taken: &[&str]) -> Option<&'a str> {
    let is_named_so = |attribute: &&Attribute| match attribute.name.strip_prefix(field.name.as_str()) {
        Some("") => !STANDARD.contains(&attribute.name.as_str()),
        Some(rest) => rest.strip_prefix(" (").and_then(|r| r.strip_suffix(')')).is_some_and(is_number),
        None => false,
    };
    let fits = |a: &&Attribute| (a.scalar, a.elements) == (field.scalar, field.elements);
    let is_free = |a: &&Attribute| !taken.contains(&a.name.as_str());
    let candidates: Vec<&Attribute> =
        schema.attributes.iter().filter(is_named_so).filter(fits).filter(is_free).collect();
    let or = |list: &[f64], default: f64| match list.is_empty() {
        true => vec![default; field.elements],
        false => list.to_vec(),
    };
    let same = |a: &&&Attribute| a.scale == or(&field.scale, 1.0) && a.offset == or(&field.offset, 0.0);
    candidates.iter().find(same).or(candidates.first()).map(|attribute| attribute.name.as_str())
}

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_fill_their_format() {
        for format in 0..=10 {
            let length = crate::format::las::record_length(format).unwrap();
            let mut covered = vec![0u8; length];
            covered[..12].fill(0xff);
            for StandardAttribute(name, scalar, elements, source) in standard_fields(format) {
                assert!(STANDARD.contains(&name), "{name}");
                match source {
                    FieldSource::Bytes { at, length } => {
                        assert_eq!(length, scalar.size() * elements, "{name}");
                        assert!(covered[at..at + length].iter().all(|&c| c == 0), "{name}");
                        covered[at..at + length].fill(0xff);
                    }
                    FieldSource::Bits { at, shift, mask } => {
                        assert_eq!(covered[at] & mask << shift, 0, "{name}");
                        covered[at] |= mask << shift;
                    }
                    FieldSource::Degrees { .. } => unreachable!("no field of a format"),
                }
            }
            assert!(covered.iter().all(|&c| c == 0xff), "format {format}: {covered:x?}");
        }
    }

    #[test]
    fn lattices_of_decimal_fractions_are_exact() {
        let axis = PositionMapping::new(0.01, 4_500_000.3, 0.001, 4_499_999.871);
        assert_eq!(axis, PositionMapping::Exact { factor: 10, shift: 429 });
        assert!(matches!(PositionMapping::new(0.001, 0.0, 0.01, 0.0), PositionMapping::Rounded { .. }));
        assert!(matches!(PositionMapping::new(0.001, 0.0004, 0.001, 0.0), PositionMapping::Rounded { .. }));
        let (index, error) = PositionMapping::new(0.001, 0.0004, 0.001, 0.0).index(7);
        assert_eq!(index, 7.0);
        assert!((error - 0.4).abs() < 1e-9);
    }

    #[test]
    fn extra_fields_find_their_attributes() {
        let scaled =
            |name: &str, scale: f64| Attribute { scale: vec![scale], ..Attribute::new(name, Scalar::U16, 1) };
        let schema = Schema {
            attributes: vec![
                Attribute::new("intensity", Scalar::U16, 1),
                scaled("intensity (2)", 1.0),
                scaled("a", 1.0),
                scaled("a (2)", 0.5),
                Attribute::new("a (b)", Scalar::U16, 1),
            ],
        };
        let field = |name: &str, scale: &[f64]| ExtraField {
            name: name.into(),
            description: String::new(),
            scalar: Scalar::U16,
            elements: 1,
            position: 30,
            scale: scale.to_vec(),
            offset: vec![],
        };
        assert_eq!(attribute_of(&field("intensity", &[]), &schema, &[]), Some("intensity (2)"));
        assert_eq!(attribute_of(&field("a", &[0.5]), &schema, &[]), Some("a (2)"));
        assert_eq!(attribute_of(&field("a", &[]), &schema, &[]), Some("a"));
        assert_eq!(attribute_of(&field("a", &[]), &schema, &["a"]), Some("a (2)"));
        assert_eq!(attribute_of(&field("b", &[]), &schema, &[]), None);
    }
}
