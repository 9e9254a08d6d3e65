//! Descriptions of extra bytes (LAS 1.4 R15, table 24), taken over whole where the inputs
//! have one and made where an attribute has none.
//!
//! copc.js, and with it iTowns and the real Potree viewer, refuses a file with a field of
//! several elements (the types 11 to 30, which the standard has given up). So such a field
//! is described as as many fields of one element, named as PDAL names them: the name and
//! the element's number. The bytes are the same.

use std::collections::HashMap;

use crate::format::las::UNDESCRIBED;
use crate::octree::attribute::{Attribute, Scalar};

/// Bytes of one description.
pub const DESCRIPTOR: usize = 192;
/// Most bytes that one description of raw bytes stands for.
const MAX_RAW_BYTES: usize = 255;
const TYPE: usize = 2;
const OPTIONS: usize = 3;
const NAME: std::ops::Range<usize> = 4..36;
const NO_DATA: usize = 40;
const MIN: usize = 64;
const MAX: usize = 88;
const SCALE: usize = 112;
const OFFSET: usize = 136;
const DESCRIPTION: std::ops::Range<usize> = 160..192;
/// Bits of the options.
const HAS_MIN: u8 = 1 << 1;
const HAS_MAX: u8 = 1 << 2;
const HAS_SCALE: u8 = 1 << 3;
const HAS_OFFSET: u8 = 1 << 4;

/// The descriptions that the inputs have for their extra fields, by the name of the
/// attribute in the octree: 192 bytes each, as they are.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Described(HashMap<String, Vec<u8>>);

impl Described {
    /// The first description of an attribute holds; what is no description is ignored.
    pub fn insert(&mut self, attribute: &str, descriptor: &[u8]) {
        if descriptor.len() == DESCRIPTOR {
            self.0.entry(attribute.to_string()).or_insert_with(|| descriptor.to_vec());
        }
    }

    /// All of them, sorted by attribute.
    pub fn entries(&self) -> Vec<(&str, &[u8])> {
        let mut entries: Vec<_> =
            self.0.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
        entries.sort_unstable();
        entries
    }
}

/// One description and which element of which attribute it is of.
#[derive(Debug, Clone, PartialEq)]
pub struct DescribedElement {
    pub bytes: Vec<u8>,
    /// The attribute's place in the schema.
    pub attribute: usize,
    pub element: usize,
}

impl DescribedElement {
    pub fn name(&self) -> String {
        crate::format::las::field_text(&self.bytes[NAME])
    }

    /// Says the smallest and largest stored value, where the input's description did.
    pub fn set_range(&mut self, scalar: Scalar, min: f64, max: f64) {
        let options = self.bytes[OPTIONS];
        if self.bytes[TYPE] == 0 || min.is_nan() || max.is_nan() || min > max {
            return;
        }
        for (present, at, value) in [(HAS_MIN, MIN, min), (HAS_MAX, MAX, max)] {
            if options & present != 0 {
                self.bytes[at..at + 8].copy_from_slice(&any_type(scalar, value));
            }
        }
    }
}

/// A value as the eight bytes of "anytype" (LAS 1.4 R15, table 25).
fn any_type(scalar: Scalar, value: f64) -> [u8; 8] {
    match scalar {
        Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64 => (value as u64).to_le_bytes(),
        Scalar::I8 | Scalar::I16 | Scalar::I32 | Scalar::I64 => (value as i64).to_le_bytes(),
        Scalar::F32 | Scalar::F64 => value.to_le_bytes(),
    }
}

/// The names of the fields that an extra-bytes record describes.
pub fn names(data: &[u8]) -> Vec<String> {
    data.chunks_exact(DESCRIPTOR).map(|bytes| crate::format::las::field_text(&bytes[NAME])).collect()
}

/// The descriptions of an attribute that goes into the extra bytes, in their order; their
/// sizes add up to the attribute's. Names that `taken` has get a number, as every name of a
/// file must be its own.
pub fn fields(
    attribute: &Attribute,
    index: usize,
    described: &Described,
    taken: &mut Vec<String>,
) -> Vec<DescribedElement> {
    let given = described.0.get(&attribute.name).filter(|bytes| fits(bytes, attribute));
    let mut fields = Vec::new();
    let is_raw = match given {
        Some(bytes) => bytes[TYPE] == 0,
        None => {
            attribute.scalar == Scalar::U8
                && (attribute.elements > 3
                    || (attribute.name.starts_with(UNDESCRIBED.0) && attribute.description == UNDESCRIBED.1))
        }
    };
    if is_raw {
        let mut left = attribute.elements;
        while left > 0 {
            let part = left.min(MAX_RAW_BYTES);
            let mut bytes = given.cloned().unwrap_or_else(|| bare(attribute));
            (bytes[TYPE], bytes[OPTIONS]) = (0, part as u8);
            let name = unique(&name(&bytes, attribute), "", taken);
            put_text(&mut bytes[NAME], &name);
            fields.push(DescribedElement { bytes, attribute: index, element: attribute.elements - left });
            left -= part;
        }
        return fields;
    }
    for element in 0..attribute.elements {
        let mut bytes = match given {
            Some(bytes) => element_of(bytes, element),
            None => typed(attribute, element),
        };
        bytes[TYPE] = type_of(attribute.scalar);
        let number = if attribute.elements > 1 { element.to_string() } else { String::new() };
        let name = unique(&name(&bytes, attribute), &number, taken);
        put_text(&mut bytes[NAME], &name);
        fields.push(DescribedElement { bytes, attribute: index, element });
    }
    fields
}

/// Whether a description is of an attribute's type.
fn fits(bytes: &[u8], attribute: &Attribute) -> bool {
    match usize::from(bytes[TYPE]) {
        0 => attribute.scalar == Scalar::U8 && usize::from(bytes[OPTIONS]) == attribute.elements,
        kind @ 1..=30 => {
            (kind - 1) % 10 + 1 == usize::from(type_of(attribute.scalar))
                && (kind - 1) / 10 + 1 == attribute.elements
        }
        _ => false,
    }
}

/// The description of one element, from that of several.
fn element_of(bytes: &[u8], element: usize) -> Vec<u8> {
    let mut one = bytes.to_vec();
    for at in [NO_DATA, MIN, MAX, SCALE, OFFSET] {
        one[at..at + 24].fill(0);
        one[at..at + 8].copy_from_slice(&bytes[at + 8 * element..][..8]);
    }
    one
}

/// A description made from what an octree knows.
fn typed(attribute: &Attribute, element: usize) -> Vec<u8> {
    let mut bytes = bare(attribute);
    for (values, at, present, none) in
        [(&attribute.scale, SCALE, HAS_SCALE, 1.0), (&attribute.offset, OFFSET, HAS_OFFSET, 0.0)]
    {
        let value = values.get(element).copied().unwrap_or(none);
        if value != none {
            bytes[OPTIONS] |= present;
            bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        }
    }
    bytes
}

fn bare(attribute: &Attribute) -> Vec<u8> {
    let mut bytes = vec![0; DESCRIPTOR];
    put_text(&mut bytes[NAME], &attribute.name);
    put_text(&mut bytes[DESCRIPTION], &attribute.description);
    bytes
}

/// The name that a description has; the attribute's where it has none.
fn name(bytes: &[u8], attribute: &Attribute) -> String {
    let name = crate::format::las::field_text(&bytes[NAME]);
    if name.is_empty() { attribute.name.clone() } else { name }
}

/// The name with its suffix, shortened to what a description has room for, and numbered if
/// another field has it.
fn unique(name: &str, suffix: &str, taken: &mut Vec<String>) -> String {
    let mut number = 1;
    loop {
        let suffix = if number == 1 { suffix.to_string() } else { format!("{suffix} ({number})") };
        let mut end = name.len().min(NAME.len() - suffix.len());
        while !name.is_char_boundary(end) {
            end -= 1;
        }
        let whole = format!("{}{suffix}", &name[..end]);
        if !taken.contains(&whole) {
            taken.push(whole.clone());
            return whole;
        }
        number += 1;
    }
}

/// Replaces a field of text: as much as fits, the rest zero.
fn put_text(field: &mut [u8], text: &str) {
    let mut end = text.len().min(field.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    field.fill(0);
    field[..end].copy_from_slice(&text.as_bytes()[..end]);
}

/// The number that LAS has for a type.
fn type_of(scalar: Scalar) -> u8 {
    match scalar {
        Scalar::U8 => 1,
        Scalar::I8 => 2,
        Scalar::U16 => 3,
        Scalar::I16 => 4,
        Scalar::U32 => 5,
        Scalar::I32 => 6,
        Scalar::U64 => 7,
        Scalar::I64 => 8,
        Scalar::F32 => 9,
        Scalar::F64 => 10,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(fields: &[DescribedElement]) -> Vec<String> {
        fields.iter().map(DescribedElement::name).collect()
    }

    #[test]
    fn tuples_become_fields_of_one_element() {
        let mut described = Described::default();
        let mut given = vec![0; DESCRIPTOR];
        (given[TYPE], given[OPTIONS]) = (23, 1 | HAS_SCALE);
        put_text(&mut given[NAME], "Colors");
        for (element, value) in [7u64, 8, 9].into_iter().enumerate() {
            given[NO_DATA + 8 * element..][..8].copy_from_slice(&value.to_le_bytes());
            given[SCALE + 8 * element..][..8].copy_from_slice(&(value as f64).to_le_bytes());
        }
        described.insert("Colors (2)", &given);
        let attribute = Attribute::new("Colors (2)", Scalar::U16, 3);
        let fields = fields(&attribute, 5, &described, &mut Vec::new());
        assert_eq!(names(&fields), ["Colors0", "Colors1", "Colors2"]);
        for (field, value) in fields.iter().zip([7u64, 8, 9]) {
            assert_eq!((field.bytes[TYPE], field.bytes[OPTIONS]), (3, 1 | HAS_SCALE));
            assert_eq!(field.bytes[NO_DATA..NO_DATA + 8], value.to_le_bytes());
            assert_eq!(field.bytes[SCALE..SCALE + 8], (value as f64).to_le_bytes());
            assert!(field.bytes[NO_DATA + 8..NO_DATA + 24].iter().all(|b| *b == 0));
        }
    }

    #[test]
    fn a_description_comes_through_whole() {
        let given: Vec<u8> = (0..DESCRIPTOR).map(|i| if NAME.contains(&i) { 0 } else { i as u8 }).collect();
        let mut given = given;
        (given[TYPE], given[OPTIONS]) = (9, 1);
        put_text(&mut given[NAME], "Height above ground");
        let mut described = Described::default();
        described.insert("h", &given);
        described.insert("h", &[1; DESCRIPTOR]);
        let made = fields(&Attribute::new("h", Scalar::F32, 1), 0, &described, &mut Vec::new());
        assert_eq!(made[0].bytes[..40], given[..40]);
        assert_eq!(made[0].bytes[NO_DATA..NO_DATA + 8], given[NO_DATA..NO_DATA + 8]);
        assert_eq!(made[0].bytes[DESCRIPTION], given[DESCRIPTION]);
        // Of another type it is none of this attribute.
        let other = fields(&Attribute::new("h", Scalar::F64, 1), 0, &described, &mut Vec::new());
        assert_eq!((other[0].bytes[TYPE], other[0].bytes[OPTIONS]), (10, 0));
    }

    #[test]
    fn many_bytes_are_raw_and_names_stay_apart() {
        let mut taken = Vec::new();
        let long = Attribute::new("an attribute of a name that is too long", Scalar::U8, 600);
        let raw = fields(&long, 0, &Described::default(), &mut taken);
        assert_eq!(raw.iter().map(|f| usize::from(f.bytes[OPTIONS])).collect::<Vec<_>>(), [255, 255, 90]);
        let pair = fields(&Attribute::new("ä", Scalar::F64, 2), 1, &Described::default(), &mut taken);
        let again = fields(&Attribute::new("ä0", Scalar::F64, 1), 1, &Described::default(), &mut taken);
        let all = names(&[raw, pair, again].concat());
        assert_eq!(&all[3..], ["ä0", "ä1", "ä0 (2)"]);
        let mut unlike = all.clone();
        unlike.sort();
        unlike.dedup();
        assert_eq!(unlike.len(), all.len());
    }

    #[test]
    fn ranges_are_told_where_the_input_told_them() {
        let mut field = DescribedElement { bytes: vec![0; DESCRIPTOR], attribute: 0, element: 0 };
        (field.bytes[TYPE], field.bytes[OPTIONS]) = (6, HAS_MAX);
        field.set_range(Scalar::I32, -5.0, 7.0);
        assert_eq!(field.bytes[MIN..MIN + 8], [0; 8]);
        assert_eq!(field.bytes[MAX..MAX + 8], 7i64.to_le_bytes());
    }
}
