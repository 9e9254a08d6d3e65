//! What is written comes back, and headers tell the truth of it.

use proptest::prelude::*;

use super::*;

#[test]
fn every_format_comes_back_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    for point_format in 0..=10 {
        let standard = record_length(point_format).unwrap();
        for compressed in [false, true] {
            for extra in [
                Vec::new(),
                vec![field("a", Scalar::F32, 1, standard), field("b", Scalar::U16, 3, standard + 4)],
            ] {
                let size = if extra.is_empty() { 0 } else { 10 };
                let records = records(point_format, size, 2500, u64::from(point_format) + 1);
                let options = LasOptions { extra: extra.clone(), ..options(point_format, compressed) };
                let file = LasFile::open(&written(folder.path(), &options, &records)).unwrap();
                let header = file.header();
                assert_eq!(header.points, 2500);
                assert_eq!((header.point_format, header.compressed), (point_format, compressed));
                assert_eq!(header.record_length, standard + size);
                assert_eq!(header.extra, extra);
                assert_eq!((header.scale, header.offset), (options.scale, options.offset));
                assert_eq!(header.software, "Lodestone tests");
                assert!(header.notes.is_empty(), "{:?}", header.notes);
                assert!(read_all(&file, 1000).unwrap() == records, "format {point_format} {compressed}");
            }
        }
    }
}

#[test]
fn the_header_says_the_true_bounds_and_returns() {
    let folder = tempfile::tempdir().unwrap();
    for point_format in [1, 7] {
        let records = records(point_format, 0, 1000, 3);
        let options = options(point_format, false);
        let path = written(folder.path(), &options, &records);
        let file = LasFile::open(&path).unwrap();
        let integers = |axis: usize| {
            records
                .chunks_exact(record_length(point_format).unwrap())
                .map(move |r| i32::from_le_bytes(r[4 * axis..4 * axis + 4].try_into().unwrap()))
        };
        for axis in 0..3 {
            let world = |i: i32| f64::from(i) * options.scale[axis] + options.offset[axis];
            assert_eq!(file.header().min[axis], world(integers(axis).min().unwrap()));
            assert_eq!(file.header().max[axis], world(integers(axis).max().unwrap()));
        }
        let raw = las::raw::Header::read_from(std::fs::read(&path).unwrap().as_slice()).unwrap();
        let counted: u64 = match raw.large_file {
            Some(large) => large.number_of_points_by_return.iter().sum(),
            None => raw.number_of_points_by_return.iter().map(|n| u64::from(*n)).sum(),
        };
        assert_eq!(counted, 1000);
        assert_eq!(raw.number_of_point_records, if point_format == 1 { 1000 } else { 0 });
    }
}

#[test]
fn the_same_points_give_the_same_bytes_in_any_portions() {
    let folder = tempfile::tempdir().unwrap();
    let records = records(3, 0, 120_000, 9);
    let whole = std::fs::read(written(folder.path(), &options(3, true), &records)).unwrap();
    let path = folder.path().join("portions.laz");
    let mut writer = LasWriter::create(&path, &options(3, true)).unwrap();
    for part in records.chunks(34) {
        writer.write(part).unwrap();
    }
    writer.finish().unwrap();
    assert!(std::fs::read(path).unwrap() == whole);
    let file = LasFile::open(&folder.path().join("cloud.laz")).unwrap();
    assert_eq!(file.slices(1).iter().map(|s| s.points).collect::<Vec<_>>(), [50_000, 50_000, 20_000]);
    assert_eq!(file.slices(100_000).len(), 2);
    assert!(read_all(&file, 70_000).unwrap() == records);
}

#[test]
fn an_empty_file_is_a_file() {
    let folder = tempfile::tempdir().unwrap();
    for (point_format, compressed) in [(0, false), (0, true), (6, false), (6, true)] {
        let file = LasFile::open(&written(folder.path(), &options(point_format, compressed), &[])).unwrap();
        assert_eq!(file.header().points, 0);
        assert!(file.slices(1000).is_empty());
        assert!(file.header().notes.is_empty());
    }
}

#[test]
fn a_crs_of_any_length_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    for length in [10, 70_000] {
        let wkt = format!("PROJCS[\"{}\"]", "x".repeat(length));
        let options = LasOptions { crs: vec![Vlr::wkt(&wkt)], ..options(6, true) };
        let file = LasFile::open(&written(folder.path(), &options, &records(6, 0, 10, 1))).unwrap();
        assert_eq!(file.header().crs, Some(Crs { text: wkt, source: CrsSource::Wkt }));
        assert_eq!(file.header().points, 10);
    }
}

#[test]
fn what_cannot_be_written_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("never.las");
    let refused = |options: LasOptions| LasWriter::create(&path, &options).is_err();
    assert!(refused(LasOptions { point_format: 11, ..options(0, false) }));
    assert!(refused(LasOptions { version: (1, 2), ..options(6, false) }));
    assert!(refused(LasOptions { version: (2, 0), ..options(0, false) }));
    assert!(refused(LasOptions { scale: [0.0, 1.0, 1.0], ..options(0, false) }));
    assert!(refused(LasOptions { offset: [f64::NAN, 1.0, 1.0], ..options(0, false) }));
    assert!(refused(LasOptions { extra: vec![field("far", Scalar::U8, 1, 70_000)], ..options(0, false) }));
    assert!(!path.exists());
    let mut writer = LasWriter::create(&path, &options(0, false)).unwrap();
    assert!(writer.write(&[0; 21]).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever bytes records are made of, they come back, as LAS and as LAZ.
    #[test]
    fn any_records_come_back(point_format in 0u8..=10, compressed: bool, seed: u64, points in 0usize..400) {
        let folder = tempfile::tempdir().unwrap();
        let length = record_length(point_format).unwrap();
        let mut records = records(point_format, 0, points, seed);
        // Bytes that make no sense must survive, too.
        for (i, byte) in records.iter_mut().enumerate() {
            if (i as u64).wrapping_mul(seed | 1).is_multiple_of(7) {
                *byte = (seed >> (i % 57)) as u8;
            }
        }
        let file = LasFile::open(&written(folder.path(), &options(point_format, compressed), &records)).unwrap();
        prop_assert_eq!(file.header().points as usize, points);
        let back = read_all(&file, 100).unwrap();
        for (ours, theirs) in back.chunks_exact(length).zip(records.chunks_exact(length)) {
            prop_assert_eq!(ours, theirs);
        }
        prop_assert_eq!(back.len(), records.len());
    }
}
