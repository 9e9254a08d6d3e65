//! Coloring by any attribute, the legend that says what the colors mean, and all values of
//! one point.

use serde::Serialize;
use serde_json::{Number, Value};

use crate::octree::attribute::{Attribute, RGB, Scalar};
use crate::render::color::{ColorBy, ColorMapper};
use crate::render::octree::Octree;
use crate::render::palette;
use crate::render::sample::{CoarseSample, percentile};
use crate::words::class_name;

/// Shares of the values below the darkest and above the lightest color.
const TAIL: f64 = 0.01;
/// Colors of a legend's gradient.
const STOPS: usize = 9;

/// How a viewer colors points.
#[derive(Debug, Clone, PartialEq)]
pub enum Paint {
    /// As pictures do.
    Picture(ColorMapper),
    /// By a number of the record.
    Number { column: Column, low: f64, range: f64 },
}

/// Where a number stands in the record, and how it is read.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    offset: usize,
    scalar: Scalar,
    scale: f64,
    shift: f64,
}

/// What the colors mean.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Legend {
    /// The points' own colors.
    Own,
    /// From low to high in even steps.
    Gradient {
        low: f64,
        high: f64,
        stops: Vec<[u8; 3]>,
    },
    Classes {
        classes: Vec<Class>,
    },
}

/// A class of points and its color.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Class {
    pub value: u8,
    pub name: &'static str,
    pub color: [u8; 3],
}

/// A way to color, as a viewer offers it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Offer {
    /// What a request names it by.
    pub by: String,
    /// What people call it.
    pub label: String,
    pub legend: Legend,
}

impl Paint {
    /// How to color by a name: `auto`, `height`, that of an attribute, or of one of its
    /// elements as `name[1]`. Nothing where there is no such attribute.
    pub fn by(octree: &Octree, sample: &CoarseSample, name: &str) -> Option<Paint> {
        let picture = |by| ColorMapper::choose(octree, sample, by).ok().map(Paint::Picture);
        match name {
            "auto" => picture(ColorBy::Auto),
            "height" => picture(ColorBy::Height),
            // Of odd layouts pictures know nothing.
            "intensity" => picture(ColorBy::Intensity).or_else(|| number(octree, sample, name)),
            "classification" => picture(ColorBy::Classification).or_else(|| number(octree, sample, name)),
            RGB => picture(ColorBy::Rgb).or_else(|| number(octree, sample, name)),
            name => other_color(octree, name).or_else(|| number(octree, sample, name)),
        }
    }

    /// The color of a point at height `z`.
    pub fn color(&self, record: &[u8], z: f64) -> [u8; 3] {
        match self {
            Paint::Picture(painter) => painter.paint(record, z),
            Paint::Number { column, low, range } => palette::viridis((column.read(record) - low) / range),
        }
    }

    fn legend(&self, octree: &Octree, sample: &CoarseSample) -> Legend {
        let gradient = |low: f64, range: f64, color: fn(f64) -> [u8; 3]| Legend::Gradient {
            low,
            high: low + range,
            stops: (0..STOPS).map(|stop| color(stop as f64 / (STOPS - 1) as f64)).collect(),
        };
        match self {
            Paint::Picture(ColorMapper::Intensity { low, range, .. }) => {
                gradient(*low, *range, palette::grey)
            }
            Paint::Picture(ColorMapper::Height { low, range }) => gradient(*low, *range, palette::height),
            Paint::Picture(ColorMapper::Blend { height, .. }) => {
                gradient(height.low, height.range, palette::height)
            }
            Paint::Picture(ColorMapper::Classification { offset }) => {
                Legend::Classes { classes: classes(octree, sample, *offset) }
            }
            Paint::Picture(ColorMapper::Rgb { .. } | ColorMapper::Plain) => Legend::Own,
            Paint::Number { low, range, .. } => gradient(*low, *range, palette::viridis),
        }
    }
}

impl Column {
    fn read(&self, record: &[u8]) -> f64 {
        self.raw(record).as_f64().unwrap_or(f64::NAN) * self.scale + self.shift
    }

    /// The value as it is stored; what is no number as zero.
    fn raw(&self, record: &[u8]) -> Number {
        fn bytes<const N: usize>(record: &[u8], offset: usize) -> [u8; N] {
            record.get(offset..).and_then(|rest| rest.first_chunk()).copied().unwrap_or([0; N])
        }
        let at = self.offset;
        let float = |value: f64| Number::from_f64(value).unwrap_or(Number::from(0));
        match self.scalar {
            Scalar::I8 => i8::from_le_bytes(bytes(record, at)).into(),
            Scalar::U8 => u8::from_le_bytes(bytes(record, at)).into(),
            Scalar::I16 => i16::from_le_bytes(bytes(record, at)).into(),
            Scalar::U16 => u16::from_le_bytes(bytes(record, at)).into(),
            Scalar::I32 => i32::from_le_bytes(bytes(record, at)).into(),
            Scalar::U32 => u32::from_le_bytes(bytes(record, at)).into(),
            Scalar::I64 => i64::from_le_bytes(bytes(record, at)).into(),
            Scalar::U64 => u64::from_le_bytes(bytes(record, at)).into(),
            Scalar::F32 => float(f64::from(f32::from_le_bytes(bytes(record, at)))),
            Scalar::F64 => float(f64::from_le_bytes(bytes(record, at))),
        }
    }
}

/// Every attribute but the position, with the columns of its elements.
fn columns(octree: &Octree) -> Vec<(&Attribute, Vec<Column>)> {
    let mut offset = 0;
    let mut all = Vec::new();
    for attribute in &octree.schema.attributes {
        let of_element = |element: usize| Column {
            offset: offset + element * attribute.scalar.size(),
            scalar: attribute.scalar,
            scale: attribute.scale.get(element).copied().unwrap_or(1.0),
            shift: attribute.offset.get(element).copied().unwrap_or(0.0),
        };
        all.push((attribute, (0..attribute.elements).map(of_element).collect()));
        offset += attribute.size();
    }
    all.retain(|(attribute, _): &(&Attribute, Vec<Column>)| attribute.name != "position");
    all
}

/// Colors beside the usual ones, as averages are.
fn other_color(octree: &Octree, name: &str) -> Option<Paint> {
    let (_, columns) = columns(octree).into_iter().find(|(attribute, _)| is_color(attribute, name))?;
    let (offset, gain) = (columns.first()?.offset, 1.0 / 256.0);
    Some(Paint::Picture(ColorMapper::Rgb { offset, gain, small_gain: gain, bare: None }))
}

fn is_color(attribute: &Attribute, name: &str) -> bool {
    attribute.name == name
        && name.starts_with(RGB)
        && attribute.scalar == Scalar::U16
        && attribute.elements == 3
}

fn number(octree: &Octree, sample: &CoarseSample, name: &str) -> Option<Paint> {
    let named = |(attribute, columns): (&Attribute, Vec<Column>)| {
        let several = columns.len() > 1;
        let mut named = columns.into_iter().enumerate();
        named.find(|(element, _)| element_name(&attribute.name, *element, several) == name)
    };
    let (_, column) = columns(octree).into_iter().find_map(named)?;
    let mut values: Vec<f64> = sample.records().map(|record| column.read(record)).collect();
    values.retain(|value| value.is_finite());
    let (low, high) = (percentile(&mut values, TAIL), percentile(&mut values, 1.0 - TAIL));
    Some(Paint::Number { column, low, range: if high > low { high - low } else { 1.0 } })
}

fn element_name(attribute: &str, element: usize, several: bool) -> String {
    if several { format!("{attribute}[{element}]") } else { attribute.to_string() }
}

/// All ways to color, the usual one first.
pub fn offers(octree: &Octree, sample: &CoarseSample) -> Vec<Offer> {
    let mut names = vec!["auto".to_string(), "height".to_string()];
    for (attribute, columns) in columns(octree) {
        if is_color(attribute, &attribute.name) {
            names.push(attribute.name.clone());
            continue;
        }
        let several = columns.len() > 1;
        names.extend((0..columns.len()).map(|element| element_name(&attribute.name, element, several)));
    }
    let offer = |name: String| {
        let paint = Paint::by(octree, sample, &name)?;
        let label = match (name.as_str(), &paint) {
            ("auto", Paint::Picture(painter)) => format!("as in its picture ({})", painter.shows()),
            (RGB, _) => "color".to_string(),
            _ => name.clone(),
        };
        Some(Offer { legend: paint.legend(octree, sample), label, by: name })
    };
    names.into_iter().filter_map(offer).collect()
}

/// The classes that occur, by the metadata's count of them or, without one, among the
/// points that were looked at.
fn classes(octree: &Octree, sample: &CoarseSample, offset: usize) -> Vec<Class> {
    let entry = octree.metadata.attributes.iter().find(|attribute| attribute.name == "classification");
    let counted = entry.and_then(|entry| entry.histogram.as_ref()).filter(|counts| counts.len() == 256);
    let mut occurs = [false; 256];
    match counted {
        Some(counts) => occurs.iter_mut().zip(counts).for_each(|(occurs, count)| *occurs = *count > 0),
        None => sample.records().for_each(|record| {
            occurs[usize::from(record.get(offset).copied().unwrap_or(0))] = true;
        }),
    }
    let class = |value: u8| Class {
        value,
        name: class_name(i64::from(value)).unwrap_or("of the file's own"),
        color: palette::class(value),
    };
    (0..=255u8).filter(|value| occurs[usize::from(*value)]).map(class).collect()
}

/// What a point has, attribute by attribute: one value, or a list of them.
pub fn values(octree: &Octree, record: &[u8]) -> Vec<(String, Value)> {
    let value = |column: &Column| {
        let raw = column.raw(record);
        if column.scale == 1.0 && column.shift == 0.0 {
            return Value::Number(raw);
        }
        Number::from_f64(column.read(record)).map_or(Value::Null, Value::Number)
    };
    let of_attribute = |(attribute, columns): (&Attribute, Vec<Column>)| {
        let value = match columns.as_slice() {
            [column] => value(column),
            columns => columns.iter().map(value).collect(),
        };
        (attribute.name.clone(), value)
    };
    columns(octree).into_iter().map(of_attribute).collect()
}
