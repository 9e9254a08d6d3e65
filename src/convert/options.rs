//! The options of a conversion: what changes the octree's bytes.

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

use super::formats::Formats;
use crate::deserialize_choice;
use crate::format::crs;
use crate::octree::attribute::{RGB, RGB_AVERAGE, RGB_ORIGINAL, Schema};
use crate::octree::sampling::nearest_to_center::NearestToCentre;
use crate::octree::sampling::poisson::PoissonDisk;
use crate::octree::sampling::poisson_shells::Shells;
use crate::octree::sampling::random_in_grid::RandomInGrid;
use crate::octree::sampling::sampler::Sampler;

/// How a node's sample is chosen from its children's points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Sampling {
    /// No two points of an inner node closer than its spacing.
    #[default]
    Poisson,
    /// One point a cell of a 128³ grid, after Kang et al.
    Random,
    /// As `poisson`, by the paper's shells; slow, and for comparison.
    Shells,
    /// The point nearest to the centre of each cell of a 128³ grid, as Entwine has it.
    Nearest,
}

impl Sampling {
    pub const ALL: [Sampling; 4] = [Sampling::Poisson, Sampling::Random, Sampling::Shells, Sampling::Nearest];

    /// What users call it.
    pub fn name(self) -> &'static str {
        match self {
            Sampling::Poisson => "poisson",
            Sampling::Random => "random",
            Sampling::Shells => "shells",
            Sampling::Nearest => "nearest",
        }
    }

    /// The sampler, for tree coordinates that were rounded by so much (see
    /// [`crate::octree::cube::Cube::slack`]).
    pub fn sampler(self, slack: u32) -> Box<dyn Sampler> {
        match self {
            Sampling::Poisson => Box::new(PoissonDisk::with_slack(slack)),
            Sampling::Random => Box::new(RandomInGrid),
            Sampling::Shells => Box::new(Shells::with_slack(slack)),
            Sampling::Nearest => Box::new(NearestToCentre),
        }
    }
}

/// How points are stored in octree.bin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "UPPERCASE")]
pub enum Encoding {
    /// Records one behind the other.
    #[default]
    #[value(alias = "UNCOMPRESSED")]
    Default,
    /// One brotli stream a node.
    Brotli,
}

/// What colours the points of coarse levels have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum LodColor {
    /// Their own.
    #[default]
    Keep,
    /// Their own, and the mean of what they stand for in an attribute beside it.
    Attribute,
    /// The mean of what they stand for, and their own in an attribute beside it.
    Average,
}

impl LodColor {
    /// The attribute that stands behind `rgb` for it.
    pub fn second(self) -> Option<&'static str> {
        match self {
            LodColor::Keep => None,
            LodColor::Attribute => Some(RGB_AVERAGE),
            LodColor::Average => Some(RGB_ORIGINAL),
        }
    }

    /// The attribute that holds the means.
    pub fn mean(self) -> Option<&'static str> {
        match self {
            LodColor::Keep => None,
            LodColor::Attribute => Some(RGB_AVERAGE),
            LodColor::Average => Some(RGB),
        }
    }

    /// What was made of it: where a cloud has no colours, or they are not kept,
    /// there is nothing to average. No field of an input has these names.
    pub fn of(schema: &Schema) -> LodColor {
        let all = [LodColor::Attribute, LodColor::Average];
        let has = |kind: &LodColor| kind.second().is_some_and(|name| schema.offset_of(name).is_some());
        all.into_iter().find(has).unwrap_or_default()
    }

    /// As options and octrees name it.
    pub fn name(self) -> &'static str {
        match self {
            LodColor::Keep => "keep",
            LodColor::Attribute => "attribute",
            LodColor::Average => "average",
        }
    }
}

/// What becomes of points that a guard finds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum GuardMode {
    /// They go into the octree like all others.
    Keep,
    /// They are written to `set-aside.laz` beside the octree.
    #[default]
    SetAside,
    /// They are counted and left out.
    Drop,
}

/// What becomes of a file that is cut, or of which some cannot be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Damaged {
    /// Nothing is converted.
    #[default]
    Fail,
    /// What can be read of it is, and what is missing is told.
    Keep,
}

deserialize_choice!(Sampling, Encoding, LodColor, GuardMode, Damaged);

/// What changes the octree's bytes. Threads, memory and folders do not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Options {
    pub sampling: Sampling,
    pub encoding: Encoding,
    /// Colours of coarse levels.
    pub lod_color: LodColor,
    /// Few points so far away that the cube would be made for them.
    pub outliers: GuardMode,
    /// Points at one position beyond a leaf's worth.
    pub duplicates: GuardMode,
    /// Files that promise more points than can be read.
    pub damaged: Damaged,
    /// Records that equal another in every attribute; kept unless asked for.
    pub twins: GuardMode,
    /// Attributes to keep by name; all where empty, and where it is `auto` all
    /// that are not zero in every point. `position` always stays.
    pub attributes: Vec<String>,
    /// The octree's name in its metadata; where none is given, from the input.
    pub name: Option<String>,
    /// The coordinate reference system as WKT, whatever the files say; read from an
    /// EPSG code too. Written only where it is given, so that the options of before
    /// there was such a thing stay the same.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "named_crs")]
    pub crs: Option<String>,
    /// What is written; told only where it is not the octree alone, for the same
    /// reason.
    #[serde(skip_serializing_if = "Formats::is_default")]
    pub format: Formats,
}

impl Options {
    /// Keys that are written only where they are given.
    pub const WRITTEN_IF_GIVEN: [&'static str; 2] = ["crs", "format"];
}

/// A system by its name, as WKT.
fn named_crs<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    let name = Option::<String>::deserialize(deserializer)?;
    name.map(|name| crs::named(&name)).transpose().map_err(D::Error::custom)
}

impl Default for Options {
    fn default() -> Options {
        Options {
            sampling: Sampling::default(),
            encoding: Encoding::default(),
            lod_color: LodColor::Keep,
            outliers: GuardMode::SetAside,
            duplicates: GuardMode::SetAside,
            twins: GuardMode::Keep,
            damaged: Damaged::Fail,
            attributes: Vec::new(),
            name: None,
            crs: None,
            format: Formats::default(),
        }
    }
}
