//! The viewer in Chromium, by WebGPU in software: that it draws, and what a person does with
//! it.

use std::fs;

use super::octree_of;
use crate::daemon_support::Daemon;
use crate::page::drive;
use lodestone::convert::options::Options;
use lodestone::lab::synth::SceneKind;
use lodestone::render::camera::OrbitCamera;
use lodestone::render::frame::Background;
use lodestone::render::octree::Octree;
use lodestone::render::sample::CoarseSample;
use lodestone::render::viewer::Description;

const CLOUDS: [(&str, SceneKind); 3] =
    [("terrain", SceneKind::Terrain), ("interior", SceneKind::Interior), ("town", SceneKind::Town)];

/// A shot as an address has it.
fn addressed(shot: &OrbitCamera) -> String {
    let numbers =
        [shot.target[0], shot.target[1], shot.target[2], shot.azimuth, shot.elevation, shot.distance];
    let numbers = numbers.map(|number| (number * 1e3).round() / 1e3);
    numbers.map(|number| number.to_string()).join(",")
}

#[test]
fn the_viewer_draws_three_octrees_and_is_worked() {
    let root = tempfile::tempdir().unwrap();
    let data = root.path().join("data");
    let mut arguments = vec![root.path().to_str().unwrap().to_string()];
    for (name, kind) in CLOUDS {
        let made = root.path().join(name);
        fs::create_dir_all(&made).unwrap();
        let octree = octree_of(kind, 60_000, &made, &Options::default());
        let place = data.join("octrees").join(name);
        fs::create_dir_all(place.parent().unwrap()).unwrap();
        fs::rename(octree, &place).unwrap();
        let mut octree = Octree::open(&place).unwrap();
        let sample = CoarseSample::take(&mut octree).unwrap();
        let start = Description::of(&octree, &sample, [320, 250]).start;
        let text = addressed(&OrbitCamera {
            target: start.target,
            azimuth: start.azimuth + 0.3,
            elevation: start.elevation,
            distance: start.distance * 0.6,
        });
        arguments.extend([name.to_string(), text]);
    }
    let daemon = Daemon::start(&data);
    arguments.insert(0, format!("http://{}", daemon.address));
    if !drive("viewer.mjs", &arguments.iter().map(String::as_str).collect::<Vec<_>>()) {
        return;
    }
    for (name, _) in CLOUDS {
        let told = fs::read_to_string(root.path().join(format!("{name}.json"))).unwrap();
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        let size = [0, 1].map(|at| told["size"][at].as_u64().unwrap() as u32);
        let pixels = fs::read(root.path().join(format!("{name}.rgba"))).unwrap();
        let pixels: Vec<[u8; 4]> = pixels.as_chunks().0.to_vec();
        let sky = (0..size[1]).flat_map(|y| vec![Background::CALM.row(y, size[1]); size[0] as usize]);
        let covered = pixels.iter().zip(sky).filter(|(pixel, sky)| *pixel != sky).count();
        assert!(covered * 5 > pixels.len(), "{name}: {covered} pixels");
    }
}
