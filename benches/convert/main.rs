//! How fast `lodestone convert` is, beside the floors of the same machine in
//! the same minutes.
//!
//! ```text
//! cargo bench --bench convert -- [--points 5M] [--rounds 3] [--threads N] [--brotli]
//! ```
//!
//! A synthetic terrain of `--points` (26-byte records) as LAS and as LAZ, and,
//! where `LODESTONE_DATA` names the folder of real clouds, the largest of them
//! too. Every figure is the median of `--rounds` runs, each a process of its
//! own; all methods take turns (A B C A B C …), so that a busy minute strikes
//! them all; inputs are read once before, so that they come from memory.
//! "× floor" is the processor time of a conversion over that of its floors:
//! for LAS copying the input, for LAZ decoding it once on all cores, and for
//! both writing as many bytes as the octree has.

mod floors;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use lodestone::measure::process::{self as measure, Run, spread};

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

const BINARY: &str = env!("CARGO_BIN_EXE_lodestone");

struct Wishes {
    points: String,
    rounds: usize,
    threads: usize,
    brotli: bool,
}

/// Something that is measured: a command and what it is called.
struct Method {
    name: String,
    arguments: Vec<String>,
    /// Of conversions: where the octree appears, and the methods that are its floors.
    octree: Option<(PathBuf, Vec<usize>)>,
    runs: Vec<Run>,
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
    let mut wishes = Wishes { points: "5M".to_string(), rounds: 3, threads: cores, brotli: false };
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().cloned().ok_or(format!("{argument} wants a value"));
        match argument.as_str() {
            "--points" => wishes.points = value()?,
            "--rounds" => wishes.rounds = value()?.parse::<usize>()?.max(1),
            "--threads" => wishes.threads = value()?.parse::<usize>()?.max(1),
            "--brotli" => wishes.brotli = true,
            "--bench" => {} // cargo's own
            other => return Err(format!("{other} is not understood (see benches/convert/main.rs)").into()),
        }
    }
    Ok(wishes)
}

fn bench(wishes: &Wishes) -> Outcome<()> {
    let folder = tempfile::Builder::new().prefix("lodestone-bench-").tempdir()?;
    let place = |name: &str| folder.path().join(name);
    let (las, laz) = (place("terrain.las"), place("terrain.laz"));
    for file in [&las, &laz] {
        let output = file.display().to_string();
        let synth = ["synth", "terrain", "--format", "2", "--points", &wishes.points, "-o", &output];
        measure::run(Command::new(BINARY).args(synth))?;
    }
    compare(wishes, &format!("terrain, {} points", wishes.points), &las, &laz, folder.path())?;
    fs::remove_file(&las)?;
    fs::remove_file(&laz)?;

    let Some(data) = std::env::var_os("LODESTONE_DATA").map(PathBuf::from) else {
        println!("LODESTONE_DATA is not set: no real cloud was measured");
        return Ok(());
    };
    let laz = largest(&data.join("large"))?;
    let las = place("real.las");
    measure::run(Command::new(std::env::current_exe()?).args(["floor", "unpack"]).arg(&laz).arg(&las))?;
    let title = laz.file_name().unwrap_or_default().to_string_lossy().into_owned();
    compare(wishes, &title, &las, &laz, folder.path())
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

/// Measures one cloud, as LAS and as LAZ, and prints its table.
fn compare(wishes: &Wishes, title: &str, las: &Path, laz: &Path, folder: &Path) -> Outcome<()> {
    let points = points_of(las)?;
    // The floor of writing must know how much is written.
    let trial = conversion(wishes, las, &folder.join("trial"), &[]);
    measure::run(&mut command(&trial)?)?;
    let written = check(&folder.join("trial"), points)?;
    fs::remove_dir_all(folder.join("trial"))?;

    let mut methods = methods(wishes, las, laz, folder, written);
    for path in [las, laz] {
        fs::read(path)?; // into the page cache
    }
    for round in 0..wishes.rounds {
        for method in &mut methods {
            eprint!("\r\x1b[K{title}: round {} of {}: {}", round + 1, wishes.rounds, method.name);
            method.runs.push(measure::run(&mut command(&method.arguments)?)?);
            if let Some((octree, _)) = &method.octree {
                check(octree, points)?;
                fs::remove_dir_all(octree)?;
            }
        }
    }
    eprint!("\r\x1b[K");
    let [las, laz] = [las, laz].map(|file| fs::metadata(file).map_or(0.0, |m| m.len() as f64 / 1e6));
    println!(
        "\n{title}: {points} points, LAS {las:.0} MB, LAZ {laz:.0} MB, octree {:.0} MB; {} threads, \
         median of {} (least to most)\n",
        written as f64 / 1e6,
        wishes.threads,
        wishes.rounds
    );
    print(&methods, points as f64 / 1e6);
    Ok(())
}

fn methods(wishes: &Wishes, las: &Path, laz: &Path, folder: &Path, written: u64) -> Vec<Method> {
    let text = |path: &Path| path.display().to_string();
    let out = text(&folder.join("floor.out"));
    let mut methods: Vec<Method> = Vec::new();
    let mut floor = |name: &str, arguments: [&str; 3]| {
        let arguments = ["floor"].iter().chain(&arguments).map(ToString::to_string).collect();
        methods.push(Method { name: name.to_string(), arguments, octree: None, runs: Vec::new() });
        methods.len() - 1
    };
    let copy = floor("floor: copy the LAS", ["copy", &text(las), &out]);
    floor("floor: copy the LAZ", ["copy", &text(laz), &out]);
    floor("floor: decode the LAZ, 1 thread", ["decode", &text(laz), "1"]);
    let decode =
        floor("floor: decode the LAZ, all cores", ["decode", &text(laz), &wishes.threads.to_string()]);
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
    fixed.iter().chain(more).map(ToString::to_string).collect()
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

fn print(methods: &[Method], millions: f64) {
    println!("| | s | M points/s | CPU-s/M points | peak MB | × floor |\n|---|---:|---:|---:|---:|---:|");
    let cpu = |method: &Method| spread(method.runs.iter().map(|run| run.cpu));
    for method in methods {
        let wall = spread(method.runs.iter().map(|run| run.wall));
        let own = cpu(method);
        let peak = method.runs.iter().map(|run| run.peak).max().unwrap_or(0);
        let times = method.octree.as_ref().map_or(String::new(), |(_, floors)| {
            let floor: f64 = floors.iter().map(|&index| cpu(&methods[index]).median).sum();
            format!("{:.1}", own.median / floor)
        });
        println!(
            "| {} | {:.2} ({:.2}–{:.2}) | {:.2} | {:.3} ({:.3}–{:.3}) | {:.0} | {times} |",
            method.name,
            wall.median,
            wall.min,
            wall.max,
            millions / wall.median,
            own.median / millions,
            own.min / millions,
            own.max / millions,
            peak as f64 / 1e6,
        );
    }
}
