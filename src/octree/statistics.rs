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
    /// Values of floats that are NaN or infinite; where elements are many, of all.
    pub not_finite: u64,
}

impl AttributeStatistics {
    pub fn empty(scalar: Scalar, elements: usize) -> AttributeStatistics {
        let bytes = elements == 1 && scalar.size() == 1;
        AttributeStatistics {
            min: vec![f64::INFINITY; elements],
            max: vec![f64::NEG_INFINITY; elements],
            histogram: bytes.then(|| vec![0; 256]),
            not_finite: 0,
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
        self.not_finite += other.not_finite;
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
        for block in records.chunks(BLOCK * schema.record_size().max(1)) {
            self.add_block(schema, block);
        }
    }

    fn add_block(&mut self, schema: &Schema, records: &[u8]) {
        let size = schema.record_size();
        let mut at = 0;
        for (attribute, statistics) in schema.attributes.iter().zip(&mut self.attributes) {
            let columns = Columns { records, size, at };
            at += attribute.elements * attribute.scalar.size();
            statistics.not_finite += columns.not_finite(attribute.scalar, attribute.elements);
        }
        let mut elements: Vec<Element> = Vec::new();
        for (attribute, statistics) in schema.attributes.iter().zip(&mut self.attributes) {
            let AttributeStatistics { min, max, histogram, .. } = statistics;
            let mut histogram = histogram.as_mut();
            for (min, max) in min.iter_mut().zip(max) {
                elements.push(Element { scalar: attribute.scalar, min, max, histogram: histogram.take() });
            }
        }
        // Neighbours of one kind are gone through together.
        let mut at = 0;
        for row in elements.chunk_by_mut(|a, b| a.kind() == b.kind()) {
            for row in row.chunks_mut(TOGETHER) {
                let columns = Columns { records, size, at };
                at += row.iter().map(|element| element.scalar.size()).sum::<usize>();
                match row {
                    [_] => columns.add::<1>(row),
                    [_, _] => columns.add::<2>(row),
                    [_, _, _] => columns.add::<3>(row),
                    [_, _, _, _] => columns.add::<4>(row),
                    [_, _, _, _, _] => columns.add::<5>(row),
                    _ => columns.add::<TOGETHER>(row),
                }
            }
        }
    }
}

/// Records that are gone through row by row before the next are: few enough to
/// stay in the core's cache, many enough that clearing tables costs nothing.
const BLOCK: usize = 4096;

/// Elements at most that are looked at in one pass over the records. Looking at
/// one alone waits for itself: most counts go to the same place as the one
/// before.
const TOGETHER: usize = 6;

/// One element of an attribute, and where its statistics go.
struct Element<'a> {
    scalar: Scalar,
    min: &'a mut f64,
    max: &'a mut f64,
    histogram: Option<&'a mut Vec<u64>>,
}

impl Element<'_> {
    /// Elements of one kind take the same steps.
    fn kind(&self) -> (usize, Option<Scalar>) {
        match self.histogram {
            Some(_) => (1, None),
            None => (self.scalar.size(), Some(self.scalar)),
        }
    }
}

/// Some elements, one behind the other, in a run of records.
struct Columns<'a> {
    records: &'a [u8],
    size: usize,
    at: usize,
}

impl Columns<'_> {
    fn add<const K: usize>(&self, row: &mut [Element]) {
        let Some(first) = row.first() else { return };
        if first.histogram.is_some() {
            return self.count::<K>(row);
        }
        let (low, high) = match first.scalar {
            Scalar::I8 => self.range::<_, 1, K>(i8::from_le_bytes, i8::MAX, i8::MIN, f64::from),
            Scalar::U8 => self.range::<_, 1, K>(u8::from_le_bytes, u8::MAX, 0, f64::from),
            Scalar::I16 => self.range::<_, 2, K>(i16::from_le_bytes, i16::MAX, i16::MIN, f64::from),
            Scalar::U16 => self.range::<_, 2, K>(u16::from_le_bytes, u16::MAX, 0, f64::from),
            Scalar::I32 => self.range::<_, 4, K>(i32::from_le_bytes, i32::MAX, i32::MIN, f64::from),
            Scalar::U32 => self.range::<_, 4, K>(u32::from_le_bytes, u32::MAX, 0, f64::from),
            Scalar::I64 => self.range::<_, 8, K>(i64::from_le_bytes, i64::MAX, i64::MIN, |v| v as f64),
            Scalar::U64 => self.range::<_, 8, K>(u64::from_le_bytes, u64::MAX, 0, |v| v as f64),
            Scalar::F32 => {
                self.range::<_, 4, K>(f32::from_le_bytes, f32::INFINITY, f32::NEG_INFINITY, f64::from)
            }
            Scalar::F64 => self.range::<_, 8, K>(f64::from_le_bytes, f64::INFINITY, f64::NEG_INFINITY, |v| v),
        };
        for ((element, low), high) in row.iter_mut().zip(low).zip(high) {
            // The other way round there was no value, or only NaN.
            if low <= high {
                *element.min = element.min.min(low);
                *element.max = element.max.max(high);
            }
        }
    }

    /// Smallest and largest value of K elements of N bytes.
    fn range<T: Copy + PartialOrd, const N: usize, const K: usize>(
        &self,
        read: impl Fn([u8; N]) -> T,
        low: T,
        high: T,
        widen: impl Fn(T) -> f64,
    ) -> ([f64; K], [f64; K]) {
        let (mut low, mut high) = ([low; K], [high; K]);
        let range = self.at..self.at + K * N;
        for record in self.records.chunks_exact(self.size) {
            let values = record[range.clone()].as_chunks::<N>().0;
            for ((bytes, low), high) in values.iter().zip(&mut low).zip(&mut high) {
                let value = read(*bytes);
                // Comparisons with NaN are false, so NaN never becomes a bound.
                *low = if value < *low { value } else { *low };
                *high = if value > *high { value } else { *high };
            }
        }
        (low.map(&widen), high.map(&widen))
    }

    /// Values of so many floats that are NaN or infinite.
    fn not_finite(&self, scalar: Scalar, elements: usize) -> u64 {
        match scalar {
            Scalar::F32 => self.count_odd::<4>(elements, |bytes| !f32::from_le_bytes(bytes).is_finite()),
            Scalar::F64 => self.count_odd::<8>(elements, |bytes| !f64::from_le_bytes(bytes).is_finite()),
            _ => 0,
        }
    }

    fn count_odd<const N: usize>(&self, elements: usize, is_odd: impl Fn([u8; N]) -> bool) -> u64 {
        let range = self.at..self.at + elements * N;
        let values = |record: &[u8]| {
            record[range.clone()]
                .as_chunks::<N>()
                .0
                .iter()
                .map(|bytes| u64::from(is_odd(*bytes)))
                .sum::<u64>()
        };
        self.records.chunks_exact(self.size).map(values).sum()
    }

    /// Points per value of K bytes.
    fn count<const K: usize>(&self, row: &mut [Element]) {
        let mut counts = [[0u32; 256]; K];
        let range = self.at..self.at + K;
        for record in self.records.chunks_exact(self.size) {
            for (value, counts) in record[range.clone()].iter().zip(&mut counts) {
                counts[usize::from(*value)] += 1;
            }
        }
        for (element, counts) in row.iter_mut().zip(&counts) {
            let Some(histogram) = &mut element.histogram else { continue };
            for (value, count) in counts.iter().enumerate().filter(|(_, c)| **c > 0) {
                histogram[value] += u64::from(*count);
                let signed = element.scalar == Scalar::I8;
                let value = if signed { f64::from(value as u8 as i8) } else { value as f64 };
                *element.min = element.min.min(value);
                *element.max = element.max.max(value);
            }
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
                Attribute::new("flags", Scalar::I8, 1),
                Attribute::new("gps-time", Scalar::F64, 1),
                Attribute::new("rgb", Scalar::U16, 3),
                Attribute::new("nir", Scalar::U16, 2),
                Attribute::new("bytes", Scalar::U8, 2),
            ],
        };
        let records: Vec<u8> = (0..10_000i32)
            .flat_map(|i| {
                let time = if i % 3 == 0 { f64::NAN } else { f64::from(i) };
                let mut r = Vec::new();
                [i, -i, 7].iter().for_each(|v| r.extend(v.to_le_bytes()));
                r.extend([(i % 5) as u8, (i % 7 - 3) as u8]);
                r.extend(time.to_le_bytes());
                [i, 5, 6, 7 + i % 3, i % 9 + 1].iter().for_each(|v| r.extend((*v as u16).to_le_bytes()));
                r.extend([(i % 11) as u8, 200]);
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
        let range = |i: usize| {
            let AttributeStatistics { min, max, .. } = &whole.attributes[i];
            min.iter().copied().zip(max.iter().copied()).collect::<Vec<_>>()
        };
        assert_eq!(range(0), [(0.0, 9999.0), (-9999.0, 0.0), (7.0, 7.0)]);
        assert_eq!((range(1), range(2)), (vec![(0.0, 4.0)], vec![(-3.0, 3.0)]));
        assert_eq!(range(3), [(1.0, 9998.0)]);
        assert_eq!(
            (range(4)[0], range(4)[2], range(5)),
            ((0.0, 9999.0), (6.0, 6.0), vec![(7.0, 9.0), (1.0, 9.0)])
        );
        assert_eq!(range(6), [(0.0, 10.0), (200.0, 200.0)]);
        assert_eq!(whole.attributes[1].histogram.as_ref().unwrap()[4], 2000);
        assert_eq!(whole.attributes[2].histogram.as_ref().unwrap()[254], 1429);
        assert!(whole.attributes[6].histogram.is_none());
    }

    #[test]
    fn only_nan_is_no_value() {
        let schema = Schema { attributes: vec![Attribute::new("t", Scalar::F32, 1)] };
        let mut statistics = Statistics::empty(&schema);
        statistics.add(&schema, &f32::NAN.to_le_bytes());
        assert_eq!(statistics.attributes[0].not_finite, 1);
        statistics.attributes[0].not_finite = 0;
        assert_eq!(statistics, Statistics::empty(&schema));
    }

    #[test]
    fn values_that_are_no_numbers_are_counted() {
        let attributes = vec![
            Attribute::new("a", Scalar::U8, 1),
            Attribute::new("t", Scalar::F64, 1),
            Attribute::new("v", Scalar::F32, 3),
        ];
        let schema = Schema { attributes };
        let record = |t: f64, v: [f32; 3]| {
            let v: Vec<u8> = v.iter().flat_map(|v| v.to_le_bytes()).collect();
            [&[255][..], &t.to_le_bytes(), &v].concat()
        };
        let mut statistics = Statistics::empty(&schema);
        statistics.add(&schema, &record(f64::NAN, [1.0, f32::NAN, f32::NEG_INFINITY]));
        statistics.add(&schema, &record(2.0, [1.0; 3]));
        let mut other = Statistics::empty(&schema);
        other.add(&schema, &record(f64::INFINITY, [0.0; 3]));
        statistics.merge(&other);
        let counts: Vec<u64> = statistics.attributes.iter().map(|a| a.not_finite).collect();
        assert_eq!(counts, [0, 2, 2]);
    }
}
