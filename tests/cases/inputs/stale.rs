//! Writers that died: the count is stale or zero, the last record torn.

use std::fs;

use super::*;
use crate::cases;

const POINTS: u64 = 5_000;

#[test]
fn files_of_writers_that_died_keep_whole_records() {
    let Some(cases) = cases() else { return };
    let folder = tempfile::tempdir().unwrap();
    for (name, said, there) in [
        ("c24_pf1_stale.las", 500, 1_893),
        ("c24_pf1_zero.las", 0, 1_893),
        ("c24_pf6_stale.las", 500, 1_898),
        ("c24_pf6_zero.las", 0, 1_898),
    ] {
        let octree = contradicts(&cases.join(name), folder.path(), said, there);
        if name == "c24_pf1_zero.las" {
            let right = verify(&octree, &cases.join("c24_pf1_zero_whole.las"), "fail");
            assert_eq!(right.code, Some(0), "{}", right.said);
        }
    }
    becomes(&cases.join("c24_pf1_zero_whole.las"), folder.path(), 1_893);
}

#[test]
fn torn_files_of_every_format_keep_whole_records() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("torn.las");
    for format in 0..=10 {
        let bytes = cloud(folder.path(), format, false, POINTS);
        let length = lodestone::format::las::record_length(format).unwrap();
        // Flushed by pages, whose ends are no record's.
        let mut end = (points_at(&bytes) + 3_000 * length) / 4096 * 4096;
        if (end - points_at(&bytes)).is_multiple_of(length) {
            end += 4096;
        }
        let there = ((end - points_at(&bytes)) / length) as u64;
        for said in [0, 500] {
            let mut torn = bytes[..end].to_vec();
            count(&mut torn, said);
            fs::write(&input, torn).unwrap();
            contradicts(&input, folder.path(), said.into(), there);
        }
    }
}

/// The header is right for what was flushed first, and the file goes on.
#[test]
fn a_header_true_of_the_first_points_alone_contradicts() {
    let folder = tempfile::tempdir().unwrap();
    let (input, first) = (folder.path().join("flushed.las"), folder.path().join("first.las"));
    for format in [1, 6] {
        let length = lodestone::format::las::record_length(format).unwrap();
        let all = records(format, POINTS);
        common::write_las(&first, &common::options_of(format, false), &all[..2_000 * length]);
        let flushed = [fs::read(&first).unwrap(), all[2_000 * length..].to_vec()].concat();
        fs::write(&input, &flushed).unwrap();
        contradicts(&input, folder.path(), 2_000, POINTS);
        fs::write(&input, &flushed[..flushed.len() - 5]).unwrap();
        contradicts(&input, folder.path(), 2_000, POINTS - 1);
    }
}

/// The system had given the file room that was never written.
#[test]
fn room_that_was_never_written_is_no_point() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("reserved.las");
    let mut bytes = cloud(folder.path(), 3, false, POINTS);
    count(&mut bytes, 500);
    bytes.resize(bytes.len() + 100_000, 0);
    fs::write(&input, bytes).unwrap();
    contradicts(&input, folder.path(), 500, POINTS);
}

#[test]
fn laz_without_its_end_keeps_whole_points() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("torn.laz");
    for format in [1, 3] {
        let bytes = cloud(folder.path(), format, true, POINTS);
        let at = points_at(&bytes);
        let end = at + (bytes.len() - at) * 2 / 3;
        for said in [0, 500] {
            let mut torn = bytes[..end].to_vec();
            count(&mut torn, said);
            torn[at..at + 8].copy_from_slice(&(-1i64).to_le_bytes());
            fs::write(&input, torn).unwrap();
            let octree = folder.path().join("octree");
            let _ = fs::remove_dir_all(&octree);
            let ended = convert(&input, &octree, "fail");
            assert_eq!(ended.code, Some(1), "format {format}, {said}: {}", ended.said);
            assert!(!octree.exists(), "{}", ended.said);
            let ended = convert(&input, &octree, "keep");
            assert!(matches!(ended.code, Some(0 | 3)), "{}", ended.said);
            let there = points(&octree);
            assert!((3_000..4_000).contains(&there), "format {format}, {said}: {there} points");
        }
    }
}

/// Whole chunks and a sound table, and a count that was never set right.
#[test]
fn laz_with_a_stale_count_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("stale.laz");
    for format in 0..=10 {
        let bytes = cloud(folder.path(), format, true, POINTS);
        for said in [0, 500] {
            let mut stale = bytes.clone();
            count(&mut stale, said);
            fs::write(&input, stale).unwrap();
            let octree = folder.path().join("octree");
            let ended = convert(&input, &octree, "fail");
            // Within the last chunk of the formats 0 to 5 only decoding tells a count that is
            // too low from a right one.
            if format < 6 && said > 0 {
                assert!(ended.code == Some(1), "{}", ended.said);
                contradicts(&input, folder.path(), said.into(), POINTS);
                continue;
            }
            assert_eq!(ended.code, Some(0), "format {format}, {said}: {}", ended.said);
            assert_eq!(points(&octree), POINTS, "format {format}, {said}");
            assert!(ended.said.contains("note: "), "nothing is told: {}", ended.said);
        }
    }
}

/// The count lies within the last chunk, below or above what that holds.
#[test]
fn a_wrong_count_of_the_last_chunk_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    let octree = folder.path().join("octree");
    // One chunk, and two of which only the last is meant.
    for (format, points) in [(0, 700), (4, 300), (1, 51_000)] {
        let bytes = cloud(folder.path(), format, true, points);
        fs::write(tiles.join("a.laz"), &bytes).unwrap();
        fs::write(tiles.join("c.laz"), &bytes).unwrap();
        let last = points / 50_000 * 50_000;
        for said in [last + 1, points - 1, last + 20_000] {
            let mut stale = bytes.clone();
            count(&mut stale, said as u32);
            let input = tiles.join("b.laz");
            fs::write(&input, &stale).unwrap();
            contradicts(&input, folder.path(), said, points);
            let ended = convert(&tiles, &octree, "fail");
            assert_eq!(ended.code, Some(1), "{}", ended.said);
            assert!(ended.said.contains("b.laz") && ended.said.contains(&said.to_string()), "{}", ended.said);
            let ended = convert(&tiles, &octree, "keep");
            assert_eq!(ended.code, Some(if said > points { 3 } else { 0 }), "{}", ended.said);
            assert_eq!(self::points(&octree), 3 * points, "format {format}, {said}: {}", ended.said);
        }
    }
}

/// Its points go on behind the damage as if they were some, and are none.
#[test]
fn a_damaged_last_chunk_is_not_taken_for_a_wrong_count() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("damaged.laz");
    let octree = folder.path().join("octree");
    for format in [1, 4] {
        let bytes = cloud(folder.path(), format, true, 55_000);
        for (change, part) in [0.3, 0.9].into_iter().enumerate() {
            let end = table(&bytes);
            let mut damaged = bytes.clone();
            // The last chunk is a tenth of the bytes or so.
            let at = end - (end - points_at(&bytes)) / 14;
            damaged[at + ((end - at) as f64 * part) as usize] ^= 1 << change;
            fs::write(&input, &damaged).unwrap();
            let ended = convert(&input, &octree, "fail");
            assert_eq!(ended.code, Some(1), "format {format}, {part}: {}", ended.said);
            assert!(ended.said.contains("is damaged"), "format {format}, {part}: {}", ended.said);
            let ended = convert(&input, &octree, "keep");
            assert_eq!(ended.code, Some(3), "format {format}, {part}: {}", ended.said);
            assert_eq!(self::points(&octree), 50_000, "format {format}, {part}: {}", ended.said);
        }
    }
}

/// Where the chunk table begins.
fn table(bytes: &[u8]) -> usize {
    let at = points_at(bytes);
    i64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize
}

#[test]
fn one_stale_tile_among_good_ones_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    let bytes = cloud(folder.path(), 1, false, POINTS);
    for name in ["a.las", "c.las"] {
        fs::write(tiles.join(name), &bytes).unwrap();
    }
    let mut stale = bytes[..points_at(&bytes) + 28 * 1_000 + 9].to_vec();
    count(&mut stale, 0);
    fs::write(tiles.join("b.las"), &stale).unwrap();
    let octree = folder.path().join("octree");
    let ended = convert(&tiles, &octree, "fail");
    assert_eq!(ended.code, Some(1), "{}", ended.said);
    assert!(ended.said.contains("b.las") && ended.said.contains("1000"), "{}", ended.said);
    let ended = convert(&tiles, &octree, "keep");
    assert!(matches!(ended.code, Some(0 | 3)), "{}", ended.said);
    assert_eq!(points(&octree), 2 * POINTS + 1_000);
}
