//! A conversion that is killed, at every stage, goes on from its receipts, and the COPC file
//! is the same to the last byte. Once at each stage, by two threads; as often as
//! LODESTONE_COPC_KILLS says, by one, two and four.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use super::support::copc_bytes;
use crate::common::{context, ended_before, listing, octree_bytes, options_of, request, surface, write_las};
use lodestone::convert::checkpoint::journal;
use lodestone::convert::checkpoint::receipt::{JournalEntry, WorkUnit};
use lodestone::convert::context::Stage;
use lodestone::convert::formats::Formats;
use lodestone::convert::options::Options;
use lodestone::convert::request::ConversionRequest;
use lodestone::convert::run;

const STAGES: [Stage; 5] = [Stage::Survey, Stage::Distribute, Stage::Index, Stage::Merge, Stage::Publish];
/// Tries to be at a stage in the moment of a kill.
const MAX_TRIES: u32 = 100;

/// A conversion that can be killed.
struct Conversion {
    inputs: PathBuf,
    output: PathBuf,
    temp: PathBuf,
    format: Formats,
    threads: usize,
    /// Units of each stage that leaves receipts, once all is known.
    units: [u64; 4],
}

impl Conversion {
    fn new(folder: &Path, inputs: &Path, format: Formats, threads: usize) -> Conversion {
        let (output, temp) = (folder.join("out/cloud"), folder.join("temp"));
        fs::create_dir_all(&temp).unwrap();
        fs::create_dir_all(folder.join("out")).unwrap();
        Conversion { inputs: inputs.to_path_buf(), output, temp, format, threads, units: [0; 4] }
    }

    fn command(&self, megabytes: u64) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestone"));
        command.args(["convert", "--progress", "none", "--name", "cloud"]);
        command.args(["--memory-limit", &format!("{megabytes}M")]);
        command.args(["--threads", &self.threads.to_string(), "--format", &self.format.to_string()]);
        command.arg("--temp-dir").arg(&self.temp).arg(&self.inputs).arg("-o").arg(&self.output);
        command
    }

    /// Megabytes, so few that it works out of core.
    fn memory(&self) -> u64 {
        match self.threads {
            1 => 100,
            2 => 170,
            _ => 330,
        }
    }

    /// Units that have receipts: of survey, distribution, and of chunks and the merge, whose
    /// numbers come after the chunks'.
    fn done(&self) -> [u64; 4] {
        let beside = fs::read_dir(&self.temp).unwrap().flatten().map(|entry| entry.path());
        let scratch = beside.into_iter().find(|path| path.extension().is_some_and(|e| e == "scratch"));
        scratch.map_or([0; 4], |scratch| units(&scratch, self.units[2]))
    }

    /// The stage whose units are being worked on.
    fn stage(&self) -> Stage {
        let done = self.done();
        let unfinished = (0..4).find(|&stage| done[stage] < self.units[stage]);
        unfinished.map_or(Stage::Publish, |stage| STAGES[stage])
    }

    fn forget(&self) {
        for folder in [&self.temp, self.output.parent().unwrap()] {
            fs::remove_dir_all(folder).unwrap();
            fs::create_dir_all(folder).unwrap();
        }
    }

    /// Kills it when so many units of a stage are done; goes on after such a kill.
    fn kill_at(&self, index: usize, units: u64) {
        let stage = STAGES[index];
        for _ in 0..MAX_TRIES {
            let is_time = || match self.stage().cmp(&stage) {
                Ordering::Less => false,
                Ordering::Equal => self.done().get(index).is_none_or(|done| *done >= units),
                Ordering::Greater => true,
            };
            let has_ended = ended_before(&mut self.command(self.memory()), is_time);
            if !has_ended && self.stage() == stage {
                return;
            }
            // It was quicker than the kill.
            self.forget();
        }
        panic!("never killed at {}", stage.name());
    }
}

/// Units by stage that have receipts in a scratch folder.
fn units(scratch: &Path, chunks: u64) -> [u64; 4] {
    let units: BTreeSet<WorkUnit> =
        journal::read(&scratch.join("journal")).unwrap().iter().filter_map(JournalEntry::unit).collect();
    let mut done = [0; 4];
    for unit in units {
        match unit {
            WorkUnit::Spooled(_) | WorkUnit::Surveyed => done[0] += 1,
            WorkUnit::Bucketed(_) => done[1] += 1,
            WorkUnit::Built(number) if u64::from(number) < chunks => done[2] += 1,
            WorkUnit::Built(_) => done[3] += 1,
        }
    }
    done
}

/// Six files. Half of them lie in one corner, so densely that chunks are deep and the merge
/// has a unit of its own: every stage has some.
fn inputs(folder: &Path) -> PathBuf {
    let inputs = folder.join("tiles");
    fs::create_dir(&inputs).unwrap();
    for tile in 0..6 {
        let is_dense = tile % 2 == 1;
        let mut records = surface(3, if is_dense { 75_000 } else { 45_000 }, tile);
        for axis in records.chunks_exact_mut(34).flat_map(|record| record[..12].chunks_exact_mut(4)) {
            let place = i32::from_le_bytes(axis.try_into().unwrap()) >> if is_dense { 3 } else { 0 };
            axis.copy_from_slice(&place.to_le_bytes());
        }
        write_las(&inputs.join(format!("{tile}.laz")), &options_of(3, true), &records);
    }
    inputs
}

#[test]
fn killed_at_every_stage_the_bytes_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let wished: Option<u64> = std::env::var("LODESTONE_COPC_KILLS").ok().map(|n| n.parse().unwrap());
    let rounds: &[usize] = if wished.is_some() { &[1, 2, 4] } else { &[2] };
    let (mut expected, mut octrees) = (None, None);
    for (round, threads) in rounds.iter().enumerate() {
        for format in [Formats::BOTH, Formats::COPC].into_iter().take(wished.map_or(1, |_| 2)) {
            let at = folder.path().join(format!("{round}-{format}"));
            let mut conversion = Conversion::new(&at, &inputs, format, *threads);
            // In core, with nothing to go on from: what it is to be.
            let whole = conversion.command(4_000).status().unwrap();
            assert!(whole.success());
            let bytes = copc_bytes(&conversion.output);
            assert!(*expected.get_or_insert_with(|| bytes.clone()) == bytes, "{threads} threads");
            if format.potree {
                let octree = octree_bytes(&conversion.output);
                assert!(*octrees.get_or_insert_with(|| octree.clone()) == octree, "{threads} threads");
            }
            // Out of core, to see what there is to do.
            conversion.forget();
            let context = context(&at, *threads, conversion.memory() * 1_000_000);
            let output = at.join("kept");
            let options = Options { format, name: Some("cloud".into()), ..Options::default() };
            let request = ConversionRequest {
                keep_scratch: true,
                ..request(std::slice::from_ref(&inputs), &output, &options)
            };
            let outcome = run::convert(&request, &context).unwrap();
            assert!(outcome.scratch_bytes > 0 && Some(copc_bytes(&output)) == expected);
            conversion.units = units(&context.scratch, outcome.chunks);
            eprintln!("{threads} threads, {format}: units of each stage {:?}", conversion.units);
            assert!(conversion.units.iter().all(|units| *units > 0));
            let kills = wished.unwrap_or(1);
            for index in 0..STAGES.len() {
                for kill in 0..kills {
                    let all = conversion.units.get(index).copied().unwrap_or(0);
                    conversion.kill_at(index, kill * all / kills);
                }
            }
            assert!(conversion.command(conversion.memory()).status().unwrap().success());
            assert!(Some(copc_bytes(&conversion.output)) == expected, "{threads} threads, {format}");
            if format.potree {
                assert!(Some(octree_bytes(&conversion.output)) == octrees, "{threads} threads");
            }
            assert_eq!(listing(conversion.output.parent().unwrap()), ["cloud"], "nothing stays behind");
            assert!(listing(&conversion.temp).is_empty());
        }
    }
}

#[test]
fn killed_in_core_it_begins_anew() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let conversion = Conversion::new(folder.path(), &inputs, Formats::COPC, 2);
    let begun = Instant::now();
    assert!(conversion.command(4_000).status().unwrap().success());
    let (took, expected) = (begun.elapsed(), copc_bytes(&conversion.output));
    let kills: u32 = std::env::var("LODESTONE_COPC_KILLS").map_or(2, |n| 5 * n.parse::<u32>().unwrap());
    for kill in 0..kills {
        conversion.forget();
        let begun = Instant::now();
        ended_before(&mut conversion.command(4_000), || begun.elapsed() > took * (kill + 1) / (kills + 1));
        // It may have been quicker this time; then there is an octree to be replaced.
        assert!(conversion.command(4_000).arg("--overwrite").status().unwrap().success());
        assert!(copc_bytes(&conversion.output) == expected);
        assert_eq!(listing(conversion.output.parent().unwrap()), ["cloud"], "nothing stays behind");
    }
}
