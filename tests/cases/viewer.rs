//! A real viewer reads our octrees: potree-core from the npm registry, loader,
//! hierarchy and decoder workers, run under Node (tests/cases/viewer/*.mjs), finds the
//! same nodes with the same points as our own reader, in both encodings.
//!
//! Runs where LODESTONE_VIEWER=1 is set, as it needs Node and npm; the packages
//! go into the build folder and are never part of the repository.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use lodestone::format::las::{LasOptions, LasWriter};
use lodestone::format::potree::{HIERARCHY, Metadata, Node, OCTREE, decode_node, read_hierarchy};
use lodestone::octree::attribute::{ExtraField, Scalar};

fn is_wanted() -> bool {
    let wanted = std::env::var("LODESTONE_VIEWER").is_ok_and(|value| value == "1");
    if !wanted {
        eprintln!("skipped: set LODESTONE_VIEWER=1 to read octrees with potree-core under Node");
    }
    wanted
}

/// A folder with the scripts and the viewer's packages.
static VIEWER: LazyLock<PathBuf> = LazyLock::new(|| {
    crate::common::scripts("viewer", "viewer", &["package.json", "browser.mjs", "read.mjs"]).unwrap()
});

fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{command:?}\n{}\n{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

fn convert(inputs: &[PathBuf], encoding: &str, lod_color: &str, output: &Path) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestone"));
    run(command
        .arg("convert")
        .args(inputs)
        .args(["--encoding", encoding, "--lod-color", lod_color, "--progress", "none", "-o"])
        .arg(output));
}

/// Writes what our own reader makes of an octree: its records, node by node.
fn write_expected(octree: &Path, folder: &Path) {
    let metadata = Metadata::read(octree).unwrap();
    let schema = metadata.schema().unwrap();
    let hierarchy = fs::read(octree.join(HIERARCHY)).unwrap();
    let nodes = read_hierarchy(&hierarchy, metadata.hierarchy.first_chunk_size).unwrap();
    let bytes = fs::read(octree.join(OCTREE)).unwrap();
    let mut records = Vec::new();
    let mut places = serde_json::Map::new();
    for Node { name, points, offset, size, .. } in nodes {
        let stored = &bytes[offset as usize..(offset + size) as usize];
        let decoded = decode_node(&schema, metadata.encoding, points, stored).unwrap();
        let place = serde_json::json!({ "start": records.len(), "size": decoded.len() });
        places.insert(name.to_string(), place);
        records.extend(decoded);
    }
    let mut start = 0;
    let attributes = metadata.attributes.iter().map(|a| {
        start += a.size;
        serde_json::json!({
            "name": a.name, "type": a.kind, "elementSize": a.element_size, "offset": start - a.size,
        })
    });
    let attributes: Vec<serde_json::Value> = attributes.collect();
    let expected = serde_json::json!({
        "scale": metadata.scale, "offset": metadata.offset, "recordSize": schema.record_size(),
        "attributes": attributes, "nodes": places,
    });
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("expected.json"), expected.to_string()).unwrap();
    fs::write(folder.join("expected.bin"), records).unwrap();
}

/// Converts to both encodings and has the viewer read both; what it should find
/// comes from the DEFAULT one. Gives the nodes and points it found.
fn the_viewer_agrees(inputs: &[PathBuf]) -> (u64, u64) {
    the_viewer_agrees_on(inputs, "keep")
}

fn the_viewer_agrees_on(inputs: &[PathBuf], lod_color: &str) -> (u64, u64) {
    let folder = tempfile::tempdir().unwrap();
    let expected = folder.path().join("expected");
    let mut found = Vec::new();
    for encoding in ["default", "brotli"] {
        let octree = folder.path().join(encoding);
        convert(inputs, encoding, lod_color, &octree);
        if encoding == "default" {
            write_expected(&octree, &expected);
        }
        let mut node = Command::new("node");
        let line = run(node.arg("read.mjs").args([&octree, &expected]).current_dir(&*VIEWER));
        let value: serde_json::Value = serde_json::from_str(&line).unwrap();
        found.push((value["nodes"].as_u64().unwrap(), value["points"].as_u64().unwrap()));
    }
    assert_eq!(found[0], found[1]);
    found[0]
}

/// Format 8 with extra fields of one, two and eight bytes, floats, and three
/// elements: every kind of column that a viewer can meet.
fn options() -> LasOptions {
    let mut position = 38;
    let kinds = [
        ("grade", Scalar::I8, 1),
        ("flow", Scalar::I16, 1),
        ("serial", Scalar::U64, 1),
        ("heat", Scalar::F32, 1),
        ("way", Scalar::F64, 3),
    ];
    let extra = kinds.map(|(name, scalar, elements)| {
        let field = ExtraField {
            name: name.into(),
            description: String::new(),
            scalar,
            elements,
            position,
            scale: vec![],
            offset: vec![],
        };
        position += scalar.size() * elements;
        field
    });
    LasOptions {
        version: (1, 4),
        point_format: 8,
        scale: [0.001; 3],
        offset: [500_000.0, 4_100_000.0, 0.0],
        compressed: false,
        extra: extra.to_vec(),
        crs: Vec::new(),
        software: String::new(),
    }
}

/// A cloud whose attributes are noise, at positions that `place` gives.
fn write_cloud(path: &Path, points: u32, place: impl Fn(u32, u64) -> [i32; 3]) {
    let mut state = 0x2545_f491_4f6c_dd1du64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut writer = LasWriter::create(path, &options()).unwrap();
    let mut records = Vec::new();
    for index in 0..points {
        records.extend(place(index, random()).iter().flat_map(|p| p.to_le_bytes()));
        // From the intensity to the point source, then the rest.
        records.extend((0..2).flat_map(|_| random().to_le_bytes()).take(10));
        records.extend((f64::from(index) * 1e-3 + 3e8).to_le_bytes());
        records.extend(random().to_le_bytes());
        records.extend([random() as u8, random() as u8, random() as u8]);
        records.extend(random().to_le_bytes());
        records.extend((random() as f32 / 1e9).to_le_bytes());
        (0..3).for_each(|_| records.extend((random() as f64).to_le_bytes()));
    }
    writer.write(&records).unwrap();
    writer.finish().unwrap();
}

#[test]
fn a_viewer_reads_what_we_wrote() {
    if !is_wanted() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("hill.las");
    write_cloud(&input, 60_000, |_, random| {
        let (x, y) = ((random & 0xffff) as i32, (random >> 16 & 0xffff) as i32);
        [x * 3, y * 3, (x / 64) * (y / 64) / 8 + (random >> 60) as i32]
    });
    let (nodes, points) = the_viewer_agrees(&[input]);
    assert_eq!(points, 60_000);
    assert!(nodes > 8, "{nodes} nodes");
}

/// A second colour is an attribute like any other to a viewer, whichever of the
/// two is called `rgb`.
#[test]
fn a_viewer_reads_both_colours_where_coarse_levels_are_averaged() {
    if !is_wanted() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("hill.las");
    write_cloud(&input, 30_000, |_, random| {
        let (x, y) = ((random & 0xffff) as i32, (random >> 16 & 0xffff) as i32);
        [x * 3, y * 3, (x / 64) * (y / 64) / 8]
    });
    for lod_color in ["attribute", "average"] {
        assert_eq!(the_viewer_agrees_on(std::slice::from_ref(&input), lod_color).1, 30_000);
    }
}

/// Where a file's integers lie decides whether the viewers' BROTLI decoder reads
/// them right (it drops the high bits of some): these would not be.
#[test]
fn a_viewer_reads_positions_that_its_decoder_is_weak_at() {
    if !is_wanted() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("far.las");
    write_cloud(&input, 3_000, |index, random| {
        let near = (random & 0x3ff) as i32;
        [(1 << 27) + near, near & 0x1ff, if index.is_multiple_of(2) { 0 } else { -(1 << 26) }]
    });
    assert_eq!(the_viewer_agrees(&[input]).1, 3_000);
}

/// Real clouds: 16-bit colours and NIR, waveforms, tiles.
#[test]
fn a_viewer_reads_real_clouds() {
    let Some(data) = std::env::var_os("LODESTONE_DATA").map(PathBuf::from).filter(|_| is_wanted()) else {
        eprintln!("skipped: needs LODESTONE_DATA and LODESTONE_VIEWER=1");
        return;
    };
    for name in
        ["single/append-bug.laz", "formats/fwf.laz", "formats/extrabytes.las", "single/autzen_trim.laz"]
    {
        let (nodes, points) = the_viewer_agrees(&[data.join(name)]);
        eprintln!("{name}: {nodes} nodes, {points} points");
        assert!(points > 0);
    }
}
