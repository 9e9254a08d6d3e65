//! Words of others reach log and terminal escaped: no line is forged, and no control
//! of the screen gets through.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::daemon_support::{Daemon, las, wait_for};

const EVIL: &str = "a\nERROR forged\u{1b}[31mred\u{7}\u{9b}2J\u{202e}x";

/// Nothing but line ends and tabs; and no line that begins as forged.
fn assert_clean(what: &str, text: &str) {
    let harmful = |c: char| (c.is_control() && c != '\n') || matches!(c, '\u{202a}'..='\u{202e}');
    assert!(!text.contains(harmful), "{what}: {text:?}");
    assert!(!text.lines().any(|line| line.starts_with("ERROR forged")), "{what}: {text}");
}

fn run(arguments: &[&str], paths: &[&Path]) -> String {
    let run = Command::new(env!("CARGO_BIN_EXE_lodestone")).args(arguments).args(paths).output().unwrap();
    format!("{}{}", String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr))
}

#[test]
fn names_reach_log_and_lists_escaped() {
    for format in ["plain", "json"] {
        let root = tempfile::tempdir().unwrap();
        let data = root.path().join("data");
        let daemon = Daemon::start_with(&data, &["--log", "debug", "--log-format", format]);
        fs::write(daemon.inbox().join(format!("{EVIL}.las")), las(400, 1)).unwrap();
        fs::write(daemon.inbox().join(format!("broken {EVIL}.las")), b"LASF no more").unwrap();
        std::os::unix::fs::symlink("x", daemon.inbox().join(format!("link {EVIL}.las"))).unwrap();
        let marker = serde_json::json!({ "name": EVIL }).to_string().into_bytes();
        daemon.drop_folder("marked", &[("t.las", las(300, 7)), ("lodestone.json", marker)]);
        wait_for("two octrees", || {
            let done = daemon.jobs().iter().filter(|job| job["state"] == "done").count();
            (done == 2).then_some(())
        });
        let log = daemon.log();
        assert!(log.contains("forged"), "{log}");
        assert_clean(format, &log);
        if format == "json" {
            for line in log.lines() {
                assert!(serde_json::from_str::<Value>(line).is_ok(), "{line}");
            }
        }
        let list = run(&["jobs", "list", "--root"], &[&data]);
        assert!(list.contains("forged"), "{list}");
        assert_clean("jobs list", &list);
        assert_clean("jobs show", &run(&["jobs", "show", "1", "--root"], &[&data]));
        assert_clean("jobs show", &run(&["jobs", "show", "2", "--root"], &[&data]));
    }
}

#[test]
fn errors_and_pages_of_commands_are_escaped() {
    let folder = tempfile::tempdir().unwrap();
    let evil = folder.path().join(EVIL);
    for command in [&["info"][..], &["verify"], &["preview"], &["convert", "-o", "/dev/null/x"]] {
        let words = run(command, &[&evil]);
        assert!(words.contains("forged"), "{command:?}: {words}");
        assert_clean(command[0], &words);
    }
    // An octree whose names are hostile, in a folder whose name is.
    let las_file = folder.path().join("cloud.las");
    fs::write(&las_file, las(400, 2)).unwrap();
    let words = run(&["convert", "--progress", "none", "--name", EVIL, "-o"], &[&evil, &las_file]);
    assert_clean("convert", &words);
    let path = evil.join("metadata.json");
    let mut metadata: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    metadata["projection"] = EVIL.into();
    metadata["description"] = EVIL.into();
    metadata["attributes"][1]["name"] = EVIL.into();
    metadata["attributes"][1]["min"] = serde_json::json!([77]);
    metadata["generator"]["version"] = EVIL.into();
    metadata["generator"]["name"] = EVIL.into();
    fs::write(&path, metadata.to_string()).unwrap();
    for command in [&["info"][..], &["verify"], &["preview", "--frames", "0"]] {
        let words = run(command, &[&evil]);
        assert!(words.contains("forged"), "{command:?}: {words}");
        assert_clean(command[0], &words);
    }
}
