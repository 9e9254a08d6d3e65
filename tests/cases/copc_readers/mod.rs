//! Readers that are not ours read our COPC files: laspy with both of its backends and
//! copclib (`read.py`), copc.js (`read.mjs`), copc-streaming (`streaming/`). Each reads every
//! node, points lie inside of their boxes, and all of them find the same records: those of
//! the input.
//!
//! Runs if LODESTONE_REQUIRE_COPC=1 is set, as it needs Python, Node and packages from
//! their registries; these go into the build folder. copc-validator has to be built by hand
//! (`validator.rs`); what it asks for is asked by `read.mjs`, and by our own `verify`, too.

mod export;
mod others;
mod validator;
mod virtual_cloud;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use lodestone::format::copc::CopcFile;
use lodestone::format::finished::copc_in;
use lodestone::format::las::{LasFile, LasOptions, Vlr, record_length};
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
    let mut files = copc_in(folder);
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

/// The program that reads with copc-streaming, built where the other readers are.
static STREAMING: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("copc-streaming");
    fs::create_dir_all(&folder).unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/copc_readers/streaming");
    for name in ["Cargo.toml", "main.rs"] {
        fs::copy(source.join(name), folder.join(name)).unwrap();
    }
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let build = ["build", "--release", "--quiet", "--target-dir", "target"];
    run(Command::new(cargo).args(build).current_dir(&folder));
    folder.join("target/release/read-streaming")
});

/// Records as our own reader finds them, and how long they are.
fn own_records(file: &Path) -> (Vec<u8>, usize, usize) {
    let copc = CopcFile::open(file, 1 << 30).unwrap();
    let mut records = Vec::new();
    let mut reader = copc.reader().unwrap();
    for entry in copc.nodes() {
        records.extend_from_slice(reader.read_las(entry).unwrap());
    }
    (records, copc.front.record_length, copc.nodes().iter().filter(|node| node.points > 0).count())
}

fn sorted(records: &[u8], length: usize) -> Vec<&[u8]> {
    let mut records: Vec<&[u8]> = records.chunks_exact(length).collect();
    records.sort_unstable();
    records
}

fn lines(text: &str) -> Vec<serde_json::Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// What every reader finds in each file must be what our own reader finds.
fn readers_agree(files: &[PathBuf]) {
    let folder = &*READERS;
    let scratch = tempfile::tempdir().unwrap();
    let zeros = |file: &PathBuf| {
        let (records, length, _) = own_records(file);
        records.chunks_exact(length).filter(|record| record[14] & 15 == 0).count().to_string()
    };
    let streamed = |number: usize| scratch.path().join(number.to_string());
    let mut python = Command::new(folder.join("venv/bin/python"));
    let mut node = Command::new("node");
    let mut streaming = Command::new(&*STREAMING);
    python.arg("read.py").args(files).current_dir(folder);
    node.arg("read.mjs").current_dir(folder);
    for (number, file) in files.iter().enumerate() {
        node.arg(file).arg(zeros(file));
        streaming.arg(file).arg(streamed(number));
    }
    let [python, node, streaming] =
        [&mut python, &mut node, &mut streaming].map(|command| lines(&run(command)));
    for (number, file) in files.iter().enumerate() {
        let (records, length, nodes) = own_records(file);
        let (python, node) = (&python[number], &node[number]);
        let points = (records.len() / length) as u64;
        for (name, found) in [
            ("lazrs", &python["lazrs"]),
            ("laszip", &python["laszip"]),
            ("copclib", &python["copclib"]),
            ("copc.js", node),
        ] {
            assert_eq!(found["points"].as_u64(), Some(points), "{name}, {}", file.display());
            assert_eq!(found["sha256"], node["sha256"], "{name}, {}", file.display());
        }
        let found = fs::read(streamed(number)).unwrap();
        assert!(sorted(&found, length) == sorted(&records, length), "copc-streaming, {}", file.display());
        for (name, found) in [
            ("copc.js", &node["nodes"]),
            ("copclib", &python["copclib"]["nodes"]),
            ("copc-streaming", &streaming[number]),
        ] {
            let expected =
                if name == "copc.js" { CopcFile::open(file, 1 << 30).unwrap().nodes().len() } else { nodes };
            assert_eq!(found.as_u64(), Some(expected as u64), "{name}, {}", file.display());
        }
    }
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
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for format in 0..=10 {
        let input = folder.path().join(format!("{format}.las"));
        noisy(&input, format, 3_000, false);
        files.push(convert(std::slice::from_ref(&input), &folder.path().join(format.to_string()), &[]));
        verify(&files[format as usize], &[input]);
        let scene = folder.path().join(format!("terrain-{format}.laz"));
        let format = format.to_string();
        run(lodestone().args(["synth", "terrain", "--points", "20K", "--format", &format, "-o"]).arg(&scene));
        let file =
            convert(std::slice::from_ref(&scene), &folder.path().join(format!("terrain-{format}")), &[]);
        verify(&file, &[scene]);
        readers_agree(&[file]);
    }
    readers_agree(&files);
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
        readers_agree(&[file]);
    }
}

/// All LAS and LAZ files of the real clouds that hold points which can be converted.
fn all_clouds(data: &Path) -> Vec<PathBuf> {
    let inputs = lodestone::format::inputs::expand(&[data.to_path_buf()]).unwrap();
    inputs.into_iter().filter(|path| LasFile::open(path).is_ok_and(|file| file.header().points > 0)).collect()
}

#[test]
fn real_clouds_are_read_by_all() {
    let (Some(data), true) = (data(), is_wanted()) else { return };
    let few = [
        "single/lone-star.copc.laz",
        "single/pine_plot.laz",
        "formats/extrabytes.las",
        "formats/fwf.laz",
        "single/870000_6618000.subset.50mx100m.las",
    ];
    let inputs = match std::env::var("LODESTONE_COPC_CLOUDS").is_ok_and(|which| which == "all") {
        true => all_clouds(&data),
        false => few.map(|name| data.join(name)).into(),
    };
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for (number, input) in inputs.iter().enumerate() {
        let output = folder.path().join(number.to_string());
        let mut command = lodestone();
        command.arg("convert").arg(input).args(["--format", "copc", "--progress", "none", "-o"]).arg(&output);
        if !command.output().unwrap().status.success() {
            // What no octree is made of, no COPC file is made of.
            let mut command = lodestone();
            command.arg("convert").arg(input).args(["--progress", "none", "-o"]).arg(&output);
            assert!(!command.output().unwrap().status.success(), "{}", input.display());
            eprintln!("{} is not readable", input.display());
            continue;
        }
        let file = copc_in(&output).remove(0);
        verify(&file, std::slice::from_ref(input));
        files.push(file);
    }
    eprintln!("{} of {} clouds", files.len(), inputs.len());
    assert!(files.len() >= few.len());
    files.chunks(20).for_each(readers_agree);
}
