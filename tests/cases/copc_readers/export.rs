//! `lodestone export`: what went in comes out, from octrees and from COPC.

use std::fs;
use std::path::{Path, PathBuf};

use lodestone::format::las::LasFile;

use super::{convert, lodestone, noisy, run};

/// All records of a file, sorted.
fn records(path: &Path) -> (u8, usize, Vec<Vec<u8>>) {
    let file = LasFile::open(path).unwrap();
    let length = file.header().record_length;
    let (mut all, mut slice_records) = (Vec::new(), Vec::new());
    for slice in file.slices(100_000) {
        file.read(slice, &mut slice_records).unwrap();
        all.extend(slice_records.chunks_exact(length).map(<[u8]>::to_vec));
    }
    all.sort_unstable();
    (file.header().point_format, length, all)
}

fn export(source: &Path, output: &Path, options: &[&str]) -> String {
    run(lodestone().arg("export").arg(source).args(options).arg("-o").arg(output))
}

fn octree(inputs: &[PathBuf], folder: &Path, options: &[&str]) {
    let mut command = lodestone();
    run(command.arg("convert").args(inputs).args(["--progress", "none"]).args(options).arg("-o").arg(folder));
}

#[test]
fn every_format_comes_back_from_octrees_and_copc() {
    for format in 0..=10 {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.las");
        noisy(&input, format, 4_000, false);
        let inputs = [input.clone()];
        let expected = records(&input);
        let encoding = if format % 2 == 0 { "default" } else { "brotli" };
        octree(&inputs, &folder.path().join("octree"), &["--encoding", encoding]);
        let copc = convert(&inputs, &folder.path().join("copc"), &[]);
        for (source, ending) in [
            (folder.path().join("octree"), "las"),
            (copc.clone(), "laz"),
            (folder.path().join("copc"), "las"),
        ] {
            let output = folder.path().join(format!("back.{ending}"));
            export(&source, &output, &[]);
            let found = records(&output);
            assert_eq!((found.0, found.1), (expected.0, expected.1), "{}", source.display());
            assert!(found.2 == expected.2, "format {format}, {}", source.display());
            let (fields, before) = (LasFile::open(&output).unwrap(), LasFile::open(&input).unwrap());
            assert_eq!(fields.header().extra, before.header().extra, "format {format}");
        }
    }
}

#[test]
fn own_colors_come_back_from_averaged_ones() {
    for mode in ["average", "attribute"] {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.las");
        noisy(&input, 3, 30_000, false);
        let inputs = [input.clone()];
        octree(&inputs, &folder.path().join("octree"), &["--lod-color", mode]);
        let copc = convert(&inputs, &folder.path().join("copc"), &["--lod-color", mode]);
        for source in [folder.path().join("octree"), copc] {
            let output = folder.path().join("back.las");
            export(&source, &output, &[]);
            assert!(records(&output) == records(&input), "{mode}, {}", source.display());
        }
    }
}

#[test]
fn boxes_and_levels_choose_points() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.las");
    let options = noisy(&input, 6, 60_000, false);
    let inputs = [input.clone()];
    octree(&inputs, &folder.path().join("octree"), &[]);
    let copc = convert(&inputs, &folder.path().join("copc"), &[]);
    let (.., all) = records(&input);
    let at = |record: &[u8], axis: usize| {
        let stored = i32::from_le_bytes(record[4 * axis..4 * axis + 4].try_into().unwrap());
        f64::from(stored) * options.scale[axis] + options.offset[axis]
    };
    let inside = |record: &&Vec<u8>| {
        (1_500.0..=2_100.0).contains(&at(record, 0)) && (2_400.0..=3_000.25).contains(&at(record, 1))
    };
    let expected: Vec<Vec<u8>> = all.iter().filter(inside).cloned().collect();
    assert!(expected.len() > 1_000 && expected.len() < 50_000, "{}", expected.len());
    for source in [folder.path().join("octree"), copc] {
        let output = folder.path().join("part.laz");
        export(&source, &output, &["--bounds", "1500,2400,2100,3000.25"]);
        assert!(records(&output).2 == expected, "{}", source.display());
        export(&source, &output, &["--level", "0"]);
        let (.., coarse) = records(&output);
        assert!(!coarse.is_empty() && coarse.len() < all.len());
        export(&source, &output, &["--bounds", "0,0,1,1"]);
        assert_eq!(records(&output).2.len(), 0);
    }
}

#[test]
fn what_cannot_be_exported_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.las");
    noisy(&input, 6, 1_000, false);
    let copc = convert(std::slice::from_ref(&input), &folder.path().join("copc"), &[]);
    let fails = |source: &Path, output: &str, options: &[&str]| {
        let output = folder.path().join(output);
        let ran = lodestone().arg("export").arg(source).args(options).arg("-o").arg(output).output().unwrap();
        assert!(!ran.status.success());
        String::from_utf8_lossy(&ran.stderr).into_owned()
    };
    assert!(fails(&copc, "a.ply", &[]).contains(".las or .laz"));
    assert!(fails(&input, "a.las", &[]).contains("neither an octree's folder nor a COPC file"));
    assert!(fails(&folder.path().join("none"), "a.las", &[]).contains("none"));
    assert!(fails(&copc, "a.las", &["--point-format", "1"]).contains("--point-format 6"));
    let name = copc.strip_prefix(folder.path()).unwrap().to_str().unwrap();
    assert!(fails(&copc, name, &[]).contains("the source itself"));
    let hidden = fs::read_dir(folder.path())
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().starts_with('.'));
    assert_eq!(hidden.count(), 0, "nothing half-made is left");
}
