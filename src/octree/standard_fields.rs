//! Where the fields of raw LAS records lie, by point format: LAS 1.4 R15, tables 7 to 17.

use super::attribute::{Attribute, RGB, Scalar};

/// A field of a raw record: whole bytes, or some bits of one byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldLocation {
    Bytes {
        at: usize,
        len: usize,
    },
    /// `byte >> shift & mask`.
    Bits {
        at: usize,
        shift: u8,
        mask: u8,
    },
}

/// A standard field, where it lies, and whether viewers expect the attribute
/// even where it is zero throughout.
pub(super) struct StandardField {
    pub name: &'static str,
    pub scalar: Scalar,
    pub elements: usize,
    pub place: FieldLocation,
    pub always: bool,
}

const fn field(name: &'static str, scalar: Scalar, elements: usize, at: usize) -> StandardField {
    let place = FieldLocation::Bytes { at, len: scalar.size() * elements };
    StandardField { name, scalar, elements, place, always: true }
}

const fn bits(name: &'static str, at: usize, shift: u8, mask: u8, always: bool) -> StandardField {
    StandardField {
        name,
        scalar: Scalar::U8,
        elements: 1,
        place: FieldLocation::Bits { at, shift, mask },
        always,
    }
}

const fn optional(field: StandardField) -> StandardField {
    StandardField { always: false, ..field }
}

/// The standard fields of a point format behind the position, in the order in
/// which viewers list them (FORMATS.md); what they have no name for comes last.
/// A second colour, where one is named, begins as the first.
pub(super) fn fields(format: u8, second_color: Option<&'static str>) -> Vec<StandardField> {
    let mut fields = vec![field("intensity", Scalar::U16, 1, 12)];
    if format < 6 {
        fields.extend([
            bits("return number", 14, 0, 7, true),
            bits("number of returns", 14, 3, 7, true),
            bits("classification flags", 15, 5, 7, false),
            bits("classification", 15, 0, 31, true),
            field("scan angle rank", Scalar::U8, 1, 16),
            field("user data", Scalar::U8, 1, 17),
            field("point source id", Scalar::U16, 1, 18),
        ]);
    } else {
        fields.extend([
            bits("return number", 14, 0, 15, true),
            bits("number of returns", 14, 4, 15, true),
            bits("classification flags", 15, 0, 15, true),
            field("classification", Scalar::U8, 1, 16),
            field("scan angle", Scalar::I16, 1, 18),
            field("user data", Scalar::U8, 1, 17),
            field("point source id", Scalar::U16, 1, 20),
        ]);
    }
    match format {
        1 | 4 => fields.push(field("gps-time", Scalar::F64, 1, 20)),
        3 | 5 => fields.push(field("gps-time", Scalar::F64, 1, 20)),
        6..=10 => fields.push(field("gps-time", Scalar::F64, 1, 22)),
        _ => {}
    }
    if let Some(at) = color_at(format) {
        fields.extend([RGB].into_iter().chain(second_color).map(|name| field(name, Scalar::U16, 3, at)));
    }
    if matches!(format, 8 | 10) {
        fields.push(optional(field("nir", Scalar::U16, 1, 36)));
    }
    if format < 6 {
        fields.extend([
            bits("scan direction flag", 14, 6, 1, false),
            bits("edge of flight line", 14, 7, 1, false),
        ]);
    } else {
        fields.extend([
            bits("scanner channel", 15, 4, 3, false),
            bits("scan direction flag", 15, 6, 1, false),
            bits("edge of flight line", 15, 7, 1, false),
        ]);
    }
    if let Some(at) = waveform_at(format) {
        fields.extend(
            [
                field("wave packet descriptor index", Scalar::U8, 1, at),
                field("byte offset to waveform data", Scalar::U64, 1, at + 1),
                field("waveform packet size", Scalar::U32, 1, at + 9),
                field("return point waveform location", Scalar::F32, 1, at + 13),
                field("x(t)", Scalar::F32, 1, at + 17),
                field("y(t)", Scalar::F32, 1, at + 21),
                field("z(t)", Scalar::F32, 1, at + 25),
            ]
            .map(optional),
        );
    }
    fields
}

/// The standard attributes of a point format behind the position, with where each lies
/// in a raw record.
pub fn standard_attributes(format: u8) -> Vec<(Attribute, FieldLocation)> {
    fields(format, None)
        .into_iter()
        .map(|f| (Attribute::new(f.name, f.scalar, f.elements), f.place))
        .collect()
}

/// Where the colour stands in a record, for the formats that have one.
fn color_at(format: u8) -> Option<usize> {
    match format {
        2 => Some(20),
        3 | 5 => Some(28),
        7 | 8 | 10 => Some(30),
        _ => None,
    }
}

/// Where the wave packet starts in a record, for the formats that have one.
fn waveform_at(format: u8) -> Option<usize> {
    match format {
        4 => Some(28),
        5 => Some(34),
        9 => Some(30),
        10 => Some(38),
        _ => None,
    }
}
