//! Averaged colours in records of the octree's layout: where they stand, and
//! between which bounds.

use super::options::LodColor;
use crate::octree::attribute::Schema;
use crate::octree::color_average::{Averager, Colour};
use crate::octree::sampling::sampler::IndexedPoint;
use crate::octree::statistics::Statistics;

/// Where records have the colour that is averaged.
#[derive(Debug, Clone, Copy)]
pub struct ColorLocation {
    /// Bytes of a record, and those before the colour.
    size: usize,
    at: usize,
}

impl ColorLocation {
    #[inline]
    pub fn get(self, records: &[u8], index: u32) -> Colour {
        let at = index as usize * self.size + self.at;
        let bytes = records[at..at + 6].as_chunks::<2>().0;
        [0, 1, 2].map(|channel| u16::from_le_bytes(bytes[channel]))
    }

    #[inline]
    pub fn put(self, records: &mut [u8], index: u32, colour: Colour) {
        let at = index as usize * self.size + self.at;
        for (to, value) in records[at..at + 6].as_chunks_mut::<2>().0.iter_mut().zip(colour) {
            *to = value.to_le_bytes();
        }
    }
}

/// Averages colours, where the schema has a place for the means.
pub struct Averages {
    pub averager: Averager,
    pub field: ColorLocation,
    /// The means' place among the schema's attributes.
    attribute: usize,
    /// Of what was written.
    low: Colour,
    high: Colour,
}

impl Averages {
    pub fn of(schema: &Schema) -> Option<Averages> {
        let name = LodColor::of(schema).mean()?;
        let field = ColorLocation { size: schema.record_size(), at: schema.offset_of(name)? };
        let attribute = schema.attributes.iter().position(|attribute| attribute.name == name)?;
        let (low, high) = ([u16::MAX; 3], [0; 3]);
        Some(Averages { averager: Averager::default(), field, attribute, low, high })
    }

    /// Takes in a node that is final. A point's mean is known only now: each level
    /// that it rises to makes a new one.
    pub fn written(&mut self, records: &[u8], items: &[IndexedPoint]) {
        for item in items {
            let colour = self.field.get(records, item.index);
            for (channel, value) in colour.into_iter().enumerate() {
                self.low[channel] = self.low[channel].min(value);
                self.high[channel] = self.high[channel].max(value);
            }
        }
    }

    /// Puts the range of what was written in the place of what the statistics say
    /// of the means: they were counted when some had yet to rise.
    pub fn tell(&self, statistics: &mut Statistics) {
        let Some(of_means) = statistics.attributes.get_mut(self.attribute) else { return };
        let is_empty = self.low > self.high;
        for channel in 0..3 {
            let (low, high) = (f64::from(self.low[channel]), f64::from(self.high[channel]));
            of_means.min[channel] = if is_empty { f64::INFINITY } else { low };
            of_means.max[channel] = if is_empty { f64::NEG_INFINITY } else { high };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::attribute::{Attribute, RGB, RGB_ORIGINAL, Scalar};

    #[test]
    fn the_range_is_that_of_what_was_written() {
        let schema = Schema {
            attributes: vec![
                Attribute::new("position", Scalar::I32, 3),
                Attribute::new(RGB, Scalar::U16, 3),
                Attribute::new(RGB_ORIGINAL, Scalar::U16, 3),
            ],
        };
        let mut averages = Averages::of(&schema).expect("the schema has two colours");
        let size = schema.record_size();
        let mut records = vec![0xff; 3 * size];
        for (index, colour) in [[5, 6, 7], [9, 2, 7], [0, 0, 0]].into_iter().enumerate() {
            averages.field.put(&mut records, index as u32, colour);
            assert_eq!(averages.field.get(&records, index as u32), colour);
        }
        assert_eq!(records[12..18], [5, 0, 6, 0, 7, 0]);
        assert_eq!(records[18..24], [0xff; 6], "the original is let be");
        let mut statistics = Statistics::empty(&schema);
        statistics.add(&schema, &records);
        averages.tell(&mut statistics);
        assert!(statistics.attributes[1].min[0] > statistics.attributes[1].max[0], "nothing was written");
        averages.written(&records, &[0, 1].map(|index| IndexedPoint { at: [0; 3], index }));
        averages.tell(&mut statistics);
        let range = &statistics.attributes[1];
        assert_eq!((&range.min, &range.max), (&vec![5.0, 2.0, 7.0], &vec![9.0, 6.0, 7.0]));
        assert_eq!(statistics.attributes[2].min, [65_535.0; 3]);
    }
}
