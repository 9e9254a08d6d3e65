//! One pass makes the octree, the COPC file or both; each is what it would be alone.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::support::{Node, copc_bytes, copc_in, nodes, octree_records};
use crate::common::{
    all_records, context, convert, data, listing, octree_bytes, options_of, request, surface, write_las,
};
use lodestone::convert::formats::Formats;
use lodestone::convert::options::{Encoding, GuardMode, LodColor, Options};
use lodestone::convert::run;
use lodestone::format::las::{GpsEpoch, LasFile, LasWriter};
use lodestone::octree::acquisition::total_order;
use lodestone::octree::collapse::{MAX_LEVELS, MAX_POINTS};
use lodestone::octree::node::NodeKey;

fn options(format: Formats) -> Options {
    Options { format, name: Some("cloud".into()), ..Options::default() }
}

fn cloud(folder: &Path, point_format: u8, points: u64) -> PathBuf {
    let input = folder.join("cloud.las");
    write_las(&input, &options_of(point_format, false), &surface(point_format, points, 7));
    input
}

fn sorted(records: &[u8], size: usize) -> Vec<&[u8]> {
    let mut records: Vec<&[u8]> = records.chunks_exact(size).collect();
    records.sort_unstable();
    records
}

fn name(key: NodeKey) -> String {
    key.to_string()
}

/// Every node of the file has the very points of the octree's node, or of all nodes of
/// a subtree that is within the bounds of a leaf.
fn agrees_with_the_octree(folder: &Path) -> Vec<Node> {
    let file = copc_bytes(folder);
    let (metadata, octree) = all_records(folder);
    let schema = metadata.schema().unwrap();
    let size = schema.record_size();
    let by_name: HashMap<String, &Vec<u8>> =
        octree.iter().map(|(node, r)| (node.name.to_string(), r)).collect();
    let nodes = nodes(&file);
    let mut points = 0;
    for node in &nodes {
        let own = name(node.key);
        let has_below = nodes.iter().any(|other| other.key != node.key && name(other.key).starts_with(&own));
        let subtree: Vec<&String> = by_name.keys().filter(|name| name.starts_with(&own)).collect();
        let expected: Vec<u8> = match has_below {
            true => by_name[&own].clone(),
            false => subtree.iter().flat_map(|name| by_name[*name].iter().copied()).collect(),
        };
        let records = if node.points == 0 { Vec::new() } else { octree_records(&file, node, &metadata) };
        assert!(sorted(&records, size) == sorted(&expected, size), "{own} has other points");
        if !has_below && subtree.len() > 1 {
            let deepest = subtree.iter().map(|name| name.len()).max().unwrap_or(0);
            assert!(node.points <= MAX_POINTS, "{own} holds {}", node.points);
            assert!(deepest - own.len() < usize::from(MAX_LEVELS), "{own} is too deep");
        }
        if let Some(at) = schema.offset_of("gps-time") {
            let times = records
                .chunks_exact(size)
                .map(|r| total_order(f64::from_le_bytes(r[at..at + 8].try_into().unwrap())));
            assert!(times.is_sorted(), "{own} is not in the order of its times");
        }
        points += node.points as u64;
    }
    assert_eq!(points, metadata.points);
    nodes
}

#[test]
fn one_pass_makes_both_as_each_alone() {
    let variants: [fn(&mut Options); 3] = [
        |_| {},
        |options| options.encoding = Encoding::Brotli,
        |options| options.lod_color = LodColor::Average,
    ];
    // The first has several chunks.
    for (change, points) in variants.into_iter().zip([230_000, 30_000, 30_000]) {
        let folder = tempfile::tempdir().unwrap();
        let input = cloud(folder.path(), 3, points);
        let [octree, copc, both] = ["octree", "copc", "both"].map(|name| folder.path().join(name));
        for (output, format) in [(&octree, Formats::POTREE), (&copc, Formats::COPC), (&both, Formats::BOTH)] {
            let mut options = options(format);
            change(&mut options);
            let outcome = convert(std::slice::from_ref(&input), output, &options).unwrap();
            assert_eq!(outcome.points_out, points);
            assert_eq!(outcome.copc.is_some(), format.copc);
        }
        assert!(octree_bytes(&octree) == octree_bytes(&both));
        assert!(copc_bytes(&copc) == copc_bytes(&both));
        assert_eq!(listing(&copc), ["cloud.copc.laz", "report.json"]);
        assert_eq!(
            listing(&both),
            ["cloud.copc.laz", "hierarchy.bin", "metadata.json", "octree.bin", "report.json"]
        );
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(both.join("report.json")).unwrap()).unwrap();
        assert_eq!(report["copc"]["file"], "cloud.copc.laz");
        assert_eq!(report["copc"]["bytes"], fs::metadata(copc_in(&both)).unwrap().len());
        assert_eq!(report["options"]["format"], "potree,copc");
    }
}

#[test]
fn bytes_depend_on_neither_threads_nor_memory() {
    let folder = tempfile::tempdir().unwrap();
    let input = cloud(folder.path(), 7, 230_000);
    let mut expected = None;
    for (threads, memory) in [(1, 4 << 30), (2, 4 << 30), (4, 4 << 30), (1, 100 << 20), (4, 330 << 20)] {
        let output = folder.path().join("out");
        let request = request(std::slice::from_ref(&input), &output, &options(Formats::COPC));
        let outcome = run::convert(&request, &context(folder.path(), threads, memory)).unwrap();
        assert_eq!(outcome.scratch_bytes > 0, memory < 1 << 30, "in core or not");
        let bytes = copc_bytes(&output);
        assert!(expected.get_or_insert_with(|| bytes.clone()) == &bytes, "{threads} {memory}");
        fs::remove_dir_all(output).unwrap();
    }
}

#[test]
fn every_format_keeps_every_bit() {
    for point_format in 0..=10 {
        let folder = tempfile::tempdir().unwrap();
        let input = cloud(folder.path(), point_format, 12_000);
        let output = folder.path().join("out");
        let outcome = convert(&[input], &output, &options(Formats::BOTH)).unwrap();
        let expected = if matches!(point_format, 8 | 10) {
            8
        } else {
            6 + u8::from(matches!(point_format, 2 | 3 | 5 | 7))
        };
        assert_eq!(outcome.copc.unwrap().point_format, expected, "format {point_format}");
        agrees_with_the_octree(&output);
        // As a plain LAZ it has the same number of points, and no word that is not so.
        let file = LasFile::open(&copc_in(&output)).unwrap();
        assert_eq!((file.header().points, file.header().notes.as_slice()), (12_000, [].as_slice()));
    }
}

#[test]
fn coarse_nodes_are_the_octree_s_and_small_subtrees_are_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let input = cloud(folder.path(), 6, 230_000);
    let output = folder.path().join("out");
    convert(&[input], &output, &options(Formats::BOTH)).unwrap();
    let nodes = agrees_with_the_octree(&output);
    let octree = all_records(&output).1.len();
    assert!(nodes.len() * 2 < octree, "{} nodes of {octree}", nodes.len());
}

#[test]
fn a_small_cloud_is_one_leaf() {
    let folder = tempfile::tempdir().unwrap();
    let input = cloud(folder.path(), 1, 60_000);
    let output = folder.path().join("out");
    convert(&[input], &output, &options(Formats::BOTH)).unwrap();
    assert_eq!(agrees_with_the_octree(&output).len(), 1);
}

#[test]
fn a_crowd_that_is_kept_is_one_node() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("crowd.las");
    let mut records = surface(1, 120_000, 3);
    for record in records.chunks_exact_mut(28).take(110_000) {
        record[..12].copy_from_slice(&[1, 2, 0, 0, 3, 4, 0, 0, 5, 6, 0, 0]);
    }
    write_las(&input, &options_of(1, false), &records);
    for duplicates in [GuardMode::Keep, GuardMode::SetAside] {
        let output = folder.path().join("out");
        let wanted = Options { duplicates, ..options(Formats::BOTH) };
        let outcome = convert(std::slice::from_ref(&input), &output, &wanted).unwrap();
        let most = agrees_with_the_octree(&output).iter().map(|node| node.points).max().unwrap();
        assert_eq!(most > MAX_POINTS, duplicates == GuardMode::Keep, "{most}");
        assert_eq!(outcome.points_out + outcome.points_set_aside, 120_000);
        fs::remove_dir_all(output).unwrap();
    }
}

fn timed(path: &Path, gps_time: GpsEpoch) {
    let mut options = options_of(6, false);
    if matches!(gps_time, GpsEpoch::Standard { offset } if offset != 1000) {
        options.version = (1, 5);
    }
    let mut writer = LasWriter::create(path, &options).unwrap();
    writer.set_gps_time(gps_time);
    let mut records = surface(6, 1000, 5);
    for (record, i) in records.chunks_exact_mut(30).zip(0..) {
        record[22..30].copy_from_slice(&f64::from(i).to_le_bytes());
    }
    writer.write(&records).unwrap();
    writer.finish().unwrap();
}

#[test]
fn times_that_one_file_cannot_hold_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["week.las", "standard.las", "later.las"].map(|name| folder.path().join(name));
    let times = [GpsEpoch::Week, GpsEpoch::ADJUSTED, GpsEpoch::Standard { offset: 1400 }];
    paths.iter().zip(times).for_each(|(path, time)| timed(path, time));
    let [week, standard, later] = paths;
    let output = folder.path().join("out");
    let tried = |inputs: &[PathBuf], format| convert(inputs, &output, &options(format));
    for format in [Formats::COPC, Formats::BOTH] {
        let error = tried(&[week.clone(), standard.clone()], format).unwrap_err();
        assert!(error.to_string().contains("seconds of the week"), "{error}");
        assert!(!error.retry_can_help() && !output.exists());
    }
    let error = tried(std::slice::from_ref(&later), Formats::BOTH).unwrap_err().to_string();
    assert!(error.contains("each format by itself"), "{error}");
    assert!(tried(&[week, standard.clone()], Formats::POTREE).is_ok());
    fs::remove_dir_all(&output).unwrap();
    // Alone, its times are moved to where COPC has them.
    tried(&[later, standard], Formats::COPC).unwrap();
    let file = LasFile::open(&copc_in(&output)).unwrap();
    assert_eq!(file.header().gps_time, GpsEpoch::ADJUSTED);
    let bytes = fs::read(copc_in(&output)).unwrap();
    let time = |at: usize| f64::from_le_bytes(bytes[429 + at..429 + at + 8].try_into().unwrap());
    assert_eq!((time(56), time(64)), (0.0, 400_000_999.0));
}

#[test]
fn what_is_odd_about_the_input_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let input = cloud(folder.path(), 0, 5_000);
    let output = folder.path().join("out");
    let outcome = convert(std::slice::from_ref(&input), &output, &options(Formats::COPC)).unwrap();
    let has = |word: &str| outcome.notes.iter().any(|note| note.contains(word));
    assert!(has("--crs") && has("no GPS times") && has("return number 0"), "{:?}", outcome.notes);
    fs::remove_dir_all(&output).unwrap();
    let crs = Some(lodestone::format::crs::named("EPSG:25832").unwrap());
    convert(&[input], &output, &Options { crs, ..options(Formats::COPC) }).unwrap();
    let file = LasFile::open(&copc_in(&output)).unwrap();
    assert!(file.header().crs.as_ref().unwrap().text.contains("25832"));
}

#[test]
fn real_clouds_keep_every_bit() {
    let Some(data) = data() else { return };
    let mut tried = 0;
    let folders = fs::read_dir(data).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir());
    let files = folders.flat_map(|folder| fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path());
    for path in files {
        let small = fs::metadata(&path).is_ok_and(|meta| meta.is_file() && meta.len() < 4 << 20);
        if !small || !LasFile::open(&path).is_ok_and(|file| file.header().points > 0) {
            continue;
        }
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out");
        match convert(std::slice::from_ref(&path), &output, &options(Formats::BOTH)) {
            Ok(_) => {
                eprintln!("{}", path.display());
                agrees_with_the_octree(&output);
                tried += 1;
            }
            // What no octree is made of, no COPC file is made of.
            Err(error) => assert!(convert(&[path], &output, &options(Formats::POTREE)).is_err(), "{error}"),
        }
    }
    assert!(tried > 3, "{tried} clouds");
}
