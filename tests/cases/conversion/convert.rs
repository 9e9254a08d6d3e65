//! Laws of a conversion: nothing lost, the same bytes whatever the means, and
//! nothing left behind where it fails.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::common::{
    all_records, context, convert, listing, octree_bytes, options_of, request, surface, write_las,
};
use lodestone::convert::options::{Encoding, Options, Sampling};
use lodestone::convert::run;
use lodestone::format::las::record_length;
use lodestone::platform::disk::Disk;
use proptest::prelude::*;

/// Positions and the bytes behind them that every format keeps as they are.
fn positions(records: &[u8], length: usize) -> Vec<[u8; 14]> {
    let mut all: Vec<[u8; 14]> = records.chunks_exact(length).map(|r| r[..14].try_into().unwrap()).collect();
    all.sort_unstable();
    all
}

fn octree_positions(folder: &Path) -> Vec<[u8; 14]> {
    let (metadata, nodes) = all_records(folder);
    let size = metadata.schema().unwrap().record_size();
    let mut all: Vec<[u8; 14]> = nodes.iter().flat_map(|(_, records)| positions(records, size)).collect();
    all.sort_unstable();
    all
}

#[test]
fn the_same_bytes_whatever_the_threads_and_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("surface.laz");
    let records = surface(3, 700_000, 1);
    write_las(&input, &options_of(3, true), &records);
    for sampling in [Sampling::Poisson, Sampling::Random] {
        let options = Options { sampling, name: Some("surface".into()), ..Options::default() };
        let mut first = None;
        for (threads, memory) in [(1, 4 << 30), (2, 4 << 30), (7, 4 << 30), (2, 60 << 20), (1, 45 << 20)] {
            let output = folder.path().join(format!("{sampling:?}-{threads}-{memory}"));
            let outcome = run::convert(
                &request(std::slice::from_ref(&input), &output, &options),
                &context(folder.path(), threads, memory),
            )
            .unwrap();
            assert_eq!(outcome.scratch_bytes > 0, memory < 100 << 20, "scratch only where memory is short");
            assert!(outcome.chunks > 1);
            let bytes = octree_bytes(&output);
            assert!(
                first.get_or_insert_with(|| bytes.clone()) == &bytes,
                "{threads} threads, {memory} bytes"
            );
        }
        let output = folder.path().join(format!("{sampling:?}-1-{}", 4u64 << 30));
        assert!(octree_positions(&output) == positions(&records, 34));
    }
}

#[test]
fn tiles_of_mixed_formats_scales_and_offsets_become_one_octree() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    for format in 0..=10u8 {
        let mut options = options_of(format, format % 2 == 1);
        options.scale = if format % 3 == 0 { [0.001; 3] } else { [0.01; 3] };
        options.offset[0] += f64::from(format) * 50.5;
        write_las(&tiles.join(format!("{format}.las")), &options, &surface(format, 3000, u64::from(format)));
    }
    for encoding in [Encoding::Default, Encoding::Brotli] {
        let output = folder.path().join(format!("{encoding:?}"));
        let options = Options { encoding, ..Options::default() };
        let outcome = convert(std::slice::from_ref(&tiles), &output, &options).unwrap();
        assert!(outcome.exact);
        assert_eq!((outcome.files, outcome.points_out), (11, 33_000));
        let (metadata, nodes) = all_records(&output);
        assert_eq!(nodes.iter().map(|(n, _)| u64::from(n.points)).sum::<u64>(), 33_000);
        assert_eq!(metadata.scale, [0.001; 3]);
        let names: Vec<&str> = metadata.attributes.iter().map(|a| a.name.as_str()).collect();
        for name in ["scan angle", "scan angle rank", "nir", "scanner channel", "x(t)", "gps-time", "rgb"] {
            assert!(names.contains(&name), "{name} is missing from {names:?}");
        }
    }
}

#[test]
fn only_the_wanted_attributes() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("a.las");
    write_las(&input, &options_of(7, false), &surface(7, 500, 3));
    let wanted = |names: &[&str]| Options {
        attributes: names.iter().map(|n| n.to_string()).collect(),
        ..Options::default()
    };
    convert(std::slice::from_ref(&input), &folder.path().join("rgb"), &wanted(&["RGB"])).unwrap();
    let (metadata, _) = all_records(&folder.path().join("rgb"));
    assert_eq!(metadata.attributes.len(), 2);
    assert!(metadata.generator.unwrap().left_out.contains(&"intensity".to_string()));
    let error = convert(&[input], &folder.path().join("no"), &wanted(&["colour"])).unwrap_err();
    assert!(error.to_string().contains("colour") && error.to_string().contains("rgb"), "{error}");
}

#[test]
fn bad_input_is_named_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let good = folder.path().join("good.las");
    write_las(&good, &options_of(0, false), &surface(0, 1000, 5));
    let bytes = fs::read(&good).unwrap();
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("empty.las", Vec::new()),
        ("text.las", b"this is no point cloud, whatever its name says".to_vec()),
        ("cut.las", bytes[..bytes.len() - 7].to_vec()),
        ("header-only.las", bytes[..227].to_vec()),
    ];
    fs::create_dir(folder.path().join("out")).unwrap();
    for (name, content) in cases {
        let input = folder.path().join(name);
        fs::write(&input, content).unwrap();
        // Beside a good tile, too: one bad tile fails the set.
        for inputs in [vec![input.clone()], vec![good.clone(), input.clone()]] {
            let error = convert(&inputs, &folder.path().join("out/octree"), &Options::default()).unwrap_err();
            assert!(error.to_string().contains(name), "{error}");
            assert!(!error.retry_can_help() || name != "text.las");
        }
        assert!(listing(&folder.path().join("out")).is_empty());
    }
    let error = convert(&[folder.path().join("gone.las")], &folder.path().join("out/o"), &Options::default());
    assert!(error.unwrap_err().to_string().contains("gone.las"));
}

#[test]
fn an_old_octree_stays_until_the_new_one_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_las(&at("old.las"), &options_of(1, false), &surface(1, 2000, 7));
    write_las(&at("new.las"), &options_of(1, false), &surface(1, 3000, 8));
    fs::create_dir(at("out")).unwrap();
    let output = at("out/octree");
    convert(&[at("old.las")], &output, &Options::default()).unwrap();
    let old = octree_bytes(&output);

    let refused = convert(&[at("new.las")], &output, &Options::default()).unwrap_err();
    assert!(refused.to_string().contains("exists already"), "{refused}");

    // A disk that fails at each of its operations in turn.
    let mut failures = 0;
    for nth in 0.. {
        let mut means = context(&at("out"), 2, 1 << 30);
        means.disk = Disk::failing_from(nth, io::ErrorKind::StorageFull);
        let mut replace = request(&[at("new.las")], &output, &Options::default());
        replace.overwrite = true;
        match run::convert(&replace, &means) {
            Ok(_) => break,
            Err(error) => {
                failures += 1;
                assert!(error.retry_can_help(), "{error}");
                assert!(error.to_string().contains("free some room"), "{error}");
                let now = octree_bytes(&output);
                // The exchange itself may be done when its sync fails.
                assert!(now == old || nth > 8, "fault {nth} touched the old octree");
                assert_eq!(listing(&at("out")), ["octree"]);
            }
        }
    }
    assert!(failures >= 8, "{failures} operations could fail");
    assert!(octree_bytes(&output) != old);
}

#[test]
fn a_stopped_conversion_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("a.las");
    write_las(&input, &options_of(0, false), &surface(0, 1000, 5));
    fs::create_dir(folder.path().join("out")).unwrap();
    let means = context(&folder.path().join("out"), 2, 1 << 30);
    means.cancel.cancel();
    let error = run::convert(&request(&[input], &folder.path().join("out/o"), &Options::default()), &means)
        .unwrap_err();
    assert!(error.is_cancelled());
    assert!(listing(&folder.path().join("out")).is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// Whatever the cloud (crowds, lines, single points, the ends of int32),
    /// what goes in comes out.
    #[test]
    fn every_point_survives(
        points in proptest::collection::vec(
            prop_oneof![
                (any::<i32>(), any::<i32>(), any::<i32>()),
                (0i32..300, 0i32..300, 0i32..3),
                Just((5, 5, 5)),
            ], 1..300),
        repeat in 1usize..60,
        random in any::<bool>(),
        brotli in any::<bool>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("a.las");
        let length = record_length(0).unwrap();
        let mut records = Vec::new();
        for i in 0..points.len() * repeat {
            let (x, y, z) = points[i % points.len()];
            let start = records.len();
            for c in [x, y, z.wrapping_add((i / points.len()) as i32)] {
                records.extend_from_slice(&c.to_le_bytes());
            }
            records.resize(start + length, i as u8);
        }
        write_las(&input, &options_of(0, false), &records);
        let options = Options {
            sampling: if random { Sampling::Random } else { Sampling::Poisson },
            encoding: if brotli { Encoding::Brotli } else { Encoding::Default },
            ..Options::default()
        };
        let output = folder.path().join("octree");
        let outcome = convert(&[input], &output, &options).unwrap();
        prop_assert!(outcome.exact);
        let (metadata, nodes) = all_records(&output);
        let size = metadata.schema().unwrap().record_size();
        // The octree's offset may have moved by whole units.
        let shift: [i64; 3] = std::array::from_fn(|a| {
            ((metadata.offset[a] - options_of(0, false).offset[a]) / 0.01).round() as i64
        });
        let place = |r: &[u8], shift: [i64; 3]| -> [i64; 3] {
            std::array::from_fn(|a| {
                i64::from(i32::from_le_bytes(r[4 * a..4 * a + 4].try_into().unwrap())) + shift[a]
            })
        };
        let mut got: Vec<_> = nodes.iter()
            .flat_map(|(_, r)| r.chunks_exact(size).map(|r| (place(r, shift), r[12])).collect::<Vec<_>>())
            .collect();
        let mut expected: Vec<_> =
            records.chunks_exact(length).map(|r| (place(r, [0; 3]), r[12])).collect();
        got.sort_unstable();
        expected.sort_unstable();
        prop_assert!(got == expected);
    }
}

#[test]
fn real_tile_sets_give_the_same_bytes_in_and_out_of_core() {
    let Some(data) = crate::common::data() else { return };
    let folder = tempfile::tempdir().unwrap();
    for set in ["tiles/bcts", "tiles/ign50m", "tiles/lion_potree_laz_nodes"] {
        let inputs: Vec<PathBuf> = vec![data.join(set)];
        let options = Options { name: Some("set".into()), ..Options::default() };
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        run::convert(&request(&inputs, &a, &options), &context(folder.path(), 2, 2 << 30)).unwrap();
        run::convert(&request(&inputs, &b, &options), &context(folder.path(), 1, 60 << 20)).unwrap();
        assert!(octree_bytes(&a) == octree_bytes(&b), "{set}");
        fs::remove_dir_all(&a).unwrap();
        fs::remove_dir_all(&b).unwrap();
    }
}
