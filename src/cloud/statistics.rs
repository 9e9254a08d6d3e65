//! Statistics of attributes that add up in any order: each chunk makes its own,
//! and their sum is the same whatever the threads did.

use serde::{Deserialize, Serialize};

use super::attribute::{Scalar, Schema};

/// What is known of one attribute over a set of points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AttributeStatistics {
    /// Smallest and largest stored value per element; `min > max` where there
    /// was no value (no points, or only NaN).
    pub min: Vec<f64>,
    pub max: Vec<f64>,
    /// Points per value, for attributes of one unsigned or signed byte
    /// (signed values count at their bit pattern, as viewers index it).
    pub histogram: Option<Vec<u64>>,
}

impl AttributeStatistics {
    pub fn empty(scalar: Scalar, elements: usize) -> AttributeStatistics {
        let bytes = elements == 1 && scalar.size() == 1;
        AttributeStatistics {
            min: vec![f64::INFINITY; elements],
            max: vec![f64::NEG_INFINITY; elements],
            histogram: bytes.then(|| vec![0; 256]),
        }
    }

    fn merge(&mut self, other: &AttributeStatistics) {
        for (a, b) in self.min.iter_mut().zip(&other.min) {
            *a = a.min(*b);
        }
        for (a, b) in self.max.iter_mut().zip(&other.max) {
            *a = a.max(*b);
        }
        if let (Some(a), Some(b)) = (&mut self.histogram, &other.histogram) {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        }
    }
}

/// Statistics of all attributes of a schema.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    pub attributes: Vec<AttributeStatistics>,
}

impl Statistics {
    pub fn empty(schema: &Schema) -> Statistics {
        let attributes =
            schema.attributes.iter().map(|a| AttributeStatistics::empty(a.scalar, a.elements)).collect();
        Statistics { attributes }
    }

    pub fn merge(&mut self, other: &Statistics) {
        self.attributes.iter_mut().zip(&other.attributes).for_each(|(a, b)| a.merge(b));
    }

    /// Takes in records of the schema, one behind the other.
    pub fn add(&mut self, schema: &Schema, records: &[u8]) {
        let size = schema.record_size();
        let mut at = 0;
        for (attribute, statistics) in schema.attributes.iter().zip(&mut self.attributes) {
            for element in 0..attribute.elements {
                let column = Column { records, size, at };
                column.add(attribute.scalar, element, statistics);
                at += attribute.scalar.size();
            }
        }
    }
}

/// One element of one attribute in a run of records.
struct Column<'a> {
    records: &'a [u8],
    size: usize,
    at: usize,
}

impl Column<'_> {
    fn add(&self, scalar: Scalar, element: usize, to: &mut AttributeStatistics) {
        if let Some(histogram) = &mut to.histogram {
            self.count(scalar, histogram, &mut to.min[0], &mut to.max[0]);
            return;
        }
        let (low, high) = match scalar {
            Scalar::I8 => self.range(|b: [u8; 1]| i8::from_le_bytes(b), i8::MAX, i8::MIN, f64::from),
            Scalar::U8 => self.range(|b: [u8; 1]| b[0], u8::MAX, 0, f64::from),
            Scalar::I16 => self.range(i16::from_le_bytes, i16::MAX, i16::MIN, f64::from),
            Scalar::U16 => self.range(u16::from_le_bytes, u16::MAX, 0, f64::from),
            Scalar::I32 => self.range(i32::from_le_bytes, i32::MAX, i32::MIN, f64::from),
            Scalar::U32 => self.range(u32::from_le_bytes, u32::MAX, 0, f64::from),
            Scalar::I64 => self.range(i64::from_le_bytes, i64::MAX, i64::MIN, |v| v as f64),
            Scalar::U64 => self.range(u64::from_le_bytes, u64::MAX, 0, |v| v as f64),
            // Comparisons with NaN are false, so NaN never becomes a bound.
            Scalar::F32 => self.range(f32::from_le_bytes, f32::INFINITY, f32::NEG_INFINITY, f64::from),
            Scalar::F64 => self.range(f64::from_le_bytes, f64::INFINITY, f64::NEG_INFINITY, |v| v),
        };
        if low <= high {
            to.min[element] = to.min[element].min(low);
            to.max[element] = to.max[element].max(high);
        }
    }

    fn range<T: Copy + PartialOrd, const N: usize>(
        &self,
        read: impl Fn([u8; N]) -> T,
        mut low: T,
        mut high: T,
        widen: impl Fn(T) -> f64,
    ) -> (f64, f64) {
        if self.records.is_empty() {
            return (f64::INFINITY, f64::NEG_INFINITY);
        }
        let mut bytes = [0; N];
        for record in self.records.chunks_exact(self.size) {
            bytes.copy_from_slice(&record[self.at..self.at + N]);
            let value = read(bytes);
            if value < low {
                low = value;
            }
            if value > high {
                high = value;
            }
        }
        (widen(low), widen(high))
    }

    fn count(&self, scalar: Scalar, histogram: &mut [u64], min: &mut f64, max: &mut f64) {
        let mut counts = [0u32; 256];
        for record in self.records.chunks_exact(self.size) {
            counts[record[self.at] as usize] += 1;
        }
        for (value, count) in counts.iter().enumerate().filter(|(_, c)| **c > 0) {
            histogram[value] += u64::from(*count);
            let value = if scalar == Scalar::I8 { f64::from(value as u8 as i8) } else { value as f64 };
            *min = min.min(value);
            *max = max.max(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::attribute::Attribute;
    use super::*;

    #[test]
    fn statistics_add_up_in_any_order() {
        let schema = Schema {
            attributes: vec![
                Attribute::new("position", Scalar::I32, 3),
                Attribute::new("classification", Scalar::U8, 1),
                Attribute::new("gps-time", Scalar::F64, 1),
            ],
        };
        let records: Vec<u8> = (0..100i32)
            .flat_map(|i| {
                let time = if i % 3 == 0 { f64::NAN } else { f64::from(i) };
                let mut r = Vec::new();
                [i, -i, 7].iter().for_each(|v| r.extend(v.to_le_bytes()));
                r.push((i % 5) as u8);
                r.extend(time.to_le_bytes());
                r
            })
            .collect();
        let mut whole = Statistics::empty(&schema);
        whole.add(&schema, &records);
        let mut parts = Statistics::empty(&schema);
        for part in records.chunks(schema.record_size() * 7).rev() {
            let mut s = Statistics::empty(&schema);
            s.add(&schema, part);
            parts.merge(&s);
        }
        assert_eq!(whole, parts);
        assert_eq!((whole.attributes[0].min[1], whole.attributes[0].max[0]), (-99.0, 99.0));
        assert_eq!(whole.attributes[1].histogram.as_ref().unwrap()[4], 20);
        assert_eq!((whole.attributes[2].min[0], whole.attributes[2].max[0]), (1.0, 98.0));
    }
}
