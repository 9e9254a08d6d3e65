//! COPC files of other programs: told about, checked against themselves, exported.

use std::fs;
use std::path::{Path, PathBuf};

use super::{convert, lodestone, noisy, run, verify};
use crate::common::data;

fn report(file: &Path, against: Option<&Path>) -> serde_json::Value {
    let mut command = lodestone();
    command.arg("verify").arg(file).arg("--json");
    if let Some(input) = against {
        command.arg("--against").arg(input);
    }
    let output = command.output().unwrap();
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|_| panic!("{}: {}", file.display(), String::from_utf8_lossy(&output.stderr)))
}

fn outcome<'a>(report: &'a serde_json::Value, name: &str) -> &'a str {
    let checks = report["checks"].as_array().unwrap();
    checks
        .iter()
        .find(|check| check["name"] == name)
        .and_then(|check| check["outcome"].as_str())
        .unwrap_or("none")
}

#[test]
fn files_of_others_hold_what_they_hold() {
    let Some(data) = data() else { return };
    for name in [
        "single/lone-star.copc.laz",
        "formats/1.2-with-color.copc.laz",
        "formats/simple_with_page.copc.laz",
        "single/lion_takanawa.copc.laz",
    ] {
        let file = data.join(name);
        let report = report(&file, Some(&file));
        let against = &report["against"];
        assert_eq!(
            (against["missing"].as_u64(), against["extra"].as_u64()),
            (Some(0), Some(0)),
            "{name}: {report:#}"
        );
        assert_eq!(outcome(&report, "decoding"), "ok", "{name}: {report:#}");
        assert_eq!(outcome(&report, "hierarchy"), "ok", "{name}: {report:#}");
        let told = run(lodestone().arg("info").arg(&file));
        assert!(told.contains("COPC") && told.contains("hierarchy"), "{told}");
    }
}

/// Where a file has its points and its records, and what a change there does.
#[test]
fn every_lie_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.las");
    noisy(&input, 7, 20_000, false);
    let file = convert(std::slice::from_ref(&input), &folder.path().join("out"), &[]);
    let good = report(&file, Some(&input));
    assert_eq!(good["ok"], true, "{good:#}");
    let whole = fs::read(&file).unwrap();
    let changed = folder.path().join("changed.copc.laz");
    let told = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = whole.clone();
        change(&mut bytes);
        fs::write(&changed, bytes).unwrap();
        report(&changed, None)
    };
    let eight = |at: usize| u64::from_le_bytes(whole[at..at + 8].try_into().unwrap());
    let evlrs_at = eight(235) as usize;
    let hierarchy_at = evlrs_at + 60;
    for (name, change) in [
        ("file", &(|bytes: &mut Vec<u8>| bytes[247] ^= 1) as &dyn Fn(&mut Vec<u8>)),
        ("bytes", &|bytes| bytes.extend_from_slice(b"more")),
        ("totals", &|bytes| bytes[255] ^= 1),
        ("totals", &|bytes| bytes[179..187].copy_from_slice(&1e6f64.to_le_bytes())),
        ("boxes", &|bytes| bytes[429..437].copy_from_slice(&1e6f64.to_le_bytes())),
        // The offset of the root's chunk.
        ("hierarchy", &move |bytes| bytes[hierarchy_at + 16] ^= 4),
        ("header", &|bytes| bytes[429 + 100] = 1),
    ] {
        let report = told(change);
        assert_eq!(report["ok"], false, "{name}");
        assert_eq!(outcome(&report, name), "wrong", "{name}: {report:#}");
    }
    // A record that somebody appends, as QGIS does, is no fault.
    let appended = told(&|bytes| {
        let count = u32::from_le_bytes(bytes[243..247].try_into().unwrap()) + 1;
        bytes[243..247].copy_from_slice(&count.to_le_bytes());
        let mut record = vec![0; 60];
        record[2..6].copy_from_slice(b"qgis");
        record[20] = 2;
        record.extend_from_slice(b"{}");
        bytes.extend_from_slice(&record);
    });
    assert_eq!(appended["ok"], true, "{appended:#}");
    // And of another cloud it is not.
    let other = folder.path().join("other.las");
    noisy(&other, 7, 20_001, false);
    let other = report(&file, Some(&other));
    assert_eq!(other["against"]["missing"], 1, "{other:#}");
}

#[test]
fn inputs_of_two_kinds_are_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let inputs: Vec<PathBuf> = [1, 5, 8]
        .map(|format| {
            let path = folder.path().join(format!("{format}.las"));
            noisy(&path, format, 10_000, false);
            path
        })
        .into();
    let file = convert(&inputs, &folder.path().join("out"), &[]);
    assert_eq!(verify(&file, &inputs)["points"], 30_000);
}
