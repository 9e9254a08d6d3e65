//! Laws of reading and writing that need both, or LAZ files that no writer of
//! ours makes: chunks of many sizes, tables at the end, wrong or missing.

use std::path::{Path, PathBuf};

use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::{LazVlr, LazVlrBuilder};
use proptest::prelude::*;

use super::coding::Coding;
use super::*;
use crate::cloud::attribute::{ExtraField, Scalar};

/// Records like those of a scan, from a seed: coordinates that wander, returns
/// that make sense, the rest anything.
fn records(point_format: u8, extra: usize, points: usize, seed: u64) -> Vec<u8> {
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
        crs_wkt: None,
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

/// A LAZ file built by hand, chunk by chunk.
struct Handmade {
    bytes: Vec<u8>,
    /// Where its points and its chunk table begin.
    points_at: usize,
    table_at: usize,
    records: Vec<u8>,
}

impl Handmade {
    /// `fixed` is the chunk size that the LASzip record tells, if any; `chunks`
    /// are those that the file has.
    fn new(point_format: u8, fixed: Option<u32>, chunks: &[usize]) -> Handmade {
        let folder = tempfile::tempdir().unwrap();
        let records = records(point_format, 0, chunks.iter().sum(), 5);
        let path = written(folder.path(), &options(point_format, true), &records);
        let mut bytes = std::fs::read(path).unwrap();
        let points_at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        bytes.truncate(points_at);
        let builder = LazVlrBuilder::default().with_point_format(point_format, 0).unwrap();
        let vlr = match fixed {
            Some(points) => builder.with_fixed_chunk_size(points),
            None => builder.with_variable_chunk_size(),
        }
        .build();
        put_laszip(&mut bytes, &vlr);
        let coding = Coding::new(vlr.items(), point_format).unwrap();
        let mut table = ChunkTable::with_capacity(chunks.len());
        bytes.extend_from_slice(&[0; 8]);
        let mut rest = records.as_slice();
        for points in chunks {
            let (now, later) = rest.split_at(points * coding.record_length);
            let chunk = coding.encode(now).unwrap();
            table.push(ChunkTableEntry { point_count: *points as u64, byte_count: chunk.len() as u64 });
            bytes.extend_from_slice(&chunk);
            rest = later;
        }
        let table_at = bytes.len();
        table.write_to(&mut bytes, &vlr).unwrap();
        bytes[points_at..points_at + 8].copy_from_slice(&(table_at as u64).to_le_bytes());
        Handmade { bytes, points_at, table_at, records }
    }

    fn open(&self) -> Result<LasFile, LasError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &self.bytes).unwrap();
        LasFile::open(file.path())
    }

    fn set_table_at(&mut self, at: i64) {
        self.bytes[self.points_at..self.points_at + 8].copy_from_slice(&at.to_le_bytes());
    }
}

/// Replaces the LASzip record's data, in its place at the end of the records.
fn put_laszip(bytes: &mut [u8], vlr: &LazVlr) {
    let mut data = Vec::new();
    vlr.write_to(&mut data).unwrap();
    let start = bytes.len() - data.len();
    bytes[start..].copy_from_slice(&data);
}

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
        let options = LasOptions { crs_wkt: Some(wkt.clone()), ..options(6, true) };
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

#[test]
fn chunks_of_any_size_are_read() {
    for point_format in [0, 3, 5, 6, 10] {
        for (fixed, chunks) in [
            (Some(100), [100, 100, 100, 40].as_slice()),
            (Some(100), &[100, 100]),
            (None, &[1, 700, 3, 50]),
            (None, &[300]),
        ] {
            let made = Handmade::new(point_format, fixed, chunks);
            let file = made.open().unwrap();
            assert!(file.header().notes.is_empty(), "{:?}", file.header().notes);
            assert_eq!(file.slices(1).len(), chunks.len());
            for points in [1, 150, 10_000] {
                assert!(read_all(&file, points).unwrap() == made.records, "format {point_format} {chunks:?}");
            }
        }
    }
}

#[test]
fn a_chunk_table_whose_place_stands_at_the_end_is_found() {
    for point_format in [1, 7] {
        let mut made = Handmade::new(point_format, Some(100), &[100, 100, 30]);
        made.set_table_at(-1);
        made.bytes.extend_from_slice(&(made.table_at as u64).to_le_bytes());
        let file = made.open().unwrap();
        assert_eq!(file.slices(1).len(), 3);
        assert!(read_all(&file, 1).unwrap() == made.records);
    }
}

#[test]
fn without_a_usable_chunk_table_the_points_are_still_read() {
    let spoil: [(&str, fn(&mut Handmade)); 4] = [
        ("missing", |made| {
            made.set_table_at(-1);
            made.bytes.truncate(made.table_at);
        }),
        ("zero", |made| made.bytes[made.table_at..].fill(0)),
        ("too many chunks", |made| made.bytes[made.table_at + 4..made.table_at + 8].fill(0xFF)),
        ("in front of the points", |made| made.set_table_at(made.points_at as i64 + 3)),
    ];
    for (name, spoil) in spoil {
        for (point_format, fixed) in [(1, Some(100)), (7, Some(100)), (7, None)] {
            let mut made = Handmade::new(point_format, fixed, &[100, 100, 30]);
            spoil(&mut made);
            let file = made.open().unwrap_or_else(|e| panic!("{name} {point_format}: {e}"));
            assert_eq!(file.header().points, 230);
            assert!(!file.header().notes.is_empty());
            for points in [7, 100, 10_000] {
                assert!(read_all(&file, points).unwrap() == made.records, "{name} {point_format} {points}");
            }
        }
        let mut made = Handmade::new(1, None, &[100, 100, 30]);
        spoil(&mut made);
        let error = made.open().unwrap_err().to_string();
        assert!(error.contains("chunk table"), "{name}: {error}");
    }
}

#[test]
fn a_cut_laz_file_says_how_much_is_left() {
    for point_format in [1, 7] {
        let mut made = Handmade::new(point_format, Some(100), &[100, 100, 30]);
        let rest = made.table_at - made.points_at;
        made.bytes.truncate(made.points_at + rest * 2 / 3);
        match made.open() {
            Err(LasError::Cut { readable, points: 230, .. }) => {
                assert!((100..200).contains(&readable), "format {point_format}: {readable}");
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_header_that_counts_wrong_in_laz_is_corrected_or_refused() {
    // Layered chunks count themselves.
    let mut made = Handmade::new(7, Some(100), &[100, 30]);
    made.bytes[247..255].copy_from_slice(&77u64.to_le_bytes());
    let file = made.open().unwrap();
    assert_eq!(file.header().points, 130);
    assert_eq!(file.header().notes.len(), 1);
    assert!(read_all(&file, 100).unwrap() == made.records);
    // The others do not say how full the last one is.
    for said in [77u32, 100, 201, 4_000_000_000] {
        let mut made = Handmade::new(1, Some(100), &[100, 30]);
        made.bytes[107..111].copy_from_slice(&said.to_le_bytes());
        let opened = made.open();
        if said == 100 {
            // Looks as if the last chunk were empty; it is not, and reading
            // must not pass over it in silence.
            assert!(opened.is_err(), "{said}");
        } else {
            assert!(matches!(opened, Err(LasError::Header { .. })), "{said}: {opened:?}");
        }
    }
}

#[test]
fn damage_inside_a_chunk_is_an_error_that_says_where() {
    for point_format in [1, 7] {
        let mut made = Handmade::new(point_format, Some(100), &[100, 100, 30]);
        let file = made.open().unwrap();
        let second = file.slices(1)[1];
        let middle = made.points_at + (made.table_at - made.points_at) / 2;
        // The layer sizes of a layered chunk, the stream of another.
        let at = if point_format == 1 { middle } else { made.points_at + 8 + 36 + 4 };
        made.bytes[at] ^= 0x55;
        let file = made.open().unwrap();
        let errors: Vec<String> = file
            .slices(1)
            .into_iter()
            .filter_map(|slice| file.read(slice, &mut Vec::new()).err())
            .map(|error| error.to_string())
            .collect();
        assert_eq!(errors.len(), 1, "{errors:?}");
        let place =
            if point_format == 1 { format!("points {} to", second.first) } else { "points 0 to 99".into() };
        assert!(errors[0].contains(&place), "{}", errors[0]);
    }
}

#[test]
fn a_slice_that_was_never_offered_is_refused() {
    let made = Handmade::new(1, Some(100), &[100, 100, 30]);
    let file = made.open().unwrap();
    for (first, points) in [(0, 50), (50, 100), (100, 131), (230, 1), (u64::MAX, 2), (0, 231)] {
        let result = file.read(Slice { first, points }, &mut Vec::new());
        assert!(matches!(result, Err(LasError::NotASlice { .. })), "{first} {points}");
    }
}

#[test]
fn a_stream_that_breaks_tells_every_thread_and_can_start_over() {
    let mut made = Handmade::new(1, Some(100), &[100, 100, 30]);
    made.set_table_at(-1);
    made.bytes.truncate(made.points_at + (made.table_at - made.points_at) * 2 / 3);
    let file = made.open().unwrap();
    let slices = file.slices(50);
    assert_eq!(slices.len(), 5);
    let failed = std::thread::scope(|scope| {
        let threads: Vec<_> =
            slices.iter().map(|slice| scope.spawn(|| file.read(*slice, &mut Vec::new()).is_err())).collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect::<Vec<_>>()
    });
    assert_eq!(failed[0..2], [false, false]);
    assert_eq!(failed[3..5], [true, true]);
    for _ in 0..2 {
        let mut records = Vec::new();
        file.read(slices[0], &mut records).unwrap();
        assert!(records == made.records[..50 * 28]);
        let error = file.read(slices[4], &mut records).unwrap_err();
        assert!(matches!(error, LasError::Cut { points: 230, .. }), "{error}");
    }
}

#[test]
fn a_chunk_too_large_to_decode_whole_is_read_in_parts() {
    // 20 000 records of 4 000 extra bytes are 80 MB; twice that is too much.
    let folder = tempfile::tempdir().unwrap();
    let extra = vec![field("blob", Scalar::U8, 3000, 20)];
    let options = LasOptions { extra, ..options(0, true) };
    let path = folder.path().join("wide.laz");
    let mut writer = LasWriter::create(&path, &options).unwrap();
    let record = vec![7; 3020];
    for _ in 0..45_000 {
        writer.write(&record).unwrap();
    }
    writer.finish().unwrap();
    let file = LasFile::open(&path).unwrap();
    let slices = file.slices(40_000);
    assert_eq!(slices[0].points, 40_000);
    let mut records = Vec::new();
    for slice in slices {
        file.read(slice, &mut records).unwrap();
        assert!(records.chunks_exact(3020).all(|r| r == record));
    }
}

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
        (24, &[1, 5], "not known yet"),
        (94, &[10, 0], "10 bytes long"),
        (94, &[255, 255], "65535 bytes long"),
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
