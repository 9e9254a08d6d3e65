//! Which coordinate reference system a file has, and where its points lie by it.

use std::fs;
use std::path::{Path, PathBuf};

use lodestone::convert::options::Options;
use lodestone::format::crs;
use lodestone::format::las::{LasFile, LasOptions, Vlr};

use super::super::common::judge::write_points;
use super::super::common::{convert, options_of, surface};
use super::{case, octree_of, tile, told};

/// What a file says: the source, and what viewers are told.
fn shown(path: &Path) -> (&'static str, String) {
    let file = LasFile::open(path).unwrap();
    match &file.header().crs {
        None => ("none", String::new()),
        Some(found) => (found.source.name(), crs::proj4(&found.text).unwrap_or_default()),
    }
}

#[test]
fn given_files_have_the_right_system_and_source() {
    let oregon = "+proj=lcc +x_0=2500000 +y_0=0 +lon_0=-120.5 +lat_1=44.33333333333 +lat_2=46 \
                  +lat_0=43.66666666667 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m +no_defs";
    let tm = "+proj=tmerc +lon_0=15 +lat_0=0 +x_0=500000 +y_0=0 +k=0.9996 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 \
              +units=m +no_defs";
    let utm = "+proj=tmerc +lat_0=0 +lon_0=15 +k=0.9996 +x_0=500000 +y_0=0 +datum=WGS84 +units=m +no_defs";
    for (name, source, proj4) in [
        ("c13_a_esri_pe.las", "GeoTIFF keys", oregon),
        ("c13_a2_esri_model32767.las", "GeoTIFF keys", oregon),
        ("c13_b_userdef_tm.las", "GeoTIFF keys", tm),
        ("c13_d_model_proj_only_gcs.las", "none", ""),
        ("c13_i9_wkt_user_liblas_first.las", "WKT", utm),
        ("c13_j_stale_liblas.las", "GeoTIFF keys", "+proj=utm +zone=10 +datum=NAD83 +units=m +no_defs"),
    ] {
        let Some(path) = case(name) else { return };
        assert_eq!(shown(&path), (source, proj4.to_string()), "{name}");
        let notes = LasFile::open(&path).unwrap().header().notes.clone();
        assert_eq!(told(&notes, &["projected, but not how"]), source == "none", "{name}: {notes:?}");
        let folder = tempfile::tempdir().unwrap();
        let held = octree_of(&path, folder.path());
        assert_eq!(held.metadata.projection, proj4, "{name}");
        assert_eq!(held.metadata.crs.contains('['), source != "none", "{name}");
    }
}

const KEYS_OF_UTM_33: [u16; 8] = [1, 1, 0, 1, 3072, 0, 1, 32633];

fn keys() -> Vlr {
    let data = KEYS_OF_UTM_33.iter().flat_map(|word| word.to_le_bytes()).collect();
    Vlr { user: "LASF_Projection".into(), id: 34735, data }
}

#[test]
fn the_wkt_bit_of_las_1_4_decides() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    let wkt = Vlr::wkt(&crs::named("EPSG:32610").unwrap());
    let old = Vlr { user: "liblas".into(), ..wkt.clone() };
    for (format, version, records, bit, right) in [
        (1, (1, 4), vec![keys(), wkt.clone()], true, "WKT"),
        (1, (1, 4), vec![keys(), wkt.clone()], false, "GeoTIFF keys"),
        (1, (1, 4), vec![keys(), old.clone()], true, "GeoTIFF keys"),
        (1, (1, 4), vec![old.clone()], true, "WKT"),
        (1, (1, 4), vec![wkt.clone()], false, "WKT"),
        // The formats from 6 on have nothing but WKT.
        (6, (1, 4), vec![keys(), wkt.clone()], false, "WKT"),
        (6, (1, 5), vec![keys(), wkt.clone()], false, "WKT"),
        (6, (1, 4), vec![keys()], true, "GeoTIFF keys"),
        // Before LAS 1.4 there was no such bit.
        (1, (1, 2), vec![keys(), wkt.clone()], false, "WKT"),
        (1, (1, 2), vec![old, keys()], false, "GeoTIFF keys"),
    ] {
        let told = format!("format {format}, {version:?}, bit {bit}, {} records", records.len());
        let options = LasOptions { version, crs: records, ..options_of(format, false) };
        let encoding = if bit { 1u16 << 4 } else { 0 };
        tile(&path, &options, &surface(format, 10, 1), &[(6, &encoding.to_le_bytes())]);
        assert_eq!(shown(&path).0, right, "{told}");
    }
}

/// A tile of format 1 with this WKT, near these world coordinates.
fn tile_at(path: &Path, wkt: &str, corner: [f64; 3], scale: f64) {
    let records = surface(1, 500, 1);
    let crs = if wkt.is_empty() { Vec::new() } else { vec![Vlr::wkt(wkt)] };
    let options = LasOptions { crs, scale: [scale, scale, 0.01], offset: corner, ..options_of(1, false) };
    tile(path, &options, &records, &[]);
}

#[test]
fn degrees_are_told_and_meters_called_degrees_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    let degrees = crs::named("EPSG:4326").unwrap();
    tile_at(&path, &degrees, [11.0, 48.0, 500.0], 1e-7);
    let held = octree_of(&path, folder.path());
    assert!(told(&held.outcome.notes, &["degrees of longitude and latitude"]), "{:?}", held.outcome.notes);
    assert_eq!(held.metadata.projection, "+proj=longlat +datum=WGS84 +no_defs");
    tile_at(&path, &degrees, [500_000.0, 5_400_000.0, 500.0], 0.01);
    let held = octree_of(&path, folder.path());
    assert!(
        told(&held.outcome.notes, &["a.las", "counts in degrees", "left out"]),
        "{:?}",
        held.outcome.notes
    );
    assert_eq!((held.metadata.projection.as_str(), held.metadata.crs.as_str()), ("", ""));
}

#[test]
fn an_asked_for_system_overrides_the_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    write_points(&path, [0.01; 3], [0.0; 3], &[[1, 2, 3], [400, 500, 600]]);
    let options = |crs: &str| -> Options { serde_json::from_str(&format!("{{\"crs\":\"{crs}\"}}")).unwrap() };
    let octree = folder.path().join("octree");
    convert(&[path], &octree, &options("EPSG:25832")).unwrap();
    let metadata = lodestone::format::potree::Metadata::read(&octree).unwrap();
    assert_eq!(Some(metadata.projection.clone()), crs::proj4("EPSG:25832"));
    assert!(metadata.crs.starts_with("PROJCS[\"ETRS89 / UTM zone 32N\""), "{}", metadata.crs);
    let report = fs::read_to_string(octree.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["crs"], metadata.crs.as_str());
    assert_eq!(report["projection"], metadata.projection.as_str());
    // Options of before there was such a thing are written as they were.
    assert!(!serde_json::to_string(&Options::default()).unwrap().contains("crs"));
    assert!(serde_json::from_str::<Options>("{\"crs\":\"nowhere\"}").is_err());
}

#[test]
fn tiles_that_say_the_same_otherwise_are_no_contradiction() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    let wkt = crs::named("EPSG:32633").unwrap();
    tile_at(&tiles.join("a.las"), &wkt, [500_000.0, 5_400_000.0, 0.0], 0.01);
    let options =
        LasOptions { crs: vec![keys()], offset: [500_000.0, 5_400_000.0, 0.0], ..options_of(1, false) };
    tile(&tiles.join("b.las"), &options, &surface(1, 100, 2), &[]);
    let held = octree_of(&tiles, folder.path());
    assert!(!told(&held.outcome.notes, &["differs"]), "{:?}", held.outcome.notes);
    tile_at(&tiles.join("c.las"), &crs::named("EPSG:32632").unwrap(), [500_000.0, 5_400_000.0, 0.0], 0.01);
    let held = octree_of(&tiles, folder.path());
    assert!(told(&held.outcome.notes, &["c.las", "differs"]), "{:?}", held.outcome.notes);
}

#[test]
fn octrees_of_old_keep_their_wkt() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    tile_at(&path, "", [0.0; 3], 0.01);
    let held = octree_of(&path, folder.path());
    assert_eq!((held.metadata.crs(), held.metadata.projection.as_str()), ("", ""));
    let mut old = held.metadata;
    old.projection = "PROJCS[\"x\"]".into();
    let text = old.to_json();
    assert!(!text.contains("\"crs\""), "{text}");
    let octree: PathBuf = folder.path().join("octree");
    fs::write(octree.join("metadata.json"), text).unwrap();
    assert_eq!(lodestone::format::potree::Metadata::read(&octree).unwrap().crs(), "PROJCS[\"x\"]");
}
