//! The compute shaders against the Rust kernels, on every scene and view: the
//! same pictures, to a level or two of 255, and the same pixels covered.
//!
//! Runs where a Vulkan adapter is, also one in software; `LODESTONE_REQUIRE_GPU=1`
//! makes a missing one a failure.

use std::path::{Path, PathBuf};

use crate::common::judge::write_scene;
use lodestone::convert::options::Options;
use lodestone::lab::flip;
use lodestone::lab::synth::{Recipe, SceneKind};
use lodestone::render::color::ColorBy;
use lodestone::render::frame::Background;
use lodestone::render::framing::View;
use lodestone::render::octree_renderer::{OctreeRenderer, Quality};
use lodestone::render::renderer::{Choice, Renderer};

const VIEWS: [View; 5] = [View::Overview, View::Top, View::Grazing, View::Close, View::Inside];

/// Whether there is an adapter to test with.
fn adapter() -> bool {
    match Renderer::open(Choice::Gpu) {
        Ok(renderer) => {
            eprintln!("twins: the CPU against {}", renderer.name());
            true
        }
        Err(error) => {
            let required = std::env::var_os("LODESTONE_REQUIRE_GPU").is_some_and(|value| value == "1");
            assert!(!required, "LODESTONE_REQUIRE_GPU=1, but: {error}");
            eprintln!("no adapter ({error}): the test of the twins is left out");
            false
        }
    }
}

fn octree(kind: SceneKind, points: u64, folder: &Path) -> PathBuf {
    let cloud = write_scene(Recipe::new(kind, points, 7), folder);
    let output = folder.join("octree");
    crate::common::convert(&[cloud], &output, &Options::default()).unwrap();
    output
}

#[test]
fn shaders_and_kernels_draw_the_same() {
    if !adapter() {
        return;
    }
    for kind in SceneKind::ALL {
        let folder = tempfile::tempdir().unwrap();
        let octree = octree(kind, 120_000, folder.path());
        let open = |choice| OctreeRenderer::open(&octree, ColorBy::Auto, choice).unwrap();
        let (mut cpu, mut gpu) = (open(Choice::Cpu), open(Choice::Gpu));
        for view in VIEWS {
            for background in [Background::CALM, Background::Transparent] {
                let quality = Quality { background, ..Quality::default() };
                let size = [320, 240];
                let (a, _) = cpu.still(size, view, &quality).unwrap();
                let (b, _) = gpu.still(size, view, &quality).unwrap();
                let covered = |pixel: &[u8; 4]| pixel[3] > 0;
                let holes = a.pixels.iter().zip(&b.pixels).filter(|(a, b)| covered(a) != covered(b)).count();
                assert_eq!(holes, 0, "{kind:?} {view:?}: pixels covered by one of them only");
                let error = flip::mean(320, &a.pixels, &b.pixels);
                assert!(error < 0.002, "{kind:?} {view:?}: FLIP {error}");
            }
        }
    }
}

/// More points at one pixel than 32 bits can add up.
#[test]
fn sums_are_carried_alike() {
    if !adapter() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    // All in one pixel of a small picture, all drawn.
    let octree = octree(SceneKind::Object, 600_000, folder.path());
    let quality = Quality::full();
    let draw = |choice| {
        OctreeRenderer::open(&octree, ColorBy::Auto, choice)
            .unwrap()
            .still([16, 16], View::Overview, &quality)
            .unwrap()
            .0
    };
    let (a, b) = (draw(Choice::Cpu), draw(Choice::Gpu));
    let largest = a.pixels.iter().flatten().zip(b.pixels.iter().flatten()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(largest <= Some(1), "{largest:?}");
}

/// The same scene from frame to frame, as a turntable draws it.
#[test]
fn a_turntable_is_the_same_by_both() {
    if !adapter() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let octree = octree(SceneKind::Town, 60_000, folder.path());
    let frames = |choice| {
        let mut studio = OctreeRenderer::open(&octree, ColorBy::Auto, choice).unwrap();
        let mut frames = Vec::new();
        studio
            .turntable([128, 128], 5, &Quality::turntable(), |picture| {
                frames.push(picture);
                Ok(())
            })
            .unwrap();
        frames
    };
    let (a, b) = (frames(Choice::Cpu), frames(Choice::Gpu));
    assert_eq!((a.len(), b.len()), (5, 5));
    for (a, b) in a.iter().zip(&b) {
        assert!(flip::mean(128, &a.pixels, &b.pixels) < 0.002);
    }
    assert_ne!(a[0], a[1], "it turns");
}
