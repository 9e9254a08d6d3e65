//! Means and spreads of attributes. Sums of floats depend on their order, so parts
//! are merged in an order that is fixed, and the result is the same to the last bit
//! whatever the threads did.

use serde::{Deserialize, Serialize};

use super::attribute::{Scalar, Schema};

/// Of a set of values: how many, their mean, and the sum of the squares of their
/// distances from it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Moment {
    pub count: u64,
    pub mean: f64,
    pub squares: f64,
}

impl Moment {
    /// Of values, but for those that are no numbers.
    fn of(values: impl Iterator<Item = f64>) -> Moment {
        let mut values = values.filter(|value| value.is_finite());
        // From the first value on: sums of large numbers would lose the small ones.
        let Some(first) = values.next() else { return Moment::default() };
        let (mut count, mut sum, mut squares) = (1u64, 0.0, 0.0);
        for value in values {
            let distance = value - first;
            count += 1;
            sum += distance;
            squares += distance * distance;
        }
        let mean = sum / count as f64;
        Moment { count, mean: first + mean, squares: (squares - sum * mean).max(0.0) }
    }

    /// Of values that were counted.
    pub fn of_counts(counts: impl Iterator<Item = (f64, u64)>) -> Moment {
        counts.filter(|(_, count)| *count > 0).fold(Moment::default(), |mut all, (value, count)| {
            all.merge(&Moment { count, mean: value, squares: 0.0 });
            all
        })
    }

    /// Adds another set (Chan, Golub, LeVeque 1979).
    pub fn merge(&mut self, other: &Moment) {
        let count = self.count + other.count;
        if count == 0 {
            return;
        }
        let (ours, theirs) = (self.count as f64, other.count as f64);
        let distance = other.mean - self.mean;
        self.mean += distance * (theirs / count as f64);
        self.squares += other.squares + distance * distance * (ours * theirs / count as f64);
        self.count = count;
    }

    /// The standard deviation of all values.
    pub fn deviation(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.squares / self.count as f64).sqrt() }
    }
}

/// Of every element of every attribute of a schema; of attributes of one byte, whose
/// values are counted anyhow, nothing.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// By attribute and element.
    pub attributes: Vec<Vec<Moment>>,
}

impl Moments {
    pub fn empty(schema: &Schema) -> Moments {
        let of = |elements: usize| vec![Moment::default(); elements];
        Moments { attributes: schema.attributes.iter().map(|attribute| of(attribute.elements)).collect() }
    }

    /// Takes in records of the schema, one behind the other.
    pub fn add(&mut self, schema: &Schema, records: &[u8]) {
        let size = schema.record_size();
        let mut at = 0;
        for (attribute, moments) in schema.attributes.iter().zip(&mut self.attributes) {
            for moment in moments {
                if attribute.size() > 1 {
                    moment.merge(&column(records, size, at, attribute.scalar));
                }
                at += attribute.scalar.size();
            }
        }
    }

    pub fn merge(&mut self, other: &Moments) {
        let all = self.attributes.iter_mut().flatten().zip(other.attributes.iter().flatten());
        all.for_each(|(a, b)| a.merge(b));
    }
}

/// Of one element.
fn column(records: &[u8], size: usize, at: usize, scalar: Scalar) -> Moment {
    match scalar {
        Scalar::I8 => of(records, size, at, |bytes| i8::from_le_bytes(bytes).into()),
        Scalar::U8 => of(records, size, at, |bytes| u8::from_le_bytes(bytes).into()),
        Scalar::I16 => of(records, size, at, |bytes| i16::from_le_bytes(bytes).into()),
        Scalar::U16 => of(records, size, at, |bytes| u16::from_le_bytes(bytes).into()),
        Scalar::I32 => of(records, size, at, |bytes| i32::from_le_bytes(bytes).into()),
        Scalar::U32 => of(records, size, at, |bytes| u32::from_le_bytes(bytes).into()),
        Scalar::I64 => of(records, size, at, |bytes| i64::from_le_bytes(bytes) as f64),
        Scalar::U64 => of(records, size, at, |bytes| u64::from_le_bytes(bytes) as f64),
        Scalar::F32 => of(records, size, at, |bytes| f32::from_le_bytes(bytes).into()),
        Scalar::F64 => of(records, size, at, f64::from_le_bytes),
    }
}

fn of<const N: usize>(records: &[u8], size: usize, at: usize, read: impl Fn([u8; N]) -> f64) -> Moment {
    Moment::of(records.chunks_exact(size).map(|record| {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&record[at..at + N]);
        read(bytes)
    }))
}

#[cfg(test)]
mod tests {
    use super::super::attribute::Attribute;
    use super::*;
    use proptest::prelude::*;

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-9 * (1.0 + a.abs().max(b.abs()))
    }

    proptest! {
        /// Parts give what the whole does, and both what the definition says.
        #[test]
        fn parts_add_up_to_the_whole(
            values in proptest::collection::vec((-1e6f64..1e6, any::<u16>()), 1..300),
            part in 1usize..50,
        ) {
            let schema = Schema { attributes: vec![
                Attribute::new("t", Scalar::F64, 1), Attribute::new("c", Scalar::U16, 1),
            ] };
            let records: Vec<u8> = values.iter()
                .flat_map(|(t, c)| [t.to_le_bytes().as_slice(), &c.to_le_bytes()].concat()).collect();
            let mut moments = Moments::empty(&schema);
            for part in records.chunks(part * schema.record_size()) {
                let mut one = Moments::empty(&schema);
                one.add(&schema, part);
                moments.merge(&one);
            }
            let columns = [values.iter().map(|v| v.0).collect::<Vec<_>>(),
                values.iter().map(|v| f64::from(v.1)).collect()];
            for (moment, column) in moments.attributes.iter().flatten().zip(columns) {
                let n = column.len() as f64;
                let mean = column.iter().sum::<f64>() / n;
                let variance = column.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
                prop_assert_eq!(moment.count, column.len() as u64);
                prop_assert!(near(moment.mean, mean) && near(moment.deviation(), variance.sqrt()), "{:?}", moment);
            }
        }
    }

    #[test]
    fn counts_are_values_and_nothing_is_made_of_no_numbers() {
        let of_counts = Moment::of_counts([(2.0, 3), (4.0, 1), (9.0, 0)].into_iter());
        assert_eq!((of_counts.count, of_counts.mean), (4, 2.5));
        assert_eq!(of_counts.deviation(), 0.75f64.sqrt());
        let some = Moment::of([f64::NAN, 1.0, f64::INFINITY, 3.0].into_iter());
        assert_eq!((some.count, some.mean, some.deviation()), (2, 2.0, 1.0));
        assert_eq!(Moment::of([f64::NAN].into_iter()).deviation(), 0.0);
    }
}
