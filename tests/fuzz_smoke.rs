//! The readers of `fuzz/` without a fuzzer: seeds that are mutated blindly, for
//! `LODESTONE_FUZZ_SECONDS` (2) each. Continuous integration takes a minute;
//! `cargo fuzz run` finds more in the same time, but needs a build of its own;
//! `LODESTONE_FUZZ_SEEDS=fuzz/corpus` writes the seeds to where it looks for them.
//!
//! No reader may panic, take 10 s, or ask for 256 MiB at once. What was found is
//! left in the temporary folder, to be made a test of its own.

mod common;
#[path = "fuzz_smoke/readers.rs"]
mod readers;

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Once;
use std::time::{Duration, Instant};

use common::{convert, mix, options_of, surface, write_las};
use lodestone::convert::options::Options;
use lodestone::format::potree;

/// No seed is as large as to justify more at once.
const MOST_MEMORY: usize = 256 << 20;
const MOST_TIME: Duration = Duration::from_secs(10);
/// Larger files are not mutated: a mutation in their points says little. All of the
/// malformed ones but one, which is ordinary and 4 MB, are smaller.
const LARGEST_SEED: usize = 256 << 10;

/// Refuses what no small file justifies; the process then ends and says so.
struct Meagre;

#[global_allocator]
static ALLOCATOR: Meagre = Meagre;

#[allow(unsafe_code, reason = "an allocator cannot be written without; all is left to the system's own")]
// SAFETY: every call goes to the system's allocator as it came, or is refused.
unsafe impl GlobalAlloc for Meagre {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.size() > MOST_MEMORY {
            return std::ptr::null_mut();
        }
        // SAFETY: the caller keeps to the same contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if layout.size() > MOST_MEMORY {
            return std::ptr::null_mut();
        }
        // SAFETY: the caller keeps to the same contract.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if size > MOST_MEMORY {
            return std::ptr::null_mut();
        }
        // SAFETY: the caller keeps to the same contract.
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps to the same contract.
        unsafe { System.dealloc(old, layout) }
    }
}

/// Small numbers and extreme ones: what counts, sizes and places are mostly wrong by.
const NUMBERS: [u64; 12] =
    [0, 1, 2, 7, 0x7F, 0xFF, 0xFFFF, 0x7FFF_FFFF, 0xFFFF_FFFF, 1 << 40, u64::MAX >> 1, u64::MAX];

struct Dice(u64);

impl Dice {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(1);
        (mix(self.0) % limit.max(1) as u64) as usize
    }

    /// Changes a few places of `bytes`, more often near its front, where numbers
    /// decide most; or cuts it, or puts a piece of another seed in.
    fn mutate(&mut self, bytes: &mut Vec<u8>, other: &[u8]) {
        for _ in 0..=self.below(4) {
            let reach = if self.below(2) == 0 { bytes.len().min(512) } else { bytes.len() };
            let at = self.below(reach);
            match self.below(8) {
                0 => bytes.truncate(self.below(bytes.len() + 1)),
                1 => {
                    let (from, length) = (self.below(other.len()), self.below(64));
                    let piece = &other[from..(from + length).min(other.len())];
                    bytes.splice(at..at, piece.iter().copied());
                }
                2 => drop(bytes.drain(at..(at + self.below(16)).min(bytes.len()))),
                3 | 4 => {
                    let (value, width) = (NUMBERS[self.below(NUMBERS.len())], 1 << self.below(4));
                    let end = (at + width).min(bytes.len());
                    bytes[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
                }
                5 if at < bytes.len() => {
                    bytes[at] = bytes[at].wrapping_add(self.below(5) as u8).wrapping_sub(2)
                }
                _ if at < bytes.len() => bytes[at] ^= 1 << self.below(8),
                _ => bytes.push(self.below(256) as u8),
            }
        }
    }
}

fn seconds() -> f64 {
    let wish = std::env::var("LODESTONE_FUZZ_SECONDS").unwrap_or_default();
    if wish.is_empty() { 2.0 } else { wish.parse().expect("LODESTONE_FUZZ_SECONDS is a number") }
}

fn fuzz(name: &str, reader: fn(&[u8]), seeds: &[Vec<u8>]) {
    static START: Once = Once::new();
    START.call_once(readers::start);
    assert!(!seeds.is_empty());
    if let Some(corpora) = std::env::var_os("LODESTONE_FUZZ_SEEDS") {
        let corpus = Path::new(&corpora).join(name);
        fs::create_dir_all(&corpus).unwrap();
        for (number, seed) in seeds.iter().enumerate() {
            fs::write(corpus.join(format!("seed-{number}")), seed).unwrap();
        }
    }
    let mut dice = Dice(mix(std::process::id().into()) ^ mix(name.len() as u64));
    let (start, mut tries) = (Instant::now(), 0u64);
    while start.elapsed().as_secs_f64() < seconds() || tries < 2 * seeds.len() as u64 {
        let mut bytes = seeds[tries as usize % seeds.len()].clone();
        // The seeds themselves first.
        if tries >= seeds.len() as u64 {
            let other = dice.below(seeds.len());
            dice.mutate(&mut bytes, &seeds[other]);
        }
        tries += 1;
        let begun = Instant::now();
        let outcome = readers::attempt(reader, &bytes);
        let slow = begun.elapsed() > MOST_TIME;
        if outcome.is_err() || slow {
            let found = std::env::temp_dir().join(format!("lodestone-fuzz-{name}-{}", std::process::id()));
            fs::write(&found, &bytes).unwrap();
            panic!(
                "{name}: {} ({:?}), see {}",
                outcome.err().unwrap_or_default(),
                begun.elapsed(),
                found.display()
            );
        }
    }
    println!("{name}: {tries} inputs in {:.0} s, nothing found", start.elapsed().as_secs_f64());
}

/// A small file of every kind, and the malformed ones where there are some.
fn clouds() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x");
    let mut seeds = Vec::new();
    for format in 0..=10 {
        for compressed in [false, true] {
            write_las(&path, &options_of(format, compressed), &surface(format, 150, format.into()));
            seeds.push(fs::read(&path).unwrap());
        }
    }
    for part in ["malformed", "formats"] {
        let Some(data) = common::data() else { break };
        let files =
            fs::read_dir(data.join(part)).unwrap().map(|entry| fs::read(entry.unwrap().path()).unwrap());
        seeds.extend(files.filter(|bytes| bytes.len() <= LARGEST_SEED));
    }
    seeds
}

/// An octree of two levels.
fn octree(folder: &Path) -> PathBuf {
    let (input, octree) = (folder.join("in.las"), folder.join("octree"));
    write_las(&input, &options_of(3, false), &surface(3, 30_000, 1));
    convert(&[input], &octree, &Options::default()).unwrap();
    octree
}

/// The fuzzers' targets are seldom compiled, but they are a line each: what could
/// leave them behind is a reader that comes, goes or gets another name.
#[test]
fn every_reader_has_its_target() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
    let manifest = fs::read_to_string(fuzz.join("Cargo.toml")).unwrap();
    let mut readers: Vec<&str> = include_str!("fuzz_smoke/readers.rs")
        .lines()
        .filter_map(|line| line.strip_prefix("pub fn ")?.strip_suffix("(bytes: &[u8]) {"))
        .collect();
    let mut targets: Vec<String> = fs::read_dir(fuzz.join("fuzz_targets"))
        .unwrap()
        .map(|entry| entry.unwrap().path().file_stem().unwrap().to_str().unwrap().to_string())
        .collect();
    readers.sort_unstable();
    targets.sort_unstable();
    assert!(readers.len() >= 6, "{readers:?}");
    assert_eq!(readers, targets);
    for reader in readers {
        let target = fs::read_to_string(fuzz.join("fuzz_targets").join(format!("{reader}.rs"))).unwrap();
        assert!(target.contains(&format!("readers::try_one(readers::{reader}, bytes)")), "{target}");
        assert!(manifest.contains(&format!("name = \"{reader}\"\npath = \"fuzz_targets/{reader}.rs\"")));
    }
}

#[test]
fn las_headers() {
    fuzz("las_header", readers::las_header, &clouds());
}

#[test]
fn laz() {
    fuzz("laz", readers::laz, &clouds());
}

#[test]
fn hierarchy() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(octree(folder.path()).join(potree::HIERARCHY)).unwrap();
    let seed = [&(bytes.len() as u64).to_le_bytes()[..], &bytes].concat();
    fuzz("hierarchy", readers::hierarchy, &[seed]);
}

#[test]
fn metadata() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(octree(folder.path()).join(potree::METADATA)).unwrap();
    fuzz("metadata", readers::metadata, &[bytes]);
}

#[test]
fn marker() {
    let seeds = [
        r#"{"name": "city", "priority": 5, "options": {"sampling": "random", "damaged": "keep"}, "on_done": "move"}"#,
        r#"{"options": {"attributes": ["intensity"], "encoding": "BROTLI", "name": null}}"#,
    ];
    fuzz("marker", readers::marker, &seeds.map(|text| text.as_bytes().to_vec()));
}

/// The journal of a conversion, and its receipts without
/// their checksums.
#[test]
fn journal() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.laz");
    write_las(&input, &options_of(3, true), &surface(3, 450_000, 1));
    let mut request = common::request(&[input], &folder.path().join("octree"), &Options::default());
    request.keep_scratch = true;
    let context = common::context(folder.path(), 2, 45 << 20);
    lodestone::convert::run::convert(&request, &context).unwrap();
    let whole = fs::read(context.scratch.join("journal")).unwrap();
    let mut payloads = Vec::new();
    let mut rest = whole.as_slice();
    while let Some((head, more)) = rest.split_first_chunk::<12>() {
        let length = u32::from_le_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let (payload, more) = more.split_at(length.min(more.len()));
        if let Ok(length) = u16::try_from(payload.len()) {
            payloads.extend_from_slice(&length.to_le_bytes());
            payloads.extend_from_slice(payload);
        }
        rest = more;
    }
    assert!(payloads.len() > 100, "{} bytes of receipts", payloads.len());
    fuzz("journal", readers::journal, &[payloads, whole]);
}
