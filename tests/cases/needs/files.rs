//! The pains of files, each as a test: headers lie, formats and attributes come
//! in every make, names in every alphabet (`docs/needs.md` has the whole list;
//! what is wrong with single records is in `src/format/las/tests`).

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use crate::common::judge::{Held, IN_CORE, field, held, held_with, patch, write_points};
use crate::common::{convert, octree_bytes, options_of, surface, write_las};
use lodestone::convert::options::Options;
use lodestone::format::las::{LasOptions, Vlr, record_length};
use lodestone::format::potree::MetadataAttribute;
use lodestone::octree::attribute::{ExtraField, Scalar};

/// Where LAS 1.4 keeps what is lied about (R15, table 3).
const LEGACY_COUNT: usize = 107;
const EVLR_START: usize = 235;
const COUNT: usize = 247;
const VLRS: usize = 100;
/// The first variable length record of a 1.4 file.
const FIRST_VLR: usize = 375;

fn of(options: &LasOptions, records: &[u8], folder: &Path) -> Held {
    let input = folder.join("cloud.las");
    write_las(&input, options, records);
    held(&input, &folder.join("octree"))
}

fn attribute<'a>(held: &'a Held, name: &str) -> &'a MetadataAttribute {
    let found = held.metadata.attributes.iter().find(|attribute| attribute.name == name);
    found.unwrap_or_else(|| panic!("{name} is missing"))
}

fn modern(format: u8) -> LasOptions {
    LasOptions { version: (1, 4), ..options_of(format, false) }
}

/// Sets bytes of every record.
fn with(mut records: Vec<u8>, format: u8, change: impl Fn(usize, &mut [u8])) -> Vec<u8> {
    let records_in = records.chunks_exact_mut(record_length(format).unwrap());
    records_in.enumerate().for_each(|(number, record)| change(number, record));
    records
}

#[test]
fn a_header_that_counts_too_few_or_none_loses_no_point_and_too_many_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    let records = surface(1, 5000, 1);
    for said in [4999u32, 1, 0] {
        write_las(&input, &options_of(1, false), &records);
        patch(&input, &[(LEGACY_COUNT, &said.to_le_bytes())]);
        let held = held(&input, &folder.path().join("octree"));
        assert_eq!(held.outcome.points_in, 5000, "the header said {said}");
        assert!(!held.outcome.repairs.is_empty(), "and it is told");
    }
    write_las(&input, &options_of(1, false), &records);
    patch(&input, &[(LEGACY_COUNT, &5001u32.to_le_bytes())]);
    let error = convert(&[input], &folder.path().join("o"), &Options::default()).unwrap_err().to_string();
    assert!(error.contains("5000 of its 5001 points") && error.contains("cloud.las"), "{error}");
}

/// The counts by return are never believed, and it is said where they lie.
#[test]
fn wrong_counts_by_return_lose_no_point_and_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (format, place) in [(1, 111), (6, 255)] {
        write_las(&at("cloud.las"), &options_of(format, false), &surface(format, 5_000, 1));
        let told =
            |held: &Held| held.outcome.repairs.iter().filter(|note| note.contains("by return")).count();
        assert_eq!(told(&held(&at("cloud.las"), &at("octree"))), 0, "format {format}: they are right");
        patch(&at("cloud.las"), &[(place, &[7, 7])]);
        let held = held(&at("cloud.las"), &at("octree"));
        assert_eq!((told(&held), held.outcome.points_in), (1, 5_000), "{:?}", held.outcome.repairs);
    }
}

#[test]
fn of_the_legacy_count_and_that_of_1_4_the_true_one_counts() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    let lies = [(4000u32, 5000u64), (5000, 4000), (0, 5000), (5000, 0), (9000, 5000)];
    for ((legacy, count), format) in lies.into_iter().flat_map(|lie| [(lie, 1), (lie, 6)]) {
        write_las(&input, &modern(format), &surface(format, 5000, 1));
        patch(&input, &[(LEGACY_COUNT, &legacy.to_le_bytes()), (COUNT, &count.to_le_bytes())]);
        let held = held(&input, &folder.path().join("octree"));
        assert_eq!(held.outcome.points_in, 5000, "legacy {legacy}, 1.4 {count}");
        // Only that of old may be left out.
        let told =
            held.outcome.repairs.iter().filter(|repair| repair.contains("two counts of points")).count();
        assert_eq!(told, usize::from(legacy > 0), "legacy {legacy}, 1.4 {count}: {:?}", held.outcome.repairs);
    }
}

#[test]
fn laz_without_a_usable_chunk_table_is_whole_and_cut_inside_a_chunk_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.laz");
    let octree = folder.path().join("octree");
    write_points(&input, [0.01; 3], [0.0; 3], &field(120_000, [0; 3], 400_000));
    let whole = fs::read(&input).unwrap();
    held_with(&input, &octree, &Options::default(), IN_CORE);
    let right = octree_bytes(&octree);
    let points_at = u32::from_le_bytes(whole[96..100].try_into().unwrap()) as usize;
    let table_at = i64::from_le_bytes(whole[points_at..points_at + 8].try_into().unwrap()) as usize;
    let pointers = [-1i64, 0, 7, whole.len() as i64 + 5, table_at as i64 + 1, i64::MIN];
    let mut damaged: Vec<Vec<u8>> = pointers
        .iter()
        .map(|at| [&whole[..points_at], &at.to_le_bytes(), &whole[points_at + 8..]].concat())
        .collect();
    damaged.push([&whole[..table_at], &[0xAA; 40][..]].concat());
    damaged.push([&whole[..table_at], &vec![0; whole.len() - table_at][..]].concat());
    damaged.push(whole[..table_at].to_vec());
    for (number, bytes) in damaged.into_iter().enumerate() {
        fs::write(&input, bytes).unwrap();
        held_with(&input, &octree, &Options::default(), IN_CORE);
        assert!(octree_bytes(&octree) == right, "chunk table {number}");
    }
    fs::write(&input, &whole[..points_at + (table_at - points_at) / 2]).unwrap();
    let error = convert(&[input], &folder.path().join("o"), &Options::default()).unwrap_err();
    assert!(error.to_string().contains("of its 120000 points"), "{error}");
    assert!(!error.retry_can_help() && !folder.path().join("o").exists());
}

#[test]
fn records_that_are_longer_than_described_keep_their_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    let extra = ExtraField {
        name: "height".into(),
        description: "above ground".into(),
        scalar: Scalar::U32,
        elements: 1,
        position: record_length(6).unwrap(),
        scale: Vec::new(),
        offset: Vec::new(),
    };
    let options = LasOptions { extra: vec![extra], ..modern(6) };
    let length = record_length(6).unwrap() + 4;
    let records: Vec<u8> = surface(7, 3000, 1).chunks_exact(36).flat_map(|r| &r[..length]).copied().collect();
    let data = FIRST_VLR + 54;
    let changes: [&[(usize, &[u8])]; 5] = [
        &[],
        // Nothing describes them any more.
        &[(FIRST_VLR + 2, b"NOBODY_SPEC")],
        // Eight bytes where the record has four.
        &[(data + 2, &[10])],
        // A name that is no UTF-8, and a count that is not so.
        &[(data + 4, &[0xff, 0xfe, b'h']), (VLRS, &[9])],
        &[(VLRS, &[0]), (EVLR_START, &[77])],
    ];
    for changes in changes {
        write_las(&input, &options, &records);
        patch(&input, changes);
        let held = held(&input, &folder.path().join("octree"));
        let own = held.metadata.attributes.last().unwrap();
        assert_eq!((own.size, held.outcome.points_out), (4, 3000), "{own:?} {changes:?}");
        assert!(own.max.iter().any(|value| *value > 0.0), "{own:?}");
    }
}

#[test]
fn every_format_alone_and_all_together_come_out_as_they_went_in() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    for format in 0..=10 {
        for ending in ["las", "laz"] {
            let input = tiles.join(format!("{format}.{ending}"));
            let records = surface(format, 2000, u64::from(format));
            write_las(&input, &options_of(format, ending == "laz"), &records);
            held(&input, &folder.path().join("octree"));
        }
    }
    let together = held(&tiles, &folder.path().join("octree"));
    assert_eq!(together.outcome.points_out, 44_000);
    // The descriptive fields of waveform packets are attributes like others.
    attribute(&together, "x(t)");
}

#[test]
fn all_classes_and_all_flags_stay() {
    let folder = tempfile::tempdir().unwrap();
    let records = with(surface(6, 4096, 1), 6, |number, record| {
        record[15] = (number >> 8) as u8 | (number as u8) << 4; // flags, channel, direction, edge
        record[16] = number as u8;
    });
    let held = of(&modern(6), &records, folder.path());
    let classes = attribute(&held, "classification").histogram.clone().unwrap();
    assert_eq!(classes, [16; 256]);
    // The legacy formats have five bits for the class and three for flags.
    let records = with(surface(1, 4096, 1), 1, |number, record| record[15] = number as u8);
    of(&options_of(1, false), &records, folder.path());
}

#[test]
fn extra_bytes_of_64_bits_and_scaled_ones_stay_the_integers_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let standard = record_length(6).unwrap();
    let mut position = standard;
    let mut field = |name: &str, scalar: Scalar, scale: &[f64]| {
        let at = position;
        position += scalar.size();
        let (description, offset) = (String::new(), scale.iter().map(|_| 100.0).collect());
        ExtraField {
            name: name.into(),
            description,
            scalar,
            elements: 1,
            position: at,
            scale: scale.to_vec(),
            offset,
        }
    };
    let extra = vec![
        field("identity", Scalar::U64, &[]),
        field("change", Scalar::I64, &[]),
        field("range", Scalar::I16, &[0.001]),
        field("doubt", Scalar::F64, &[]),
    ];
    let options = LasOptions { extra, ..modern(6) };
    let records: Vec<u8> = surface(6, 3000, 1)
        .chunks_exact(standard)
        .enumerate()
        .flat_map(|(number, record)| {
            let mut record = record.to_vec();
            record.extend_from_slice(&(u64::MAX - number as u64).to_le_bytes());
            record.extend_from_slice(&(i64::MIN + number as i64).to_le_bytes());
            record.extend_from_slice(&(number as i16 - 1500).to_le_bytes());
            record.extend_from_slice(&(number as f64 / 7.0).to_le_bytes());
            record
        })
        .collect();
    let held = of(&options, &records, folder.path());
    let range = attribute(&held, "range");
    assert_eq!((range.min[0], range.max[0]), (-1500.0, 1499.0));
    assert_eq!((range.scale[0], range.offset[0]), (0.001, 100.0));
    assert_eq!(attribute(&held, "identity").size, 8);
    assert_eq!(attribute(&held, "doubt").max[0], 2999.0 / 7.0);
}

#[test]
fn colours_stay_what_they_are_dark_shallow_or_black() {
    let folder = tempfile::tempdir().unwrap();
    let colour = |records: Vec<u8>, of: fn(usize) -> u16| {
        with(records, 2, |number, record| {
            (0..3).for_each(|c| record[20 + 2 * c..][..2].copy_from_slice(&of(number).to_le_bytes()));
        })
    };
    type Brightness = fn(usize) -> u16;
    // Eight bits in sixteen; black for a long time, then bright; black throughout.
    let cases: [(Brightness, f64); 3] = [
        (|number| (number % 256) as u16, 255.0),
        (|number| if number < 19_000 { 0 } else { 65_535 }, 65_535.0),
        (|_| 0, 0.0),
    ];
    for (of_point, most) in cases {
        let held = of(&options_of(2, false), &colour(surface(2, 20_000, 1), of_point), folder.path());
        assert_eq!(attribute(&held, "rgb").max, [most; 3]);
        assert!(attribute(&held, "intensity").max[0] > 0.0);
    }
}

#[test]
fn a_gps_time_that_stands_still_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    for time in [0.0f64, 331_000_000.25] {
        let records =
            with(surface(1, 5000, 1), 1, |_, record| record[20..28].copy_from_slice(&time.to_le_bytes()));
        let held = of(&options_of(1, false), &records, folder.path());
        let times = attribute(&held, "gps-time");
        assert_eq!((times.min[0], times.max[0]), (time, time));
    }
}

#[test]
fn reference_systems_of_every_make_reach_the_octree() {
    let folder = tempfile::tempdir().unwrap();
    let records = surface(6, 500, 1);
    let compound = r#"COMPD_CS["both",PROJCS["flat"],VERT_CS["up"]]"#;
    let wkt2 = r#"PROJCRS["ETRS89 / UTM zone 32N",BASEGEOGCRS["ETRS89"]]"#;
    for wkt in [None, Some(compound), Some(wkt2)] {
        let options = LasOptions { crs: wkt.into_iter().map(Vlr::wkt).collect(), ..modern(6) };
        let held = of(&options, &records, folder.path());
        assert_eq!(held.metadata.crs, wkt.unwrap_or_default());
    }
    // Tiles that contradict each other: the first one's holds, and it is told.
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    for (name, wkt) in [("a.las", None), ("b.las", Some(compound)), ("c.las", Some(wkt2))] {
        let options = LasOptions { crs: wkt.into_iter().map(Vlr::wkt).collect(), ..modern(6) };
        write_las(&tiles.join(name), &options, &records);
    }
    let held = held(&tiles, &folder.path().join("octree"));
    assert_eq!(held.metadata.crs, compound);
    let told = held.outcome.notes.iter().filter(|note| note.contains("reference system differs"));
    assert_eq!(told.count(), 1, "{:?}", held.outcome.notes);
}

#[test]
fn names_in_any_alphabet_with_spaces_very_long_in_capitals_and_behind_links() {
    let folder = tempfile::tempdir().unwrap();
    let converts = |input: &Path, output: &Path| {
        held_with(input, output, &Options::default(), IN_CORE).outcome.points_out
    };
    let [good, packed] = ["good.las", "good.laz"].map(|name| folder.path().join(name));
    for path in [&good, &packed] {
        write_points(path, [0.01; 3], [0.0; 3], &field(1000, [0; 3], 9000));
    }
    let deep: PathBuf = (0..12).map(|_| "a folder with a name that is long ".repeat(6)).collect();
    let names = ["a b  c.las", "Ünïcødé 点群 мир.las", "🛰.LAS", "CLOUD.Las", "CLOUD.LAZ", "é.Laz"];
    let odd = ["-o.las", "@list.las", "'\"$(x).las"];
    let mut places: Vec<PathBuf> = names.iter().chain(&odd).map(PathBuf::from).collect();
    places.push(deep.join("cloud.las"));
    places.push(PathBuf::from(format!("{}.las", "n".repeat(251))));
    for (number, place) in places.iter().enumerate() {
        // A folder each, so that the set is this file.
        let set = folder.path().join(number.to_string());
        let input = set.join(place);
        fs::create_dir_all(input.parent().unwrap()).unwrap();
        let is_packed = place.extension().is_some_and(|end| end.eq_ignore_ascii_case("laz"));
        fs::copy(if is_packed { &packed } else { &good }, &input).unwrap();
        for named in [&set, &input] {
            // A name that begins with @ is a list, but for a folder's content.
            if named == &input && place.starts_with("@list.las") {
                continue;
            }
            assert_eq!(converts(named, &folder.path().join("octree")), 1000, "{named:?}");
        }
        // And as the name of the octree.
        let stem = place.file_stem().unwrap();
        assert_eq!(converts(&input, &set.join(stem)), 1000);
    }
    let links = folder.path().join("links");
    fs::create_dir(&links).unwrap();
    symlink(&good, links.join("link.las")).unwrap();
    symlink(&links, folder.path().join("to the folder")).unwrap();
    for named in [links.join("link.las"), links.clone(), folder.path().join("to the folder")] {
        assert_eq!(converts(&named, &folder.path().join("octree")), 1000, "{named:?}");
    }
    symlink("gone.las", links.join("dangling.las")).unwrap();
    let error = convert(&[links.join("dangling.las")], &folder.path().join("o"), &Options::default());
    let text = error.unwrap_err().to_string();
    assert!(text.contains("dangling.las"), "{text}");
}
