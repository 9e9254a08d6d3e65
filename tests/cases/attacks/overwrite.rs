//! Several conversions into one output at the same time: what stands there in the
//! end is one whole octree of one that said so.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::common::{listing, mix};
use crate::daemon_support::{content, converted, las};

type Content = BTreeMap<PathBuf, Vec<u8>>;

/// Rounds of five processes; `LODESTONE_OVERWRITE_ROUNDS` says how many.
fn rounds() -> u64 {
    std::env::var("LODESTONE_OVERWRITE_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(24)
}

struct Race {
    folder: tempfile::TempDir,
    clouds: Vec<PathBuf>,
    expected: Vec<Content>,
    more: &'static [&'static str],
}

impl Race {
    fn new(points: u32, more: &'static [&'static str]) -> Race {
        let folder = tempfile::tempdir().unwrap();
        let clouds: Vec<PathBuf> = (0..4).map(|n| folder.path().join(format!("cloud-{n}.las"))).collect();
        let mut expected = Vec::new();
        for (n, cloud) in clouds.iter().enumerate() {
            fs::write(cloud, las(points + 100 * n as u32, n as u64 + 1)).unwrap();
            expected.push(converted(&[cloud], &folder.path().join(format!("expected-{n}/x"))));
        }
        fs::create_dir(folder.path().join("race")).unwrap();
        Race { folder, clouds, expected, more }
    }

    fn output(&self) -> PathBuf {
        self.folder.path().join("race/x")
    }

    /// Five processes; the clouds of those that succeeded.
    fn round(&self, seed: u64, overwrite: bool) -> Vec<usize> {
        let mut runs = Vec::new();
        for n in 0..5u64 {
            let chance = mix(seed << 8 | n);
            let cloud = (chance % self.clouds.len() as u64) as usize;
            let mut command = Command::new(env!("CARGO_BIN_EXE_lodestone"));
            command.arg("convert").arg(&self.clouds[cloud]).arg("-o").arg(self.output());
            command.args(["--progress", "none"]).args(self.more);
            if overwrite {
                command.arg("--overwrite");
            }
            let run = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
            runs.push((cloud, run));
            sleep(Duration::from_micros(chance >> 20 & 0x3FFF));
        }
        let mut done = Vec::new();
        for (cloud, run) in runs {
            let ended = run.wait_with_output().unwrap();
            let words = String::from_utf8_lossy(&ended.stderr);
            if ended.status.success() {
                done.push(cloud);
            } else {
                let known = ["another conversion is at work", "exists already"];
                assert!(known.iter().any(|reason| words.contains(reason)), "round {seed}: {words}");
                assert!(ended.status.code().is_some(), "round {seed}: {words}");
            }
        }
        done
    }

    /// The cloud whose octree stands there.
    fn winner(&self, seed: u64) -> usize {
        let there = content(&self.output());
        let names: Vec<&Path> = there.keys().map(PathBuf::as_path).collect();
        let winner = self.expected.iter().position(|expected| *expected == there);
        winner.unwrap_or_else(|| panic!("round {seed}: no octree of any: {names:?}"))
    }

    fn left_over(&self) -> Vec<String> {
        listing(&self.folder.path().join("race")).into_iter().filter(|name| name != "x").collect()
    }
}

fn many_overwrite(race: &Race, rounds: u64) {
    let mut busy = 0;
    for seed in 0..rounds {
        let done = race.round(seed, true);
        busy += 5 - done.len();
        assert!(done.contains(&race.winner(seed)), "round {seed}: of one that did not succeed");
        assert_eq!(race.left_over(), [] as [&str; 0], "round {seed}");
    }
    println!("{rounds} rounds of five, of which {busy} found another at work");
}

#[test]
fn five_overwrite_one_output_and_one_stands() {
    many_overwrite(&Race::new(500, &[]), rounds());
}

#[test]
fn five_overwrite_out_of_core_and_one_stands() {
    let race = Race::new(900_000, &["--memory-limit", "24M", "--threads", "1"]);
    many_overwrite(&race, rounds().div_ceil(8));
    let report = fs::read(race.output().join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    assert!(report["scratch_bytes"].as_u64() > Some(0), "it was in core: {report}");
}

#[test]
fn without_overwriting_only_the_first_stands() {
    let race = Race::new(500, &[]);
    for seed in 0..rounds().div_ceil(4) {
        let done = race.round(seed, false);
        assert_eq!(done, [race.winner(seed)], "round {seed}");
        assert_eq!(race.left_over(), [] as [&str; 0], "round {seed}");
        fs::remove_dir_all(race.output()).unwrap();
    }
}

/// A process that is killed after the exchange leaves the old octree behind; the
/// next one clears it.
#[test]
fn what_a_killed_conversion_left_is_cleared() {
    let race = Race::new(500, &[]);
    for (seed, left) in [".x.building", ".x.building.7-1234-0.old"].into_iter().enumerate() {
        let left = race.folder.path().join("race").join(left);
        fs::create_dir_all(left.join("sub")).unwrap();
        fs::write(left.join("octree.bin"), "old").unwrap();
        let done = race.round(seed as u64, true);
        assert!(done.contains(&race.winner(seed as u64)));
        assert_eq!(race.left_over(), [] as [&str; 0]);
    }
}
