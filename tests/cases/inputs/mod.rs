//! Counts, chunk tables, what lies behind the points, and inputs that claim too much.

mod behind;
mod bombs;
mod chunk_tables;
mod deep;
mod stale;

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common;

const LODESTONE: &str = env!("CARGO_BIN_EXE_lodestone");
/// Places in a LAS header (LAS 1.4 R15, table 3).
const POINTS_AT: usize = 96;
const LEGACY_COUNT: usize = 107;
const LEGACY_RETURNS: usize = 111;
const EVLR: usize = 235;
const COUNT: usize = 247;
const RETURNS: usize = 255;

/// How the program ended, and all that it said.
struct Ended {
    code: Option<i32>,
    said: String,
}

fn lodestone(arguments: &[&str]) -> Ended {
    let output = Command::new(LODESTONE).args(arguments).args(["--threads", "2"]).output().unwrap();
    let said = [output.stdout, output.stderr].concat();
    Ended { code: output.status.code(), said: String::from_utf8_lossy(&said).into_owned() }
}

fn convert(input: &Path, octree: &Path, damaged: &str) -> Ended {
    let [input, octree] = [input, octree].map(|path| path.to_str().unwrap());
    lodestone(&["convert", input, "-o", octree, "--overwrite", "--progress", "plain", "--damaged", damaged])
}

fn verify(octree: &Path, input: &Path, damaged: &str) -> Ended {
    let [input, octree] = [input, octree].map(|path| path.to_str().unwrap());
    lodestone(&["verify", octree, "--damaged", damaged, "--against", input])
}

fn points(octree: &Path) -> u64 {
    lodestone::format::potree::Metadata::read(octree).unwrap().points
}

/// Converted to so many points without a question.
fn becomes(input: &Path, folder: &Path, count: u64) -> PathBuf {
    let octree = folder.join("octree");
    let ended = convert(input, &octree, "fail");
    assert_eq!(ended.code, Some(0), "{}: {}", input.display(), ended.said);
    assert_eq!(points(&octree), count, "{}: {}", input.display(), ended.said);
    let verified = verify(&octree, input, "fail");
    assert_eq!(verified.code, Some(0), "{}: {}", input.display(), verified.said);
    octree
}

/// Refused with both numbers; and all whole records where what can be read is kept.
fn contradicts(input: &Path, folder: &Path, said: u64, there: u64) -> PathBuf {
    let octree = folder.join("octree");
    let _ = std::fs::remove_dir_all(&octree);
    let ended = convert(input, &octree, "fail");
    assert_eq!(ended.code, Some(1), "{}: {}", input.display(), ended.said);
    for number in [said, there] {
        let is_told = ended.said.split(|c: char| !c.is_ascii_digit()).any(|part| part == number.to_string());
        assert!(is_told, "{number} is not told: {}", ended.said);
    }
    assert!(ended.said.contains("--damaged keep") && !octree.exists(), "{}", ended.said);
    let ended = convert(input, &octree, "keep");
    assert!(matches!(ended.code, Some(0 | 3)), "{}: {}", input.display(), ended.said);
    assert!(ended.said.contains("note: "), "nothing is told: {}", ended.said);
    assert_eq!(points(&octree), there, "{}: {}", input.display(), ended.said);
    let verified = verify(&octree, input, "keep");
    assert_eq!(verified.code, Some(0), "{}: {}", input.display(), verified.said);
    octree
}

/// A cloud of so many points, as bytes.
fn cloud(folder: &Path, format: u8, compressed: bool, count: u64) -> Vec<u8> {
    let path = folder.join("made");
    common::write_las(&path, &common::options_of(format, compressed), &records(format, count));
    std::fs::read(path).unwrap()
}

/// A surface with returns that can be.
fn records(format: u8, count: u64) -> Vec<u8> {
    let length = lodestone::format::las::record_length(format).unwrap();
    let mut records = common::surface(format, count, 7);
    for (number, record) in records.chunks_exact_mut(length).enumerate() {
        let (number, of) = ((number % 3) as u8 + 1, 3);
        record[14] = if format < 6 { number | of << 3 } else { number | of << 4 };
    }
    records
}

fn points_at(bytes: &[u8]) -> usize {
    u32::from_le_bytes(bytes[POINTS_AT..POINTS_AT + 4].try_into().unwrap()) as usize
}

/// Has the header count so many points, all of them first returns.
fn count(bytes: &mut [u8], said: u32) {
    let legacy = if bytes[24..26] == [1, 4] && bytes[104] & 63 >= 6 { 0 } else { said };
    bytes[LEGACY_COUNT..LEGACY_COUNT + 4].copy_from_slice(&legacy.to_le_bytes());
    bytes[LEGACY_RETURNS..LEGACY_RETURNS + 20].fill(0);
    bytes[LEGACY_RETURNS..LEGACY_RETURNS + 4].copy_from_slice(&legacy.to_le_bytes());
    if bytes[25] >= 4 {
        bytes[COUNT..COUNT + 8].copy_from_slice(&u64::from(said).to_le_bytes());
        bytes[RETURNS..RETURNS + 120].fill(0);
        bytes[RETURNS..RETURNS + 8].copy_from_slice(&u64::from(said).to_le_bytes());
    }
}
