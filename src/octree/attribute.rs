//! Attributes: the names, types and sizes of what a point record holds.

use serde::{Deserialize, Serialize};

/// A point's colour, as viewers know it. Where coarse levels have averaged
/// colours, a second attribute stands behind it: the averages, or, where `rgb`
/// holds those, the points' own.
pub const RGB: &str = "rgb";
pub const RGB_AVERAGE: &str = "rgb average";
pub const RGB_ORIGINAL: &str = "rgb original";

/// The type of one element of an attribute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// Bytes of one element.
    pub const fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }
}

/// One attribute of a point: `elements` values of one scalar type, stored
/// little endian and without padding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Attribute {
    pub name: String,
    pub description: String,
    pub scalar: Scalar,
    pub elements: usize,
    /// World value = stored value × scale + offset, per element. Values are
    /// kept as the integers they are; these only tell how to read them.
    pub scale: Vec<f64>,
    pub offset: Vec<f64>,
}

impl Attribute {
    pub fn new(name: &str, scalar: Scalar, elements: usize) -> Attribute {
        Attribute {
            name: name.to_string(),
            description: String::new(),
            scalar,
            elements,
            scale: vec![1.0; elements],
            offset: vec![0.0; elements],
        }
    }

    /// Bytes a point.
    pub fn size(&self) -> usize {
        self.scalar.size() * self.elements
    }
}

/// A field behind the standard ones of a LAS record: described by an
/// extra-bytes VLR (LAS 1.4 R15, table 24), or the undescribed rest of a record
/// that is longer than its point format.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExtraField {
    pub name: String,
    pub description: String,
    pub scalar: Scalar,
    pub elements: usize,
    /// Bytes from the start of the record.
    pub position: usize,
    /// Empty where the VLR gives none (then 1 and 0 hold).
    pub scale: Vec<f64>,
    pub offset: Vec<f64>,
}

/// The layout of an octree's point record: attributes one behind the other.
/// The first is always `position`, three 32-bit integers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Schema {
    pub attributes: Vec<Attribute>,
}

impl Schema {
    /// Bytes a record.
    pub fn record_size(&self) -> usize {
        self.attributes.iter().map(Attribute::size).sum()
    }

    /// Where an attribute starts in the record, in bytes.
    pub fn offset_of(&self, name: &str) -> Option<usize> {
        let mut offset = 0;
        for attribute in &self.attributes {
            if attribute.name == name {
                return Some(offset);
            }
            offset += attribute.size();
        }
        None
    }
}
