//! Statistics of an octree's points, counted anew from the records: what
//! metadata.json says must be what octree.bin holds.

use crate::octree::attribute::{Attribute, Scalar, Schema};
use crate::octree::statistics::AttributeStatistics;

/// Statistics of all attributes of a schema.
#[derive(Debug, Clone)]
pub struct RecomputedStatistics {
    columns: Vec<AttributeStatistics>,
}

impl RecomputedStatistics {
    pub fn new(schema: &Schema) -> RecomputedStatistics {
        let column = |attribute: &Attribute| AttributeStatistics {
            min: vec![f64::INFINITY; attribute.elements],
            max: vec![f64::NEG_INFINITY; attribute.elements],
            histogram: (attribute.size() == 1).then(|| vec![0; 256]),
            not_finite: 0,
        };
        RecomputedStatistics { columns: schema.attributes.iter().map(column).collect() }
    }

    /// Counts whole records of the schema.
    pub fn add(&mut self, schema: &Schema, records: &[u8]) {
        let record_size = schema.record_size();
        let mut start = 0;
        for (attribute, column) in schema.attributes.iter().zip(&mut self.columns) {
            let values =
                records.chunks_exact(record_size).map(|record| &record[start..start + attribute.size()]);
            add_column(attribute, column, values);
            start += attribute.size();
        }
    }

    pub fn merge(&mut self, other: RecomputedStatistics) {
        for (mine, theirs) in self.columns.iter_mut().zip(other.columns) {
            mine.min.iter_mut().zip(theirs.min).for_each(|(a, b)| *a = a.min(b));
            mine.max.iter_mut().zip(theirs.max).for_each(|(a, b)| *a = a.max(b));
            let histograms = mine.histogram.iter_mut().flatten().zip(theirs.histogram.into_iter().flatten());
            histograms.for_each(|(a, b)| *a += b);
        }
    }

    pub fn columns(&self) -> &[AttributeStatistics] {
        &self.columns
    }
}

fn add_column<'a>(
    attribute: &Attribute,
    column: &mut AttributeStatistics,
    values: impl Iterator<Item = &'a [u8]> + Clone,
) {
    if let Some(histogram) = &mut column.histogram {
        values.clone().for_each(|value| histogram[usize::from(value[0])] += 1);
    }
    for element in 0..attribute.elements {
        let (min, max) = (&mut column.min[element], &mut column.max[element]);
        let at = element * attribute.scalar.size();
        let values = values.clone().map(move |value| &value[at..]);
        // One loop a type, so that the type is not looked up for every value.
        match attribute.scalar {
            Scalar::I8 => range(values, min, max, |b| f64::from(i8::from_le_bytes(b))),
            Scalar::U8 => range(values, min, max, |b| f64::from(u8::from_le_bytes(b))),
            Scalar::I16 => range(values, min, max, |b| f64::from(i16::from_le_bytes(b))),
            Scalar::U16 => range(values, min, max, |b| f64::from(u16::from_le_bytes(b))),
            Scalar::I32 => range(values, min, max, |b| f64::from(i32::from_le_bytes(b))),
            Scalar::U32 => range(values, min, max, |b| f64::from(u32::from_le_bytes(b))),
            Scalar::I64 => range(values, min, max, |b| i64::from_le_bytes(b) as f64),
            Scalar::U64 => range(values, min, max, |b| u64::from_le_bytes(b) as f64),
            Scalar::F32 => range(values, min, max, |b| f64::from(f32::from_le_bytes(b))),
            Scalar::F64 => range(values, min, max, f64::from_le_bytes),
        }
    }
}

/// Widens a range by values; NaN is no value.
fn range<'a, const N: usize>(
    values: impl Iterator<Item = &'a [u8]>,
    min: &mut f64,
    max: &mut f64,
    parse: impl Fn([u8; N]) -> f64,
) {
    for bytes in values {
        let value = bytes.first_chunk().map_or(f64::NAN, |bytes| parse(*bytes));
        *min = min.min(value);
        *max = max.max(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_histograms_add_up() {
        let schema = Schema {
            attributes: vec![Attribute::new("a", Scalar::I8, 1), Attribute::new("b", Scalar::F32, 2)],
        };
        let record = |a: i8, b: [f32; 2]| {
            [a.to_le_bytes().as_slice(), &b[0].to_le_bytes(), &b[1].to_le_bytes()].concat()
        };
        let mut tally = RecomputedStatistics::new(&schema);
        tally.add(&schema, &record(-1, [f32::NAN, 2.0]));
        let mut other = RecomputedStatistics::new(&schema);
        other.add(&schema, &[record(5, [1.0, f32::NEG_INFINITY]), record(-1, [0.5, 3.0])].concat());
        tally.merge(other);
        let [a, b] = tally.columns() else { panic!("two columns") };
        assert_eq!((a.min[0], a.max[0]), (-1.0, 5.0));
        let histogram = a.histogram.as_ref().unwrap();
        assert_eq!((histogram[255], histogram[5], histogram.iter().sum::<u64>()), (2, 1, 3));
        assert_eq!((&b.min, &b.max), (&vec![0.5, f64::NEG_INFINITY], &vec![1.0, 3.0]));
    }
}
