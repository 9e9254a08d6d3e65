//! Records without the colors that coarse levels have instead of their own: what was put
//! in does not have them.

use crate::octree::attribute::{RGB, RGB_AVERAGE, RGB_ORIGINAL, Schema};

/// Which bytes of a record are taken.
pub struct Pick {
    pub schema: Schema,
    from_size: usize,
    /// Start and length; nothing if records stay as they are.
    ranges: Vec<(usize, usize)>,
}

impl Pick {
    /// Of records whose colors are averaged, the points' own colors.
    pub fn new(schema: &Schema, has_averages: bool) -> Pick {
        let has =
            |name: &str| has_averages && schema.attributes.iter().any(|attribute| attribute.name == name);
        let dropped = match (has(RGB_AVERAGE), has(RGB_ORIGINAL)) {
            (true, _) => RGB_AVERAGE,
            (_, true) => RGB,
            _ => return Pick { schema: schema.clone(), from_size: schema.record_size(), ranges: Vec::new() },
        };
        let (mut ranges, mut attributes, mut at) = (Vec::new(), Vec::new(), 0);
        for attribute in &schema.attributes {
            if attribute.name != dropped {
                ranges.push((at, attribute.size()));
                attributes.push(attribute.clone());
            }
            at += attribute.size();
        }
        for attribute in attributes.iter_mut().filter(|attribute| attribute.name == RGB_ORIGINAL) {
            attribute.name = RGB.to_string();
        }
        Pick { schema: Schema { attributes }, from_size: at, ranges }
    }

    pub fn apply(&self, records: Vec<u8>) -> Vec<u8> {
        if self.ranges.is_empty() {
            return records;
        }
        let mut picked = Vec::with_capacity(records.len());
        for record in records.chunks_exact(self.from_size) {
            self.ranges.iter().for_each(|(at, length)| picked.extend_from_slice(&record[*at..at + length]));
        }
        picked
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::attribute::{Attribute, Scalar};

    #[test]
    fn own_colors_take_the_place_of_averages() {
        let color = |name: &str| Attribute::new(name, Scalar::U16, 3);
        let schema = |names: [&str; 2]| Schema { attributes: names.map(color).to_vec() };
        let record: Vec<u8> = (0..12).collect();
        for (names, kept) in [([RGB, RGB_AVERAGE], 0..6), ([RGB, RGB_ORIGINAL], 6..12)] {
            let pick = Pick::new(&schema(names), true);
            assert_eq!(pick.schema.attributes, [color(RGB)]);
            assert_eq!(pick.apply(record.clone()), record[kept]);
            let all = Pick::new(&schema(names), false);
            assert_eq!((all.schema.attributes.len(), all.apply(record.clone())), (2, record.clone()));
        }
    }
}
