//! Headers that lie, and files that change while they are read.

use super::*;

#[test]
fn a_file_that_changes_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &options(0, false), &records(0, 0, 5000, 1));
    let bytes = std::fs::read(&path).unwrap();
    let file = LasFile::open(&path).unwrap();
    file.check_unchanged().unwrap();

    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(50_000).unwrap();
    assert!(file.check_unchanged().unwrap_err().to_string().contains("bytes"));
    let error = file.read(file.slices(10_000)[0], &mut Vec::new()).unwrap_err();
    assert!(matches!(error, LasError::Changed { .. }) && error.may_pass());

    let other = folder.path().join("other");
    std::fs::write(&other, &bytes).unwrap();
    std::fs::rename(&other, &path).unwrap();
    assert!(file.check_unchanged().unwrap_err().to_string().contains("took its place"));
    std::fs::remove_file(&path).unwrap();
    assert!(file.check_unchanged().unwrap_err().to_string().contains("removed"));
}

#[test]
fn headers_that_cannot_be_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &options(1, false), &records(1, 0, 100, 1));
    let good = std::fs::read(&path).unwrap();
    let scale_at = 131;
    let cases: [(usize, &[u8], &str); 11] = [
        (0, b"LASG", "does not begin with LASF"),
        (24, &[126, 203], "no LAS version 126.203"),
        (24, &[1, 6], "not known yet"),
        (94, &[10, 0], "has 10 bytes, and no LAS header has fewer than 227"),
        (94, &[255, 255], "has 65535 bytes, and the whole file has"),
        (96, &[225, 0, 0, 0], "inside its"),
        (104, &[14], "no point format 14"),
        (105, &[27, 0], "too short"),
        (scale_at, &0f64.to_le_bytes(), "scale of x is 0"),
        (scale_at + 8, &f64::NAN.to_le_bytes(), "scale of y is NaN"),
        (scale_at + 40, &f64::INFINITY.to_le_bytes(), "offset of z is inf"),
    ];
    for (at, patch, reason) in cases {
        let mut bad = good.clone();
        bad[at..at + patch.len()].copy_from_slice(patch);
        std::fs::write(&path, &bad).unwrap();
        let message = LasFile::open(&path).unwrap_err().to_string();
        assert!(message.contains(reason) && message.contains("cloud.laz"), "{message}");
    }
    for length in [0, 3, 100, 226] {
        std::fs::write(&path, &good[..length]).unwrap();
        assert!(matches!(LasFile::open(&path), Err(LasError::NotLas { .. })), "{length}");
    }
    let missing = LasFile::open(&folder.path().join("missing.las")).unwrap_err();
    assert!(matches!(missing, LasError::Io { .. }) && !missing.may_pass());
    assert!(matches!(LasFile::open(folder.path()), Err(LasError::NotLas { .. })));
}

#[test]
fn extended_records_that_are_not_there_are_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &options(6, false), &records(6, 0, 100, 1));
    let good = std::fs::read(&path).unwrap();
    for (start, count, notes) in
        [(12345u64, 0u32, 0), (u64::MAX, 1, 1), (10, 1, 1), (good.len() as u64 - 20, 9, 2)]
    {
        let mut odd = good.clone();
        odd[235..243].copy_from_slice(&start.to_le_bytes());
        odd[243..247].copy_from_slice(&count.to_le_bytes());
        std::fs::write(&path, &odd).unwrap();
        let file = LasFile::open(&path).unwrap();
        assert_eq!(file.header().points, 100, "{start} {count}");
        assert_eq!(file.header().notes.len(), notes, "{:?}", file.header().notes);
    }
}

#[test]
fn variable_length_records_are_found_whatever_the_header_counts() {
    let folder = tempfile::tempdir().unwrap();
    let extra = vec![field("a", Scalar::U16, 1, 30)];
    let crs = vec![Vlr::wkt("PROJCS[\"x\"]")];
    for compressed in [false, true] {
        let options = LasOptions { extra: extra.clone(), crs: crs.clone(), ..options(6, compressed) };
        let path = written(folder.path(), &options, &records(6, 2, 100, 1));
        let good = std::fs::read(&path).unwrap();
        let there = u32::from_le_bytes(good[100..104].try_into().unwrap());
        for said in [0, 1, there, there + 1, 1_069_128_089, u32::MAX] {
            let mut lying = good.clone();
            lying[100..104].copy_from_slice(&said.to_le_bytes());
            std::fs::write(&path, &lying).unwrap();
            let file = LasFile::open(&path).unwrap();
            let header = file.header();
            assert_eq!((header.points, &header.extra), (100, &extra));
            assert!(header.crs.is_some());
            assert_eq!(header.notes.is_empty(), said == there, "{:?}", header.notes);
        }
    }
}

#[test]
fn bytes_between_the_records_and_the_points_are_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let records = records(1, 0, 100, 1);
    for (gap, compressed) in [(2usize, false), (1000, false), (2, true), (1000, true)] {
        let path = written(folder.path(), &options(1, compressed), &records);
        let mut bytes = std::fs::read(&path).unwrap();
        let at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        bytes.splice(at..at, vec![0xDD; gap]);
        bytes[96..100].copy_from_slice(&((at + gap) as u32).to_le_bytes());
        if compressed {
            let table = u64::from_le_bytes(bytes[at + gap..at + gap + 8].try_into().unwrap());
            bytes[at + gap..at + gap + 8].copy_from_slice(&(table + gap as u64).to_le_bytes());
        }
        std::fs::write(&path, &bytes).unwrap();
        let file = LasFile::open(&path).unwrap();
        assert!(file.header().notes.is_empty(), "{:?}", file.header().notes);
        assert!(read_all(&file, 1000).unwrap() == records);
    }
}

#[test]
fn a_record_that_is_longer_than_the_room_for_it_is_cut_to_that() {
    let folder = tempfile::tempdir().unwrap();
    let options = LasOptions { crs: vec![Vlr::wkt("PROJCS[\"x\"]")], ..options(1, false) };
    let path = written(folder.path(), &options, &records(1, 0, 100, 1));
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[227 + 20..227 + 22].copy_from_slice(&60_000u16.to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let file = LasFile::open(&path).unwrap();
    assert_eq!(file.header().crs.as_ref().unwrap().text, "PROJCS[\"x\"]");
    assert_eq!(file.header().notes.len(), 1);
}

#[test]
fn names_that_are_not_utf_8_are_read_as_well_as_can_be() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &options(0, false), &records(0, 0, 10, 1));
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[58..64].copy_from_slice(b"Lo\xE9d\xFF\0");
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(LasFile::open(&path).unwrap().header().software, "Lo\u{FFFD}d\u{FFFD}");
}

#[test]
fn a_pipe_is_refused_without_waiting_for_its_writer() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe.las");
    rustix::fs::mkfifoat(rustix::fs::CWD, &path, rustix::fs::Mode::RWXU).unwrap();
    assert!(matches!(LasFile::open(&path), Err(LasError::NotLas { .. })));
}

#[test]
fn a_file_whose_header_counts_too_few_is_read_and_not_complete() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &options(1, false), &records(1, 0, 100, 1));
    let mut bytes = std::fs::read(&path).unwrap();
    assert!(LasFile::open(&path).unwrap().is_complete());
    for said in [0u32, 60] {
        bytes[107..111].copy_from_slice(&said.to_le_bytes());
        std::fs::write(&path, &bytes).unwrap();
        let file = LasFile::open(&path).unwrap();
        assert_eq!((file.header().points, file.header().notes.len(), file.is_complete()), (100, 1, false));
    }
}
