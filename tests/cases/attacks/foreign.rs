//! Octrees of others that claim far more than they are: an error within seconds, and
//! never more memory than allowed.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::{Value, json};

/// Memory that `verify` may take, in MB, and what the program itself may take more.
const LIMIT: u64 = 256;
const MORE: u64 = 64;
/// Seconds of the processor, on two threads: ten of the clock.
const SECONDS: f64 = 20.0;

fn metadata() -> Value {
    json!({
        "version": "2.0", "name": "x", "description": "", "points": 1000, "projection": "",
        "hierarchy": { "firstChunkSize": 22, "stepSize": 4, "depth": 0 },
        "offset": [0, 0, 0], "scale": [0.01, 0.01, 0.01], "spacing": 1.0,
        "boundingBox": { "min": [0, 0, 0], "max": [128, 128, 128] }, "encoding": "DEFAULT",
        "attributes": [{
            "name": "position", "description": "", "size": 12, "numElements": 3, "elementSize": 4,
            "type": "int32", "min": [0, 0, 0], "max": [100, 100, 100], "scale": [1, 1, 1], "offset": [0, 0, 0],
        }],
    })
}

fn record(kind: u8, mask: u8, points: u32, offset: u64, size: u64) -> Vec<u8> {
    let mut bytes = vec![kind, mask];
    bytes.extend(points.to_le_bytes());
    bytes.extend(offset.to_le_bytes());
    bytes.extend(size.to_le_bytes());
    bytes
}

/// A brotli stream of nothing but zeros.
fn brotli_zeros(bytes: u64) -> Vec<u8> {
    use lodestone::octree::attribute::{Attribute, Scalar, Schema};
    // The points of a node that are all zero are 16 bytes each, all zero.
    let schema = Schema { attributes: vec![Attribute::new("position", Scalar::I32, 3)] };
    let mut stream = Vec::new();
    let records = vec![0; usize::try_from(bytes / 16 * 12).unwrap()];
    lodestone::format::potree::encode_brotli(&schema, &records, 5, &mut stream).unwrap();
    stream
}

struct Bomb {
    folder: tempfile::TempDir,
}

impl Bomb {
    fn new(metadata: &Value, hierarchy: &[u8], octree: &[u8]) -> Bomb {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("metadata.json"), metadata.to_string()).unwrap();
        fs::write(folder.path().join("hierarchy.bin"), hierarchy).unwrap();
        fs::write(folder.path().join("octree.bin"), octree).unwrap();
        Bomb { folder }
    }

    /// Makes a file longer than it is.
    fn sparse(self, file: &str, length: u64) -> Bomb {
        let file = fs::File::options().write(true).open(self.path().join(file)).unwrap();
        file.set_len(length).unwrap();
        self
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Holds the three programs to their bounds; their exit codes and words.
    fn held(&self, name: &str) -> Vec<(i32, String)> {
        let octree = self.path().to_path_buf();
        let pictures = self.path().join("pictures");
        let limit = format!("{LIMIT}M");
        let lines: [Vec<&str>; 3] = [
            vec!["info"],
            vec!["verify", "--threads", "2", "--memory-limit", &limit],
            vec![
                "preview",
                "--threads",
                "2",
                "--frames",
                "0",
                "--size",
                "64x64",
                "-o",
                pictures.to_str().unwrap(),
            ],
        ];
        lines.iter().map(|line| held(name, line, &octree)).collect()
    }

    /// The same, where every program has something against it.
    fn refused(&self, name: &str) {
        let all = self.held(name);
        for ((code, words), program) in all[1..].iter().zip(["verify", "preview"]) {
            assert_ne!(*code, 0, "{name}: {program}: {words}");
        }
    }
}

/// Runs a program to its end, and watches its memory meanwhile.
fn held(name: &str, line: &[&str], octree: &Path) -> (i32, String) {
    // A file: a pipe that nobody reads yet would fill.
    let said = tempfile::NamedTempFile::new().unwrap();
    let mut run = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(line)
        .arg(octree)
        .stdout(Stdio::from(fs::File::options().append(true).open(said.path()).unwrap()))
        .stderr(Stdio::from(fs::File::options().append(true).open(said.path()).unwrap()))
        .spawn()
        .unwrap();
    let (start, mut peak, mut seconds) = (Instant::now(), 0, 0.0f64);
    let status = loop {
        let status = fs::read_to_string(format!("/proc/{}/status", run.id())).unwrap_or_default();
        let most = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kb = most.and_then(|most| most.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
        peak = peak.max(kb.unwrap_or(0) / 1024);
        seconds = seconds.max(processor_seconds(run.id()));
        if let Some(status) = run.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > Duration::from_secs(150) {
            run.kill().unwrap();
            panic!("{name}: {line:?} does not end; {peak} MB");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let words = String::from_utf8_lossy(&fs::read(said.path()).unwrap()).into_owned();
    println!("| {name} | {} | {seconds:.1} s | {peak} MB | {:?} |", line[0], status.code());
    assert!(status.code().is_some_and(|code| code < 100), "{name}: {line:?}: {status}: {words}");
    assert!(!words.contains("panicked"), "{name}: {line:?}: {words}");
    assert!(peak <= LIMIT + MORE, "{name}: {line:?} took {peak} MB");
    assert!(seconds < SECONDS, "{name}: {line:?} took {seconds} s");
    (status.code().unwrap(), words)
}

/// Of the processor, which a busy machine does not change; of all threads.
fn processor_seconds(process: u32) -> f64 {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks: u64 = fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<u64>().ok()).sum();
    ticks as f64 / 100.0
}

fn brotli(points: u64) -> Value {
    let mut metadata = metadata();
    metadata["encoding"] = json!("BROTLI");
    metadata["points"] = json!(points);
    metadata
}

#[test]
fn streams_that_unpack_to_far_more_are_refused() {
    let stream = brotli_zeros(80 << 20);
    let points = (1u64 << 30) / 16;
    let bomb = Bomb::new(&brotli(points), &record(1, 0, points as u32, 0, stream.len() as u64), &stream);
    bomb.refused("a stream of some hundred bytes said to be 1 GiB");
    let points = (80u64 << 20) / 16;
    let bomb = Bomb::new(&brotli(points), &record(1, 0, points as u32, 0, stream.len() as u64), &stream);
    bomb.refused("a stream of some hundred bytes that is 80 MiB");

    let part = brotli_zeros(4 << 20);
    let (points, size) = (1u32 << 18, part.len() as u64);
    let inner = record(0, 255, points, 0, size);
    let hierarchy = [inner.repeat(1 + 8 + 64), record(1, 0, points, 0, size).repeat(512)].concat();
    let mut described = brotli(u64::from(points) * 585);
    described["hierarchy"] = json!({ "firstChunkSize": hierarchy.len(), "stepSize": 4, "depth": 3 });
    let all = Bomb::new(&described, &hierarchy, &part).held("585 nodes on the same bytes");
    assert_ne!(all[1].0, 0, "{}", all[1].1);
    assert!(all[1].1.contains("another node's"), "{}", all[1].1);

    // Each of its own bytes, so that only the sum is too much.
    let parts: Vec<u8> = part.repeat(585);
    let records =
        (0..585u64).map(|n| record(u8::from(n > 72), if n > 72 { 0 } else { 255 }, points, n * size, size));
    let hierarchy = records.collect::<Vec<_>>().concat();
    let all = Bomb::new(&described, &hierarchy, &parts).held("585 nodes of 4 MiB in some bytes each");
    assert_ne!(all[1].0, 0, "{}", all[1].1);
}

#[test]
fn sparse_files_are_no_points_and_no_nodes() {
    let tib = 1u64 << 40;
    Bomb::new(&brotli(1), &record(1, 0, 1, 0, tib), b"x")
        .sparse("octree.bin", tib)
        .refused("octree.bin of 1 TiB, one node of it");
    let mut many = metadata();
    many["points"] = json!(4_000_000_000u64);
    Bomb::new(&many, &record(1, 0, 4_000_000_000, 0, 48_000_000_000), b"x")
        .sparse("octree.bin", 48_000_000_000)
        .refused("a leaf of 4 000 million points in a hole");
    many["points"] = json!(4_000_000);
    let all = Bomb::new(&many, &record(1, 0, 4_000_000, 0, 48_000_000), b"x")
        .sparse("octree.bin", 48_000_000)
        .held("a leaf of 4 million points in a hole");
    assert!(all[1].0 != 0 && all[1].1.contains("never written"), "{}", all[1].1);

    let small = record(1, 0, 10, 0, 120);
    let all =
        Bomb::new(&metadata(), &small, &[0; 120]).sparse("hierarchy.bin", tib).held("hierarchy.bin of 1 TiB");
    assert_ne!(all[1].0, 0, "{}", all[1].1);
    let mut first = metadata();
    for size in [tib, u64::MAX, 22 * 1000, 0, 21] {
        first["hierarchy"]["firstChunkSize"] = json!(size);
        Bomb::new(&first, &small, &[0; 120])
            .sparse("hierarchy.bin", tib)
            .refused("and a first chunk of another size");
    }
}

#[test]
fn records_and_metadata_have_bounds() {
    let mut wide = metadata();
    let attribute = |n: usize, size: usize| {
        json!({ "name": format!("a{n}"), "description": "", "size": size, "numElements": size,
                "elementSize": 1, "type": "uint8", "min": [0], "max": [0] })
    };
    let list = wide["attributes"].as_array_mut().unwrap();
    list.extend((0..2000).map(|n| attribute(n, 65_535)));
    let size = (12 + 65_535 * 2000) * 65_536;
    Bomb::new(&wide, &record(1, 0, 65_536, 0, size), b"x")
        .sparse("octree.bin", size)
        .refused("records of 131 MB");
    let mut many = metadata();
    many["attributes"].as_array_mut().unwrap().extend((0..60_000).map(|n| attribute(n, 1)));
    Bomb::new(&many, &record(1, 0, 1, 0, 60_012), &[0; 60_012]).refused("60 000 attributes");
    let mut long = metadata();
    long["description"] = json!("x".repeat(40 << 20));
    let all = Bomb::new(&long, &record(1, 0, 10, 0, 120), &[0; 120]).held("metadata.json of 40 MB");
    assert!(all.iter().all(|(code, _)| *code != 0));
    let deep = Bomb::new(&metadata(), &record(1, 0, 10, 0, 120), &[0; 120]);
    fs::write(deep.path().join("metadata.json"), "{\"a\":".repeat(100_000)).unwrap();
    assert!(deep.held("metadata.json nested 100 000 deep").iter().all(|(code, _)| *code != 0));
}

#[test]
fn numbers_that_cannot_be_are_errors() {
    let points: Vec<u8> =
        (0..1000i32).flat_map(|i| [i * 10, i * 7 % 5000, i * 3 % 4000]).flat_map(i32::to_le_bytes).collect();
    let hierarchy = record(1, 0, 1000, 0, 12_000);
    let whole = Bomb::new(&metadata(), &hierarchy, &points);
    assert_eq!(whole.held("a sound octree")[2].0, 0);
    for (key, values) in [
        ("spacing", json!([0, -1, 1e300, 1e-300])),
        ("scale", json!([[0, 0, 0], [-1, -1, -1], [1e-300, 1e-300, 1e-300], [1e300, 1e300, 1e300]])),
        ("offset", json!([[1e300, 1e300, 1e300], [-1e308, 1e308, 0]])),
        (
            "boundingBox",
            json!([
                { "min": [0, 0, 0], "max": [0, 0, 0] },
                { "min": [100, 100, 100], "max": [-100, -100, -100] },
                { "min": [-1e308, -1e308, -1e308], "max": [1e308, 1e308, 1e308] },
                { "min": [0, 0, 0], "max": [1e-300, 1e-300, 1e-300] }
            ]),
        ),
    ] {
        for value in values.as_array().unwrap() {
            let mut wrong = metadata();
            wrong[key] = value.clone();
            Bomb::new(&wrong, &hierarchy, &points).held(&format!("{key} {value}"));
        }
    }
    let mut negative = metadata();
    negative["spacing"] = json!(-1);
    Bomb::new(&negative, &hierarchy, &points).refused("a spacing of -1");
}

#[test]
fn pipes_and_circles_end() {
    for file in ["metadata.json", "hierarchy.bin", "octree.bin"] {
        let bomb = Bomb::new(&metadata(), &record(1, 0, 10, 0, 120), &[0; 120]);
        fs::remove_file(bomb.path().join(file)).unwrap();
        mknodat(CWD, bomb.path().join(file), FileType::Fifo, Mode::from_raw_mode(0o600), 0).unwrap();
        bomb.refused(&format!("{file} is a pipe"));
    }
    let itself = Bomb::new(&metadata(), &record(2, 0, 10, 0, 22), &[0; 120]);
    itself.refused("the root is a proxy of itself");
    let chain = [record(0, 1, 1, 0, 12).repeat(42), record(1, 0, 1, 0, 12)].concat();
    let mut deep = metadata();
    deep["points"] = json!(43);
    deep["hierarchy"] = json!({ "firstChunkSize": chain.len(), "stepSize": 4, "depth": 42 });
    let all = Bomb::new(&deep, &chain, &[0; 12]).held("a chain of 43 levels");
    assert_ne!(all[1].0, 0, "{}", all[1].1);
}
