//! Extra bytes: the descriptions of fields behind the standard ones of a
//! record (LAS 1.4 R15, tables 24 and 25), read and written.
//!
//! A description carries no position: the fields follow one another from the
//! end of the point format's own. Whatever a record holds beyond its last
//! described field becomes one more field, so that no byte is without a name.

use super::text;
use crate::octree::attribute::{ExtraField, Scalar};

/// Bytes of one description.
const DESCRIPTOR: usize = 192;
const HAS_SCALE: u8 = 1 << 3;
const HAS_OFFSET: u8 = 1 << 4;
/// The name and the description of the bytes that nothing describes.
pub const UNDESCRIBED: (&str, &str) = ("extra bytes", "bytes of the record that the file does not describe");

/// The types 1 to 10; 11 to 20 and 21 to 30 are two and three of them.
const SCALARS: [Scalar; 10] = [
    Scalar::U8,
    Scalar::I8,
    Scalar::U16,
    Scalar::I16,
    Scalar::U32,
    Scalar::I32,
    Scalar::U64,
    Scalar::I64,
    Scalar::F32,
    Scalar::F64,
];

/// Reads the descriptions in `data` (one slice a VLR, in file order) for
/// records of `record_length` bytes whose format takes `standard_length`.
/// Oddities go to `notes`.
pub fn parse<'a>(
    data: impl Iterator<Item = &'a [u8]>,
    standard_length: usize,
    record_length: usize,
    notes: &mut Vec<String>,
) -> Vec<ExtraField> {
    let mut fields = Vec::new();
    let mut position = standard_length;
    let descriptors = data.flat_map(|vlr| vlr.chunks_exact(DESCRIPTOR));
    for descriptor in descriptors {
        let Some(mut field) = parse_descriptor(descriptor) else {
            notes.push(format!(
                "an extra-bytes description has the unknown type {}; it and all after it are kept as plain bytes",
                descriptor[2]
            ));
            break;
        };
        let size = field.scalar.size() * field.elements;
        if size == 0 {
            continue;
        }
        if position + size > record_length {
            notes.push(format!(
                "the extra-bytes field \"{}\" of {size} bytes does not fit into the record of {record_length} bytes and is ignored",
                field.name
            ));
            break;
        }
        field.position = position;
        name_uniquely(&mut field, &fields);
        position += size;
        fields.push(field);
    }
    if position < record_length {
        let mut rest = ExtraField {
            name: UNDESCRIBED.0.to_string(),
            description: UNDESCRIBED.1.to_string(),
            scalar: Scalar::U8,
            elements: record_length - position,
            position,
            scale: Vec::new(),
            offset: Vec::new(),
        };
        name_uniquely(&mut rest, &fields);
        fields.push(rest);
    }
    fields
}

/// The descriptions that [`parse`] makes fields of, by the fields' names; those of bytes
/// that nothing describes have none.
pub fn descriptors<'a>(
    data: impl Iterator<Item = &'a [u8]>,
    fields: &[ExtraField],
) -> Vec<(String, Vec<u8>)> {
    let descriptors = data.flat_map(|vlr| vlr.chunks_exact(DESCRIPTOR));
    let of_fields = descriptors.filter(|d| parse_descriptor(d).is_none_or(|field| field.elements > 0));
    fields.iter().zip(of_fields).map(|(field, bytes)| (field.name.clone(), bytes.to_vec())).collect()
}

/// One description without its position; nothing for a type that LAS does not
/// define.
fn parse_descriptor(descriptor: &[u8]) -> Option<ExtraField> {
    let (kind, options) = (descriptor[2] as usize, descriptor[3]);
    let (scalar, elements) = match kind {
        // Type 0 are raw bytes, and the options say how many.
        0 => (Scalar::U8, options as usize),
        1..=30 => (SCALARS[(kind - 1) % 10], (kind - 1) / 10 + 1),
        _ => return None,
    };
    let doubles = |at: usize, present: u8| -> Vec<f64> {
        if kind == 0 || options & present == 0 {
            return Vec::new();
        }
        (0..elements).map(|element| double_at(descriptor, at + 8 * element)).collect()
    };
    let scale = doubles(112, HAS_SCALE);
    // A scale of zero or NaN would make every value the same; such a file
    // means that it has none.
    let scale = if scale.iter().all(|s| s.is_finite() && *s != 0.0) { scale } else { Vec::new() };
    let offset = doubles(136, HAS_OFFSET);
    let offset = if offset.iter().all(|o| o.is_finite()) { offset } else { Vec::new() };
    Some(ExtraField {
        name: text::get(&descriptor[4..36]),
        description: text::get(&descriptor[160..192]),
        scalar,
        elements,
        position: 0,
        scale,
        offset,
    })
}

fn double_at(bytes: &[u8], at: usize) -> f64 {
    let mut double = [0; 8];
    double.copy_from_slice(&bytes[at..at + 8]);
    f64::from_le_bytes(double)
}

/// Gives a field without a name one, and a second field of a name a number:
/// viewers find attributes by their names.
fn name_uniquely(field: &mut ExtraField, before: &[ExtraField]) {
    if field.name.is_empty() {
        field.name = format!("{} {}", UNDESCRIBED.0, before.len() + 1);
    }
    let name = field.name.clone();
    let mut number = 2;
    while before.iter().any(|other| other.name == field.name) {
        field.name = format!("{name} {number}");
        number += 1;
    }
}

/// The descriptions of `fields` as VLR data, and the record length that they
/// ask for. Bytes between fields are described as raw, since a reader infers
/// positions from sizes.
pub fn describe(fields: &[ExtraField], standard_length: usize) -> Result<(Vec<u8>, usize), String> {
    let mut data = Vec::new();
    let mut position = standard_length;
    for field in fields {
        let size = field.scalar.size() * field.elements;
        if field.position < position {
            return Err(format!(
                "the extra field \"{}\" at byte {} overlaps the fields before it, which end at byte {position}",
                field.name, field.position
            ));
        }
        push_raw(&mut data, "", "", field.position - position);
        if field.elements <= 3 {
            let kind = SCALARS.iter().position(|s| *s == field.scalar).unwrap_or(0) + 1;
            push_typed(&mut data, field, (kind + 10 * (field.elements.max(1) - 1)) as u8);
        } else {
            push_raw(&mut data, &field.name, &field.description, size);
        }
        position = field.position + size;
    }
    Ok((data, position))
}

fn push_typed(data: &mut Vec<u8>, field: &ExtraField, kind: u8) {
    let mut descriptor = [0; DESCRIPTOR];
    descriptor[2] = kind;
    text::put(&mut descriptor[4..36], &field.name);
    for (values, at, present) in [(&field.scale, 112, HAS_SCALE), (&field.offset, 136, HAS_OFFSET)] {
        if !values.is_empty() {
            descriptor[3] |= present;
        }
        for (element, value) in values.iter().take(3).enumerate() {
            descriptor[at + 8 * element..][..8].copy_from_slice(&value.to_le_bytes());
        }
    }
    text::put(&mut descriptor[160..192], &field.description);
    data.extend_from_slice(&descriptor);
}

/// Raw bytes, in as many descriptions as their count needs: one can say at
/// most 255.
fn push_raw(data: &mut Vec<u8>, name: &str, description: &str, size: usize) {
    let mut left = size;
    while left > 0 {
        let part = left.min(255);
        let mut descriptor = [0; DESCRIPTOR];
        descriptor[3] = part as u8;
        text::put(&mut descriptor[4..36], name);
        text::put(&mut descriptor[160..192], description);
        data.extend_from_slice(&descriptor);
        left -= part;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(name: &str, scalar: Scalar, elements: usize, position: usize) -> ExtraField {
        ExtraField {
            name: name.to_string(),
            description: String::new(),
            scalar,
            elements,
            position,
            scale: Vec::new(),
            offset: Vec::new(),
        }
    }

    #[test]
    fn fields_come_back_as_they_were_described() {
        let mut fields = vec![
            field("height", Scalar::I32, 1, 20),
            field("normal", Scalar::F32, 3, 24),
            field("id", Scalar::U64, 1, 36),
            field("blob", Scalar::U8, 7, 44),
        ];
        fields[0].scale = vec![0.01];
        fields[0].offset = vec![-5.0];
        fields[0].description = "above ground".to_string();
        let (data, length) = describe(&fields, 20).unwrap();
        assert_eq!(length, 51);
        let mut notes = Vec::new();
        let back = parse([data.as_slice()].into_iter(), 20, length, &mut notes);
        assert_eq!(back, fields);
        assert!(notes.is_empty(), "{notes:?}");
    }

    #[test]
    fn every_type_has_its_size() {
        let sizes = [1, 1, 2, 2, 4, 4, 8, 8, 4, 8];
        for kind in 1..=30usize {
            let mut descriptor = [0u8; DESCRIPTOR];
            descriptor[2] = kind as u8;
            let field = parse_descriptor(&descriptor).unwrap();
            assert_eq!(field.scalar.size() * field.elements, sizes[(kind - 1) % 10] * ((kind - 1) / 10 + 1));
        }
        assert!(
            parse_descriptor(&{
                let mut descriptor = [0u8; DESCRIPTOR];
                descriptor[2] = 31;
                descriptor
            })
            .is_none()
        );
    }

    #[test]
    fn a_field_that_does_not_fit_is_dropped_and_its_bytes_stay() {
        let (data, _) =
            describe(&[field("room for this", Scalar::U8, 1, 20), field("none", Scalar::U16, 1, 21)], 20)
                .unwrap();
        let mut notes = Vec::new();
        let fields = parse([data.as_slice()].into_iter(), 20, 22, &mut notes);
        assert_eq!(fields.len(), 2);
        assert_eq!((fields[1].name.as_str(), fields[1].elements), (UNDESCRIBED.0, 1));
        assert_eq!(notes.len(), 1);
    }

    #[test]
    fn names_are_never_empty_twice_or_invalid() {
        let (mut data, length) = describe(
            &[field("", Scalar::U8, 1, 20), field("a", Scalar::U8, 1, 21), field("a", Scalar::U8, 1, 22)],
            20,
        )
        .unwrap();
        data[DESCRIPTOR + 4..DESCRIPTOR + 7].copy_from_slice(&[0xC3, 0x28, 0xFF]);
        let fields = parse([data.as_slice()].into_iter(), 20, length, &mut Vec::new());
        assert_eq!(fields.len(), 3);
        assert!(fields.iter().all(|f| !f.name.is_empty()));
        let (data, length) =
            describe(&[field("a", Scalar::U8, 1, 20), field("a", Scalar::U8, 1, 21)], 20).unwrap();
        let fields = parse([data.as_slice()].into_iter(), 20, length, &mut Vec::new());
        assert_ne!(fields[0].name, fields[1].name);
    }

    #[test]
    fn gaps_and_long_fields_are_raw_bytes() {
        let (data, length) = describe(&[field("far", Scalar::U8, 1, 600)], 20).unwrap();
        assert_eq!(length, 601);
        let fields = parse([data.as_slice()].into_iter(), 20, length, &mut Vec::new());
        assert_eq!(fields.last().map(|f| (f.name.as_str(), f.position)), Some(("far", 600)));
        assert_eq!(fields.iter().map(|f| f.elements).sum::<usize>(), 581);
        assert!(describe(&[field("inside", Scalar::U8, 1, 19)], 20).is_err());
    }
}
