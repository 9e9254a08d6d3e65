//! One row: a scene by one sampler, in turns with the benign scene.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde::Serialize;

use super::cases::Case;
use crate::convert::options::Sampling;
use crate::format::potree::{self, Metadata};
use crate::lab::process::{self, ProcessEnd, ProcessRun, spread};
use crate::lab::settings::{BenchmarkSettings, MeasureError, Result, WorkFolder, last_words};

/// What lies in the folder for temporary files.
pub(super) const BENIGN: &str = "benign";
pub(super) const CLOUD: &str = "cloud";
pub(super) const OCTREE: &str = "octree";
pub(super) const WORDS: &str = "words";
pub(super) const VERDICT: &str = "verdict";

/// Most that a scene may cost, in multiples of the benign one.
pub(super) const MOST_TIME: f64 = 2.0;
pub(super) const MOST_MEMORY: f64 = 1.5;
/// Levels that an octree may have below what the cloud asks for.
pub(super) const MOST_LEVELS: u32 = 1;

/// What became of a scene. Costs are medians; "times" is the multiple of what
/// the benign scene took in the same minutes.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    pub scene: String,
    pub points: u64,
    pub sampling: Sampling,
    /// `done`, or why not.
    pub outcome: String,
    /// Whether octree and set aside were found to be the input, and the positions
    /// where the input has them.
    pub exact: bool,
    pub seconds: f64,
    pub seconds_times: f64,
    pub cpu_seconds: f64,
    pub cpu_times: f64,
    pub peak_bytes: u64,
    pub peak_times: f64,
    pub depth: u32,
    /// What the cloud asks for by itself (see `depth::asked`).
    pub depth_asked: u32,
    pub nodes: u64,
    /// Points of the largest node.
    pub largest_node: u32,
    pub set_aside: BTreeMap<String, u64>,
    /// Targets that it missed.
    pub missed: Vec<String>,
}

/// A conversion that takes so many times as long as the benign one hangs, as far
/// as a user can tell.
const MOST_PATIENCE: f64 = 50.0;

pub fn measure(
    means: &BenchmarkSettings,
    case: &Case,
    sampling: Sampling,
    place: &WorkFolder,
    depth_asked: u32,
    say: &dyn Fn(String),
) -> Result<Row> {
    let (mut benign, mut own): (Vec<ProcessRun>, Vec<ProcessRun>) = (Vec::new(), Vec::new());
    let mut last = None;
    for round in 0..means.rounds.max(1) {
        say(format!("{}, {sampling:?}: round {} of {}", case.title, round + 1, means.rounds));
        let first = convert(means, sampling, BENIGN, place, Duration::MAX)?;
        benign.push(first.run);
        let patience = Duration::from_secs_f64(60.0 + MOST_PATIENCE * first.run.wall);
        let ended = convert(means, sampling, CLOUD, place, patience)?;
        own.push(ended.run);
        let failed = !matches!(ended.status.code(), Some(0 | 3));
        last = Some(ended);
        if failed {
            break;
        }
    }
    let median = |runs: &[ProcessRun], of: fn(&ProcessRun) -> f64| spread(runs.iter().map(of)).median;
    let times = |of: fn(&ProcessRun) -> f64| median(&own, of) / median(&benign, of);
    let mut row = Row {
        scene: case.title.clone(),
        points: case.recipe.points,
        sampling,
        outcome: last.map_or(String::new(), |ended| outcome(ended, &place.at(WORDS))),
        exact: false,
        seconds: median(&own, |run| run.wall),
        seconds_times: times(|run| run.wall),
        cpu_seconds: median(&own, |run| run.cpu),
        cpu_times: times(|run| run.cpu),
        peak_bytes: median(&own, |run| run.peak as f64) as u64,
        peak_times: times(|run| run.peak as f64),
        depth: 0,
        depth_asked,
        nodes: 0,
        largest_node: 0,
        set_aside: BTreeMap::new(),
        missed: Vec::new(),
    };
    if row.outcome == "done" {
        say(format!("{}, {sampling:?}: held against its input", case.title));
        row.look(means, place)?;
    }
    row.judge();
    Ok(row)
}

fn convert(
    means: &BenchmarkSettings,
    sampling: Sampling,
    cloud: &str,
    place: &WorkFolder,
    patience: Duration,
) -> Result<ProcessEnd> {
    let (cloud, octree, words) = (place.at(cloud), place.at(OCTREE), place.at(WORDS));
    means.convert(&["-m", sampling.name()], &cloud, &octree, &words, patience)
}

/// In a word, or in those that the program had for it.
fn outcome(ended: ProcessEnd, words: &Path) -> String {
    match ended.status.code() {
        Some(0 | 3) => "done".to_string(),
        _ if ended.late => format!("not done after {:.0} s", ended.run.wall),
        _ => last_words(words).unwrap_or_else(|| ended.status.to_string()),
    }
}

impl Row {
    /// Fills in what the octree and its verification tell.
    fn look(&mut self, means: &BenchmarkSettings, place: &WorkFolder) -> Result<()> {
        let octree = place.at(OCTREE);
        let metadata = Metadata::read(&octree)?;
        let path = octree.join(potree::HIERARCHY);
        let bytes = fs::read(&path).map_err(|source| MeasureError::Folder { path, source })?;
        let nodes = potree::read_hierarchy(&bytes, metadata.hierarchy.first_chunk_size)?;
        self.depth = metadata.hierarchy.depth;
        self.nodes = nodes.len() as u64;
        self.largest_node = nodes.iter().map(|node| node.points).max().unwrap_or(0);

        let words = fs::read_to_string(place.at(WORDS)).unwrap_or_default();
        let last = words.lines().rev().find(|line| line.starts_with('{')).unwrap_or_default();
        let told: serde_json::Value = serde_json::from_str(last).unwrap_or_default();
        if let Some(aside) = told["outcome"]["set_aside"].as_object() {
            let counts = aside.iter().filter_map(|(reason, n)| Some((reason.clone(), n.as_u64()?)));
            self.set_aside = counts.collect();
        }
        let fault = |source| MeasureError::Folder { path: place.at(VERDICT), source };
        let verdict = File::create(place.at(VERDICT)).map_err(fault)?;
        let mut verify = Command::new(&means.program);
        verify.args(["verify", "--json", "--threads", &means.threads.to_string()]);
        verify.arg(&octree).arg("--against").arg(place.at(CLOUD)).stdout(verdict).stderr(Stdio::null());
        means.ended("the verification", process::run_within(&mut verify, Duration::MAX, &means.cancel))?;
        let verdict = fs::read(place.at(VERDICT)).map_err(fault)?;
        let report: serde_json::Value = serde_json::from_slice(&verdict).unwrap_or_default();
        let against = &report["against"];
        self.exact = report["ok"] == true
            && against["missing"] == 0
            && against["extra"] == 0
            && against["position"]["octree_units"] == 0.0;
        Ok(())
    }

    fn judge(&mut self) {
        let mut missed = Vec::new();
        if self.outcome != "done" {
            missed.push("not done".to_string());
        } else if !self.exact {
            missed.push("not exact".to_string());
        }
        for (what, times) in [("time", self.seconds_times), ("processor time", self.cpu_times)] {
            if times > MOST_TIME {
                missed.push(format!("{what} {times:.1} ×"));
            }
        }
        if self.peak_times > MOST_MEMORY {
            missed.push(format!("memory {:.1} ×", self.peak_times));
        }
        if self.depth > self.depth_asked + MOST_LEVELS {
            missed.push(format!("{} levels more", self.depth - self.depth_asked));
        }
        self.missed = missed;
    }
}
