//! copc-validator's deep check of our COPC files. No registry has it; LODESTONE_COPC_VALIDATOR
//! names the folder of its sources, built as tests/README.md tells.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{convert, lodestone, run};
use crate::common::{data, options_of, surface, write_las};

fn validator() -> Option<PathBuf> {
    let folder = std::env::var_os("LODESTONE_COPC_VALIDATOR").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("skipped: LODESTONE_COPC_VALIDATOR names no folder with a built copc-validator");
    }
    folder
}

/// The names of all checks that fail.
fn failures(validator: &Path, file: &Path) -> Vec<String> {
    let mut node = Command::new("node");
    // By its own folder: its workers are found by relative paths.
    node.arg("lib/index.js").args(["--deep", "--mini"]).arg(file).current_dir(validator);
    let text = run(&mut node);
    let report: serde_json::Value = serde_json::from_str(&text[text.find('{').unwrap_or(0)..])
        .unwrap_or_else(|error| {
            panic!("{error}: {text}");
        });
    assert_eq!(report["scan"]["filetype"], "COPC", "{text}");
    let checks = report["checks"].as_array().unwrap();
    assert!(checks.len() > 20, "{text}");
    let failed = checks.iter().filter(|check| check["status"] == "fail");
    failed.map(|check| format!("{}: {}", check["id"].as_str().unwrap(), check["info"])).collect()
}

/// How many points of a file the note of `verify` on returns counts.
fn odd_returns(file: &Path) -> u64 {
    let text = run(lodestone().arg("verify").arg(file).arg("--json"));
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    let checks = report["checks"].as_array().unwrap();
    checks.iter().find(|check| check["name"] == "returns").map_or(0, |check| check["count"].as_u64().unwrap())
}

#[test]
fn the_validator_fails_no_format() {
    let Some(validator) = validator() else { return };
    let folder = tempfile::tempdir().unwrap();
    for format in 0..=10 {
        let input = folder.path().join(format!("{format}.laz"));
        let format = format.to_string();
        run(lodestone()
            .args(["synth", "terrain", "--points", "150K", "--format", &format, "-o"])
            .arg(&input));
        let crs = ["--crs", "EPSG:25832"];
        let file = convert(&[input], &folder.path().join(&format), &crs);
        assert_eq!(failures(&validator, &file), [""; 0], "format {format}");
    }
}

#[test]
fn the_validator_fails_what_verify_notes() {
    let Some(validator) = validator() else { return };
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("noisy.las");
    write_las(&input, &options_of(7, false), &surface(7, 3_000, 1));
    let file = convert(&[input], &folder.path().join("noisy"), &["--crs", "EPSG:25832"]);
    let failed = failures(&validator, &file);
    let names: Vec<&str> = failed.iter().filter_map(|failure| failure.split(':').next()).collect();
    assert_eq!(names, ["pointCountByReturn", "returnNumber"], "{failed:?}");
    assert!(odd_returns(&file) > 1_000);
    let Some(data) = data() else { return };
    for name in [
        "single/lone-star.copc.laz",
        "single/pine_plot.laz",
        "single/autzen_trim.laz",
        "formats/fwf.laz",
        "tiles/bcts/bcts_1.laz",
        "tiles/ign50m/test_data_77060_627755_LA93_IGN69.laz",
    ] {
        let output = folder.path().join(name.replace('/', "-"));
        let file = convert(&[data.join(name)], &output, &[]);
        let text = run(lodestone().arg("verify").arg(&file).arg("--json"));
        let failed = failures(&validator, &file);
        eprintln!("{name}: {failed:?}");
        let is_known = |failure: &String| match failure.split(':').next() {
            Some("pointCountByReturn" | "returnNumber") => odd_returns(&file) > 0,
            // Of systems that proj4js knows no projection of, it says so.
            Some("wkt") => text.contains("there is no CRS as WKT") || failure.contains("initialize proj4"),
            _ => false,
        };
        assert!(failed.iter().all(is_known), "{name}: {failed:?}");
    }
}
