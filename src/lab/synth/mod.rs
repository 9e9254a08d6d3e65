//! Synthetic clouds: the scenes of the measurements, from a seed, identical on
//! every machine and at any size.
//!
//! A scene is a function from a point's number to the point, so that any slice
//! can be made alone, in parallel and in constant memory. No file is written
//! here; the records are those of LAS and the command line hands them on.

mod aerial;
mod interior;
mod land;
mod noise;
mod point;
mod scan;
mod scene;
mod shapes;
mod source;
mod street;

pub use point::{Lattice, Point};
pub use scene::{Recipe, Scene, SceneError, Tile};

use serde::{Deserialize, Serialize};

/// The scenes, by the name of what they try out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Aerial flight strips over hills, houses, trees and roads.
    Terrain,
    /// Aerial, with a dense street-level scan in its middle.
    Town,
    /// Terrestrial scan positions in rooms behind each other.
    Interior,
    /// A dense closed surface in shuffled order.
    Object,
    /// A regular n³ grid.
    Volume,
    /// Terrain with a share of its points at one position, or in twins.
    Duplicates,
    /// A cloud of 400 m with 6 points hundreds of kilometres away.
    Outliers,
    /// No extent on one axis.
    Flat,
    /// No extent on two axes.
    Line,
    /// All points at one position.
    Dot,
    /// Terrain in tiles of different scale and offset; the output is a folder.
    Strips,
    /// A 0.1 mm lattice in UTM that nearly fills 32 bits.
    Far,
}

impl Kind {
    pub const ALL: [Kind; 12] = [
        Kind::Terrain,
        Kind::Town,
        Kind::Interior,
        Kind::Object,
        Kind::Volume,
        Kind::Duplicates,
        Kind::Outliers,
        Kind::Flat,
        Kind::Line,
        Kind::Dot,
        Kind::Strips,
        Kind::Far,
    ];

    /// What users call it.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Terrain => "terrain",
            Kind::Town => "town",
            Kind::Interior => "interior",
            Kind::Object => "object",
            Kind::Volume => "volume",
            Kind::Duplicates => "duplicates",
            Kind::Outliers => "outliers",
            Kind::Flat => "flat",
            Kind::Line => "line",
            Kind::Dot => "dot",
            Kind::Strips => "strips",
            Kind::Far => "far",
        }
    }
}

#[cfg(test)]
mod tests;
