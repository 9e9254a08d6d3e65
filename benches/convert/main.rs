//! How fast `lodestone convert` is, beside the floors of the same machine in
//! the same minutes.
//!
//! ```text
//! cargo bench --bench convert -- [--points 5M,20M,…] [--scenes terrain,object,…] [--rounds 3]
//!     [--threads N] [--brotli] [--memory-limit 512M] [--folder DIR] [--codec]
//! ```
//!
//! Synthetic scenes of so many points (26-byte records) as LAS and as LAZ, and,
//! where `LODESTONE_DATA` names the folder of real clouds, the largest of them
//! too. Every figure is the median of `--rounds` runs, each a process of its
//! own; all methods take turns (A B C A B C …), so that a busy minute strikes
//! them all; inputs are read once before, so that they come from memory.
//!
//! "× floor" is the processor time of a conversion over that of its floors: for
//! LAS copying the input, for LAZ decoding it once on all cores, and for both
//! writing as many bytes as the octree has. "× D" is it over decoding the cloud's
//! LAZ once, whatever the input was: a measure that holds on any machine. A
//! second table has the seconds of each stage, and how busy the threads were.
//! Where there are several clouds, a last one has what a point costs in each.
//!
//! A table of what COPC files cost comes behind, beside copc_converter's where that is
//! found (`benches/convert/copc.rs`).
//!
//! Before all that, a table of what decoding and encoding LAZ chunks costs by point
//! format, by the `laz` crate and by our own codec; `--codec` is that alone.
//!
//! `--folder` is where clouds and octrees lie, by default the system's folder of
//! temporary files: 320 million points take 8 GB as LAS, 3 as LAZ and 9 as octree,
//! and as much as the LAS again where the memory limit is below it.

mod codec;
mod copc;
mod floors;
mod tables;

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use lodestone::lab::process::{self as measure, ProcessRun};
use tables::Cost;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

const BINARY: &str = env!("CARGO_BIN_EXE_lodestone");

struct Wishes {
    points: Vec<String>,
    scenes: Vec<String>,
    rounds: usize,
    threads: usize,
    brotli: bool,
    codec_only: bool,
    memory_limit: Option<String>,
    folder: PathBuf,
}

/// Something that is measured: a command and what it is called.
struct Method {
    name: String,
    arguments: Vec<String>,
    /// Of conversions: where the octree appears, and the methods that are its floors.
    octree: Option<(PathBuf, Vec<usize>)>,
    runs: Vec<ProcessRun>,
    /// Of conversions: seconds by stage, a map a run.
    stages: Vec<BTreeMap<String, f64>>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let outcome = match arguments.split_first() {
        Some((first, [name, operands @ ..])) if first == "floor" => floors::run(name, operands),
        _ => wishes(&arguments).and_then(|wishes| bench(&wishes)),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench: {error}");
            ExitCode::FAILURE
        }
    }
}

fn wishes(arguments: &[String]) -> Outcome<Wishes> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let list = |value: String| value.split(',').map(str::to_string).collect::<Vec<_>>();
    let mut wishes = Wishes {
        points: vec!["5M".to_string()],
        scenes: vec!["terrain".to_string()],
        rounds: 3,
        threads: cores,
        brotli: false,
        codec_only: false,
        memory_limit: None,
        folder: std::env::temp_dir(),
    };
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().cloned().ok_or(format!("{argument} wants a value"));
        match argument.as_str() {
            "--points" => wishes.points = list(value()?),
            "--scenes" => wishes.scenes = list(value()?),
            "--rounds" => wishes.rounds = value()?.parse::<usize>()?.max(1),
            "--threads" => wishes.threads = value()?.parse::<usize>()?.max(1),
            "--brotli" => wishes.brotli = true,
            "--codec" => wishes.codec_only = true,
            "--memory-limit" => wishes.memory_limit = Some(value()?),
            "--folder" => wishes.folder = PathBuf::from(value()?),
            "--bench" => {} // cargo's own
            other => return Err(format!("{other} is not understood (see benches/convert/main.rs)").into()),
        }
    }
    Ok(wishes)
}

fn bench(wishes: &Wishes) -> Outcome<()> {
    let folder = tempfile::Builder::new().prefix("lodestone-bench-").tempdir_in(&wishes.folder)?;
    codec::bench(wishes.rounds.max(5), folder.path())?;
    if wishes.codec_only {
        return Ok(());
    }
    let mut costs: Vec<Cost> = Vec::new();
    for points in &wishes.points {
        for scene in &wishes.scenes {
            let [las, laz] = ["las", "laz"].map(|kind| folder.path().join(scene).with_extension(kind));
            for file in [&las, &laz] {
                let output = file.display().to_string();
                let synth = ["synth", scene, "--format", "2", "--points", points, "-o", &output];
                measure::run(Command::new(BINARY).args(synth))?;
            }
            let title = format!("{scene}, {points} points");
            costs.push(compare(wishes, &title, &las, &laz, folder.path())?);
            fs::remove_file(&las)?;
            fs::remove_file(&laz)?;
        }
    }
    match std::env::var_os("LODESTONE_DATA").map(PathBuf::from) {
        None => println!("LODESTONE_DATA is not set: no real cloud was measured"),
        Some(data) => {
            let laz = largest(&data.join("large"))?;
            let las = folder.path().join("real.las");
            let unpack = ["floor", "unpack"];
            measure::run(Command::new(std::env::current_exe()?).args(unpack).arg(&laz).arg(&las))?;
            let title = laz.file_name().unwrap_or_default().to_string_lossy().into_owned();
            costs.push(compare(wishes, &title, &las, &laz, folder.path())?);
        }
    }
    tables::costs(&costs);
    Ok(())
}

fn largest(folder: &Path) -> Outcome<PathBuf> {
    let mut best = None;
    for entry in fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))? {
        let path = entry?.path();
        let size = fs::metadata(&path)?.len();
        if path.extension().is_some_and(|e| e == "laz") && best.as_ref().is_none_or(|(most, _)| size > *most)
        {
            best = Some((size, path));
        }
    }
    best.map(|(_, path)| path).ok_or(format!("no LAZ file in {}", folder.display()).into())
}

/// Measures one cloud, as LAS and as LAZ, and prints its tables.
fn compare(wishes: &Wishes, title: &str, las: &Path, laz: &Path, folder: &Path) -> Outcome<Cost> {
    let points = points_of(las)?;
    // The floor of writing must know how much is written.
    let trial = conversion(wishes, las, &folder.join("trial"), &[]);
    measure::run(&mut command(&trial)?)?;
    let written = check(&folder.join("trial"), points)?;
    fs::remove_dir_all(folder.join("trial"))?;

    let mut methods = methods(wishes, las, laz, folder, written);
    for path in [las, laz] {
        std::io::copy(&mut fs::File::open(path)?, &mut std::io::sink())?; // into the page cache
    }
    for round in 0..wishes.rounds {
        for method in &mut methods {
            eprint!("\r\x1b[K{title}: round {} of {}: {}", round + 1, wishes.rounds, method.name);
            method.runs.push(measure::run(&mut command(&method.arguments)?)?);
            if let Some((octree, _)) = &method.octree {
                check(octree, points)?;
                method.stages.push(stages(octree)?);
                fs::remove_dir_all(octree)?;
            }
        }
    }
    eprint!("\r\x1b[K");
    let inputs = [las, laz];
    let [las, laz] = [las, laz].map(|file| fs::metadata(file).map_or(0.0, |m| m.len() as f64 / 1e6));
    println!(
        "\n{title}: {points} points, LAS {las:.0} MB, LAZ {laz:.0} MB, octree {:.0} MB; {} threads, \
         median of {} (least to most)\n",
        written as f64 / 1e6,
        wishes.threads,
        wishes.rounds
    );
    let millions = points as f64 / 1e6;
    tables::methods(&methods, millions);
    tables::stages(&methods, wishes.threads);
    copc::compare(wishes, title, inputs, folder)?;
    Ok(tables::cost(title, &methods, millions))
}

/// Seconds of each stage, as the report beside the octree has them.
fn stages(octree: &Path) -> Outcome<BTreeMap<String, f64>> {
    let report: serde_json::Value = serde_json::from_slice(&fs::read(octree.join("report.json"))?)?;
    Ok(serde_json::from_value(report["seconds_by_stage"].clone())?)
}

fn methods(wishes: &Wishes, las: &Path, laz: &Path, folder: &Path, written: u64) -> Vec<Method> {
    let text = |path: &Path| path.display().to_string();
    let out = text(&folder.join("floor.out"));
    let mut methods: Vec<Method> = Vec::new();
    let mut floor = |name: &str, arguments: [&str; 3]| {
        let arguments = ["floor"].iter().chain(&arguments).map(ToString::to_string).collect();
        let (name, runs, stages) = (name.to_string(), Vec::new(), Vec::new());
        methods.push(Method { name, arguments, octree: None, runs, stages });
        methods.len() - 1
    };
    let copy = floor("floor: copy the LAS", ["copy", &text(las), &out]);
    floor("floor: copy the LAZ", ["copy", &text(laz), &out]);
    floor("floor: decode the LAZ, 1 thread", ["decode", &text(laz), "1"]);
    let decode = floor(tables::DECODE, ["decode", &text(laz), &wishes.threads.to_string()]);
    let write = floor("floor: write the octree's bytes", ["write", &out, &written.to_string()]);
    let mut variants = vec![("poisson", "default"), ("random", "default")];
    if wishes.brotli {
        variants.push(("poisson", "brotli"));
    }
    for (sampling, encoding) in variants {
        for (input, read) in [(las, copy), (laz, decode)] {
            let octree = folder.join("octree");
            let kind = if read == copy { "LAS" } else { "LAZ" };
            let brotli = if encoding == "brotli" { ", brotli" } else { "" };
            methods.push(Method {
                name: format!("convert {kind}, {sampling}{brotli}"),
                arguments: conversion(wishes, input, &octree, &["-m", sampling, "--encoding", encoding]),
                octree: Some((octree, vec![read, write])),
                runs: Vec::new(),
                stages: Vec::new(),
            });
        }
    }
    methods
}

fn conversion(wishes: &Wishes, input: &Path, octree: &Path, more: &[&str]) -> Vec<String> {
    let (input, octree) = (input.display().to_string(), octree.display().to_string());
    let threads = wishes.threads.to_string();
    let fixed =
        ["convert", &input, "-o", &octree, "--overwrite", "--progress", "none", "--threads", &threads];
    let limit = wishes.memory_limit.as_deref().map(|limit| ["--memory-limit", limit]);
    let limit = limit.iter().flatten();
    fixed.iter().chain(more).chain(limit).map(ToString::to_string).collect()
}

fn command(arguments: &[String]) -> Outcome<Command> {
    let floor = arguments.first().is_some_and(|first| first == "floor");
    let program = if floor { std::env::current_exe()? } else { PathBuf::from(BINARY) };
    let mut command = Command::new(program);
    command.args(arguments);
    Ok(command)
}

/// Bytes of an octree, if it holds as many points as it should: a fast run
/// that loses some is no run.
fn check(octree: &Path, points: u64) -> Outcome<u64> {
    let metadata: serde_json::Value = serde_json::from_slice(&fs::read(octree.join("metadata.json"))?)?;
    if metadata["points"].as_u64() != Some(points) {
        return Err(format!("{} holds {} of {points} points", octree.display(), metadata["points"]).into());
    }
    let mut bytes = 0;
    for entry in fs::read_dir(octree)? {
        bytes += entry?.metadata()?.len();
    }
    Ok(bytes)
}

fn points_of(las: &Path) -> Outcome<u64> {
    Ok(lodestone::format::las::LasFile::open(las)?.header().points)
}
