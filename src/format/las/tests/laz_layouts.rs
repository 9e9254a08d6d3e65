//! LAZ files that no writer of ours makes: chunks of many sizes, tables at the
//! end, wrong or missing, streams that break.

use super::super::ReadMode;
use super::super::explore::MOST_CHUNKS_TO_COUNT;
use super::handmade::*;
use super::*;

/// LAZ with a chunk for each node, and two records more.
#[test]
fn copc_is_read_as_the_laz_that_it_is() {
    for point_format in [6, 7, 8] {
        let chunks = [700, 1, 3, 50];
        let made = Handmade::new(point_format, None, &chunks).with_copc();
        let file = made.open().unwrap();
        assert!(file.header().notes.is_empty(), "{:?}", file.header().notes);
        assert!(file.is_complete());
        assert_eq!(file.slices(1).len(), chunks.len());
        assert!(read_all(&file, 150).unwrap() == made.records);
    }
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
            assert!(file.is_complete());
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
    type Spoil = fn(&mut Handmade);
    let spoil: [(&str, Spoil); 4] = [
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
            assert!(!file.header().notes.is_empty() && !file.is_complete());
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
fn of_a_cut_laz_file_in_tiny_chunks_only_the_front_is_tried_beforehand() {
    let most = MOST_CHUNKS_TO_COUNT as usize;
    let whole = Handmade::new(1, Some(1), &vec![1; most + 50]);
    let length = (whole.table_at - whole.points_at - 8) / (most + 50);
    let cut_after = |chunks: usize| {
        let mut bytes = whole.bytes.clone();
        bytes.truncate(whole.points_at + 8 + length * chunks);
        Handmade { bytes, records: Vec::new(), ..whole }.open()
    };
    let readable = |result: Result<_, LasError>| match result {
        Err(LasError::Cut { readable, .. }) => readable as usize,
        other => panic!("{other:?}"),
    };
    assert_eq!(readable(cut_after(most - 30).map(drop)), most - 30);
    // Behind that reading finds the cut; where there is none, it finds all.
    let file = cut_after(most + 30).unwrap();
    assert_eq!(readable(read_all(&file, 100).map(drop)), most + 30);
    assert!(read_all(&cut_after(most + 50).unwrap(), 100).unwrap() == whole.records);
}

#[test]
fn a_laz_file_that_is_cut_behind_its_last_point_has_them_all() {
    for point_format in [1, 7] {
        let mut made = Handmade::new(point_format, Some(100), &[100, 100, 30]);
        made.bytes.truncate(made.table_at + 5);
        let file = made.open().unwrap();
        assert_eq!(file.header().points, 230);
        assert_eq!(file.header().notes.len(), 1);
        assert!(read_all(&file, 100).unwrap() == made.records);
    }
}

#[test]
fn a_header_that_counts_wrong_in_laz_is_corrected_or_refused() {
    for (point_format, place) in [(7, 247), (1, 107)] {
        let open = |said: u32| {
            let mut made = Handmade::new(point_format, Some(100), &[100, 30]);
            made.bytes[place..place + 4].copy_from_slice(&said.to_le_bytes());
            (made.open(), made.records)
        };
        // Layered chunks count themselves; of the others the last is decoded, and
        // ends where its bytes do.
        for said in [0, 77, 100] {
            let (file, records) = open(said);
            let file = file.unwrap();
            assert_eq!(file.header().points, 130, "{said}");
            assert_eq!(file.header().notes.len(), 1, "{:?}", file.header().notes);
            assert!(!file.is_complete());
            assert!(read_all(&file, 100).unwrap() == records);
        }
        let (file, _) = open(201);
        assert!(matches!(file, Err(LasError::Cut { readable: 130, points: 201, .. })), "{file:?}");
        assert!(matches!(open(4_000_000_000).0, Err(LasError::Header { .. })));
    }
}

/// Entries that the table lacks, has too many of, or has wrong.
#[test]
fn a_chunk_table_that_lacks_chunks_loses_none() {
    for (point_format, fixed, listed) in [
        (1, Some(100), 1),
        (1, Some(100), 2),
        (1, Some(100), 0),
        (7, Some(100), 1),
        (7, None, 2),
        (1, None, 2),
    ] {
        let mut made = Handmade::new(point_format, fixed, &[100, 100, 30]);
        made.list_only(fixed, listed);
        let file = made.open().unwrap_or_else(|e| panic!("{point_format} {fixed:?} {listed}: {e}"));
        assert_eq!(file.header().points, 230, "{point_format} {fixed:?} {listed}");
        assert!(!file.header().notes.is_empty() && !file.is_complete());
        for points in [7, 100, 10_000] {
            assert!(read_all(&file, points).unwrap() == made.records, "{point_format} {fixed:?} {listed}");
        }
    }
    // Chunks of any size of which two are not listed are nowhere.
    let mut made = Handmade::new(1, None, &[100, 100, 30]);
    made.list_only(None, 1);
    assert!(read_all(&made.open().unwrap(), 100).is_err());
}

/// The count is that of the chunks listed, and there are more.
#[test]
fn chunks_that_neither_count_nor_table_know_contradict() {
    for (point_format, place) in [(1, 107), (7, 247)] {
        let mut made = Handmade::new(point_format, Some(100), &[100, 100, 30]);
        made.list_only(Some(100), 1);
        made.bytes[place..place + 4].copy_from_slice(&100u32.to_le_bytes());
        match made.open() {
            Ok(file) => assert_eq!(file.header().points, 230, "{point_format}"),
            Err(LasError::Contradiction { said: 100, there, .. }) => assert!((230..=235).contains(&there)),
            Err(error) => panic!("{error}"),
        }
    }
}

/// A stale count among bytes that go on.
#[test]
fn a_stream_is_not_left_before_its_points_end() {
    for said in [0u32, 120] {
        let mut made = Handmade::new(1, Some(100), &[100, 100, 30]);
        made.set_table_at(-1);
        made.bytes.truncate(made.table_at - 9);
        made.bytes[107..111].copy_from_slice(&said.to_le_bytes());
        let error = made.open().unwrap_err();
        let LasError::Contradiction { said: told, there, .. } = error else { panic!("{error}") };
        assert_eq!(told, u64::from(said));
        assert!((220..230).contains(&there), "{there}");
        let file = made.open_as(ReadMode::Readable).unwrap();
        assert_eq!(file.header().points, there);
        let length = 28 * there as usize;
        assert!(read_all(&file, 100).unwrap() == made.records[..length], "{said}");
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
    // More chunks than are tried beforehand.
    let all = MOST_CHUNKS_TO_COUNT as usize + 250;
    let mut made = Handmade::new(1, Some(1), &vec![1; all]);
    made.set_table_at(-1);
    made.bytes.truncate(made.table_at - 28 * 120);
    let file = made.open().unwrap();
    let slices = file.slices(500);
    assert_eq!(slices.len(), 3);
    let failed = std::thread::scope(|scope| {
        let threads: Vec<_> =
            slices.iter().map(|slice| scope.spawn(|| file.read(*slice, &mut Vec::new()).is_err())).collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect::<Vec<_>>()
    });
    assert_eq!(failed, [false, false, true]);
    for _ in 0..2 {
        let mut records = Vec::new();
        file.read(slices[0], &mut records).unwrap();
        assert!(records == made.records[..500 * 28]);
        let error = file.read(slices[2], &mut records).unwrap_err();
        assert!(matches!(error, LasError::Cut { points, .. } if points == all as u64), "{error}");
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

/// Found by fuzzing: what the front of such a stream says of its layers was prepared for
/// in memory, and nothing had held it against the file.
#[test]
fn layers_without_chunks_are_refused() {
    for (point_format, fixed) in [(6, Some(100)), (7, None), (10, Some(100))] {
        let mut made = Handmade::new(point_format, fixed, &[100, 100, 30]);
        let laszip = made.points_at - laszip_length(&made.bytes[..made.points_at]);
        made.bytes[laszip..laszip + 2].copy_from_slice(&1u16.to_le_bytes());
        // The sizes of its layers, wherever they are looked for.
        let record = made.records.len() / 230;
        for start in [made.points_at, made.points_at + 8] {
            let mut front = made.bytes.clone();
            front[start + record + 4..start + record + 12]
                .copy_from_slice(&[0xFF, 0xFF, 0xFF, 0x2D].repeat(2));
            let spoiled = Handmade { bytes: front, records: Vec::new(), ..made };
            for reading in [ReadMode::Whole, ReadMode::Strict, ReadMode::Readable] {
                let error = spoiled.open_as(reading).unwrap_err().to_string();
                assert!(error.contains("only chunks have"), "format {point_format}: {error}");
            }
        }
    }
}

#[test]
fn sizes_of_layers_beyond_the_file_are_an_error() {
    for (point_format, fixed) in [(6, Some(100)), (7, None), (8, Some(100)), (10, None)] {
        for with_table in [true, false] {
            let mut made = Handmade::new(point_format, fixed, &[100, 100, 30]);
            if !with_table {
                made.bytes.truncate(made.table_at);
                made.set_table_at(-1);
            }
            let size_at = made.points_at + 8 + made.records.len() / 230 + 4 + 4;
            made.bytes[size_at..size_at + 4].copy_from_slice(&0x2E00_0000u32.to_le_bytes());
            // Whole chunks, and portions of them.
            for most in [1 << 20, 1000] {
                let Ok(mut file) = made.open() else { continue };
                file.bound_slices(most);
                assert!(read_all(&file, 10_000).is_err(), "format {point_format}");
            }
        }
    }
}
