//! Damaged LAS and LAZ: whatever bytes a file has, reading it ends soon, in
//! points or in an error, and takes no memory that the file does not justify.
//!
//! One test, alone in its process, because the limit on memory is the process's:
//! an allocation beyond it ends the test.

use std::path::Path;
use std::time::{Duration, Instant};

use lodestone::format::las::{LasError, LasFile, LasOptions, LasWriter, Vlr, record_length};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Bytes that reading may take on top of what the process has.
const MOST_MEMORY: u64 = 256 << 20;
const MOST_TIME: Duration = Duration::from_secs(10);

/// Points read and the error that ended it, if any.
fn read(path: &Path) -> (u64, Option<LasError>) {
    let start = Instant::now();
    let result = (|| {
        let file = LasFile::open(path).map_err(|e| (0, e))?;
        let (mut points, mut records) = (0, Vec::new());
        for slice in file.slices(100_000) {
            file.read(slice, &mut records).map_err(|e| (points, e))?;
            points += u64::from(slice.points);
        }
        assert_eq!(points, file.header().points);
        Ok(points)
    })();
    assert!(start.elapsed() < MOST_TIME, "it took {:?}", start.elapsed());
    match result {
        Ok(points) => (points, None),
        Err((points, error)) => {
            assert!(!error.to_string().is_empty());
            (points, Some(error))
        }
    }
}

/// A small good file, as bytes.
fn good(folder: &Path, point_format: u8, compressed: bool) -> Vec<u8> {
    let path = folder.join("good");
    let options = LasOptions {
        version: (1, 4),
        point_format,
        scale: [0.001; 3],
        offset: [0.0; 3],
        compressed,
        extra: Vec::new(),
        crs: vec![Vlr::wkt("PROJCS[\"somewhere\"]")],
        software: "Lodestone".to_string(),
    };
    let length = record_length(point_format).unwrap();
    let mut records = vec![0; 700 * length];
    for (i, record) in records.chunks_exact_mut(length).enumerate() {
        for (j, byte) in record.iter_mut().enumerate() {
            *byte = (i * 7 + j * i / 3) as u8;
        }
    }
    let mut writer = LasWriter::create(&path, &options).unwrap();
    writer.write(&records).unwrap();
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

fn limit_memory() {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmSize:")).unwrap();
    let kilobytes: u64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    let maximum = getrlimit(Resource::As).maximum;
    setrlimit(Resource::As, Rlimit { current: Some(kilobytes * 1024 + MOST_MEMORY), maximum }).unwrap();
}

#[test]
fn no_bytes_make_reading_panic_hang_or_take_memory() {
    let folder = tempfile::tempdir().unwrap();
    // Before the limit: the writer's threads take address space of their own.
    let originals: Vec<Vec<u8>> = [(0, false), (3, true), (5, true), (6, false), (7, true), (10, true)]
        .into_iter()
        .map(|(point_format, compressed)| good(folder.path(), point_format, compressed))
        .collect();
    limit_memory();
    // What laz panics over is caught; its messages would only be noise.
    std::panic::set_hook(Box::new(|_| {}));

    let mut outcomes: Vec<Result<(), String>> = Vec::new();
    let path = folder.path().join("bad");
    for original in &originals {
        std::fs::write(&path, original).unwrap();
        assert_eq!(read(&path).0, 700);
    }
    let cases = std::env::var("LODESTONE_FUZZ_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(400);
    let config = Config { cases, failure_persistence: None, ..Config::default() };

    // Flipped bytes: often in the header, whose numbers decide most.
    let flips = proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>(), any::<bool>()), 1..6);
    let which = 0..originals.len();
    let outcome = TestRunner::new(config.clone()).run(&(which.clone(), flips), |(which, flips)| {
        let mut bytes = originals[which].clone();
        let whole = bytes.len();
        for (at, value, front) in flips {
            bytes[at.index(if front { 480 } else { whole })] = value;
        }
        std::fs::write(&path, &bytes).unwrap();
        read(&path);
        Ok(())
    });
    outcomes.push(outcome.map_err(|e| e.to_string()));

    // Whole numbers that are extreme, at every place of the header.
    let extremes =
        prop::sample::select(vec![0u64, 1, 0x7FFF_FFFF, 0xFFFF_FFFF, u64::MAX >> 1, u64::MAX, 1 << 40]);
    let outcome =
        TestRunner::new(config.clone()).run(&(which.clone(), 24usize..480, 1usize..=8, extremes), |case| {
            let (which, at, width, value) = case;
            let mut bytes = originals[which].clone();
            let end = (at + width).min(bytes.len());
            bytes[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
            std::fs::write(&path, &bytes).unwrap();
            read(&path);
            Ok(())
        });
    outcomes.push(outcome.map_err(|e| e.to_string()));

    // Cut files never read as whole ones.
    let outcome =
        TestRunner::new(config.clone()).run(&(which, any::<prop::sample::Index>()), |(which, end)| {
            let original = &originals[which];
            let end = end.index(original.len());
            std::fs::write(&path, &original[..end]).unwrap();
            let (points, error) = read(&path);
            prop_assert!(error.is_some() || points == 700);
            if let Some(LasError::Cut { readable, points, .. }) = error {
                prop_assert!(readable < points);
            }
            Ok(())
        });
    outcomes.push(outcome.map_err(|e| e.to_string()));

    // Noise, with and without the right first bytes.
    let noise = proptest::collection::vec(any::<u8>(), 0..3000);
    let outcome = TestRunner::new(config).run(&(noise, any::<bool>()), |(mut bytes, signature)| {
        if signature && bytes.len() > 26 {
            bytes[..4].copy_from_slice(b"LASF");
            (bytes[24], bytes[25]) = (1, bytes[25] % 5);
        }
        std::fs::write(&path, &bytes).unwrap();
        read(&path);
        Ok(())
    });
    outcomes.push(outcome.map_err(|e| e.to_string()));

    let _ = std::panic::take_hook();
    assert_eq!(outcomes, vec![Ok(()); 4]);
    if let Some(data) = std::env::var_os("LODESTONE_DATA") {
        for entry in std::fs::read_dir(Path::new(&data).join("malformed")).unwrap() {
            let path = entry.unwrap().path();
            let (points, error) = read(&path);
            eprintln!("{}: {points} points, {error:?}", path.display());
        }
    }
}
