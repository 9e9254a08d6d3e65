//! What the stability table is to measure.

use crate::lab::settings::BenchmarkSettings;
use crate::lab::synth::SceneKind;

/// What is to be measured, and by what means.
#[derive(Debug, Clone)]
pub struct StabilityOptions {
    pub means: BenchmarkSettings,
    /// Points of every scene.
    pub points: u64,
    /// Also the failing scenes as large as the papers have them.
    pub full: bool,
    /// Only these scenes; all where empty.
    pub scenes: Vec<SceneKind>,
}
