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

pub use point::{FileLattice, Point};
pub use scene::{Recipe, SceneError, SceneFile, SyntheticScene};

use serde::{Deserialize, Serialize};

/// The scenes, by the name of what they try out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum SceneKind {
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

impl SceneKind {
    pub const ALL: [SceneKind; 12] = [
        SceneKind::Terrain,
        SceneKind::Town,
        SceneKind::Interior,
        SceneKind::Object,
        SceneKind::Volume,
        SceneKind::Duplicates,
        SceneKind::Outliers,
        SceneKind::Flat,
        SceneKind::Line,
        SceneKind::Dot,
        SceneKind::Strips,
        SceneKind::Far,
    ];

    /// What users call it.
    pub fn name(self) -> &'static str {
        match self {
            SceneKind::Terrain => "terrain",
            SceneKind::Town => "town",
            SceneKind::Interior => "interior",
            SceneKind::Object => "object",
            SceneKind::Volume => "volume",
            SceneKind::Duplicates => "duplicates",
            SceneKind::Outliers => "outliers",
            SceneKind::Flat => "flat",
            SceneKind::Line => "line",
            SceneKind::Dot => "dot",
            SceneKind::Strips => "strips",
            SceneKind::Far => "far",
        }
    }
}

#[cfg(test)]
mod tests;
