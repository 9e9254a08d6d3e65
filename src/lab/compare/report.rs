//! The figures: what is written as JSON, and read again to be held against a
//! later run.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::machine;
use super::method::Method;
use super::options::{CompareOptions, SEED};
use crate::lab::process::Spread;
use crate::lab::sampling::evenness::Evenness;
use crate::lab::sampling::spectrum::Spectrum;
use crate::lab::settings::{MeasureError, Result};

/// Changes when an earlier report can no longer be held against a new one.
const FORMAT: u32 = 1;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ComparisonReport {
    pub format: u32,
    pub version: String,
    /// Of the checkout that the program lies in; empty where it lies in none.
    pub commit: String,
    /// In words.
    pub machine: String,
    pub threads: usize,
    pub rounds: usize,
    pub seed: u64,
    pub budgets: Vec<u64>,
    pub patterns: Vec<PatternReport>,
    pub scenes: Vec<SceneReport>,
}

/// A sampler on a plane of noise.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PatternReport {
    pub method: String,
    pub spectrum: Spectrum,
    /// Of the finer level of all patterns.
    pub even: Evenness,
    /// The dots of one, around the middle, in the unit square, in thousandths.
    pub dots: Vec<[u16; 2]>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SceneReport {
    pub name: String,
    pub points: u64,
    /// Of all its files.
    pub bytes: u64,
    pub methods: Vec<MethodReport>,
    pub renderers: Vec<RendererReport>,
}

/// A way to convert a scene. Costs are those of the whole process.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MethodReport {
    pub method: String,
    pub wall: Spread,
    pub cpu: Spread,
    /// Most memory resident at once, bytes.
    pub peak: u64,
    pub seconds_by_stage: BTreeMap<String, f64>,
    /// Bytes of octree.bin.
    pub octree_bytes: u64,
    /// Nanoseconds a point of the sampler alone, on one thread; of each sampler
    /// once.
    pub sampler_ns: Option<Spread>,
    /// Of all levels with inner nodes.
    pub even: Evenness,
    /// Of the coarse levels, by budget.
    pub pictures: Vec<PictureReport>,
}

/// A picture, held against that of all points.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PictureReport {
    pub view: String,
    pub budget: u64,
    pub points: u64,
    /// Of 255.
    pub error: f64,
    pub flip: f64,
}

/// A way to draw, at several budgets.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RendererReport {
    pub style: String,
    /// `cpu`, or the GPU's name.
    pub renderer: String,
    pub pictures: Vec<FrameReport>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FrameReport {
    pub picture: PictureReport,
    /// Milliseconds to draw what is in memory, and to choose and read it before.
    pub draw_ms: f64,
    pub load_ms: f64,
}

impl ComparisonReport {
    pub fn new(options: &CompareOptions) -> ComparisonReport {
        ComparisonReport {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_string(),
            commit: machine::commit(&options.means.program),
            machine: machine::words(),
            threads: options.means.threads,
            rounds: options.means.rounds,
            seed: SEED,
            budgets: options.budgets.clone(),
            patterns: Vec::new(),
            scenes: Vec::new(),
        }
    }

    /// The scene of a name.
    pub fn scene(&self, name: &str) -> Option<&SceneReport> {
        self.scenes.iter().find(|scene| scene.name == name)
    }
}

impl SceneReport {
    /// The figures of the default method.
    pub fn default_method(&self) -> Option<&MethodReport> {
        self.methods.iter().find(|method| method.is_default())
    }

    pub fn method(&self, name: &str) -> Option<&MethodReport> {
        self.methods.iter().find(|method| method.method == name)
    }
}

impl MethodReport {
    /// Processor seconds a million points.
    pub fn cpu_a_million(&self, points: u64) -> f64 {
        self.cpu.median / points.max(1) as f64 * 1e6
    }

    /// The mean error of the pictures of a budget, over the views.
    pub fn error(&self, budget: u64) -> f64 {
        mean(self.pictures.iter().filter(|picture| picture.budget == budget).map(|picture| picture.error))
    }

    /// The mean ꟻLIP, likewise.
    pub fn flip(&self, budget: u64) -> f64 {
        mean(self.pictures.iter().filter(|picture| picture.budget == budget).map(|picture| picture.flip))
    }

    pub fn is_default(&self) -> bool {
        self.method == Method::ALL[0].name()
    }
}

/// Not a number where there are none.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count)
}

/// Reads an earlier report.
pub fn read(path: &Path) -> Result<ComparisonReport> {
    let earlier = |problem: String| MeasureError::Earlier { path: path.to_path_buf(), problem };
    let text = std::fs::read(path).map_err(|error| earlier(error.to_string()))?;
    let report: ComparisonReport = serde_json::from_slice(&text)
        .map_err(|error| earlier(format!("this is no report of `lodestone report --json`: {error}")))?;
    if report.format != FORMAT {
        let other = format!("its format is {} where {FORMAT} is known here", report.format);
        return Err(earlier(format!("{other}; measure it again with this version")));
    }
    Ok(report)
}

/// Made-up figures, for tests of what is made of them.
#[cfg(test)]
pub mod tests_support {
    use super::*;
    use crate::lab::process::spread;

    pub fn method(name: &str, cpu: f64, error: f64) -> MethodReport {
        let times = |value: f64| spread([value, value * 1.1, value * 0.9].into_iter());
        let picture = |view: &str, budget| PictureReport {
            view: view.to_string(),
            budget,
            points: budget - 7,
            error,
            flip: error / 100.0,
        };
        MethodReport {
            method: name.to_string(),
            wall: times(cpu / 1.8),
            cpu: times(cpu),
            peak: 300_000_000,
            seconds_by_stage: BTreeMap::from([("index".to_string(), cpu / 2.0)]),
            octree_bytes: 29_000_000,
            sampler_ns: Some(times(if name == "shells" { 250.0 } else { 50.0 })),
            even: Evenness { samples: 10_000, inside: 0, across: 1, rejected: 50_000, hole: 1.0 },
            pictures: vec![picture("overview", 50_000), picture("close", 50_000), picture("close", 200_000)],
        }
    }

    pub fn report(methods: Vec<MethodReport>) -> ComparisonReport {
        let spectrum =
            Spectrum { rings: (0..192).map(f64::from).collect(), spacings: 128, line: 4.0, low: 0.07 };
        let pattern = |method: &MethodReport| PatternReport {
            method: method.method.clone(),
            spectrum: spectrum.clone(),
            even: method.even,
            dots: vec![[10, 20], [500, 500], [1000, 0]],
        };
        let frame = |budget: u64| FrameReport {
            picture: PictureReport {
                view: "overview".into(),
                budget,
                points: budget,
                error: 1e6 / budget as f64,
                flip: 0.05,
            },
            draw_ms: budget as f64 / 1e4,
            load_ms: 12.0,
        };
        let renderer = |style: &str| RendererReport {
            style: style.into(),
            renderer: "cpu".into(),
            pictures: vec![frame(25_000), frame(100_000), frame(600_000)],
        };
        ComparisonReport {
            format: FORMAT,
            version: "1.2.3".into(),
            commit: "0123456789ab".into(),
            machine: "a <machine>".into(),
            threads: 2,
            rounds: 3,
            seed: 1,
            budgets: vec![50_000, 200_000],
            patterns: methods.iter().map(pattern).collect(),
            scenes: vec![SceneReport {
                name: "terrain".into(),
                points: 1_000_000,
                bytes: 26_000_000,
                methods,
                renderers: vec![renderer("one pixel"), renderer("high quality")],
            }],
        }
    }
}
