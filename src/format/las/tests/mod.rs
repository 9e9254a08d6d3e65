//! Laws of reading and writing that need both, and the clouds that the tests
//! share.

mod handmade;
mod headers;
mod laz_layouts;
mod round_trips;

use std::path::{Path, PathBuf};

use super::*;
use crate::octree::attribute::{ExtraField, Scalar};

/// Records like those of a scan, from a seed: coordinates that wander, returns
/// that make sense, the rest anything.
pub fn records(point_format: u8, extra: usize, points: usize, seed: u64) -> Vec<u8> {
    let length = record_length(point_format).unwrap() + extra;
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut records = vec![0; points * length];
    let mut position = [1000i32, -2000, 300];
    for record in records.chunks_exact_mut(length) {
        for byte in record.iter_mut() {
            *byte = (random() >> 40) as u8 & 0x3F;
        }
        for axis in 0..3 {
            position[axis] = position[axis].wrapping_add((random() % 2001) as i32 - 1000);
            record[4 * axis..4 * axis + 4].copy_from_slice(&position[axis].to_le_bytes());
        }
        let returns = (random() % 5 + 1) as u8;
        let number = (random() % u64::from(returns)) as u8 + 1;
        record[14] = if point_format < 6 { number | returns << 3 } else { number | returns << 4 };
    }
    records
}

fn field(name: &str, scalar: Scalar, elements: usize, position: usize) -> ExtraField {
    let (description, scale, offset) = (String::new(), Vec::new(), Vec::new());
    ExtraField { name: name.to_string(), description, scalar, elements, position, scale, offset }
}

fn options(point_format: u8, compressed: bool) -> LasOptions {
    LasOptions {
        version: (1, if point_format < 4 { 2 } else { 4 }),
        point_format,
        scale: [0.01, 0.02, 0.001],
        offset: [500_000.0, -4_000_000.0, 0.5],
        compressed,
        extra: Vec::new(),
        crs: Vec::new(),
        software: "Lodestone tests".to_string(),
    }
}

fn written(folder: &Path, options: &LasOptions, records: &[u8]) -> PathBuf {
    let path = folder.join("cloud.laz");
    let mut writer = LasWriter::create(&path, options).unwrap();
    // In portions of whole records that go with no buffer's size.
    for part in records.chunks(writer.record_length() * 7919) {
        writer.write(part).unwrap();
    }
    writer.finish().unwrap();
    path
}

fn read_all(file: &LasFile, points: u32) -> Result<Vec<u8>, LasError> {
    let (mut all, mut records) = (Vec::new(), Vec::new());
    for slice in file.slices(points) {
        file.read(slice, &mut records)?;
        all.extend_from_slice(&records);
    }
    Ok(all)
}
