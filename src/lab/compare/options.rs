//! What is to be compared, and from where it is looked at.

use std::path::PathBuf;

use crate::lab::settings::BenchmarkSettings;
use crate::lab::synth::SceneKind;
use crate::render::framing::View;

/// What is to be compared.
#[derive(Debug, Clone)]
pub struct CompareOptions {
    pub means: BenchmarkSettings,
    pub scenes: Vec<SceneKind>,
    /// Points of each scene.
    pub points: u64,
    /// Clouds of the user, beside the scenes.
    pub clouds: Vec<PathBuf>,
    /// Points of a picture, by which octrees are compared.
    pub budgets: Vec<u64>,
    /// Patterns that a spectrum is the mean of.
    pub patterns: u32,
}

impl CompareOptions {
    /// For an impression, in minutes.
    pub fn quick(means: BenchmarkSettings) -> CompareOptions {
        let scenes = vec![SceneKind::Terrain, SceneKind::Interior, SceneKind::Object];
        let budgets = vec![50_000, 200_000];
        CompareOptions { means, scenes, points: 2_000_000, clouds: Vec::new(), budgets, patterns: 4 }
    }

    /// For the record, in an hour.
    pub fn full(means: BenchmarkSettings) -> CompareOptions {
        let scenes = vec![SceneKind::Terrain, SceneKind::Interior, SceneKind::Object, SceneKind::Town];
        let budgets = vec![50_000, 200_000, 800_000];
        CompareOptions { means, scenes, points: 20_000_000, clouds: Vec::new(), budgets, patterns: 16 }
    }
}

/// Side of all pictures, in pixels.
pub const SIZE: [u32; 2] = [512, 512];

/// The views of MEASURES.
pub const VIEWS: [(&str, View); 4] = [
    ("overview", View::Overview),
    ("grazing", View::Grazing),
    ("close", View::Close),
    ("inside", View::Inside),
];

/// The number that all scenes are made from.
pub const SEED: u64 = 1;
