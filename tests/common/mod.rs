//! What the integration tests share: small clouds, conversions with chosen
//! means, and a look at everything an octree holds.
#![allow(dead_code, reason = "each test file uses its part")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use lodestone::convert::context::{Cancel, Context, Progress};
use lodestone::convert::options::Options;
use lodestone::convert::run::{self, ConductError, ConversionOutcome, ConversionRequest};
use lodestone::format::las::{LasOptions, LasWriter, record_length};
use lodestone::format::potree::{self, Metadata};
use lodestone::platform::disk::Disk;

/// The folder of real clouds, where there is one.
pub fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("LODESTONE_DATA").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("LODESTONE_DATA names no folder: the tests of real clouds are left out");
    }
    folder
}

/// Runs a command and kills it as soon as `is_time`; true where it ended before, and well.
pub fn ended_before(command: &mut Command, is_time: impl Fn() -> bool) -> bool {
    let mut child = command.stdout(Stdio::null()).spawn().unwrap();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success());
            return true;
        }
        if is_time() {
            child.kill().unwrap();
            child.wait().unwrap();
            return false;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// A folder of the build with these scripts of `tests/cases/<from>` and the packages of npm
/// that their `package.json` names.
///
/// # Errors
/// Why there are no packages.
pub fn scripts(name: &str, from: &str, scripts: &[&str]) -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::create_dir_all(&folder).unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases").join(from);
    for script in scripts {
        fs::copy(source.join(script), folder.join(script)).unwrap();
    }
    let npm = ["install", "--ignore-scripts", "--no-audit", "--no-fund", "--prefer-offline"];
    let run = Command::new("npm").args(npm).current_dir(&folder).output().map_err(|e| format!("npm: {e}"))?;
    match run.status.success() {
        true => Ok(folder),
        false => Err(String::from_utf8_lossy(&[run.stdout, run.stderr].concat()).into_owned()),
    }
}

/// A small, well mixed number; the tests' only source of chance.
pub fn mix(n: u64) -> u64 {
    let mut h = n.wrapping_add(0x9E37_79B9_7F4A_7C15).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h ^= h >> 27;
    h = h.wrapping_mul(0x94D0_49BB_1331_11EB);
    h ^ h >> 31
}

/// Raw records of a bumpy surface in strips; every other byte is noise.
pub fn surface(format: u8, points: u64, seed: u64) -> Vec<u8> {
    let length = record_length(format).unwrap();
    let side = 1u64 << 17;
    let mut records = Vec::with_capacity(points as usize * length);
    for i in 0..points {
        let h = mix(seed ^ i << 20);
        let x = (i * side / points + h % 4000) % side;
        let y = h >> 20 & (side - 1);
        let z = (x * y / side / 8 + (h >> 50)) % (side / 4);
        let start = records.len();
        for c in [x, y, z] {
            records.extend_from_slice(&(c as i32).to_le_bytes());
        }
        let mut noise = mix(h);
        while records.len() < start + length {
            records.push(noise as u8);
            noise = noise.rotate_right(8) ^ mix(noise);
        }
    }
    records
}

pub fn options_of(format: u8, compressed: bool) -> LasOptions {
    LasOptions {
        version: if format >= 6 { (1, 4) } else { (1, 3) },
        point_format: format,
        scale: [0.01; 3],
        offset: [1000.0, 2000.0, -5.0],
        compressed,
        extra: Vec::new(),
        crs: Vec::new(),
        software: "lodestone tests".into(),
    }
}

pub fn write_las(path: &Path, options: &LasOptions, records: &[u8]) {
    let mut writer = LasWriter::create(path, options).unwrap();
    writer.write(records).unwrap();
    writer.finish().unwrap();
}

pub fn context(folder: &Path, threads: usize, memory_limit: u64) -> Context {
    Context {
        disk: Disk::new(),
        scratch: folder.join("scratch"),
        threads,
        memory_limit,
        cancel: Cancel::default(),
        progress: Arc::new(Progress::default()),
    }
}

pub fn request(inputs: &[PathBuf], output: &Path, options: &Options) -> ConversionRequest {
    ConversionRequest {
        inputs: inputs.to_vec(),
        output: output.to_path_buf(),
        overwrite: false,
        keep_scratch: false,
        options: options.clone(),
        hashes: Default::default(),
    }
}

/// Converts with plenty of memory on two threads.
pub fn convert(
    inputs: &[PathBuf],
    output: &Path,
    options: &Options,
) -> Result<ConversionOutcome, ConductError> {
    run::convert(&request(inputs, output, options), &context(output.parent().unwrap(), 2, 1 << 30))
}

/// The three files of an octree.
pub fn octree_bytes(folder: &Path) -> [Vec<u8>; 3] {
    [potree::METADATA, potree::HIERARCHY, potree::OCTREE].map(|name| fs::read(folder.join(name)).unwrap())
}

/// All records of an octree (DEFAULT layout), node by node, with the nodes.
pub fn all_records(folder: &Path) -> (Metadata, Vec<(potree::Node, Vec<u8>)>) {
    let metadata = Metadata::read(folder).unwrap();
    let schema = metadata.schema().unwrap();
    let [_, hierarchy, octree] = octree_bytes(folder);
    let nodes = potree::read_hierarchy(&hierarchy, metadata.hierarchy.first_chunk_size).unwrap();
    let records = nodes
        .into_iter()
        .map(|node| {
            let bytes = &octree[node.offset as usize..(node.offset + node.size) as usize];
            (node, potree::decode_node(&schema, metadata.encoding, node.points, bytes).unwrap())
        })
        .collect();
    (metadata, records)
}

/// What a folder holds, hidden files too, sorted.
pub fn listing(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

pub mod judge;
