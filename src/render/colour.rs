//! What the points are painted by: their own colour where they have one, else
//! intensity, else classification, else height.

use serde::Serialize;

use super::error::{RenderError, Result};
use super::octree::Octree;
use super::palette;
use super::sample::{Sample, percentile};
use crate::cloud::attribute::{RGB, RGB_AVERAGE, Scalar, Schema};
use crate::deserialize_choice;

/// What to colour by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum ColorBy {
    /// By what is there.
    #[default]
    Auto,
    Rgb,
    Intensity,
    Classification,
    Height,
}

deserialize_choice!(ColorBy);

/// How a record becomes a colour.
#[derive(Debug, Clone, PartialEq)]
pub enum Painter {
    /// Three values from `offset` on, of two bytes each; `gain` makes 255 of
    /// the largest one.
    Rgb {
        offset: usize,
        gain: f32,
    },
    /// The value at `offset`, of two bytes: `low` is dark, `low + range` light.
    Intensity {
        offset: usize,
        low: f64,
        range: f64,
    },
    Classification {
        offset: usize,
    },
    /// World z.
    Height {
        low: f64,
        range: f64,
    },
}

impl Painter {
    /// The painter that is asked for; `Auto` never fails.
    pub fn choose(octree: &Octree, sample: &Sample, by: ColorBy) -> Result<Painter> {
        let schema = &octree.schema;
        let missing = |attribute| RenderError::NoAttribute { folder: octree.folder.clone(), attribute };
        match by {
            ColorBy::Rgb => {
                let offset = own_color(octree).ok_or_else(|| missing("rgb"))?;
                Ok(rgb(sample, offset).unwrap_or(Painter::Rgb { offset, gain: 1.0 / 256.0 }))
            }
            ColorBy::Intensity => {
                let offset = two_bytes(schema, "intensity", 1).ok_or_else(|| missing("intensity"))?;
                Ok(intensity(sample, offset))
            }
            ColorBy::Classification => {
                let offset = class_byte(schema).ok_or_else(|| missing("classification"))?;
                Ok(Painter::Classification { offset })
            }
            ColorBy::Height => Ok(height(sample)),
            ColorBy::Auto => Ok(automatic(octree, sample)),
        }
    }

    /// The name of what is shown, as the metadata has it.
    pub fn shows(&self) -> &'static str {
        match self {
            Painter::Rgb { .. } => "rgb",
            Painter::Intensity { .. } => "intensity",
            Painter::Classification { .. } => "classification",
            Painter::Height { .. } => "height",
        }
    }

    /// The colour of a point.
    pub fn paint(&self, record: &[u8], z: f64) -> [u8; 3] {
        match *self {
            Painter::Rgb { offset, gain } => {
                std::array::from_fn(|i| (f32::from(u16_at(record, offset + 2 * i)) * gain).min(255.0) as u8)
            }
            Painter::Intensity { offset, low, range } => {
                palette::grey((f64::from(u16_at(record, offset)) - low) / range)
            }
            Painter::Classification { offset } => palette::class(record.get(offset).copied().unwrap_or(0)),
            Painter::Height { low, range } => palette::height((z - low) / range),
        }
    }
}

fn automatic(octree: &Octree, sample: &Sample) -> Painter {
    let schema = &octree.schema;
    let own = own_color(octree).and_then(|offset| rgb(sample, offset));
    let by_intensity = || {
        let painter = intensity(sample, two_bytes(schema, "intensity", 1)?);
        matches!(painter, Painter::Intensity { range, .. } if range > 1.0).then_some(painter)
    };
    let by_class = || {
        let offset = class_byte(schema)?;
        // 0 and 1 say that nobody has looked.
        let told = sample.records().filter(|record| record[offset] > 1).count();
        (told * 20 > sample.size()).then_some(Painter::Classification { offset })
    };
    own.or_else(by_intensity).or_else(by_class).unwrap_or_else(|| height(sample))
}

/// Colours, unless they are all the same one (as black is, where none were
/// taken). Values of eight bits in the sixteen of the field are recognised
/// over the whole cloud, and pictures that are far too dark are lightened.
fn rgb(sample: &Sample, offset: usize) -> Option<Painter> {
    let color = |record: &[u8]| -> [u16; 3] { std::array::from_fn(|i| u16_at(record, offset + 2 * i)) };
    let first = color(sample.records().next()?);
    if sample.records().all(|record| color(record) == first) {
        return None;
    }
    let mut brightest: Vec<f64> =
        sample.records().map(|record| f64::from(color(record).into_iter().max().unwrap_or(0))).collect();
    let high = percentile(&mut brightest, 0.995);
    if high <= 0.0 {
        return None;
    }
    // By 256 and rounded down: 65535 and 65280 are both how writers say 255.
    let (full, mut gain) = if high <= 255.0 { (255.0, 1.0) } else { (65535.0, 1.0 / 256.0) };
    if high < 0.35 * full {
        gain *= (0.85 * full / high).min(16.0);
    }
    Some(Painter::Rgb { offset, gain: gain as f32 })
}

/// The range that UnityPIC shows (section 5): of each node two standard
/// deviations to either side of the mean, weighted by its points; here of
/// values between the 0.5th and the 99.5th percentile, since a few mirrors and
/// retroreflectors outshine all the rest.
fn intensity(sample: &Sample, offset: usize) -> Painter {
    let value = |record: &[u8]| f64::from(u16_at(record, offset));
    let mut all: Vec<f64> = sample.records().map(value).collect();
    let (floor, ceiling) = (percentile(&mut all, 0.005), percentile(&mut all, 0.995));
    let (mut low, mut high, mut weight) = (0.0, 0.0, 0.0);
    for node in sample.nodes() {
        let values = || node.clone().map(|record| value(record).clamp(floor, ceiling));
        let count = values().count() as f64;
        let mean = values().sum::<f64>() / count;
        let deviation = (values().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt();
        low += count * (mean - 2.0 * deviation).max(floor);
        high += count * (mean + 2.0 * deviation).min(ceiling);
        weight += count;
    }
    let (low, high) = if weight > 0.0 { (low / weight, high / weight) } else { (0.0, 0.0) };
    Painter::Intensity { offset, low, range: (high - low).max(1.0) }
}

fn height(sample: &Sample) -> Painter {
    let mut heights: Vec<f64> = sample.positions.iter().map(|p| p[2]).collect();
    let (low, high) = (percentile(&mut heights, 0.01), percentile(&mut heights, 0.99));
    Painter::Height { low, range: (high - low).max(f64::MIN_POSITIVE) }
}

fn u16_at(record: &[u8], offset: usize) -> u16 {
    record.get(offset..).and_then(|bytes| bytes.first_chunk()).map_or(0, |b| u16::from_le_bytes(*b))
}

/// Where a record has its colour: the average of what it stands for, where the
/// octree has those beside, for pictures show few of the points.
fn own_color(octree: &Octree) -> Option<usize> {
    let generator = octree.metadata.generator.as_ref();
    let has_averages = generator.is_some_and(|generator| generator.lod_color.as_deref() == Some("attribute"));
    let average = if has_averages { two_bytes(&octree.schema, RGB_AVERAGE, 3) } else { None };
    average.or_else(|| two_bytes(&octree.schema, RGB, 3))
}

/// Where an attribute of sixteen-bit numbers stands in the record.
fn two_bytes(schema: &Schema, name: &str, elements: usize) -> Option<usize> {
    let attribute = schema.attributes.iter().find(|attribute| attribute.name == name)?;
    let fits = attribute.scalar == Scalar::U16 && attribute.elements == elements;
    fits.then(|| schema.offset_of(name)).flatten()
}

fn class_byte(schema: &Schema) -> Option<usize> {
    let attribute = schema.attributes.iter().find(|attribute| attribute.name == "classification")?;
    (attribute.scalar == Scalar::U8).then(|| schema.offset_of("classification")).flatten()
}
