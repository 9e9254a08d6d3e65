//! Every real cloud, converted by the program itself and held against its input
//! by the independent checker: nothing missing, nothing extra, all attributes,
//! positions exact. Prints a table. And every malformed file: success with the
//! truth told, or a clear error; never a crash, a hang or memory without bound.
//!
//! Runs where LODESTONE_DATA names the folder of real clouds.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use lodestone::verify::{self, SpacingRule, VerifyReport};

const LODESTONE: &str = env!("CARGO_BIN_EXE_lodestone");

/// Address space that a conversion of a malformed file may take, in KiB:
/// memory, threads' stacks and allocator arenas together.
const ADDRESS_SPACE: u64 = 1 << 20;

fn lodestone(arguments: &[&str]) -> Output {
    Command::new(LODESTONE).args(arguments).output().unwrap()
}

fn convert(inputs: &[&Path], output: &Path, more: &[&str]) -> Output {
    let mut arguments = vec!["convert", "--overwrite", "--progress", "none", "-o", output.to_str().unwrap()];
    arguments.extend(more);
    arguments.extend(inputs.iter().map(|i| i.to_str().unwrap()));
    lodestone(&arguments)
}

fn report(octree: &Path, against: &[&Path]) -> VerifyReport {
    verify::verify(&verify::VerifyRequest {
        damaged: false,
        octree: octree.to_path_buf(),
        against: against.iter().map(|p| p.to_path_buf()).collect(),
        memory_limit: 1 << 30,
        spacing: SpacingRule::Auto,
    })
    .unwrap()
}

/// Files of a folder, those in `folders` as one data set a folder.
fn inputs(data: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for part in ["formats", "single", "large", "tiles"] {
        let mut entries: Vec<PathBuf> =
            fs::read_dir(data.join(part)).unwrap().map(|e| e.unwrap().path()).collect();
        entries.sort();
        all.extend(entries);
    }
    all
}

#[test]
fn every_readable_cloud_comes_out_as_it_went_in() {
    let Some(data) = crate::common::data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let octree = folder.path().join("octree");
    println!("{:58} {:>10} {:>8} {:>6} {:>6}", "cloud", "points", "seconds", "nodes", "levels");
    let mut clouds = 0;
    for input in inputs(&data) {
        let name = input.strip_prefix(&data).unwrap().display().to_string();
        let start = Instant::now();
        let output = convert(&[&input], &octree, &[]);
        let seconds = start.elapsed().as_secs_f64();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        if name.contains("no-points") {
            assert_eq!(output.status.code(), Some(1), "{name}");
            assert!(said.contains(&name) && said.contains("holds no points"), "{said}");
            continue;
        }
        assert_eq!(output.status.code(), Some(0), "{name}: {said}");
        let report = report(&octree, &[&input]);
        assert!(report.ok, "{name}: {report:#?}");
        let against = report.against.as_ref().unwrap();
        assert_eq!((against.missing, against.extra), (0, 0), "{name}");
        assert_eq!(against.position.octree_units, 0.0, "{name}: {against:?}");
        println!(
            "{name:58} {:>10} {seconds:>8.2} {:>6} {:>6}",
            report.points,
            report.nodes,
            report.depth + 1
        );
        clouds += 1;
    }
    assert!(clouds >= 50, "only {clouds} clouds were found");
}

#[test]
fn both_samplings_and_encodings_hold_a_real_cloud() {
    let Some(data) = crate::common::data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let cloud = data.join("single/las_with_several_extra_byte_bloc.laz");
    for sampling in ["poisson", "RANDOM"] {
        for encoding in ["Default", "BROTLI"] {
            let octree = folder.path().join(format!("{sampling}-{encoding}"));
            let output = convert(&[&cloud], &octree, &["-m", sampling, "--encoding", encoding]);
            assert!(output.status.success(), "{output:?}");
            let report = report(&octree, &[&cloud]);
            assert!(report.ok, "{sampling} {encoding}: {report:#?}");
        }
    }
}

#[test]
fn tiles_named_in_another_order_still_hold_every_point() {
    let Some(data) = crate::common::data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut tiles: Vec<PathBuf> =
        fs::read_dir(data.join("tiles/ign50m")).unwrap().map(|e| e.unwrap().path()).collect();
    tiles.sort_by(|a, b| b.cmp(a));
    let tiles: Vec<&Path> = tiles.iter().map(PathBuf::as_path).collect();
    let octree = folder.path().join("octree");
    assert!(convert(&tiles, &octree, &[]).status.success());
    assert!(report(&octree, &tiles).ok);
}

#[test]
fn malformed_files_end_in_truth_or_a_clear_error() {
    let Some(data) = crate::common::data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let octree = folder.path().join("octree");
    let mut files: Vec<PathBuf> =
        fs::read_dir(data.join("malformed")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 10);
    for file in files {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let start = Instant::now();
        let output = Command::new("sh")
            .arg("-c")
            .arg(format!("ulimit -v {ADDRESS_SPACE}; exec \"$@\""))
            .args(["sh", LODESTONE, "convert", "--threads", "2", "--overwrite", "--progress", "none", "-o"])
            .arg(&octree)
            .arg(&file)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(start.elapsed() < Duration::from_secs(60), "{name}");
        match output.status.code() {
            // 3: with points set aside, which the verifier counts in.
            Some(0 | 3) => assert!(report(&octree, &[&file]).ok, "{name}"),
            Some(1) => {
                assert!(said.contains(&name), "{name}: {said}");
                assert!(!said.contains("panicked"), "{name}: {said}");
            }
            code => panic!("{name} ended with {code:?}: {said}"),
        }
        println!("{name}: {} in {:.2} s: {}", output.status, start.elapsed().as_secs_f64(), said.trim());
    }
}
