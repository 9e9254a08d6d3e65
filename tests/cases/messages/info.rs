//! `lodestone info`: for people on one screen, for programs as JSON.

use std::fs;

use serde_json::Value;

use super::{lodestone, stderr, stdout, text};
use crate::common::{options_of, surface, write_las};
use crate::daemon_support::las;

fn json(path: &str) -> Value {
    let run = lodestone(&["info", path, "--json"]);
    assert!(run.status.success(), "{}", stderr(&run));
    serde_json::from_slice(&run.stdout).expect("JSON")
}

#[test]
fn a_file_and_an_octree_are_told_as_json() {
    let root = tempfile::tempdir().expect("a folder");
    let (input, octree) = (root.path().join("a.laz"), root.path().join("octree"));
    write_las(&input, &options_of(7, true), &surface(7, 5000, 1));
    let file = json(text(&input));
    assert_eq!(
        (&file["kind"], &file["points"], &file["point_format"]),
        (&"LAZ".into(), &5000.into(), &7.into())
    );
    assert_eq!((&file["version"], &file["software"]), (&"1.4".into(), &"lodestone tests".into()));
    assert_eq!(file["scale"], serde_json::json!([0.01, 0.01, 0.01]));
    assert!(lodestone(&["convert", text(&input), "-o", text(&octree)]).status.success());
    let told = json(text(&octree));
    assert_eq!((&told["kind"], &told["points"]), (&"octree".into(), &5000.into()));
    let metadata: Value =
        serde_json::from_slice(&fs::read(octree.join("metadata.json")).expect("there")).expect("JSON");
    assert_eq!(told["metadata"]["attributes"], metadata["attributes"]);
    let points: u64 =
        told["levels"].as_array().expect("levels").iter().filter_map(|l| l["points"].as_u64()).sum();
    assert_eq!(points, 5000);
    // The same by the octree's metadata.json.
    assert_eq!(json(text(&octree.join("metadata.json")))["nodes"], told["nodes"]);
}

#[test]
fn no_number_fills_the_screen() {
    let root = tempfile::tempdir().expect("a folder");
    let path = root.path().join("box.las");
    let mut bytes = las(100, 1);
    for (at, value) in [(179, f64::MAX), (187, f64::MIN), (195, 1e300), (203, -5e-324), (211, f64::INFINITY)]
    {
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }
    fs::write(&path, &bytes).expect("written");
    let page = stdout(&lodestone(&["info", text(&path)]));
    assert!(page.contains("1.7976931348623157e308"), "{page}");
    assert!(page.lines().all(|line| line.chars().count() < 140), "{page}");
    // Nor in what a conversion says.
    for (at, value) in [(155, 1e300f64), (131, 1e300), (131, 5e-324), (155, f64::MAX)] {
        let mut bytes = las(100, 1);
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        fs::write(&path, &bytes).expect("written");
        let octree = root.path().join("octree");
        let run = lodestone(&["convert", text(&path), "-o", text(&octree), "--overwrite"]);
        let said = stdout(&run) + &stderr(&run);
        let longest = said.split(|c: char| !c.is_ascii_digit()).map(str::len).max().unwrap_or(0);
        assert!(longest < 40, "{value}: {said}");
        if run.status.success() {
            let page = stdout(&lodestone(&["info", text(&octree)]));
            let longest = page.split(|c: char| !c.is_ascii_digit()).map(str::len).max().unwrap_or(0);
            assert!(longest < 40, "{value}: {page}");
        }
    }
}

#[test]
fn wkt_of_many_lines_is_one_line_for_people() {
    let root = tempfile::tempdir().expect("a folder");
    let path = root.path().join("a.las");
    let wkt = "GEOGCS[\"WGS 84\",\r\n    DATUM[\"WGS_1984\",\n\n        SPHEROID[\"WGS 84\",6378137,298.257223563]],\n    PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]";
    let mut options = options_of(6, false);
    options.crs = vec![lodestone::format::las::Vlr {
        user: "LASF_Projection".into(),
        id: 2112,
        data: [wkt.as_bytes(), &[0]].concat(),
    }];
    write_las(&path, &options, &surface(6, 50, 1));
    let page = stdout(&lodestone(&["info", text(&path)]));
    let line = page.lines().find(|line| line.starts_with("CRS")).expect("a line");
    assert!(line.contains("DATUM[\"WGS_1984\", SPHEROID") && line.ends_with("]]"), "{page}");
}
