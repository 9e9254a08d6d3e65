//! What the points are painted by: their own color where they have one, else
//! intensity, else classification, else height. It is decided point by point: tiles
//! with and without colors, and with colors of eight and of sixteen bits, may lie in
//! one cloud.

use serde::Serialize;

use super::error::{RenderError, Result};
use super::lone_points::Neighborhood;
use super::octree::Octree;
use super::palette;
use super::sample::{CoarseSample, percentile};
use crate::deserialize_choice;
use crate::octree::attribute::{RGB, RGB_AVERAGE, Scalar, Schema};

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

/// How a record becomes a color.
#[derive(Debug, Clone, PartialEq)]
pub enum ColorMapper {
    /// Three values from `offset` on, of two bytes each.
    Rgb {
        offset: usize,
        /// What makes 255 of the largest value, of points whose values are sixteen bits.
        gain: f32,
        /// The same for points of which no value is over 255.
        small_gain: f32,
        /// What paints points that are black throughout, where so many are that they
        /// have no color rather than that one.
        bare: Option<Box<ColorMapper>>,
    },
    /// The value at `offset`, of two bytes: `low` is dark, `low + range` light.
    Intensity {
        offset: usize,
        low: f64,
        range: f64,
    },
    /// Height in color, intensity as its light.
    Blend {
        height: ValueRange,
        intensity: ValueRange,
        offset: usize,
    },
    Classification {
        offset: usize,
    },
    /// World z.
    Height {
        low: f64,
        range: f64,
    },
    /// One grey, for points of which nothing is known.
    Plain,
}

/// What is darkest, and how much more is lightest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueRange {
    pub low: f64,
    pub range: f64,
}

impl ValueRange {
    fn share(self, value: f64) -> f64 {
        (value - self.low) / self.range
    }
}

impl ColorMapper {
    /// The painter that is asked for; `Auto` never fails.
    pub fn choose(octree: &Octree, sample: &CoarseSample, by: ColorBy) -> Result<ColorMapper> {
        let schema = &octree.schema;
        let missing = |attribute| RenderError::NoAttribute { folder: octree.folder.clone(), attribute };
        match by {
            ColorBy::Rgb => {
                let offset = own_color(octree).ok_or_else(|| missing("rgb"))?;
                let gain = 1.0 / 256.0;
                let plain = ColorMapper::Rgb { offset, gain, small_gain: gain, bare: None };
                Ok(rgb(octree, sample, offset).unwrap_or(plain))
            }
            ColorBy::Intensity => {
                let offset = two_bytes(schema, "intensity", 1).ok_or_else(|| missing("intensity"))?;
                Ok(intensity(sample, offset))
            }
            ColorBy::Classification => {
                let offset = class_byte(schema).ok_or_else(|| missing("classification"))?;
                Ok(ColorMapper::Classification { offset })
            }
            ColorBy::Height => Ok(height(sample)),
            ColorBy::Auto => Ok(automatic(octree, sample)),
        }
    }

    /// The name of what is shown, as the metadata has it.
    pub fn shows(&self) -> &'static str {
        match self {
            ColorMapper::Rgb { .. } => "rgb",
            ColorMapper::Intensity { .. } => "intensity",
            ColorMapper::Blend { .. } => "intensity and height",
            ColorMapper::Classification { .. } => "classification",
            ColorMapper::Height { .. } => "height",
            ColorMapper::Plain => "nothing",
        }
    }

    /// The color of a point.
    pub fn paint(&self, record: &[u8], z: f64) -> [u8; 3] {
        match *self {
            ColorMapper::Rgb { offset, gain, small_gain, ref bare } => {
                let color = color_at(record, offset);
                match (brightest(color), bare) {
                    (0, Some(bare)) => bare.paint(record, z),
                    (0..=255, _) => color.map(|value| (f32::from(value) * small_gain).min(255.0) as u8),
                    _ => color.map(|value| (f32::from(value) * gain).min(255.0) as u8),
                }
            }
            ColorMapper::Intensity { offset, low, range } => {
                palette::grey((f64::from(u16_at(record, offset)) - low) / range)
            }
            ColorMapper::Blend { height, intensity, offset } => {
                let light = intensity.share(f64::from(u16_at(record, offset))).clamp(0.0, 1.0);
                let light = DIMMEST + (1.0 - DIMMEST) * light;
                palette::height(height.share(z)).map(|value| (f64::from(value) * light) as u8)
            }
            ColorMapper::Classification { offset } => {
                palette::class(record.get(offset).copied().unwrap_or(0))
            }
            ColorMapper::Height { low, range } => palette::height((z - low) / range),
            ColorMapper::Plain => palette::grey(0.5),
        }
    }
}

/// Light of the darkest intensity where it only shades the colors of heights.
const DIMMEST: f64 = 0.4;
/// Fewer colored points than this share are no color of the cloud.
const COLORED: f64 = 0.05;
/// More black points than this share have no color.
const BARE: f64 = 0.01;
/// Fewer points than this share, of those with a color, are no kind of their own.
const KIND: f64 = 0.005;
/// Neighbors that differ by this share of what any two points differ by are noise, ...
const NOISE: f64 = 0.85;
/// ... and by this so grainy that the shape helps.
const GRAINY: f64 = 0.65;
/// Intensities of which this share is the largest value are cut off there.
const SATURATED: f64 = 0.05;

fn automatic(octree: &Octree, sample: &CoarseSample) -> ColorMapper {
    let schema = &octree.schema;
    let own = own_color(octree).and_then(|offset| rgb(octree, sample, offset));
    let by_intensity = || {
        let painter = intensity(sample, two_bytes(schema, "intensity", 1)?);
        matches!(painter, ColorMapper::Intensity { range, .. } if range > 1.0)
            .then(|| shaped(sample, painter))
    };
    let by_class = || {
        let offset = class_byte(schema)?;
        // 0 and 1 say that nobody has looked.
        let told = sample.records().filter(|record| record[offset] > 1).count();
        (told * 20 > sample.size()).then_some(ColorMapper::Classification { offset })
    };
    own.or_else(by_intensity).or_else(by_class).unwrap_or_else(|| height(sample))
}

/// Intensity where it shows something; with the height, or the height alone, where it
/// is noise or cut off. A cloud without heights has nothing else to show.
fn shaped(sample: &CoarseSample, painter: ColorMapper) -> ColorMapper {
    let ColorMapper::Intensity { offset, low, range } = painter else { return painter };
    let (bottom, top) = heights(sample);
    if top <= bottom {
        return painter;
    }
    let value = |record: &[u8]| u16_at(record, offset);
    let most = sample.records().map(value).max().unwrap_or(0);
    let cut_off = sample.records().filter(|record| value(record) == most).count();
    let graininess = graininess(sample, offset);
    if graininess >= NOISE {
        ColorMapper::Height { low: bottom, range: top - bottom }
    } else if graininess >= GRAINY || cut_off as f64 >= SATURATED * sample.size() as f64 {
        let (height, intensity) =
            (ValueRange { low: bottom, range: top - bottom }, ValueRange { low, range });
        ColorMapper::Blend { height, intensity, offset }
    } else {
        painter
    }
}

/// How much the intensities of neighbors differ, as a share of how much those of any
/// two points do: 1 is noise, 0 is smooth.
fn graininess(sample: &CoarseSample, offset: usize) -> f64 {
    let mut values: Vec<f64> = sample.records().map(|record| f64::from(u16_at(record, offset))).collect();
    // Positions that are no numbers have no neighbors.
    let Some(neighborhood) = Neighborhood::of(&sample.positions) else { return 0.0 };
    if values.len() != sample.positions.len() {
        return 0.0;
    }
    let mut sorted = values.clone();
    let (floor, ceiling) = (percentile(&mut sorted, 0.005), percentile(&mut sorted, 0.995));
    values.iter_mut().for_each(|value| *value = value.clamp(floor, ceiling));
    let pairs = neighborhood.pairs(PAIRS);
    let near: f64 = pairs.iter().map(|(a, b)| (values[*a] - values[*b]).abs()).sum();
    // A stride that is prime to nearly every count, so that partners are well mixed.
    let any = |n: &usize| (values[*n] - values[(n * 7919 + 104_729) % values.len()]).abs();
    let far: f64 = pairs.iter().map(|(a, _)| any(a)).sum();
    if far > 0.0 { near / far } else { 0.0 }
}

/// Pairs of neighbors that are enough to judge by.
const PAIRS: usize = 4000;

fn color_at(record: &[u8], offset: usize) -> [u16; 3] {
    std::array::from_fn(|i| u16_at(record, offset + 2 * i))
}

fn brightest(color: [u16; 3]) -> u16 {
    color.into_iter().max().unwrap_or(0)
}

/// Colors, unless hardly a point has one, or all have the same. Black throughout is
/// none. Values of eight bits in the sixteen of the field are recognized by the points
/// themselves, and pictures that are far too dark are lightened.
fn rgb(octree: &Octree, sample: &CoarseSample, offset: usize) -> Option<ColorMapper> {
    let all: Vec<[u16; 3]> = sample.records().map(|record| color_at(record, offset)).collect();
    let first = all.iter().find(|color| brightest(**color) > 0)?;
    let mut colored: Vec<f64> =
        all.iter().map(|color| f64::from(brightest(*color))).filter(|high| *high > 0.0).collect();
    let bare = all.len() - colored.len();
    let too_few = (colored.len() as f64) < COLORED * all.len() as f64;
    if too_few
        || (bare == 0 || is_many(bare, all.len(), BARE))
            && all.iter().all(|c| c == first || brightest(*c) == 0)
    {
        return None;
    }
    let (mut small, mut large): (Vec<f64>, Vec<f64>) = colored.drain(..).partition(|high| *high <= 255.0);
    // Shadows of a picture of sixteen bits are as dark as the light of one of eight. But
    // values thin out from the ones above 255 to the ones below, where they are of one kind.
    let within =
        |values: &[f64], low: f64, high: f64| values.iter().filter(|v| (low..high).contains(*v)).count();
    let of_eight = large.is_empty()
        || is_many(small.len(), small.len() + large.len(), KIND)
            && within(&small, 128.0, 256.0) > 2 * within(&large, 256.0, 512.0);
    // By 256 and rounded down: 65535 and 65280 are both how writers say 255.
    let gain = if large.is_empty() { 1.0 / 256.0 } else { gain(&mut large, 65_535.0, 1.0 / 256.0) };
    let small_gain = if of_eight { gain_of_small(&mut small) } else { gain };
    let bare = is_many(bare, all.len(), BARE).then(|| Box::new(uncolored(octree, sample, offset)));
    Some(ColorMapper::Rgb { offset, gain: gain as f32, small_gain: small_gain as f32, bare })
}

fn is_many(some: usize, of: usize, share: f64) -> bool {
    some as f64 > share * of as f64
}

fn gain_of_small(values: &mut [f64]) -> f64 {
    if values.is_empty() { 1.0 } else { gain(values, 255.0, 1.0) }
}

/// What makes colors of values; more where even the bright ones are dark.
fn gain(values: &mut [f64], full: f64, usual: f64) -> f64 {
    let high = percentile(values, 0.995);
    if high < 0.35 * full { usual * (0.85 * full / high.max(1.0)).min(64.0) } else { usual }
}

/// What paints points without a color among colored ones: a grey, so that nobody takes
/// it for a color; by the intensity of such points, and of height where they have none.
fn uncolored(octree: &Octree, sample: &CoarseSample, color: usize) -> ColorMapper {
    let is_bare = |record: &&[u8]| brightest(color_at(record, color)) == 0;
    let by_intensity = two_bytes(&octree.schema, "intensity", 1).and_then(|offset| {
        let mut values: Vec<f64> =
            sample.records().filter(is_bare).map(|record| f64::from(u16_at(record, offset))).collect();
        let (low, high) = (percentile(&mut values, 0.02), percentile(&mut values, 0.98));
        (high > low).then_some(ColorMapper::Intensity { offset, low, range: (high - low).max(1.0) })
    });
    by_intensity.unwrap_or(ColorMapper::Plain)
}

/// The range that UnityPIC shows (section 5): of each node two standard
/// deviations to either side of the mean, weighted by its points; here of
/// values between the 0.5th and the 99.5th percentile, since a few mirrors and
/// retroreflectors outshine all the rest.
fn intensity(sample: &CoarseSample, offset: usize) -> ColorMapper {
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
    ColorMapper::Intensity { offset, low, range: (high - low).max(1.0) }
}

/// The color of the middle where a cloud is level.
fn height(sample: &CoarseSample) -> ColorMapper {
    let (low, high) = heights(sample);
    match high > low {
        true => ColorMapper::Height { low, range: high - low },
        false => ColorMapper::Height { low: low - 0.5, range: 1.0 },
    }
}

/// Lowest and highest of what does not stand alone: noise in the sky is not to take the
/// colors.
fn heights(sample: &CoarseSample) -> (f64, f64) {
    let mut heights: Vec<f64> = sample.together.iter().map(|p| p[2]).collect();
    (percentile(&mut heights, 0.01), percentile(&mut heights, 0.99))
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
