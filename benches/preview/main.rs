//! What pictures cost and how true they are: `cargo bench --bench preview`.
//!
//! For every scene, octrees of `--points` (20M) points are converted once; then
//! each view is drawn with all points at the highest setting, and again with
//! points ever closer together. Printed are points drawn, the share of the
//! octree's bytes read, the time, and how far the picture is from the full one:
//! mean pixel error (of 255) and mean ꟻLIP. The line of the default is marked.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use lodestone::lab::flip;
use lodestone::render::color::ColorBy;
use lodestone::render::framing::View;
use lodestone::render::octree_renderer::{OctreeRenderer, Quality};
use lodestone::render::renderer::Choice;

const SIZE: [u32; 2] = [512, 512];
const SCENES: [&str; 4] = ["terrain", "town", "interior", "object"];
const VIEWS: [(&str, View); 4] = [
    ("overview", View::Overview),
    ("grazing", View::Grazing),
    ("close", View::Close),
    ("inside", View::Inside),
];
const SPACINGS: [f64; 7] = [4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str, default: &str| {
        let at = arguments.iter().position(|argument| argument == name);
        at.and_then(|at| arguments.get(at + 1)).map_or(default.to_string(), String::clone)
    };
    let points = value("--points", "20M");
    let scenes = value("--scenes", &SCENES.join(","));
    let renderer = if value("--renderer", "cpu") == "gpu" { Choice::Gpu } else { Choice::Cpu };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let kept = value("--octrees", "");
    for scene in scenes.split(',') {
        let octree = match kept.as_str() {
            "" => convert(folder.path(), scene, &points),
            kept => PathBuf::from(kept).join(scene),
        };
        let all = std::fs::metadata(octree.join("octree.bin")).expect("an octree").len();
        for (name, view) in VIEWS {
            let mut studio = OctreeRenderer::open(&octree, ColorBy::Auto, renderer).expect("a studio");
            let (full, effort) = studio.still(SIZE, view, &Quality::full()).expect("a picture");
            println!(
                "\n{scene}, {name}: {} points in the full picture, by {}",
                effort.points,
                studio.renderer()
            );
            println!(
                "{:>9} {:>10} {:>8} {:>8} {:>7} {:>7}",
                "spacing", "points", "bytes %", "ms", "error", "FLIP"
            );
            let default = Quality::default();
            for spacing in SPACINGS {
                let quality = Quality { spacing, ..default.clone() };
                let started = Instant::now();
                let (picture, effort) = studio.still(SIZE, view, &quality).expect("a picture");
                println!(
                    "{:>9} {:>10} {:>8.2} {:>8.0} {:>7.2} {:>7.4}{}",
                    format!("{spacing} px"),
                    effort.points,
                    effort.bytes_read as f64 / all as f64 * 100.0,
                    started.elapsed().as_secs_f64() * 1e3,
                    flip::pixel_error(&full.pixels, &picture.pixels),
                    flip::mean(SIZE[0] as usize, &full.pixels, &picture.pixels),
                    if spacing == default.spacing { "  default" } else { "" },
                );
            }
        }
    }
}

fn convert(folder: &Path, scene: &str, points: &str) -> PathBuf {
    let (las, octree) = (folder.join(format!("{scene}.las")), folder.join(scene));
    let lodestone = |arguments: &[&str]| {
        let done = Command::new(env!("CARGO_BIN_EXE_lodestone")).args(arguments).output().expect("lodestone");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    };
    let path = |path: &Path| path.to_str().expect("a path in UTF-8").to_string();
    lodestone(&["synth", scene, "-o", &path(&las), "--points", points]);
    lodestone(&["convert", &path(&las), "-o", &path(&octree)]);
    std::fs::remove_file(&las).expect("a file");
    octree
}
