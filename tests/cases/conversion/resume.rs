//! A conversion that is killed goes on from its receipts, and what it makes is
//! the same to the last byte: killed after every so many units, with remains of
//! other conversions about, with remains that somebody damaged, on a disk that
//! fails.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::common::{context, ended_before, listing, octree_bytes, options_of, request, surface, write_las};
use lodestone::convert::checkpoint::journal;
use lodestone::convert::checkpoint::receipt::{JournalEntry, WorkUnit};
use lodestone::convert::checkpoint::scratch::units_done;
use lodestone::convert::options::{Encoding, LodColor, Options, Sampling};
use lodestone::convert::run::{self, ConversionOutcome};
use lodestone::format::las::LasFile;
use lodestone::platform::disk::Disk;

const OUT_OF_CORE: u64 = 45 << 20;

/// A cloud of several slices and chunks, in LAS or LAZ.
fn cloud(folder: &Path, compressed: bool) -> PathBuf {
    let input = folder.join(if compressed { "surface.laz" } else { "surface.las" });
    write_las(&input, &options_of(3, compressed), &surface(3, 450_000, 1));
    input
}

fn named(encoding: Encoding, sampling: Sampling) -> Options {
    Options { encoding, sampling, name: Some("surface".into()), ..Options::default() }
}

fn uninterrupted(folder: &Path, input: &Path, options: &Options) -> [Vec<u8>; 3] {
    let output = folder.join("whole");
    let inputs = [input.to_path_buf()];
    run::convert(&request(&inputs, &output, options), &context(folder, 2, 4 << 30)).unwrap();
    octree_bytes(&output)
}

/// Work that has receipts; none may come twice.
fn units(scratch: &Path) -> Vec<WorkUnit> {
    let receipts = journal::read(&scratch.join("journal")).unwrap();
    receipts.iter().filter_map(JournalEntry::unit).collect()
}

/// The scratch folder that `convert` makes beside its output.
fn scratch_of(output: &Path) -> Option<PathBuf> {
    let name = output.file_name().unwrap().to_str().unwrap();
    let beside = fs::read_dir(output.parent().unwrap()).unwrap();
    let mut beside = beside.map(|entry| entry.unwrap().path());
    beside.find(|path| {
        let other = path.file_name().unwrap().to_str().unwrap();
        other.starts_with(&format!(".{name}-")) && other.ends_with(".scratch")
    })
}

/// `lodestone convert`, killed as soon as it has done `more` units; true where it
/// ended before.
fn convert_killed(input: &Path, output: &Path, options: &Options, more: u64) -> bool {
    let before = scratch_of(output).map_or(0, |scratch| units_done(&scratch));
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestone"));
    command
        .args([
            "convert",
            "--progress",
            "none",
            "--name",
            "surface",
            "--threads",
            "2",
            "--memory-limit",
            "90M",
        ])
        .args(["--encoding", if options.encoding == Encoding::Brotli { "brotli" } else { "default" }])
        .args(["--lod-color", options.lod_color.name()])
        .args(["--sampling", if options.sampling == Sampling::Random { "random" } else { "poisson" }])
        .arg(input)
        .arg("-o")
        .arg(output);
    ended_before(&mut command, || {
        scratch_of(output).is_some_and(|scratch| units_done(&scratch) >= before + more)
    })
}

#[test]
fn killed_after_every_few_units_the_bytes_are_the_same_and_no_unit_is_done_twice() {
    for (compressed, encoding, sampling, lod_color) in [
        (false, Encoding::Default, Sampling::Poisson, LodColor::Average),
        (true, Encoding::Default, Sampling::Random, LodColor::Keep),
        (true, Encoding::Brotli, Sampling::Poisson, LodColor::Keep),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let input = cloud(folder.path(), compressed);
        let options = Options { lod_color, ..named(encoding, sampling) };
        let expected = uninterrupted(folder.path(), &input, &options);
        let out = folder.path().join("out");
        fs::create_dir(&out).unwrap();
        let output = out.join("octree");
        let mut kills = 0;
        let mut done = BTreeSet::new();
        while !convert_killed(&input, &output, &options, 1 + kills % 4) {
            kills += 1;
            let Some(scratch) = scratch_of(&output) else { continue };
            let now = units(&scratch);
            let known: BTreeSet<_> = now.iter().copied().collect();
            assert_eq!(known.len(), now.len(), "a unit was done twice: {now:?}");
            assert!(known.is_superset(&done), "a receipt was lost");
            done = known;
            assert!(kills < 200, "it never gets on");
        }
        // Many on an idle machine, few where the killer has to wait for its turn.
        assert!(kills >= 2, "{kills} kills");
        assert!(octree_bytes(&output) == expected, "{options:?}");
        assert_eq!(listing(&out), ["octree"], "nothing stays behind");
    }
}

/// Stops a conversion in this process by its cancel flag, once it has done
/// `stop_at` units; its remains stay in `folder`.
fn stopped(folder: &Path, input: &Path, options: &Options, stop_at: u64) {
    let output = folder.join("octree");
    // A machine may be so busy that the conversion is through before it is stopped.
    for _ in 0..50 {
        let means = context(folder, 2, OUT_OF_CORE);
        let wanted = request(&[input.to_path_buf()], &output, options);
        let result = std::thread::scope(|scope| {
            let conversion = scope.spawn(|| run::convert(&wanted, &means));
            while units_done(&means.scratch) < stop_at && !conversion.is_finished() {
                std::thread::sleep(Duration::from_micros(200));
            }
            means.cancel.cancel();
            conversion.join().unwrap()
        });
        match result {
            Ok(_) => fs::remove_dir_all(&output).unwrap(),
            Err(error) => {
                assert!(error.is_cancelled(), "{error}");
                assert!(units_done(&means.scratch) >= stop_at);
                return;
            }
        }
    }
    panic!("it was never stopped in time");
}

fn go_on(folder: &Path, input: &Path, options: &Options) -> ConversionOutcome {
    let request = request(&[input.to_path_buf()], &folder.join("octree"), options);
    run::convert(&request, &context(folder, 1, OUT_OF_CORE)).unwrap()
}

#[test]
fn stopped_and_asked_again_with_other_threads_it_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let (input, options) =
        (cloud(folder.path(), true), Options { name: Some("surface".into()), ..Options::default() });
    let expected = uninterrupted(folder.path(), &input, &options);
    stopped(folder.path(), &input, &options, 20);
    let outcome = go_on(folder.path(), &input, &options);
    assert!(outcome.units_resumed >= 20, "{outcome:?}");
    assert!(outcome.notes.iter().any(|note| note.contains("went on")), "{:?}", outcome.notes);
    assert!(octree_bytes(&folder.path().join("octree")) == expected);
    assert_eq!(listing(folder.path()), ["octree", "surface.laz", "whole"]);
}

/// untwine#179: stale intermediate files poison the next run.
#[test]
fn remains_of_other_options_or_another_input_are_never_used() {
    let folder = tempfile::tempdir().unwrap();
    let input = cloud(folder.path(), true);
    let (poisson, random) =
        (named(Encoding::Default, Sampling::Poisson), named(Encoding::Default, Sampling::Random));
    let averaged = Options { lod_color: LodColor::Average, ..poisson.clone() };
    for other in [&random, &averaged] {
        stopped(folder.path(), &input, &poisson, 20);
        let outcome = go_on(folder.path(), &input, other);
        assert_eq!(outcome.units_resumed, 0);
        assert!(octree_bytes(&folder.path().join("octree")) == uninterrupted(folder.path(), &input, other));
        for name in ["octree", "whole"] {
            fs::remove_dir_all(folder.path().join(name)).unwrap();
        }
    }

    stopped(folder.path(), &input, &poisson, 20);
    write_las(&input, &options_of(3, true), &surface(3, 450_000, 2));
    let outcome = go_on(folder.path(), &input, &poisson);
    assert_eq!(outcome.units_resumed, 0);
    assert!(octree_bytes(&folder.path().join("octree")) == uninterrupted(folder.path(), &input, &poisson));
}

#[test]
fn remains_that_were_cut_emptied_or_removed_cost_work_but_no_point() {
    let folder = tempfile::tempdir().unwrap();
    let (input, options) = (cloud(folder.path(), true), named(Encoding::Default, Sampling::Poisson));
    let expected = uninterrupted(folder.path(), &input, &options);
    // Deep in the index: there are slices in it, chunks and an octree.
    let all = 9 + 1 + 9;
    for damage in ["journal", "runs.bin", "risen.bin", "octree.bin"] {
        for cut in [0, 2, 3] {
            stopped(folder.path(), &input, &options, all + 2);
            let file = match damage {
                "octree.bin" => folder.path().join(".octree.building/octree.bin"),
                name => folder.path().join("scratch").join(name),
            };
            match cut {
                0 => fs::remove_file(&file).unwrap(),
                part => {
                    let length = fs::metadata(&file).unwrap().len();
                    fs::File::options()
                        .write(true)
                        .open(&file)
                        .unwrap()
                        .set_len(length * (part - 1) / 3)
                        .unwrap();
                }
            }
            go_on(folder.path(), &input, &options);
            assert!(octree_bytes(&folder.path().join("octree")) == expected, "{damage} {cut}");
            fs::remove_dir_all(folder.path().join("octree")).unwrap();
        }
    }
}

/// Other content of the same length, with the same time: nothing tells but the
/// points, which are not where they were counted.
#[test]
fn a_source_that_changed_unnoticed_in_between_is_converted_anew() {
    let folder = tempfile::tempdir().unwrap();
    let (input, options) = (cloud(folder.path(), false), named(Encoding::Default, Sampling::Poisson));
    // Surveyed (LAS is not copied in that), and some of it distributed.
    stopped(folder.path(), &input, &options, 1 + 2);
    let time = fs::metadata(&input).unwrap().modified().unwrap();
    let mut bytes = fs::read(&input).unwrap();
    let file = LasFile::open(&input).unwrap();
    let (length, records) = (file.header().record_length, file.header().points as usize);
    let start = bytes.len() - records * length;
    let half = records / 2 * length;
    bytes[start + half..].copy_from_slice(&surface(3, records as u64, 2)[half..]);
    fs::write(&input, bytes).unwrap();
    fs::File::options().write(true).open(&input).unwrap().set_modified(time).unwrap();
    let outcome = go_on(folder.path(), &input, &options);
    assert_eq!(outcome.units_resumed, 0);
    assert!(octree_bytes(&folder.path().join("octree")) == uninterrupted(folder.path(), &input, &options));
}

#[test]
fn a_disk_that_fails_at_any_operation_costs_only_the_unit_in_hand() {
    let folder = tempfile::tempdir().unwrap();
    let (input, options) = (cloud(folder.path(), true), named(Encoding::Default, Sampling::Poisson));
    let expected = uninterrupted(folder.path(), &input, &options);
    let request = request(&[input], &folder.path().join("octree"), &options);
    let mut failures = 0;
    // Every operation at first, then every few: the later ones are all alike.
    let mut nth = 0;
    loop {
        let mut means = context(folder.path(), 2, OUT_OF_CORE);
        let kind = [io::ErrorKind::StorageFull, io::ErrorKind::Other][nth as usize % 2];
        means.disk = Disk::failing_from(nth, kind);
        match run::convert(&request, &means) {
            Ok(_) => break,
            Err(error) => assert!(error.retry_can_help(), "{error}"),
        }
        failures += 1;
        if failures % 5 == 0 {
            // The disk is well again.
            run::convert(&request, &context(folder.path(), 2, OUT_OF_CORE)).unwrap();
            assert!(octree_bytes(&folder.path().join("octree")) == expected, "after fault {nth}");
            fs::remove_dir_all(folder.path().join("octree")).unwrap();
        }
        nth += if nth < 20 { 1 } else { 7 };
    }
    assert!(failures > 20, "{failures} operations could fail");
    assert!(octree_bytes(&folder.path().join("octree")) == expected);
}

#[test]
fn two_conversions_never_make_the_same_octree_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let (input, options) = (cloud(folder.path(), false), named(Encoding::Default, Sampling::Poisson));
    let staging = folder.path().join(".octree.building");
    let lock = Disk::new().lock_dir(&staging).unwrap().expect("free");
    let request = request(&[input], &folder.path().join("octree"), &options);
    let error = run::convert(&request, &context(folder.path(), 2, 1 << 30)).unwrap_err();
    assert!(error.to_string().contains("another conversion is at work"), "{error}");
    assert!(error.retry_can_help() && staging.exists());
    drop(lock);
    run::convert(&request, &context(folder.path(), 2, 1 << 30)).unwrap();
}
