//! What a COPC file costs, beside the converter that writes the smallest ones so far:
//! copc_converter 0.16 (`cargo install copc_converter`), found in the path or by
//! `LODESTONE_COPC_CONVERTER`; without it, its rows are left out.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use lodestone::lab::process::{self as measure, ProcessRun};

use super::{BINARY, Outcome, Wishes, conversion};

/// One who writes COPC from an input.
struct Row {
    name: String,
    program: PathBuf,
    arguments: Vec<String>,
    file: PathBuf,
    runs: Vec<ProcessRun>,
    bytes: u64,
}

fn peer() -> Option<PathBuf> {
    let named = std::env::var_os("LODESTONE_COPC_CONVERTER").map(PathBuf::from);
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let in_path = || std::env::split_paths(&folders).map(|folder| folder.join("copc_converter"));
    named.or_else(|| in_path().find(|path| path.is_file()))
}

/// Measures both in turns, from LAS and from LAZ, and prints the table.
pub fn compare(wishes: &Wishes, title: &str, inputs: [&Path; 2], folder: &Path) -> Outcome<()> {
    let peer = peer();
    if peer.is_none() {
        println!("\ncopc_converter was not found: COPC files are measured without it");
    }
    let mut rows = Vec::new();
    for (input, kind) in inputs.into_iter().zip(["LAS", "LAZ"]) {
        let octree = folder.join("copc");
        let options = ["--format", "copc", "--name", "cloud"];
        rows.push(Row {
            name: format!("{kind}, lodestone"),
            program: BINARY.into(),
            arguments: conversion(wishes, input, &octree, &options),
            file: octree.join("cloud.copc.laz"),
            runs: Vec::new(),
            bytes: 0,
        });
        if let Some(program) = &peer {
            let file = folder.join("peer.copc.laz");
            let (threads, paths) =
                (wishes.threads.to_string(), [input, &file].map(|p| p.display().to_string()));
            let mut arguments: Vec<String> =
                ["--progress", "plain", "--threads", &threads].map(str::to_string).into();
            arguments.extend(
                wishes.memory_limit.iter().flat_map(|limit| ["--memory-limit".to_string(), limit.clone()]),
            );
            arguments.extend(paths);
            let (name, program) = (format!("{kind}, copc_converter"), program.clone());
            rows.push(Row { name, program, arguments, file, runs: Vec::new(), bytes: 0 });
        }
    }
    for _ in 0..wishes.rounds {
        for row in &mut rows {
            let _ = fs::remove_file(&row.file);
            row.runs.push(measure::run(Command::new(&row.program).args(&row.arguments))?);
            row.bytes = fs::metadata(&row.file)?.len();
        }
    }
    println!("\n{title}, as COPC; median of {}\n", wishes.rounds);
    println!("| | CPU s | wall s | peak MB | MB |\n|---|---:|---:|---:|---:|");
    for row in &rows {
        let median = |value: fn(&ProcessRun) -> f64| {
            let mut values: Vec<f64> = row.runs.iter().map(value).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        println!(
            "| {} | {:.2} | {:.2} | {:.0} | {:.1} |",
            row.name,
            median(|run| run.cpu),
            median(|run| run.wall),
            median(|run| run.peak as f64 / 1e6),
            row.bytes as f64 / 1e6
        );
    }
    Ok(())
}
