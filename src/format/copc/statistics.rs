//! The record `qgis`/0: statistics of all attributes as QGIS keeps them. A file that has
//! none is read to the end when QGIS first opens it, and then written to; a file that has
//! them is left alone.
//!
//! Names, scales and keys are QGIS's (QgsPointCloudStatistics, QgsLazDecoder).

use serde_json::{Map, Value, json};

use super::layout::{ANGLE, RANK};
use crate::octree::attribute::{Attribute, RGB, Schema};
use crate::octree::moments::{Moment, Moments};
use crate::octree::statistics::Statistics;

/// Degrees of a unit of the fine scan angle.
const ANGLE_UNIT: f64 = 0.006;

/// One element of an attribute under QGIS's name: what was stored × scale + offset.
struct StatisticsColumn<'a> {
    name: String,
    scale: f64,
    offset: f64,
    min: f64,
    max: f64,
    moment: Moment,
    /// Of one unsigned byte.
    counts: Option<&'a [u64]>,
}

impl StatisticsColumn<'_> {
    /// Keys as QGIS reads them; bounds that are no numbers have no place in JSON.
    fn json(&self) -> Value {
        let value = |stored: f64| stored * self.scale + self.offset;
        let (a, b) = match self.min <= self.max {
            true => (value(self.min), value(self.max)),
            false => (0.0, 0.0),
        };
        let deviation = (self.moment.deviation() * self.scale).abs();
        let counts: Map<String, Value> = (0..)
            .zip(self.counts.unwrap_or_default())
            .filter(|(_, n)| **n > 0)
            .map(|(value, points): (u32, _)| (value.to_string(), json!(points)))
            .collect();
        json!({
            "count": self.moment.count,
            "minimum": finite(a.min(b)),
            "maximum": finite(a.max(b)),
            "mean": finite(value(self.moment.mean)),
            "standard-deviation": finite(deviation),
            "class-count": counts,
        })
    }
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { value.signum() * f64::MAX * f64::from(!value.is_nan() as u8) }
}

/// The data of the record.
pub fn json(
    schema: &Schema,
    scale: [f64; 3],
    offset: [f64; 3],
    statistics: &Statistics,
    moments: &Moments,
) -> String {
    let points = moments.attributes.first().and_then(|position| position.first()).map_or(0, |x| x.count);
    let mut all = Map::new();
    for (index, attribute) in schema.attributes.iter().enumerate() {
        let Some(known) = statistics.attributes.get(index) else { continue };
        for element in 0..attribute.elements {
            let Some(name) = name(index, attribute, element) else { continue };
            let counts = known.histogram.as_deref();
            let moment = match counts {
                Some(counts) => Moment::of_counts(
                    counts.iter().zip(0u8..).map(|(count, byte)| (byte_value(attribute, byte), *count)),
                ),
                None => moments
                    .attributes
                    .get(index)
                    .and_then(|all| all.get(element))
                    .copied()
                    .unwrap_or_default(),
            };
            let (scale, offset) = match index {
                0 => (scale[element], offset[element]),
                _ if attribute.name == ANGLE => (ANGLE_UNIT, 0.0),
                _ => (attribute.scale[element], attribute.offset[element]),
            };
            let (mut min, mut max) = (known.min[element], known.max[element]);
            if let Some(counts) = counts {
                // A rank is signed, whatever viewers take it for.
                let met = || {
                    (0u8..=255)
                        .filter(|byte| counts[usize::from(*byte)] > 0)
                        .map(|byte| byte_value(attribute, byte))
                };
                (min, max) = met().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            }
            let column = StatisticsColumn { name, scale, offset, min, max, moment, counts };
            // Both kinds of angles are one to QGIS; the one that comes first is told.
            all.entry(column.name.clone()).or_insert_with(|| column.json());
        }
    }
    json!({ "sampled-points": points.min(i32::MAX as u64), "stats": all }).to_string()
}

fn byte_value(attribute: &Attribute, byte: u8) -> f64 {
    match attribute.name == RANK || attribute.scalar == crate::octree::attribute::Scalar::I8 {
        true => f64::from(byte as i8),
        false => f64::from(byte),
    }
}

/// QGIS's name for an element of an attribute; nothing for what it does not show.
fn name(index: usize, attribute: &Attribute, element: usize) -> Option<String> {
    if index == 0 {
        return Some(["X", "Y", "Z"][element].to_string());
    }
    if attribute.name == RGB {
        return Some(["Red", "Green", "Blue"][element].to_string());
    }
    let standard = match attribute.name.as_str() {
        "intensity" => "Intensity",
        "return number" => "ReturnNumber",
        "number of returns" => "NumberOfReturns",
        "scan direction flag" => "ScanDirectionFlag",
        "edge of flight line" => "EdgeOfFlightLine",
        "classification" => "Classification",
        ANGLE | RANK => "ScanAngleRank",
        "user data" => "UserData",
        "point source id" => "PointSourceId",
        "gps-time" => "GpsTime",
        "nir" => "Infrared",
        "scanner channel" => "ScannerChannel",
        // It stands for four of QGIS's.
        "classification flags" => return None,
        _ if attribute.elements > 1 => return None,
        other => other,
    };
    Some(standard.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::attribute::Scalar;

    #[test]
    fn statistics_are_in_the_words_of_qgis() {
        let attributes = [
            ("position", Scalar::I32, 3),
            ("classification", Scalar::U8, 1),
            (RANK, Scalar::U8, 1),
            ("rgb", Scalar::U16, 3),
        ];
        let schema = Schema { attributes: attributes.map(|(n, s, e)| Attribute::new(n, s, e)).to_vec() };
        let records: Vec<u8> = [(10i32, 2u8, -5i8, 7u16), (20, 2, 5, 9)]
            .iter()
            .flat_map(|(x, c, r, red)| {
                let mut record = [x.to_le_bytes(); 3].concat();
                record.extend([*c, *r as u8]);
                record.extend([red.to_le_bytes(); 3].concat());
                record
            })
            .collect();
        let mut statistics = Statistics::empty(&schema);
        statistics.add(&schema, &records);
        let mut moments = Moments::empty(&schema);
        moments.add(&schema, &records);
        let told = json(&schema, [0.5; 3], [100.0, 0.0, 0.0], &statistics, &moments);
        let told: Value = serde_json::from_str(&told).unwrap();
        assert_eq!(told["sampled-points"], 2);
        let x = &told["stats"]["X"];
        assert_eq!(
            (x["minimum"].as_f64(), x["maximum"].as_f64(), x["mean"].as_f64()),
            (Some(105.0), Some(110.0), Some(107.5))
        );
        assert_eq!(x["standard-deviation"], 2.5);
        assert_eq!(told["stats"]["Classification"]["class-count"], json!({ "2": 2 }));
        let angle = &told["stats"]["ScanAngleRank"];
        assert_eq!(
            (angle["minimum"].as_f64(), angle["maximum"].as_f64(), angle["mean"].as_f64()),
            (Some(-5.0), Some(5.0), Some(0.0))
        );
        assert_eq!(told["stats"]["Blue"]["mean"], 8.0);
    }
}
