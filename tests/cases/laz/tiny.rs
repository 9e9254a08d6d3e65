//! LAZ in chunks of ten points: what a chunk costs is paid for every ten.

use std::path::Path;
use std::process::Command;
use std::{fs, iter};

use laz::LazVlrBuilder;
use laz::laszip::{ChunkTable, ChunkTableEntry};
use lodestone::lab::process;

use super::*;
use crate::common::{options_of, surface, write_las};

const POINT_FORMAT: u8 = 6;
const RECORD: usize = 30;
const CHUNK: usize = 10;
const POINTS: usize = 300_000;

/// Writes a cloud in chunks of ten; gives the first chunks.
fn write(path: &Path, kept: usize) -> Vec<Vec<u8>> {
    let records = surface(POINT_FORMAT, POINTS as u64, 1);
    write_las(path, &options_of(POINT_FORMAT, false), &records);
    let mut plain = fs::read(path).expect("read");
    let start = u32::from_le_bytes(plain[96..100].try_into().expect("four bytes"));
    let mut items = LazItemRecordBuilder::new();
    items.add_item(LazItemType::Point14);
    let vlr =
        LazVlrBuilder::default().with_laz_items(items.build()).with_fixed_chunk_size(CHUNK as u32).build();
    let mut content = Vec::new();
    vlr.write_to(&mut content).expect("written");

    plain.truncate(start as usize);
    let length = content.len() as u16;
    plain[96..100].copy_from_slice(&(start + 54 + u32::from(length)).to_le_bytes());
    plain[100] += 1;
    plain[104] |= 128;
    plain.extend_from_slice(&[0; 2]);
    plain.extend_from_slice(b"laszip encoded\0\0");
    plain.extend([22204u16, length].iter().flat_map(|number| number.to_le_bytes()));
    plain.extend(iter::repeat_n(0, 32));
    plain.extend_from_slice(&content);

    let table_at = plain.len();
    plain.extend_from_slice(&[0; 8]);
    let mut encoder =
        Encoder::new(RecordShape::new(POINT_FORMAT, 0, 3).expect("a shape")).expect("an encoder");
    let mut table = ChunkTable::with_capacity(POINTS / CHUNK);
    let mut first = Vec::new();
    for points in records.chunks(CHUNK * RECORD) {
        let mut chunk = Vec::new();
        encoder.encode(points, &mut chunk);
        table.push(ChunkTableEntry { point_count: CHUNK as u64, byte_count: chunk.len() as u64 });
        plain.extend_from_slice(&chunk);
        if first.len() < kept {
            first.push(chunk);
        }
    }
    let end = plain.len() as u64;
    plain[table_at..table_at + 8].copy_from_slice(&end.to_le_bytes());
    table.write_to(&mut plain, &vlr).expect("written");
    fs::write(path, plain).expect("written");
    first
}

/// Seconds of processor that this thread has had.
fn processor() -> f64 {
    let told = fs::read_to_string("/proc/thread-self/schedstat").expect("Linux");
    told.split(' ').next().and_then(|n| n.parse::<f64>().ok()).expect("nanoseconds") / 1e9
}

/// How many times as much processor time as LASzip `laz` takes for such chunks: 233
/// microseconds a point against 13. Both make all models of a chunk anew.
const SLOWER: f64 = 18.0;

/// A whole conversion has five times what LASzip takes to decode.
#[test]
fn tiny_chunks_cost_as_little_as_elsewhere() {
    let folder = tempfile::tempdir().expect("a folder");
    let input = folder.path().join("tiny.laz");
    let chunks = write(&input, 300);
    let oracle = Oracle::new(POINT_FORMAT, 0, 3);
    let before = processor();
    chunks.iter().for_each(|chunk| drop(oracle.decode(chunk, CHUNK).expect("sound")));
    let usual = (processor() - before) / (chunks.len() * CHUNK) as f64;

    let mut convert = Command::new(env!("CARGO_BIN_EXE_lodestone"));
    convert.arg("convert").args(["--progress", "none", "--outliers", "keep", "--duplicates", "keep", "-o"]);
    let ours = process::run(convert.arg(folder.path().join("octree")).arg(&input)).expect("converted");
    let ours = ours.cpu / POINTS as f64;
    eprintln!("chunks of ten: {:.2} microseconds a point, laz {:.2} to decode", ours * 1e6, usual * 1e6);
    assert!(ours <= 5.0 * usual / SLOWER, "{ours} seconds a point, {usual} to decode it with laz");
}
