//! A browser with a cache on disk shows an octree that is replaced under its name:
//! after one reload all points are the new one's, and none is left of the old.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::common::{mix, options_of, write_las};
use crate::daemon_support::Daemon;

use super::elsewhere::{Pages, viewer};

/// Points of one color; their places are the same for any color.
fn cloud(path: &Path, points: u64, color: [u8; 3]) {
    let mut records = Vec::new();
    for n in 0..points {
        let dice = mix(n);
        let at = [dice % 100_000, dice >> 20 & 0xffff, dice >> 50];
        at.iter().for_each(|c| records.extend_from_slice(&(*c as i32).to_le_bytes()));
        records.extend_from_slice(&[0, 0, 0b1001, 2, 0, 0, 0, 0]);
        color.iter().for_each(|value| records.extend_from_slice(&(u16::from(*value) * 256).to_le_bytes()));
    }
    write_las(path, &options_of(2, false), &records);
}

#[test]
fn one_reload_shows_the_octree_that_replaced_another() {
    let Some(folder) = viewer() else { return };
    let root = tempfile::tempdir().expect("a folder");
    // One of the same sizes, of which every range and the hierarchy would fit; one that is
    // larger, one that is smaller.
    let clouds = [
        ("red", 120_000, [200, 30, 30]),
        ("blue", 120_000, [30, 30, 200]),
        ("green", 150_000, [30, 200, 30]),
        ("grey", 40_000, [90, 90, 90]),
    ];
    let file = |name: &str| root.path().join(format!("{name}.las"));
    clouds.iter().for_each(|(name, points, color)| cloud(&file(name), *points, *color));
    let daemon = Daemon::start(&root.path().join("data"));
    let source = daemon.inbox().join("a.las");
    fs::copy(file("red"), &source).expect("dropped");
    daemon.wait("a", "done");

    let pages = Pages::serve(folder.clone());
    let jobs = format!("http://{}/api/jobs", daemon.address);
    let page =
        format!("http://{}/loaded.html?url=http://{}/octrees/a/metadata.json", pages.address, daemon.address);
    let mut node = Command::new("node");
    node.current_dir(&folder).args(["reload.mjs", "/usr/bin/chromium"]);
    node.arg(root.path().join("profile")).args([&page, &jobs]).arg(&source).arg(clouds[0].1.to_string());
    clouds[1..].iter().for_each(|(name, points, _)| {
        node.arg(file(name)).arg(points.to_string());
    });
    let run = node.output().expect("node");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let told: Value = serde_json::from_slice(&run.stdout).expect("JSON");
    assert_eq!(told["errors"], serde_json::json!([]));
    for ((name, points, [r, g, b]), seen) in clouds.iter().zip(told["told"].as_array().expect("a list")) {
        let all = serde_json::json!({ format!("{r},{g},{b}"): points });
        assert_eq!((&seen["points"], &seen["colors"]), (&Value::from(*points), &all), "{name}");
    }
}
