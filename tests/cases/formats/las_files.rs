//! Real LAS and LAZ files: every one is opened and read to its end, and what
//! comes out is what the manifest, its twin or its own header says.
//!
//! Runs where `LODESTONE_DATA` names the folder of clouds; elsewhere it says so
//! and passes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use lodestone::format::las::{LasError, LasFile};

fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("LODESTONE_DATA").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("LODESTONE_DATA is not set: no real clouds to read");
    }
    folder
}

fn clouds(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path
                .extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("las") || e.eq_ignore_ascii_case("laz"))
            {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// What is known after reading all of a file.
struct Whole {
    points: u64,
    min: [f64; 3],
    max: [f64; 3],
}

fn read_all(path: &Path) -> Result<Whole, LasError> {
    let file = LasFile::open(path)?;
    let header = file.header();
    let mut whole = Whole { points: 0, min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3] };
    let mut records = Vec::new();
    for slice in file.slices(200_000) {
        assert_eq!(slice.first, whole.points, "slices of {} leave a gap", path.display());
        file.read(slice, &mut records)?;
        assert_eq!(records.len(), slice.points as usize * header.record_length);
        for record in records.chunks_exact(header.record_length) {
            for axis in 0..3 {
                let integer = i32::from_le_bytes(record[4 * axis..4 * axis + 4].try_into().unwrap());
                let world = f64::from(integer) * header.scale[axis] + header.offset[axis];
                whole.min[axis] = whole.min[axis].min(world);
                whole.max[axis] = whole.max[axis].max(world);
            }
        }
        whole.points += u64::from(slice.points);
    }
    assert_eq!(whole.points, header.points, "{}", path.display());
    file.check_unchanged()?;
    Ok(whole)
}

/// One line of the manifest by column name, keyed by the file's place.
fn manifest(folder: &Path) -> BTreeMap<String, BTreeMap<String, String>> {
    let text = std::fs::read_to_string(folder.join("MANIFEST.csv")).unwrap();
    let mut lines = text.lines().map(split);
    let names = lines.next().unwrap();
    lines
        .map(|line| {
            let row: BTreeMap<String, String> = names.iter().cloned().zip(line).collect();
            (row["file"].clone(), row)
        })
        .collect()
}

/// The cells of a line of CSV, some in quotes.
fn split(line: &str) -> Vec<String> {
    let (mut cells, mut cell, mut quoted) = (Vec::new(), String::new(), false);
    for c in line.chars() {
        match c {
            '"' => quoted = !quoted,
            ',' if !quoted => cells.push(std::mem::take(&mut cell)),
            c => cell.push(c),
        }
    }
    cells.push(cell);
    cells
}

/// Where a manifest's number was rounded for print.
const ROUNDING: f64 = 1e-3;

#[test]
fn every_good_file_holds_what_the_manifest_says() {
    let Some(folder) = data() else { return };
    let manifest = manifest(&folder);
    let mut files = 0;
    for part in ["formats", "single", "tiles", "large"] {
        for path in clouds(&folder.join(part)) {
            let whole = read_all(&path).unwrap_or_else(|e| panic!("{e}"));
            let place = path.strip_prefix(&folder).unwrap().to_str().unwrap();
            let row = &manifest[place];
            assert_eq!(whole.points.to_string(), row["n_read"], "{place}");
            for (ours, theirs) in [(whole.min, &row["true_min"]), (whole.max, &row["true_max"])] {
                let theirs: Vec<f64> = theirs.split(' ').filter_map(|v| v.parse().ok()).collect();
                assert_eq!(theirs.len(), if whole.points == 0 { 0 } else { 3 }, "{place}");
                for (ours, theirs) in ours.iter().zip(&theirs) {
                    assert!((ours - theirs).abs() <= ROUNDING, "{place}: {ours} is not {theirs}");
                }
            }
            files += 1;
        }
    }
    assert!(files > 200, "only {files} files");
}

#[test]
fn las_and_laz_of_the_same_cloud_are_the_same_records() {
    let Some(folder) = data() else { return };
    for name in ["point10", "point-time", "point-color", "point-time-color", "extrabytes", "1_4_w_evlr"] {
        let [plain, packed] = ["las", "laz"].map(|extension| {
            let file = LasFile::open(&folder.join("formats").join(format!("{name}.{extension}"))).unwrap();
            let mut all = Vec::new();
            let mut records = Vec::new();
            for slice in file.slices(300) {
                file.read(slice, &mut records).unwrap();
                all.extend_from_slice(&records);
            }
            (all, file.header().compressed)
        });
        assert!(!plain.1 && packed.1);
        assert_eq!(plain.0, packed.0, "{name}");
    }
}

#[test]
fn a_stream_without_chunks_is_read_by_threads_in_any_order() {
    let Some(folder) = data() else { return };
    let path = folder.join("formats/simple-laszip-compressor-version-1.2r0.laz");
    let file = LasFile::open(&path).unwrap();
    let mut whole = Vec::new();
    file.read(file.slices(u32::MAX)[0], &mut whole).unwrap();
    assert_eq!(whole.len(), 1065 * 34);
    let slices = file.slices(100);
    assert_eq!(slices.len(), 11);
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (file, whole, slices) = (&file, &whole, &slices);
            scope.spawn(move || {
                let mut records = Vec::new();
                for slice in slices.iter().skip(thread).step_by(4) {
                    file.read(*slice, &mut records).unwrap();
                    let start = slice.first as usize * 34;
                    assert_eq!(records, whole[start..start + records.len()]);
                }
            });
        }
    });
    let mut records = Vec::new();
    for slice in slices.iter().rev() {
        file.read(*slice, &mut records).unwrap();
        assert_eq!(records, whole[slice.first as usize * 34..][..records.len()]);
    }
}

/// What becomes of every malformed file: its points, or a part of its error.
const MALFORMED: [(&str, Result<u64, &str>); 16] = [
    ("1.2-no-points.las", Err("0 of its 1065 points")),
    ("1.2-with-color-clipped.las", Err("1064 of its 1065 points")),
    ("autzen_trim_mostly_zero.las", Ok(110_000)),
    ("classification.laz", Ok(700)),
    ("garbage_nVariableLength.las", Err("718 of its 719 points")),
    ("gps-time-nan.las", Ok(1)),
    ("las12.las", Ok(8144)),
    ("las12_bounding_box.las", Ok(8144)),
    ("las12_number_of_point_records.las", Err("8144 of its 8150 points")),
    ("las12_number_of_points_by_return.las", Ok(8144)),
    ("las12_offset_to_point_data.las", Err("inside its 227 bytes of header")),
    ("las12_scale_factor.las", Ok(8144)),
    ("lone-star-2-2-2-2-noise.laz", Err("no LAS version 126.203")),
    ("malformed_extrabytes.las", Ok(10)),
    ("simple1_3.las", Ok(999)),
    ("spurious.las", Ok(1065)),
];

#[test]
fn every_malformed_file_is_read_or_refused_with_its_reason() {
    let Some(folder) = data() else { return };
    let folder = folder.join("malformed");
    assert_eq!(clouds(&folder).len(), MALFORMED.len());
    for (name, expected) in MALFORMED {
        let start = Instant::now();
        let path = folder.join(name);
        match (read_all(&path), expected) {
            (Ok(whole), Ok(points)) => assert_eq!(whole.points, points, "{name}"),
            (Err(error), Err(part)) => {
                let message = error.to_string();
                assert!(message.contains(part) && message.contains(name), "{message}");
            }
            (result, _) => panic!("{name}: {:?} is not {expected:?}", result.map(|whole| whole.points)),
        }
        assert!(start.elapsed() < Duration::from_secs(10), "{name} took {:?}", start.elapsed());
    }
}
