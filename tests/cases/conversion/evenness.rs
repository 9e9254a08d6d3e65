//! How even the samples of whole octrees are, of clouds of several chunks that
//! several threads work on.

use std::path::Path;
use std::process::Command;

use lodestone::lab::sampling::evenness::{Evenness, of_levels, total};

fn lodestone(arguments: &[&str]) {
    let done = Command::new(env!("CARGO_BIN_EXE_lodestone")).args(arguments).output().expect("lodestone");
    assert!(done.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
}

fn evenness(folder: &Path, scene: &str, sampling: &str, memory: &str) -> Evenness {
    let path = |name: &str| folder.join(name).to_str().expect("a path in UTF-8").to_string();
    let (cloud, octree) = (path(scene) + ".las", path(&format!("{scene}-{sampling}-{memory}")));
    if !Path::new(&cloud).exists() {
        lodestone(&["synth", scene, "--points", "900k", "-o", &cloud]);
    }
    lodestone(&[
        "convert",
        &cloud,
        "-o",
        &octree,
        "-m",
        sampling,
        "--threads",
        "3",
        "--memory-limit",
        memory,
    ]);
    let levels = of_levels(Path::new(&octree)).expect("an octree");
    assert!(levels.len() > 2, "{levels:?}");
    total(&levels)
}

/// Also where the nodes are of different chunks: those above and below the level
/// at which the merge begins, in memory and out of core.
#[test]
fn samples_keep_their_distance_across_all_nodes() {
    let folder = tempfile::tempdir().unwrap();
    for scene in ["terrain", "interior", "object"] {
        for memory in ["2G", "48M"] {
            let even = evenness(folder.path(), scene, "poisson", memory);
            assert!(even.samples > 100_000, "{scene}: {even:?}");
            assert_eq!((even.inside, even.across), (0, 0), "{scene}, {memory}: {even:?}");
            assert!(even.hole <= 1.0 + 1e-9, "{scene}: {even:?}");
        }
    }
}

/// The other methods promise less, and the measure sees it.
#[test]
fn the_methods_for_comparison_keep_what_they_promise_and_no_more() {
    let folder = tempfile::tempdir().unwrap();
    let shells = evenness(folder.path(), "terrain", "shells", "2G");
    assert_eq!(shells.inside, 0);
    assert!((0.001..0.05).contains(&shells.across_share()), "{shells:?}");
    for sampling in ["random", "nearest"] {
        let even = evenness(folder.path(), "terrain", sampling, "2G");
        // One point a cell: within √3 spacings of it lies whatever was rejected.
        assert!(even.inside_share() > 0.2 && even.hole < 1.74, "{sampling}: {even:?}");
    }
}
