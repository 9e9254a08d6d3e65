//! Which attributes hold a point's own color, and which the mean of what it stands for
//! on coarse levels.

use crate::format::potree::{Metadata, ScalarKind};
use crate::octree::attribute::{Scalar, Schema};

/// The attribute of a point's own color, and that of its mean, by what
/// metadata.json says of the octree.
const KINDS: [(&str, &str, &str); 2] =
    [("attribute", "rgb", "rgb average"), ("average", "rgb original", "rgb")];

/// Where records have both.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColorAttributes {
    pub own: &'static str,
    pub mean: &'static str,
    own_at: usize,
    mean_at: usize,
}

/// Bytes of a color.
const SIZE: usize = 6;

fn said(metadata: &Metadata) -> Option<&str> {
    metadata.generator.as_ref()?.lod_color.as_deref()
}

/// Whether the octree has the attributes that it says it has.
pub fn are_there(metadata: &Metadata) -> bool {
    let Some(said) = said(metadata) else { return true };
    let is_there = |name: &str| {
        let found = metadata.attributes.iter().find(|attribute| attribute.name == name);
        found.is_some_and(|attribute| (attribute.kind, attribute.num_elements) == (ScalarKind::Uint16, 3))
    };
    KINDS.iter().any(|(kind, own, mean)| *kind == said && is_there(own) && is_there(mean))
}

impl ColorAttributes {
    /// `None` where the octree does not say that colors were averaged, or lacks
    /// the attributes.
    pub fn of(metadata: &Metadata, schema: &Schema) -> Option<ColorAttributes> {
        let said = said(metadata)?;
        let (_, own, mean) = KINDS.into_iter().find(|(kind, ..)| *kind == said)?;
        let place = |name: &str| {
            let attribute = schema.attributes.iter().find(|attribute| attribute.name == name)?;
            let fits = (attribute.scalar, attribute.elements) == (Scalar::U16, 3);
            fits.then(|| schema.offset_of(name)).flatten()
        };
        Some(ColorAttributes { own, mean, own_at: place(own)?, mean_at: place(mean)? })
    }

    /// A copy of records without the means, which no input has.
    pub fn without_means(&self, records: &[u8], record_size: usize, into: &mut Vec<u8>) {
        into.clear();
        into.extend_from_slice(records);
        into.chunks_exact_mut(record_size).for_each(|r| r[self.mean_at..self.mean_at + SIZE].fill(0));
    }

    /// Whether the mean of a record is its own color.
    pub fn is_own(&self, record: &[u8]) -> bool {
        record[self.own_at..self.own_at + SIZE] == record[self.mean_at..self.mean_at + SIZE]
    }
}
