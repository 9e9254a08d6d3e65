//! LAS 1.5: its header, and GPS times that count from elsewhere.

use std::fs;
use std::path::Path;

use lodestone::convert::options::Options;
use lodestone::format::las::{GpsEpoch, LasFile, LasOptions, LasWriter, record_length};

use super::super::common::{all_records, convert, options_of, surface};
use super::{case, octree_of, told};

/// Where GPS times stand in records of the formats 6 to 10.
const GPS_TIME: usize = 22;

/// Writes LAS 1.5 with these GPS times, one a point.
fn write(path: &Path, offset: u16, times: &[f64]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let compressed = path.extension().is_some_and(|e| e == "laz");
    let options = LasOptions { version: (1, 5), ..options_of(6, compressed) };
    let mut records = surface(6, times.len() as u64, u64::from(offset));
    for (record, time) in records.chunks_exact_mut(record_length(6).unwrap()).zip(times) {
        record[GPS_TIME..GPS_TIME + 8].copy_from_slice(&time.to_le_bytes());
    }
    let mut writer = LasWriter::create(path, &options).unwrap();
    writer.set_gps_time(GpsEpoch::Standard { offset });
    writer.write(&records).unwrap();
    writer.finish().unwrap();
}

/// Times from `first` on, in steps of eighths of a second.
fn times(first: f64, count: usize) -> Vec<f64> {
    (0..count).map(|number| first + number as f64 / 8.0).collect()
}

/// All GPS times of an octree, sorted.
fn octree_times(folder: &Path) -> Vec<f64> {
    let (metadata, nodes) = all_records(folder);
    let schema = metadata.schema().unwrap();
    let at = schema.offset_of("gps-time").unwrap();
    let records = nodes.iter().flat_map(|(_, records)| records.chunks_exact(schema.record_size()));
    let mut times: Vec<f64> =
        records.map(|record| f64::from_le_bytes(record[at..at + 8].try_into().unwrap())).collect();
    times.sort_by(f64::total_cmp);
    times
}

#[test]
fn las_1_5_is_read_to_its_last_point() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.las", "a.laz"] {
        let path = folder.path().join(name);
        write(&path, 1400, &times(2500.0, 3000));
        let bytes = fs::read(&path).unwrap();
        assert_eq!((bytes[25], u16::from_le_bytes([bytes[94], bytes[95]])), (5, 393));
        assert_eq!(bytes[375..383], (2500.0f64 + 2999.0 / 8.0).to_le_bytes());
        assert_eq!(bytes[383..391], 2500.0f64.to_le_bytes());
        assert_eq!(bytes[391..393], 1400u16.to_le_bytes());
        let file = LasFile::open(&path).unwrap();
        let header = file.header();
        assert_eq!((header.version, header.points), ((1, 5), 3000));
        assert_eq!(header.gps_time, GpsEpoch::Standard { offset: 1400 });
        assert_eq!(header.notes, [""; 0]);
        let held = octree_of(&path, folder.path());
        assert_eq!(held.metadata.gps_time_offset, Some(1400));
        assert_eq!(octree_times(&folder.path().join("octree")), times(2500.0, 3000));
    }
}

#[test]
fn given_files_of_las_1_5_are_converted() {
    for name in ["c03_v15.las", "c03_v15.laz"] {
        let Some(path) = case(name) else { return };
        let folder = tempfile::tempdir().unwrap();
        let held = octree_of(&path, folder.path());
        assert_eq!((held.outcome.points_in, held.metadata.gps_time_offset), (3000, None), "{name}");
    }
}

#[test]
fn time_offsets_are_brought_together_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    // The same quarter of an hour, counted from three places.
    write(&tiles.join("a.las"), 1000, &times(400_002_500.0, 800));
    write(&tiles.join("b.laz"), 1400, &times(2600.0, 800));
    write(&tiles.join("c.las"), 0, &times(1_400_002_700.0, 800));
    let held = octree_of(&tiles, folder.path());
    assert_eq!(held.metadata.gps_time_offset, Some(1400));
    let mut right = [times(2500.0, 800), times(2600.0, 800), times(2700.0, 800)].concat();
    right.sort_by(f64::total_cmp);
    assert_eq!(octree_times(&folder.path().join("octree")), right);
    for name in ["a.las", "c.las"] {
        assert!(told(&held.outcome.notes, &[name, "GPS times", "1400000000 s"]), "{:?}", held.outcome.notes);
    }
    assert!(!told(&held.outcome.notes, &["b.laz"]));
}

#[test]
fn time_offsets_that_would_round_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    write(&tiles.join("a.las"), 1400, &times(2500.0, 100));
    // Thirty-two binary digits behind the point, which 4 × 10^8 has no room for.
    write(&tiles.join("b.las"), 1000, &[f64::from(1u32 << 31).recip()]);
    let error = convert(&[tiles], &folder.path().join("octree"), &Options::default()).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("b.las") && error.contains("time offset 1000"), "{error}");
    assert!(error.contains("1400") && error.contains("apart"), "{error}");
}

#[test]
fn seconds_of_the_week_stay_and_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    write(&tiles.join("a.las"), 1000, &times(1000.0, 100));
    super::tile(&tiles.join("b.las"), &options_of(6, false), &surface(6, 100, 1), &[]);
    let held = octree_of(&tiles, folder.path());
    assert_eq!(held.metadata.gps_time_offset, None);
    assert!(told(&held.outcome.notes, &["1 of 2 files", "seconds of the week"]), "{:?}", held.outcome.notes);
}

#[test]
fn points_set_aside_keep_their_files_times() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    write(&tiles.join("a.las"), 1000, &times(400_002_500.0, 2000));
    write(&tiles.join("b.las"), 1400, &times(2600.0, 2000));
    // The first point of a.las flies far away.
    let far = [1i32 << 30; 3].map(i32::to_le_bytes).concat();
    super::super::common::judge::patch(&tiles.join("a.las"), &[(393, &far)]);
    let held = octree_of(&tiles, folder.path());
    assert_eq!(held.outcome.points_set_aside, 1);
    let aside = LasFile::open(&folder.path().join("octree/set-aside.laz")).unwrap();
    assert_eq!(aside.header().gps_time, GpsEpoch::ADJUSTED);
    let records = super::records_of(aside.path());
    assert_eq!(records[GPS_TIME..GPS_TIME + 8], 400_002_500.0f64.to_le_bytes());
}
