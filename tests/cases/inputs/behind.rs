//! Things behind the points that are no points.

use std::fs;

use super::*;
use crate::cases;

const POINTS: u64 = 2_000;

#[test]
fn files_with_something_behind_hold_only_points() {
    let Some(cases) = cases() else { return };
    let folder = tempfile::tempdir().unwrap();
    for name in ["c10a_evlr_count0.las", "c10a_evlr_count1.las", "c10b_zero_padded.las"] {
        becomes(&cases.join(name), folder.path(), 2_000);
    }
    // And where nothing is wrong, nothing is said.
    becomes(&cases.join("c30_good.las"), folder.path(), 300);
    let said = convert(&cases.join("c30_good.las"), &folder.path().join("octree"), "fail").said;
    assert!(!said.contains("note: "), "{said}");
}

/// An extended record with WKT.
fn evlr(length: usize) -> Vec<u8> {
    let mut record = vec![0; 60];
    record[2..17].copy_from_slice(b"LASF_Projection");
    record[18..20].copy_from_slice(&2112u16.to_le_bytes());
    record[20..28].copy_from_slice(&(length as u64 - 60).to_le_bytes());
    record.extend(b"PROJCS[\"somewhere\"]".iter().chain(b" ").cycle().take(length - 60));
    record
}

#[test]
fn whole_records_of_anything_else_are_no_points() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("longer.las");
    for format in 0..=10 {
        let length = lodestone::format::las::record_length(format).unwrap();
        let bytes = cloud(folder.path(), format, false, POINTS);
        let noise: Vec<u8> = (0..20 * length as u64).map(|i| common::mix(i) as u8).collect();
        let text = b"Whoever reads this: it is no point, but a remark. ".repeat(length);
        for (name, tail) in [
            ("zeros", vec![0; 500 * length]),
            ("ones", vec![0xFF; length]),
            ("one zero record", vec![0; length]),
            ("noise", noise),
            ("text", text),
            ("an extended record", evlr(60 * length)),
            ("another file", bytes[..points_at(&bytes)].to_vec()),
        ] {
            for spare in [0, 3] {
                let longer = [bytes.as_slice(), &tail, &vec![7; spare]].concat();
                fs::write(&input, longer).unwrap();
                let octree = folder.path().join("octree");
                let ended = convert(&input, &octree, "fail");
                assert_eq!(ended.code, Some(0), "format {format}, {name}: {}", ended.said);
                assert_eq!(points(&octree), POINTS, "format {format}, {name}: {}", ended.said);
            }
        }
    }
}

/// Its start ends the points, whatever the header counts.
#[test]
fn the_start_of_an_extended_record_ends_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("extended.las");
    for format in [6, 7, 10] {
        let length = lodestone::format::las::record_length(format).unwrap();
        let bytes = cloud(folder.path(), format, false, POINTS);
        for number in [0u32, 1, 9] {
            for said in [POINTS, 0, 1_999, 2_015] {
                let mut longer = [bytes.as_slice(), &evlr(15 * length)].concat();
                longer[EVLR..EVLR + 8].copy_from_slice(&(bytes.len() as u64).to_le_bytes());
                longer[EVLR + 8..EVLR + 12].copy_from_slice(&number.to_le_bytes());
                longer[COUNT..COUNT + 8].copy_from_slice(&said.to_le_bytes());
                fs::write(&input, &longer).unwrap();
                if said > POINTS {
                    let ended = convert(&input, &folder.path().join("octree"), "fail");
                    assert_eq!(ended.code, Some(1), "{}", ended.said);
                    assert!(ended.said.contains("2000 of its 2015"), "{}", ended.said);
                } else {
                    becomes(&input, folder.path(), POINTS);
                }
            }
        }
    }
}
