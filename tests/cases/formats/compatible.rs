//! LASzip's compatibility mode: what was stored as an old point format becomes
//! what it was.

use std::path::Path;

use lodestone::format::las::{LasFile, LasOptions, Vlr, record_length};
use lodestone::octree::attribute::{ExtraField, Scalar};

use super::super::common::{mix, octree_bytes, options_of, surface};
use super::{case, octree_of, records_of, tile};

/// The fields that the mode adds, with an own one before them.
fn fields(format: u8, own: usize) -> Vec<ExtraField> {
    let mut at = record_length(stored_format(format)).unwrap();
    let mut fields = Vec::new();
    let mut push = |name: &str, scalar: Scalar, elements: usize| {
        fields.push(ExtraField {
            name: name.into(),
            description: String::new(),
            scalar,
            elements,
            position: at,
            scale: Vec::new(),
            offset: Vec::new(),
        });
        at += scalar.size() * elements;
    };
    if own > 0 {
        push("own", Scalar::U8, own);
    }
    push("LAS 1.4 scan angle", Scalar::I16, 1);
    push("LAS 1.4 extended returns", Scalar::U8, 1);
    push("LAS 1.4 classification", Scalar::U8, 1);
    push("LAS 1.4 flags and channel", Scalar::U8, 1);
    if matches!(format, 8 | 10) {
        push("LAS 1.4 NIR band", Scalar::U16, 1);
    }
    fields
}

fn stored_format(format: u8) -> u8 {
    match format {
        6 => 1,
        7 | 8 => 3,
        9 => 4,
        _ => 5,
    }
}

/// A record as LASzip stores it (laszip_dll.cpp, laszip_write_point).
fn store(format: u8, record: &[u8], own: usize) -> Vec<u8> {
    let (number, count) = (record[14] & 15, record[14] >> 4);
    let (class, angle) = (record[16], i16::from_le_bytes([record[18], record[19]]));
    let rank = {
        let degrees = 0.006f32 * f32::from(angle);
        let rounded = if degrees >= 0.0 { degrees + 0.5 } else { degrees - 0.5 } as i16;
        rounded.clamp(-128, 127) as i8
    };
    let units = f32::from(rank) / 0.006;
    let units = if units >= 0.0 { units + 0.5 } else { units - 0.5 } as i16;
    let (old_number, old_count) = match (number, count) {
        (number, count @ 0..=7) => (number.min(7), count),
        (number @ 0..=4, _) => (number, 7),
        (number, count) => match i32::from(count) - i32::from(number) {
            ..=0 => (7, 7),
            3.. => (4, 7),
            difference => (7 - difference as u8, 7),
        },
    };
    let (old_class, more_class) = if class > 31 { (0, class) } else { (class, 0) };
    let mut stored = record[..14].to_vec();
    stored.push(old_number | old_count << 3 | record[15] & 0b1100_0000);
    stored.push(old_class | (record[15] & 7) << 5);
    stored.extend([rank as u8, record[17], record[20], record[21]]);
    stored.extend(&record[22..30]);
    let (colors, nir) = match format {
        7 => (6, 0),
        8 | 10 => (6, 2),
        _ => (0, 0),
    };
    stored.extend(&record[30..30 + colors]);
    if format >= 9 {
        stored.extend(&record[30 + colors + nir..30 + colors + nir + 29]);
    }
    stored.extend(&record[record.len() - own..]);
    stored.extend((angle.wrapping_sub(units)).to_le_bytes());
    stored.push((number - old_number) << 4 | (count - old_count));
    stored.extend([more_class, (record[15] >> 4 & 3) << 1 | record[15] >> 3 & 1]);
    if nir > 0 {
        stored.extend(&record[36..38]);
    }
    stored
}

/// The record that marks such a file; its counts by return are `returns`.
fn mark(points: u64, returns: [u64; 15]) -> Vlr {
    let mut data = vec![0; 28];
    data[2] = 3;
    data.extend(points.to_le_bytes());
    returns.iter().for_each(|count| data.extend(count.to_le_bytes()));
    assert_eq!(data.len(), 156);
    Vlr { user: "lascompatible".into(), id: 22204, data }
}

/// Noise of a format with `own` bytes behind it, such that the return number is
/// no larger than the number of returns.
fn records(format: u8, points: u64, own: usize) -> Vec<u8> {
    let length = record_length(format).unwrap();
    let noise = surface(format, points, u64::from(format));
    let mut all = Vec::new();
    for (record, seed) in noise.chunks_exact(length).zip(1u64..) {
        let mut record = record.to_vec();
        let count = mix(seed) as u8 % 16;
        record[14] = (mix(!seed) as u8 % 16).min(count) | count << 4;
        // No further than a scan angle may go: 30 000 units are 180 degrees.
        let angle = (mix(seed ^ 77) % 42_001) as i16 - 21_000;
        record[18..20].copy_from_slice(&angle.to_le_bytes());
        record.extend(mix(seed).to_le_bytes().iter().take(own));
        all.extend(record);
    }
    all
}

fn write(path: &Path, format: u8, compressed: bool, own: usize, vlr: Option<Vlr>) -> Vec<u8> {
    let right = records(format, 2000, own);
    let stored: Vec<u8> = right
        .chunks_exact(record_length(format).unwrap() + own)
        .flat_map(|record| store(format, record, own))
        .collect();
    let options = LasOptions {
        version: (1, if format < 9 { 2 } else { 3 }),
        extra: fields(format, own),
        crs: vlr.into_iter().collect(),
        ..options_of(stored_format(format), compressed)
    };
    tile(path, &options, &stored, &[]);
    right
}

#[test]
fn every_format_in_compatibility_mode_is_restored() {
    let folder = tempfile::tempdir().unwrap();
    for (format, compressed) in [(6, true), (7, false), (8, true), (8, false), (9, false), (10, false)] {
        for own in [0, 3] {
            let path = folder.path().join(if compressed { "a.laz" } else { "a.las" });
            let mut returns = [0; 15];
            returns[14] = 1234;
            let right = write(&path, format, compressed, own, Some(mark(2000, returns)));
            let file = LasFile::open(&path).unwrap();
            let header = file.header();
            assert_eq!((header.point_format, header.version), (format, (1, 4)));
            assert_eq!(header.record_length, record_length(format).unwrap() + own);
            assert_eq!(header.extra.len(), usize::from(own > 0));
            assert_eq!(header.returns[14], 1234);
            assert!(records_of(&path) == right, "format {format}, {own} own bytes");
            octree_of(&path, folder.path());
        }
    }
}

#[test]
fn without_its_mark_nothing_is_restored() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    write(&path, 8, false, 0, None);
    assert_eq!(LasFile::open(&path).unwrap().header().point_format, 3);
    let short = Vlr { data: vec![0; 150], ..mark(1, [0; 15]) };
    write(&path, 8, false, 0, Some(short));
    assert_eq!(LasFile::open(&path).unwrap().header().point_format, 3);
}

#[test]
fn a_given_compatible_file_gives_the_original_octree() {
    let (Some(original), Some(stored)) = (case("c02_pf8.las"), case("c02_pf8_compat.laz")) else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("octree");
    octree_of(&original, folder.path());
    let right = octree_bytes(&path);
    octree_of(&stored, folder.path());
    let restored = octree_bytes(&path);
    assert!(restored == right, "the octrees differ");
    assert!(records_of(&original) == records_of(&stored));
}
