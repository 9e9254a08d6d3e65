//! A conversion that is killed goes on from its receipts, and the COPC file is the same
//! to the last byte.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::support::copc_bytes;
use crate::common::{context, ended_before, listing, octree_bytes, options_of, request, surface, write_las};
use lodestone::convert::checkpoint::scratch::units_done;
use lodestone::convert::formats::Formats;
use lodestone::convert::options::Options;
use lodestone::convert::run;

/// Killed after ever so many more units; true where it ended before.
fn convert_killed(input: &Path, output: &Path, format: Formats, scratch: &Path, more: u64) -> bool {
    let before = units_done(scratch);
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestone"));
    command
        .args([
            "convert",
            "--progress",
            "none",
            "--name",
            "cloud",
            "--threads",
            "2",
            "--memory-limit",
            "170M",
        ])
        .args(["--format", &format.to_string()])
        .arg("--temp-dir")
        .arg(scratch.parent().unwrap())
        .arg(input)
        .arg("-o")
        .arg(output);
    ended_before(&mut command, || units_done(&found(scratch)) >= before + more)
}

/// The scratch folder, whose name has a hash.
fn found(scratch: &Path) -> PathBuf {
    let beside = fs::read_dir(scratch.parent().unwrap()).unwrap().flatten().map(|entry| entry.path());
    beside.into_iter().find(|path| path.extension().is_some_and(|e| e == "scratch")).unwrap_or(scratch.into())
}

#[test]
fn killed_at_every_stage_the_bytes_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.laz");
    write_las(&input, &options_of(3, true), &surface(3, 230_000, 1));
    for (format, round) in [(Formats::BOTH, 0), (Formats::COPC, 1), (Formats::BOTH, 2)] {
        let options = Options { format, name: Some("cloud".into()), ..Options::default() };
        let whole = folder.path().join("whole");
        let inputs = [input.clone()];
        run::convert(&request(&inputs, &whole, &options), &context(folder.path(), 2, 4 << 30)).unwrap();
        let temp = folder.path().join(format!("temp{round}"));
        let out = folder.path().join(format!("out{round}"));
        fs::create_dir_all(&temp).unwrap();
        fs::create_dir_all(&out).unwrap();
        let output = out.join("cloud");
        let mut kills = 0;
        loop {
            let scratch = found(&temp.join("none"));
            if convert_killed(&input, &output, format, &scratch, 1 + (kills + round) % 4) {
                break;
            }
            kills += 1;
            assert!(kills < 200, "it never gets on");
        }
        assert!(kills >= 2, "{kills} kills");
        assert!(copc_bytes(&output) == copc_bytes(&whole), "{format}, {kills} kills");
        if format.potree {
            assert!(octree_bytes(&output) == octree_bytes(&whole), "{kills} kills");
        }
        assert_eq!(listing(&out), ["cloud"], "nothing stays behind");
        assert!(listing(&temp).is_empty());
        fs::remove_dir_all(whole).unwrap();
    }
}
