//! Readers that are not ours read our COPC files: laspy with both of its backends and
//! copclib (`read.py`), copc.js (`read.mjs`). Each reads every node, points lie inside of
//! their boxes, and all of them find the same records: those of the input.
//!
//! Runs if LODESTONE_REQUIRE_COPC=1 is set, as it needs Python, Node and packages from
//! their registries; these go into the build folder. copc-validator is on no registry; what
//! it asks for is asked by `read.mjs`, and by our own `verify`. copc-streaming is left out:
//! it would bring an asynchronous reader and a second LAZ codec into everybody's build.

mod export;
mod others;
mod virtual_cloud;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use lodestone::format::copc::CopcFile;
use lodestone::format::las::{LasOptions, Vlr, record_length};
use lodestone::octree::attribute::{ExtraField, Scalar};

use crate::common::{data, mix, options_of, scripts, write_las};

fn is_wanted() -> bool {
    let wanted = std::env::var("LODESTONE_REQUIRE_COPC").is_ok_and(|value| value == "1");
    if !wanted {
        eprintln!("skipped: set LODESTONE_REQUIRE_COPC=1 to read COPC with laspy, copclib and copc.js");
    }
    wanted
}

/// A folder with the scripts and the packages of the readers.
static READERS: LazyLock<PathBuf> = LazyLock::new(|| {
    let names = ["package.json", "requirements.txt", "read.mjs", "read.py"];
    let folder = scripts("copc-readers", "copc_readers", &names).unwrap();
    run(Command::new("python3").args(["-m", "venv", "venv"]).current_dir(&folder));
    let install = ["install", "--quiet", "--disable-pip-version-check", "-r", "requirements.txt"];
    run(Command::new(folder.join("venv/bin/pip")).args(install).current_dir(&folder));
    folder
});

pub fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    // The readers' own errors come with a megabyte of code.
    let text =
        |bytes: &[u8]| String::from_utf8_lossy(&bytes[bytes.len().saturating_sub(3_000)..]).into_owned();
    assert!(output.status.success(), "{command:?}\n{}\n{}", text(&output.stdout), text(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

pub fn lodestone() -> Command {
    Command::new(env!("CARGO_BIN_EXE_lodestone"))
}

/// Converts to COPC alone and gives the file.
pub fn convert(inputs: &[PathBuf], folder: &Path, options: &[&str]) -> PathBuf {
    let mut command = lodestone();
    command.arg("convert").args(inputs).args(["--format", "copc", "--progress", "none"]).args(options);
    run(command.arg("-o").arg(folder));
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.to_string_lossy().ends_with(".copc.laz"));
    assert_eq!(files.len(), 1, "{files:?}");
    files.remove(0)
}

/// Checks a file against its inputs with our own verifier.
pub fn verify(file: &Path, inputs: &[PathBuf]) -> serde_json::Value {
    let text = run(lodestone().arg("verify").arg(file).arg("--json").arg("--against").args(inputs));
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (report["against"]["missing"].as_u64(), report["against"]["extra"].as_u64()),
        (Some(0), Some(0))
    );
    report
}

/// What every reader found must be what our own reader finds.
fn readers_agree(file: &Path) {
    let copc = CopcFile::open(file, 1 << 30).unwrap();
    let (mut records, length) = (Vec::new(), copc.front.record_length);
    let mut reader = copc.reader().unwrap();
    for entry in copc.nodes() {
        records.extend_from_slice(reader.read_las(entry).unwrap());
    }
    let zeros = records.chunks_exact(length).filter(|record| record[14] & 15 == 0).count();
    let folder = &*READERS;
    let python =
        run(Command::new(folder.join("venv/bin/python")).arg("read.py").arg(file).current_dir(folder));
    let node = run(Command::new("node").arg("read.mjs").arg(file).arg(zeros.to_string()).current_dir(folder));
    let [python, node]: [serde_json::Value; 2] =
        [python, node].map(|text| serde_json::from_str(&text).unwrap());
    let points = (records.len() / length) as u64;
    for (name, found) in [
        ("lazrs", &python["lazrs"]),
        ("laszip", &python["laszip"]),
        ("copclib", &python["copclib"]),
        ("copc.js", &node),
    ] {
        assert_eq!(found["points"].as_u64(), Some(points), "{name}, {}", file.display());
        assert_eq!(found["sha256"], node["sha256"], "{name}, {}", file.display());
    }
    assert_eq!(node["nodes"].as_u64(), Some(copc.nodes().len() as u64));
    assert_eq!(
        python["copclib"]["nodes"].as_u64(),
        Some(copc.nodes().iter().filter(|node| node.points > 0).count() as u64)
    );
}

/// Fields of extra bytes of every kind, and three that nothing describes.
pub fn extra(format: u8) -> Vec<ExtraField> {
    let mut position = record_length(format).unwrap();
    [
        ("height", Scalar::F32, 1),
        ("Colors", Scalar::U16, 3),
        ("Intensity", Scalar::I64, 1),
        ("extra bytes", Scalar::U8, 5),
    ]
    .into_iter()
    .map(|(name, scalar, elements)| {
        let (scale, offset) = match name {
            "height" => (vec![0.5], vec![-3.0]),
            _ => (vec![], vec![]),
        };
        let description = String::new();
        let field = ExtraField { name: name.into(), description, scalar, elements, position, scale, offset };
        position += scalar.size() * elements;
        field
    })
    .collect()
}

/// Writes a file of a point format whose every bit is noise, but for positions.
pub fn noisy(path: &Path, format: u8, points: u64, compressed: bool) -> LasOptions {
    let fields = extra(format);
    let length = fields.last().map_or(0, |field| field.position + field.scalar.size() * field.elements);
    let mut records = Vec::with_capacity(points as usize * length);
    for number in 0..points {
        let (mut noise, start) = (mix(number), records.len());
        for axis in 0..3 {
            let place = (noise >> (20 * axis)) % 40_000 + number * 3;
            records.extend_from_slice(&(place as i32).to_le_bytes());
        }
        while records.len() < start + length {
            noise = mix(noise);
            records.extend_from_slice(&noise.to_le_bytes());
        }
        records.truncate(start + length);
    }
    let crs = vec![Vlr::wkt(
        r#"PROJCS["x",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",15],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1]]"#,
    )];
    let version = if format >= 6 { (1, 4) } else { (1, 3) };
    let crs = if format >= 6 { crs } else { Vec::new() };
    let options = LasOptions { extra: fields, version, crs, ..options_of(format, compressed) };
    write_las(path, &options, &records);
    options
}

#[test]
fn every_reader_finds_the_points_of_every_format() {
    if !is_wanted() {
        return;
    }
    for format in 0..=10 {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.las");
        noisy(&input, format, 3_000, false);
        let file = convert(std::slice::from_ref(&input), &folder.path().join("out"), &[]);
        verify(&file, &[input]);
        readers_agree(&file);
    }
}

#[test]
fn averaged_colors_are_read_by_all() {
    if !is_wanted() {
        return;
    }
    for mode in ["average", "attribute"] {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.las");
        noisy(&input, 7, 5_000, false);
        let file = convert(std::slice::from_ref(&input), &folder.path().join("out"), &["--lod-color", mode]);
        verify(&file, &[input]);
        readers_agree(&file);
    }
}

#[test]
fn real_clouds_are_read_by_all() {
    let (Some(data), true) = (data(), is_wanted()) else { return };
    for name in [
        "single/lone-star.copc.laz",
        "single/pine_plot.laz",
        "formats/extrabytes.las",
        "formats/fwf.laz",
        "single/870000_6618000.subset.50mx100m.las",
    ] {
        let folder = tempfile::tempdir().unwrap();
        let input = data.join(name);
        let file = convert(std::slice::from_ref(&input), &folder.path().join("out"), &[]);
        verify(&file, &[input]);
        readers_agree(&file);
    }
}
