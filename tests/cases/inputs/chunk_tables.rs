//! LAZ chunk tables with fewer entries than there are chunks, none, too many, wrong
//! ones, and none at all.

use std::fs;
use std::io::Cursor;

use laz::LazVlr;
use laz::laszip::{ChunkTable, ChunkTableEntry};

use super::*;
use crate::cases;

/// Three chunks of LASzip's usual size.
const POINTS: u64 = 120_000;

/// The chunk table of a file, and where it lies.
struct Table {
    at: usize,
    entries: Vec<ChunkTableEntry>,
    vlr: LazVlr,
}

fn table(bytes: &[u8]) -> Table {
    let points_at = points_at(bytes);
    let at = u64::from_le_bytes(bytes[points_at..points_at + 8].try_into().unwrap()) as usize;
    let name = bytes.windows(14).position(|part| part == b"laszip encoded").unwrap();
    let length = usize::from(u16::from_le_bytes([bytes[name + 18], bytes[name + 19]]));
    let vlr = LazVlr::from_buffer(&bytes[name + 52..name + 52 + length]).unwrap();
    let entries = ChunkTable::read(&mut Cursor::new(&bytes[at..]), vlr.uses_variable_size_chunks()).unwrap();
    Table { at, entries: entries.into_iter().copied().collect(), vlr }
}

/// The file with another table.
fn with_table(bytes: &[u8], change: impl FnOnce(&mut Vec<ChunkTableEntry>)) -> Vec<u8> {
    let Table { at, mut entries, vlr } = table(bytes);
    change(&mut entries);
    let mut new = ChunkTable::with_capacity(entries.len());
    entries.into_iter().for_each(|entry| new.push(entry));
    let mut bytes = bytes[..at].to_vec();
    new.write_to(&mut bytes, &vlr).unwrap();
    bytes
}

#[test]
fn files_with_a_short_table_lose_no_point() {
    let Some(cases) = cases() else { return };
    let folder = tempfile::tempdir().unwrap();
    let octree = becomes(&cases.join("c07b_pf1_short.laz"), folder.path(), 5_000);
    let right = verify(&octree, &cases.join("c07b_pf1.las"), "fail");
    assert_eq!(right.code, Some(0), "{}", right.said);
    becomes(&cases.join("c07b_pf7_short.laz"), folder.path(), 5_000);
}

#[test]
fn a_table_that_lacks_chunks_loses_no_point() {
    let folder = tempfile::tempdir().unwrap();
    let (input, whole) = (folder.path().join("short.laz"), folder.path().join("whole.laz"));
    for format in [0, 3, 5, 6, 8] {
        let bytes = cloud(folder.path(), format, true, POINTS);
        fs::write(&whole, &bytes).unwrap();
        for listed in 0..3 {
            fs::write(&input, with_table(&bytes, |entries| entries.truncate(listed))).unwrap();
            let octree = becomes(&input, folder.path(), POINTS);
            let same = verify(&octree, &whole, "fail");
            assert_eq!(same.code, Some(0), "format {format}, {listed} listed: {}", same.said);
        }
    }
}

#[test]
fn wrong_tables_lose_no_point() {
    type Change = fn(&mut Vec<ChunkTableEntry>);
    let changes: [(&str, Change); 5] = [
        ("too many", |entries| entries.push(ChunkTableEntry { point_count: 0, byte_count: 77 })),
        ("empty ones", |entries| {
            (0..3).for_each(|_| entries.push(ChunkTableEntry { point_count: 0, byte_count: 0 }));
        }),
        ("first too long", |entries| entries[0].byte_count += 1000),
        ("last too short", |entries| entries[2].byte_count -= 1000),
        ("border moved", |entries| {
            entries[0].byte_count += 100;
            entries[1].byte_count -= 100;
        }),
    ];
    let folder = tempfile::tempdir().unwrap();
    let (input, whole) = (folder.path().join("wrong.laz"), folder.path().join("whole.laz"));
    for format in [1, 7] {
        let bytes = cloud(folder.path(), format, true, POINTS);
        fs::write(&whole, &bytes).unwrap();
        for (name, change) in changes {
            fs::write(&input, with_table(&bytes, change)).unwrap();
            let octree = folder.path().join("octree");
            let ended = convert(&input, &octree, "fail");
            assert_eq!(ended.code, Some(0), "format {format}, {name}: {}", ended.said);
            let same = verify(&octree, &whole, "fail");
            assert_eq!(same.code, Some(0), "format {format}, {name}: {}", same.said);
        }
        // And none at all.
        fs::write(&input, &bytes[..table(&bytes).at]).unwrap();
        becomes(&input, folder.path(), POINTS);
    }
}

/// Bytes are left over, and yet they are not as many points as the header counts.
#[test]
fn fewer_points_than_counted_are_never_a_success() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("short.laz");
    for format in [1, 7] {
        let bytes = cloud(folder.path(), format, true, POINTS);
        let mut short = with_table(&bytes, |entries| entries.truncate(1));
        let place = if format < 6 { LEGACY_COUNT } else { COUNT };
        short[place..place + 4].copy_from_slice(&(POINTS as u32 + 1).to_le_bytes());
        fs::write(&input, short).unwrap();
        let ended = convert(&input, &folder.path().join("octree"), "fail");
        assert_eq!(ended.code, Some(1), "format {format}: {}", ended.said);
        assert!(ended.said.contains("120001"), "{}", ended.said);
        let ended = convert(&input, &folder.path().join("octree"), "keep");
        assert_eq!(ended.code, Some(3), "format {format}: {}", ended.said);
        assert_eq!(points(&folder.path().join("octree")), POINTS);
    }
}

/// The checker reads headers on its own.
#[test]
fn verify_tells_what_the_header_promised() {
    let folder = tempfile::tempdir().unwrap();
    let (good, bad) = (folder.path().join("good.las"), folder.path().join("bad.las"));
    let bytes = cloud(folder.path(), 1, false, 5_000);
    let at = points_at(&bytes);
    fs::write(&good, &bytes).unwrap();
    let octree = becomes(&good, folder.path(), 5_000);
    let verified = verify(&octree, &good, "fail");
    assert!(verified.said.contains("promise"), "{}", verified.said);
    // Cut, and taken for what is left of it.
    fs::write(&bad, &bytes[..at + 4_000 * 28]).unwrap();
    assert_eq!(convert(&bad, &octree, "keep").code, Some(3));
    let verified = verify(&octree, &bad, "keep");
    assert!(verified.said.contains("promises 5 000 points, 4 000 were found"), "{}", verified.said);
}
