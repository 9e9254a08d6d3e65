//! What guards keep out of the octree lies beside it, with all it has, and the
//! two together are the input.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{context, octree_bytes, options_of, request, surface, write_las};
use lodestone::convert::context::{Context, Snapshot, Stage};
use lodestone::convert::options::{GuardMode, Options};
use lodestone::convert::run::{self, ConversionOutcome};
use lodestone::convert::values::record_range::SetAsideReason;
use lodestone::format::las::{LasFile, LasOptions, Vlr, record_length};
use lodestone::format::potree::Metadata;
use lodestone::octree::node::LEAF_LIMIT;
use lodestone::platform::disk::Disk;
use lodestone::verify;
use serde_json::json;

const IN_CORE: u64 = 2 << 30;
const OUT_OF_CORE: u64 = 45 << 20;

fn convert(input: &Path, output: &Path, options: &Options, memory: u64) -> ConversionOutcome {
    let _ = fs::remove_dir_all(output);
    let inputs = [input.to_path_buf()];
    let folder = output.parent().unwrap();
    run::convert(&request(&inputs, output, options), &context(folder, 2, memory)).unwrap()
}

/// Holds octree and set-aside files against the input.
fn verified(output: &Path, input: &Path, set_aside: u64) {
    let report = verify::verify(&verify::VerifyRequest {
        damaged: false,
        octree: output.to_path_buf(),
        against: vec![input.to_path_buf()],
        memory_limit: 1 << 30,
        spacing: verify::SpacingRule::Auto,
    })
    .unwrap();
    assert!(report.ok, "{report}");
    let against = report.against.unwrap();
    assert_eq!((against.missing, against.extra, against.set_aside), (0, 0, set_aside));
}

fn report(octree: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(octree.join("report.json")).unwrap()).unwrap()
}

/// What was dropped is told by the report and by `verify`, which ends with 3; and
/// where more is missing than that, the octree is wrong.
fn told_as_dropped(octree: &Path, input: &Path, guard: &str, points: u64) {
    assert!(!octree.join("set-aside.laz").exists());
    let mut report = report(octree);
    let guards = report["guards"].as_array().unwrap();
    let told = guards.iter().find(|told| told["name"] == guard).unwrap();
    assert_eq!((&told["mode"], &told["points"]), (&json!("drop"), &json!(points)));
    let verify = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestone"));
        let run = command.arg("verify").arg(octree).arg("--against").arg(input).output().unwrap();
        (run.status.code(), String::from_utf8_lossy(&run.stdout).replace(' ', ""))
    };
    let (code, text) = verify();
    assert!(code == Some(3) && text.contains(&format!("{points}missing({points}weredropped")), "{text}");
    assert!(text.contains(&format!("Nothingiswrong,but{points}points")), "{text}");
    report["points_dropped"] = json!(points - 1);
    fs::write(octree.join("report.json"), report.to_string()).unwrap();
    let (code, text) = verify();
    assert!(code == Some(1) && text.contains("WRONG"), "{text}");
}

/// Moves the last `count` of some records to what `place` says.
fn moved(mut records: Vec<u8>, length: usize, count: usize, place: impl Fn(usize) -> [i32; 3]) -> Vec<u8> {
    let first = records.len() / length - count;
    for i in 0..count {
        let record = &mut records[(first + i) * length..];
        for (axis, c) in place(i).into_iter().enumerate() {
            record[4 * axis..4 * axis + 4].copy_from_slice(&c.to_le_bytes());
        }
    }
    records
}

fn reasons(file: &Path) -> Vec<u8> {
    let file = LasFile::open(file).unwrap();
    let mut all = Vec::new();
    for slice in file.slices(1 << 20) {
        let mut records = Vec::new();
        file.read(slice, &mut records).unwrap();
        let length = file.header().record_length;
        all.extend(records.chunks_exact(length).map(|record| record[length - 1]));
    }
    all
}

fn depth(output: &Path) -> u32 {
    Metadata::read(output).unwrap().hierarchy.depth
}

/// MEASURES.md: six outliers make PotreeConverter coarsen the scale of all.
#[test]
fn six_outliers_cost_no_level_no_scale_and_no_point() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let length = record_length(3).unwrap();
    let records = surface(3, 300_000, 1);
    write_las(&at("without.las"), &options_of(3, false), &records);
    let far = |i: usize| [i as i32 * 300_000_000 - 900_000_000, 2_000_000_000 - i as i32, -1_000_000_000];
    write_las(&at("with.laz"), &options_of(3, true), &moved(records, length, 6, far));
    convert(&at("without.las"), &at("expected"), &Options::default(), IN_CORE);
    let mut first = None;
    for memory in [IN_CORE, OUT_OF_CORE] {
        let outcome = convert(&at("with.laz"), &at("octree"), &Options::default(), memory);
        assert_eq!(outcome.set_aside.get(&SetAsideReason::Outlier), Some(&6), "{outcome:?}");
        assert!(outcome.notes.iter().any(|note| note.contains("6 of 300000 points")), "{:?}", outcome.notes);
        assert_eq!(depth(&at("octree")), depth(&at("expected")));
        assert_eq!(reasons(&at("octree/set-aside.laz")), [1; 6]);
        verified(&at("octree"), &at("with.laz"), 6);
        let bytes = (octree_bytes(&at("octree")), fs::read(at("octree/set-aside.laz")).unwrap());
        assert!(first.get_or_insert_with(|| bytes.clone()) == &bytes);
    }
    let keep = Options { outliers: GuardMode::Keep, ..Options::default() };
    let outcome = convert(&at("with.laz"), &at("octree"), &keep, IN_CORE);
    assert_eq!((outcome.points_set_aside, outcome.points_out), (0, 300_000));
    assert!(depth(&at("octree")) > depth(&at("expected")) + 8, "the levels that the guard saves");
    verified(&at("octree"), &at("with.laz"), 0);
    let drop = Options { outliers: GuardMode::Drop, ..Options::default() };
    let outcome = convert(&at("with.laz"), &at("octree"), &drop, IN_CORE);
    assert_eq!((outcome.points_set_aside, outcome.points_dropped), (6, 6));
    assert_eq!((outcome.points_out, outcome.files_aside), (299_994, vec![]));
    assert_eq!(depth(&at("octree")), depth(&at("expected")));
    told_as_dropped(&at("octree"), &at("with.laz"), "outlier", 6);
}

/// PC#437, PC#438, PC#442: duplicate points never end, or are lost.
#[test]
fn of_a_crowd_at_one_position_a_leafs_worth_stays_and_no_chain_of_levels() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let length = record_length(1).unwrap();
    write_las(&at("plain.las"), &options_of(1, false), &surface(1, 300_000, 1));
    convert(&at("plain.las"), &at("plain"), &Options::default(), IN_CORE);
    // Just at the limit, just above it, more than a chunk.
    for crowd in [LEAF_LIMIT, LEAF_LIMIT + 1, 3 * LEAF_LIMIT, 250_000] {
        let input = at("crowd.las");
        let records = moved(surface(1, 300_000 + crowd as u64, 1), length, crowd, |_| [15_000, 15_000, 700]);
        write_las(&input, &options_of(1, false), &records);
        let mut first = None;
        for memory in [IN_CORE, OUT_OF_CORE] {
            let outcome = convert(&input, &at("octree"), &Options::default(), memory);
            let aside = outcome.points_set_aside as usize;
            // One of the surface's points may lie there, too.
            assert!((crowd - LEAF_LIMIT..=crowd - LEAF_LIMIT + 1).contains(&aside), "{crowd}: {aside}");
            assert_eq!(
                outcome.set_aside.keys().copied().find(|reason| *reason != SetAsideReason::Duplicate),
                None
            );
            verified(&at("octree"), &input, aside as u64);
            if aside > 0 {
                assert!(depth(&at("octree")) <= depth(&at("plain")) + 1, "{crowd}: {}", depth(&at("octree")));
                assert_eq!(reasons(&at("octree/set-aside.laz")), vec![2; aside]);
            }
            let bytes = octree_bytes(&at("octree"));
            assert!(first.get_or_insert_with(|| bytes.clone()) == &bytes);
        }
    }
    let input = at("crowd.las");
    let keep = Options { duplicates: GuardMode::Keep, ..Options::default() };
    let outcome = convert(&input, &at("octree"), &keep, IN_CORE);
    assert_eq!(outcome.points_set_aside, 0);
    verified(&at("octree"), &input, 0);
    let drop = Options { duplicates: GuardMode::Drop, ..Options::default() };
    let outcome = convert(&input, &at("octree"), &drop, IN_CORE);
    assert_eq!(outcome.points_in, outcome.points_out + outcome.points_set_aside);
    assert!(outcome.points_set_aside > 0 && !at("octree/set-aside.laz").exists());
    told_as_dropped(&at("octree"), &input, "duplicate", outcome.points_set_aside);
}

#[test]
fn exact_twins_are_set_aside_on_request_and_near_twins_never() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let length = record_length(1).unwrap();
    let once = surface(1, 60_000, 3);
    let mut records = once.clone();
    // Every tenth once more, and every tenth but with another intensity.
    for (i, record) in once.chunks_exact(length).enumerate().filter(|(i, _)| i % 10 < 2) {
        records.extend_from_slice(record);
        if i % 10 == 1 {
            let end = records.len() - length + 12;
            records[end] ^= 1;
        }
    }
    write_las(&at("twins.laz"), &options_of(1, true), &records);
    let options = Options { twins: GuardMode::SetAside, ..Options::default() };
    for memory in [IN_CORE, OUT_OF_CORE] {
        let outcome = convert(&at("twins.laz"), &at("octree"), &options, memory);
        assert_eq!(outcome.set_aside.get(&SetAsideReason::Twin), Some(&6_000), "{outcome:?}");
        assert_eq!(reasons(&at("octree/set-aside.laz")), vec![3; 6_000]);
        verified(&at("octree"), &at("twins.laz"), 6_000);
    }
    let outcome = convert(&at("twins.laz"), &at("octree"), &Options::default(), IN_CORE);
    assert_eq!(outcome.points_set_aside, 0);
    let drop = Options { twins: GuardMode::Drop, ..Options::default() };
    let outcome = convert(&at("twins.laz"), &at("octree"), &drop, IN_CORE);
    assert_eq!((outcome.points_set_aside, outcome.points_dropped), (6_000, 6_000));
    assert_eq!((outcome.points_out, outcome.files_aside), (66_000, vec![]));
    told_as_dropped(&at("octree"), &at("twins.laz"), "twin", 6_000);
}

#[test]
fn of_a_crowd_twins_go_first_and_of_the_others_a_leafs_worth_stays() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let length = record_length(1).unwrap();
    let options = Options { twins: GuardMode::SetAside, ..Options::default() };
    // Less than a chunk may hold, and more. Five that come again and again stand
    // before those that differ, by their times.
    for (copies, others) in [(20_000, 15_000), (230_000, 40_000), (250_000, 500)] {
        let mut records = surface(1, 100_000, 1);
        for i in 0..copies + others {
            let mut record = [0; 28];
            for (axis, c) in [15_000, 15_000, 70_000i32].into_iter().enumerate() {
                record[4 * axis..4 * axis + 4].copy_from_slice(&c.to_le_bytes());
            }
            let time = if i < copies { i % 5 } else { i };
            record[20..].copy_from_slice(&f64::from(time).to_le_bytes());
            assert_eq!(record.len(), length);
            records.extend_from_slice(&record);
        }
        write_las(&at("crowd.las"), &options_of(1, false), &records);
        let twins = copies as u64 - 5;
        let duplicates = (others as u64 + 5).saturating_sub(LEAF_LIMIT as u64);
        let mut first = None;
        for memory in [IN_CORE, OUT_OF_CORE] {
            let outcome = convert(&at("crowd.las"), &at("octree"), &options, memory);
            let aside = |reason| outcome.set_aside.get(&reason).copied().unwrap_or(0);
            assert_eq!((aside(SetAsideReason::Twin), aside(SetAsideReason::Duplicate)), (twins, duplicates));
            let reasons = reasons(&at("octree/set-aside.laz"));
            assert_eq!(reasons.iter().filter(|reason| **reason == 3).count() as u64, twins);
            verified(&at("octree"), &at("crowd.las"), twins + duplicates);
            assert!(depth(&at("octree")) < 12, "no chain of levels: {}", depth(&at("octree")));
            let bytes = (octree_bytes(&at("octree")), fs::read(at("octree/set-aside.laz")).unwrap());
            assert!(first.get_or_insert_with(|| bytes.clone()) == &bytes);
        }
    }
}

#[test]
fn a_report_lies_beside_every_octree_and_tells_no_path() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("hill.las");
    write_las(&input, &options_of(2, false), &surface(2, 3_000, 5));
    let output = folder.path().join("octree");
    let options = Options { attributes: vec!["auto".into()], ..Options::default() };
    let outcome = convert(&input, &output, &options, IN_CORE);
    let text = fs::read_to_string(output.join("report.json")).unwrap();
    assert!(!text.contains(folder.path().to_str().unwrap()), "{text}");
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["inputs"][0]["name"], "hill.las");
    assert_eq!(report["inputs"][0]["points"], 3_000);
    assert_eq!(report["inputs"][0]["version"], "1.3");
    assert_eq!(report["inputs"][0]["bytes"], fs::metadata(&input).unwrap().len());
    assert!(report["inputs"][0].get("blake3").is_none(), "nobody has read it for that");
    assert_eq!(report["lodestone"], env!("CARGO_PKG_VERSION"));
    assert_eq!(report["lattice"]["scale"], json!([0.01, 0.01, 0.01]));
    assert_eq!((&report["exact"], &report["max_error"]), (&json!(true), &json!([0.0, 0.0, 0.0])));
    assert_eq!((&report["nodes"], &report["depth"]), (&json!(outcome.nodes), &json!(depth(&output))));
    assert_eq!((&report["repairs"], &report["notes"]), (&json!([]), &json!([])));
    assert_eq!((&report["points_in"], &report["points_set_aside"]), (&json!(3_000), &json!(0)));
    // Of every guard, though none found anything.
    let guards = report["guards"].as_array().unwrap();
    let told =
        guards.iter().map(|g| (g["name"].as_str().unwrap(), g["mode"].as_str().unwrap(), &g["points"]));
    let zero = json!(0);
    let expected =
        [("outlier", "set-aside", &zero), ("duplicate", "set-aside", &zero), ("twin", "keep", &zero)];
    assert_eq!(told.collect::<Vec<_>>(), expected);
    assert!(guards[0]["threshold"].as_str().unwrap().contains("at most 16 points"), "{guards:?}");
    assert!(guards[1]["threshold"].as_str().unwrap().contains("10000 points"), "{guards:?}");
    assert_eq!(report["points_out"], outcome.points_out);
    assert_eq!(report["options"]["outliers"], "set-aside");
    for stage in ["survey", "distribute", "index", "merge", "publish"] {
        assert!(report["seconds_by_stage"][stage].is_number(), "{stage}");
        assert!(report["peak_bytes_by_stage"][stage].is_number(), "{stage}");
    }
    verified(&output, &input, 0);
}

/// "No attribute that is empty everywhere is stored unless asked for."
#[test]
fn attributes_that_are_zero_throughout_are_left_out_where_that_is_left_to_the_records() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("bare.las");
    let length = record_length(3).unwrap();
    let mut records = surface(3, 3_000, 5);
    records.chunks_exact_mut(length).for_each(|record| record[12..].fill(0));
    records.chunks_exact_mut(length).for_each(|record| record[12] = 7);
    write_las(&input, &options_of(3, false), &records);
    let output = folder.path().join("octree");
    let names = |attributes: &[&str]| {
        let attributes = attributes.iter().map(|name| name.to_string()).collect();
        convert(&input, &output, &Options { attributes, ..Options::default() }, IN_CORE);
        verified(&output, &input, 0);
        let metadata = Metadata::read(&output).unwrap();
        metadata.attributes.into_iter().map(|attribute| attribute.name).collect::<Vec<_>>()
    };
    assert_eq!(names(&["auto"]), ["position", "intensity"]);
    assert!(names(&[]).contains(&"rgb".to_string()));
}

#[test]
fn files_of_different_layouts_have_what_is_set_aside_in_files_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    for (format, compressed) in [(1, true), (6, true), (4, false)] {
        let length = record_length(format).unwrap();
        let records = moved(surface(format, 30_000, 7), length, 15_000, |_| [9_000, 9_000, 900]);
        write_las(&tiles.join(format!("{format}.las")), &options_of(format, compressed), &records);
    }
    let output = folder.path().join("octree");
    let outcome = convert(&tiles, &output, &Options::default(), IN_CORE);
    assert_eq!(outcome.files_aside.len(), 3, "{outcome:?}");
    assert!(outcome.points_set_aside >= 35_000);
    verified(&output, &tiles, outcome.points_set_aside);
    // What was set aside is a cloud like any other, and can be converted.
    let again = folder.path().join("again");
    let input: PathBuf = output.join(&outcome.files_aside[0]);
    let aside =
        convert(&input, &again, &Options { duplicates: GuardMode::Keep, ..Options::default() }, IN_CORE);
    assert!(aside.points_out > 0);
    verified(&again, &input, 0);
}

/// Else a long write would be taken for a job that stands still. Where the disk
/// fails under it, what it had told by then can be seen.
#[test]
fn writing_what_is_set_aside_is_progress() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("crowd.las"), folder.path().join("octree"));
    let (length, aside) = (record_length(0).unwrap(), 140_000);
    let records = moved(surface(0, 180_000, 7), length, aside + LEAF_LIMIT, |_| [9_000, 9_000, 900]);
    write_las(&input, &options_of(0, false), &records);
    let inputs = [input];
    for operation in 0.. {
        let _ = fs::remove_dir_all(&output);
        let disk = Disk::failing_from(operation, ErrorKind::StorageFull);
        let means = Context { disk, ..context(folder.path(), 1, IN_CORE) };
        let result = run::convert(&request(&inputs, &output, &Options::default()), &means);
        let Snapshot { stage, done, total } = means.progress.snapshot();
        if stage == Stage::Index && total == aside as u64 && 0 < done && done < total {
            return;
        }
        assert!(result.is_err(), "of {operation} operations none was under way there");
    }
}

#[test]
fn the_command_says_what_was_set_aside_and_ends_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("crowd.las");
    let records = moved(surface(0, 30_000, 7), record_length(0).unwrap(), 25_000, |_| [9_000, 9_000, 900]);
    write_las(&input, &options_of(0, false), &records);
    let run = |more: &[&str]| {
        let run = Command::new(env!("CARGO_BIN_EXE_lodestone"))
            .args(["convert", "--overwrite", "--progress", "plain"])
            .args(more)
            .arg(&input)
            .arg("-o")
            .arg(folder.path().join("octree"))
            .output()
            .unwrap();
        (run.status.code(), String::from_utf8_lossy(&run.stdout).into_owned())
    };
    let (code, text) = run(&[]);
    assert_eq!(code, Some(3));
    assert!(text.contains("15000 points set aside as duplicates, in set-aside.laz"), "{text}");
    let (code, text) = run(&["--duplicates", "drop"]);
    assert_eq!(code, Some(3));
    assert!(text.contains("15000 points dropped as duplicates, as asked"), "{text}");
    assert_eq!(run(&["--duplicates", "keep"]).0, Some(0));
}

#[test]
fn what_is_set_aside_keeps_its_reference_system_however_it_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let record = |id: u16, data: &[u8]| Vlr { user: "LASF_Projection".into(), id, data: data.to_vec() };
    // UTM zone 32 with a citation, as GeoTIFF keys; and WKT.
    let words: [u16; 12] = [1, 1, 0, 2, 3072, 0, 1, 25832, 1026, 34737, 5, 0];
    let keys: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let geo_keys = vec![record(34735, &keys), record(34736, &[0; 8]), record(34737, b"UTM32|\0")];
    let wkt = vec![Vlr::wkt("PROJCS[\"somewhere\"]"), record(2111, b"a transform\0")];
    for crs in [geo_keys, wkt] {
        let options = LasOptions { crs: crs.clone(), ..options_of(3, false) };
        let far = |_: usize| [2_000_000_000, 2_000_000_000, 0];
        let records = moved(surface(3, 50_000, 1), record_length(3).unwrap(), 1, far);
        write_las(&at("in.las"), &options, &records);
        let outcome = convert(&at("in.las"), &at("octree"), &Options::default(), IN_CORE);
        assert_eq!(outcome.points_set_aside, 1);
        let (input, aside) =
            (LasFile::open(&at("in.las")).unwrap(), LasFile::open(&at("octree/set-aside.laz")).unwrap());
        assert!(input.header().crs.is_some());
        assert_eq!(aside.header().crs, input.header().crs);
        assert_eq!(aside.header().crs_records, crs);
    }
}
