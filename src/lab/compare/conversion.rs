//! What each method's conversion costs: a process each, in turns (A B C A B C …),
//! so that a busy minute of the machine strikes all of them.

use std::path::Path;
use std::time::Duration;

use super::method::{Method, octree};
use super::options::CompareOptions;
use super::report::MethodReport;
use super::steps::Steps;
use crate::format::potree::{self, Metadata};
use crate::lab::process::{ProcessRun, spread};
use crate::lab::sampling::evenness::Evenness;
use crate::lab::settings::{MeasureError, Result, WorkFolder, last_words};

/// Converts a cloud by all methods, whose octrees stay. Returns its points too.
pub fn measure(
    options: &CompareOptions,
    name: &str,
    cloud: &Path,
    place: &WorkFolder,
    steps: &Steps,
) -> Result<(u64, Vec<MethodReport>)> {
    let means = &options.means;
    let mut runs: Vec<Vec<ProcessRun>> = vec![Vec::new(); Method::ALL.len()];
    for round in 0..means.rounds {
        for (method, runs) in Method::ALL.into_iter().zip(&mut runs) {
            steps.next(format!("{name}: {}, round {} of {}", method.name(), round + 1, means.rounds));
            let (folder, words) = (octree(place, method), place.at("words"));
            let ended = means.convert(&method.arguments(), cloud, &folder, &words, Duration::MAX)?;
            if !matches!(ended.status.code(), Some(0 | 3)) {
                let what = format!("converting {} by {}", cloud.display(), method.name());
                let words = last_words(&words).unwrap_or_else(|| ended.status.to_string());
                return Err(MeasureError::Failed { what, words });
            }
            runs.push(ended.run);
        }
    }
    let mut points = 0;
    let mut methods = Vec::new();
    for (method, runs) in Method::ALL.into_iter().zip(runs) {
        let folder = octree(place, method);
        points = Metadata::read(&folder)?.points;
        let path = folder.join(potree::OCTREE);
        let size = std::fs::metadata(&path).map_err(|source| MeasureError::Folder { path, source })?.len();
        methods.push(MethodReport {
            method: method.name(),
            wall: spread(runs.iter().map(|run| run.wall)),
            cpu: spread(runs.iter().map(|run| run.cpu)),
            peak: spread(runs.iter().map(|run| run.peak as f64)).median as u64,
            seconds_by_stage: stages(&folder)?,
            octree_bytes: size,
            sampler_ns: None,
            even: Evenness::default(),
            pictures: Vec::new(),
        });
    }
    Ok((points, methods))
}

/// Of the last run, as the report beside the octree has them.
fn stages(octree: &Path) -> Result<std::collections::BTreeMap<String, f64>> {
    let path = octree.join("report.json");
    let bytes = std::fs::read(&path).map_err(|source| MeasureError::Folder { path: path.clone(), source })?;
    let report: serde_json::Value = serde_json::from_slice(&bytes).unwrap_or_default();
    Ok(serde_json::from_value(report["seconds_by_stage"].clone()).unwrap_or_default())
}
