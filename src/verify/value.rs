//! Attribute values in words, for examples of faults.

use crate::octree::attribute::{Attribute, Scalar, Schema};

/// The attributes in which two records differ: "name: 1 instead of 2".
pub fn differences(schema: &Schema, expected: &[u8], found: &[u8]) -> Vec<String> {
    let mut start = 0;
    let mut texts = Vec::new();
    for attribute in &schema.attributes {
        let range = start..start + attribute.size();
        start = range.end;
        let (a, b) = (&expected[range.clone()], &found[range]);
        if a != b {
            texts.push(format!(
                "{}: {} instead of {}",
                attribute.name,
                text(attribute, b),
                text(attribute, a)
            ));
        }
    }
    texts
}

fn text(attribute: &Attribute, bytes: &[u8]) -> String {
    let elements = bytes.chunks_exact(attribute.scalar.size());
    elements.map(|element| element_text(attribute.scalar, element)).collect::<Vec<_>>().join(" ")
}

fn element_text(scalar: Scalar, bytes: &[u8]) -> String {
    let mut wide = [0; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    let bits = u64::from_le_bytes(wide);
    match scalar {
        Scalar::I8 => (bits as i8).to_string(),
        Scalar::I16 => (bits as i16).to_string(),
        Scalar::I32 => (bits as i32).to_string(),
        Scalar::I64 => (bits as i64).to_string(),
        Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64 => bits.to_string(),
        Scalar::F32 => f32::from_bits(bits as u32).to_string(),
        Scalar::F64 => f64::from_bits(bits).to_string(),
    }
}
