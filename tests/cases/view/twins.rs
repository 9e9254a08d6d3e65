//! What the browser's scripts choose, against Rust: the same nodes, and as many points of
//! each; and how they load. The scripts run under Node.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use super::{all_pages, octree_of};
use crate::common::mix;
use lodestone::convert::options::Options;
use lodestone::lab::synth::SceneKind;
use lodestone::render::camera::{Camera, OrbitCamera};
use lodestone::render::node_selection::{SelectionRequest, select};
use lodestone::render::octree::Octree;
use lodestone::render::sample::CoarseSample;
use lodestone::render::viewer::Description;

const CAMERAS: u64 = 200;
const KINDS: [SceneKind; 5] =
    [SceneKind::Terrain, SceneKind::Town, SceneKind::Interior, SceneKind::Object, SceneKind::Outliers];

/// A camera somewhere around or in a cloud, and what it asks for; by chance.
fn case(seed: u64, bounds: &[[f64; 3]; 2]) -> (Camera, SelectionRequest) {
    let share = |n: u64| (mix(seed ^ n << 32) >> 11) as f64 / (1u64 << 53) as f64;
    let target = std::array::from_fn(|i| bounds[0][i] + share(i as u64) * (bounds[1][i] - bounds[0][i]));
    let extent = (0..3).map(|i| bounds[1][i] - bounds[0][i]).fold(1e-3, f64::max);
    let shot = OrbitCamera {
        target,
        azimuth: share(3) * 7.0 - 3.5,
        elevation: share(4) * 3.0 - 1.5,
        distance: extent * 10f64.powf(share(5) * 4.0 - 3.0),
    };
    let top =
        if share(6) < 0.2 { bounds[0][2] + share(7) * (bounds[1][2] - bounds[0][2]) } else { f64::INFINITY };
    let size = [100 + (share(8) * 3000.0) as u32, 100 + (share(9) * 2000.0) as u32];
    let wanted = SelectionRequest {
        spacing: 0.5 + share(10) * 3.0,
        budget: 500 + (share(11) * 90_000.0) as u64,
        size,
        top,
    };
    (shot.camera(), wanted)
}

fn finite(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { Value::Null }
}

/// An octree as the scripts are told of it, with what Rust chooses.
fn fixture(kind: SceneKind, folder: &Path) -> Value {
    let path = octree_of(kind, 60_000, folder, &Options::default());
    let mut octree = Octree::open(&path).unwrap();
    let sample = CoarseSample::take(&mut octree).unwrap();
    let description = Description::of(&octree, &sample, [800, 600]);
    let (pages, _) = all_pages(&mut octree, 30);
    let pages: Vec<Value> =
        pages.iter().map(|(name, page)| json!({ "node": name.to_string(), "bytes": page })).collect();
    let mut cases = Vec::new();
    for seed in 0..CAMERAS {
        let (camera, wanted) = case(mix(seed), &description.bounds);
        let chosen = select(&mut octree, &[camera], &wanted).unwrap();
        let chosen: Vec<Value> =
            chosen.iter().map(|chosen| json!([chosen.node.name.to_string(), chosen.take])).collect();
        cases.push(json!({
            "camera": { "eye": camera.eye, "right": camera.right, "up": camera.up, "forward": camera.forward },
            "spacing": wanted.spacing, "budget": wanted.budget, "size": wanted.size, "top": finite(wanted.top),
            "chosen": chosen,
        }));
    }
    json!({ "description": description, "pages": pages, "cases": cases })
}

#[test]
fn the_browser_chooses_the_nodes_that_rust_chooses() {
    if Command::new("node").arg("--version").output().is_err() {
        let required = std::env::var_os("LODESTONE_REQUIRE_CHROMIUM").is_some_and(|value| value == "1");
        assert!(!required, "LODESTONE_REQUIRE_CHROMIUM=1, but Node is missing");
        eprintln!("no Node: the viewer's scripts are not tried");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let octrees: Vec<Value> = KINDS
        .iter()
        .map(|kind| {
            let own = folder.path().join(format!("{kind:?}"));
            fs::create_dir_all(&own).unwrap();
            fixture(*kind, &own)
        })
        .collect();
    let scripts = super::scripts(folder.path());
    fs::write(folder.path().join("octrees.json"), json!(octrees).to_string()).unwrap();
    let run = Command::new("node")
        .args(["twins.mjs".as_ref(), folder.path().join("octrees.json").as_os_str()])
        .current_dir(scripts)
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(run.status.success(), "{told}\n{}", String::from_utf8_lossy(&run.stderr));
    assert!(told.contains("1000 of 1000 cameras"), "{told}");
}

/// What the loader asks for, of a daemon that is slow, fails, and replaces the octree.
#[test]
fn the_loader_asks_once_and_tries_again() {
    if Command::new("node").arg("--version").output().is_err() {
        eprintln!("no Node: the viewer's scripts are not tried");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = octree_of(SceneKind::Town, 60_000, folder.path(), &Options::default());
    let mut octree = Octree::open(&path).unwrap();
    let sample = CoarseSample::take(&mut octree).unwrap();
    let description = Description::of(&octree, &sample, [800, 600]);
    let (pages, nodes) = all_pages(&mut octree, 30);
    let pages: Vec<Value> =
        pages.iter().map(|(name, page)| json!({ "node": name.to_string(), "bytes": page })).collect();
    let nodes: Vec<Value> = nodes.iter().map(|(name, points)| json!([name.to_string(), points])).collect();
    let told = json!({ "description": description, "pages": pages, "nodes": nodes });
    fs::write(folder.path().join("octree.json"), told.to_string()).unwrap();
    let run = Command::new("node")
        .args(["loads.mjs".as_ref(), folder.path().join("octree.json").as_os_str()])
        .current_dir(super::scripts(folder.path()))
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(run.status.success(), "{told}\n{}", String::from_utf8_lossy(&run.stderr));
}
