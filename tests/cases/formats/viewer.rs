//! What viewers make of an octree's `projection`: the proj4.js that Potree 1.8
//! ships, under Node, and the real Potree viewer in Chromium.
//!
//! Node's part runs where LODESTONE_VIEWER=1 is set. The viewer's own part needs a
//! built Potree 1.8, as one unpacks a release of it, in the folder that
//! LODESTONE_POTREE names: no registry has it.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;

use lodestone::convert::formats::Formats;
use lodestone::convert::options::Options;
use lodestone::format::crs;
use lodestone::format::las::{LasFile, LasOptions, Vlr};
use lodestone::octree::attribute::{ExtraField, Scalar};

use super::super::common::{convert, data, options_of, scripts, surface};
use super::{case, tile};

fn is_wanted() -> bool {
    let wanted = std::env::var("LODESTONE_VIEWER").is_ok_and(|value| value == "1");
    if !wanted {
        eprintln!("skipped: set LODESTONE_VIEWER=1 to hear proj4.js under Node");
    }
    wanted
}

/// A folder with the scripts and their packages.
static SCRIPTS: LazyLock<PathBuf> = LazyLock::new(|| {
    scripts("potree", "viewer/potree", &["package.json", "transform.mjs", "draw.mjs"]).unwrap()
});

/// Longitude and latitude of points by their projections.
fn places(points: &[(String, [f64; 3])]) -> Vec<serde_json::Value> {
    let list: Vec<_> = points.iter().map(|(text, [x, y, z])| serde_json::json!([text, x, y, z])).collect();
    let mut node = Command::new("node")
        .arg("transform.mjs")
        .current_dir(&*SCRIPTS)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    node.stdin.take().unwrap().write_all(serde_json::to_string(&list).unwrap().as_bytes()).unwrap();
    let output = node.wait_with_output().unwrap();
    assert!(output.status.success());
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Meters between two places that are near.
fn apart(place: &serde_json::Value, [longitude, latitude]: [f64; 2]) -> f64 {
    let (Some(x), Some(y)) = (place[0].as_f64(), place[1].as_f64()) else { return f64::INFINITY };
    let east = (x - longitude) * latitude.to_radians().cos() * 111_320.0;
    east.hypot((y - latitude) * 111_132.0)
}

/// Each reference system of the real clouds, at the middle of the file's box, and
/// where PROJ 9.5 (pyproj 3.7) puts it on WGS 84.
const REAL: &[(&str, [f64; 3], [f64; 2])] = &[
    ("formats/perm_1.1_1.las", [470692.44, 4602888.9, 16.0], [-93.3515626, 41.5771484]),
    ("formats/test1_4.las", [1694289.0613265, 1816495.3412665, 5595.9098], [-106.0678827, 35.9922546]),
    ("formats/simple_with_page.copc.laz", [637301.2, 851217.565, 496.485], [-117.2449853, 49.3605692]),
    ("formats/point-time-1.4.las.laz", [494494.275, 4878123.32, 151.33], [-123.0687371, 44.0562553]),
    ("formats/las14_pdrf6.laz", [487824.4685, 5313799.9185, 689.2605], [-123.1631495, 47.9773884]),
    ("formats/eb.laz", [2654536.12, 2594892.59, 219.715], [146.7169783, -36.1322203]),
    ("formats/autzen-bmx-2010.las", [194489.87, 259243.14, 428.72], [-123.0656303, 44.0544681]),
    ("single/autzen_trim.laz", [636590.49, 849216.55, 463.385], [-123.0711901, 44.0507283]),
    ("single/lone-star.copc.laz", [515384.8226, 4918360.7439, 2330.7359], [84.0179257, 0.0272389]),
    ("single/las_with_several_extra_byte_bloc.laz", [484824.675, 6632814.86, 110.0], [0.1801224, 46.7608746]),
    ("single/epsg_4326.las", [-94.67204825, 31.0420316, 58.6], [-94.6720483, 31.0420316]),
    ("single/simple1_4.las", [113.5, 50.5, 149.0], [113.5, 50.5]),
    ("large/autzen-10.65M-rgb-feet.laz", [637290.76, 851209.905, 510.7], [-123.0687646, 44.0562551]),
    (
        "tiles/ign50m/test_data_77060_627755_LA93_IGN69.laz",
        [770625.0, 6277525.0, 27.8],
        [3.8743211, 43.5932625],
    ),
    ("tiles/bcts/bcts_4.laz", [885128.645, 630109.74, 380.27], [-127.6263817, 50.6740455]),
    (
        "formats/certainty3d-color-utm-feet-navd88.las",
        [6328493.4188, 2069791.8285, 2864.6],
        [-118.7755743, 34.6773724],
    ),
    ("single/mvk-thin.las", [2047497.84, 1270000.49, 162.26], [-91.1456609, 32.9888593]),
    ("single/test.las", [2483789.26, 366410.235, 1531.33], [-75.8785809, 41.1570463]),
    ("single/32-1-472-150-76.laz", [326800.0, 6724186.255, 101.185], [5.8349737, 60.6159946]),
    ("malformed/las12.las", [309247.495, 6143462.495, 463.23], [144.9139838, -34.8332697]),
    ("malformed/spurious.las", [-123.0687348, 44.0562529, 151.33], [-123.0687348, 44.0562529]),
];

#[test]
fn real_clouds_lie_where_their_systems_say() {
    let Some(data) = data().filter(|_| is_wanted()) else { return };
    let points: Vec<(String, [f64; 3])> = REAL
        .iter()
        .map(|(name, point, _)| {
            let file = LasFile::open(&data.join(name)).unwrap();
            let text = &file.header().crs.as_ref().unwrap_or_else(|| panic!("{name} has none")).text;
            (crs::proj4(text).unwrap_or_else(|| panic!("{name}: {text}")), *point)
        })
        .collect();
    for ((name, _, right), (place, (text, _))) in REAL.iter().zip(places(&points).iter().zip(&points)) {
        let off = apart(place, *right);
        // PROJ shifts NAD83(HARN) by a meter, with an accuracy of one; the EPSG data set not.
        assert!(off < 1.5, "{name} is {off} m off: {place} by {text}");
    }
}

/// Systems of other kinds, and what PROJ makes of them, with how far a shift of
/// seven parameters may be from the best there is.
const CODES: &[(u16, [f64; 2], [f64; 2], f64)] = &[
    (32633, [500050.0, 5400050.0], [15.0006802, 48.7534628], 1.0),
    (27700, [530000.0, 180000.0], [-0.1283539, 51.5039908], 5.0),
    (31467, [3500000.0, 5400000.0], [8.9989708, 48.7375393], 5.0),
    (26715, [500000.0, 3500000.0], [-93.0001719, 31.6370465], 30.0),
    (2056, [2600000.0, 1200000.0], [7.4386324, 46.9510828], 2.0),
    (28992, [155000.0, 463000.0], [5.3872035, 52.1551723], 2.0),
    (5514, [-743000.0, -1043000.0], [14.4185939, 50.0873466], 10.0),
    (3857, [1e6, 6e6], [8.9831528, 47.3537047], 1.0),
    (3413, [500000.0, -1000000.0], [-18.4349488, 79.7057755], 1.0),
    (27572, [600000.0, 2200000.0], [2.3365336, 46.7999488], 5.0),
];

#[test]
fn codes_of_all_kinds_keep_their_datum_shifts() {
    if !is_wanted() {
        return;
    }
    let point = |(code, [x, y], ..): &(u16, [f64; 2], [f64; 2], f64)| {
        (crs::proj4(&format!("EPSG:{code}")).unwrap(), [*x, *y, 0.0])
    };
    let points: Vec<(String, [f64; 3])> = CODES.iter().map(point).collect();
    for ((code, _, right, most), (place, (text, _))) in CODES.iter().zip(places(&points).iter().zip(&points))
    {
        let off = apart(place, *right);
        assert!(off < *most, "EPSG:{code} is {off} m off: {place} by {text}");
    }
}

/// Converts to a folder of octrees, each by its name.
fn octree(octrees: &Path, name: &str, input: &Path) {
    convert(&[input.to_path_buf()], &octrees.join(name), &Options::default()).unwrap();
}

/// The same as a COPC file, alone in its folder.
fn copc(octrees: &Path, name: &str, input: &Path) {
    let options = Options { format: Formats::COPC, name: Some(name.into()), ..Options::default() };
    convert(&[input.to_path_buf()], &octrees.join(name), &options).unwrap();
}

/// The viewer's word on all clouds of a folder. Its pictures stay in the build folder.
fn drawn(potree: &OsStr, octrees: &Path) -> serde_json::Map<String, serde_json::Value> {
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("potree-pictures");
    fs::create_dir_all(&pictures).unwrap();
    let output = Command::new("node")
        .arg("draw.mjs")
        .args([Path::new(potree), octrees, Path::new("/usr/bin/chromium"), &pictures])
        .current_dir(&*SCRIPTS)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let seen = seen.as_object().unwrap().clone();
    for (name, seen) in &seen {
        assert_eq!(seen["errors"], serde_json::json!([]), "{name}: {seen}");
        assert_eq!(seen["loaded"], true, "{name}: {seen}");
        assert!(
            seen["points"].as_u64().unwrap() > 100 && seen["drawn"].as_u64().unwrap() > 30,
            "{name}: {seen}"
        );
    }
    seen
}

/// The built Potree, if there is one.
fn potree() -> Option<OsString> {
    let potree = std::env::var_os("LODESTONE_POTREE").filter(|_| is_wanted());
    if potree.is_none() {
        eprintln!("skipped: LODESTONE_POTREE names no folder with a built Potree 1.8");
    }
    potree
}

#[test]
fn the_potree_viewer_draws_copc_files() {
    let Some(potree) = potree() else { return };
    let folder = tempfile::tempdir().unwrap();
    let octrees = folder.path().join("octrees");
    fs::create_dir(&octrees).unwrap();
    let input = folder.path().join("a.las");
    for format in 0..=10 {
        let options = LasOptions { offset: [500_000.0, 5_400_000.0, 300.0], ..options_of(format, false) };
        tile(&input, &options, &surface(format, 120_000, 1), &[]);
        copc(&octrees, &format!("copc-{format}"), &input);
    }
    for (name, file) in [
        ("copc-autzen", "single/autzen_trim.laz"),
        ("copc-town", "tiles/ign50m/test_data_77060_627755_LA93_IGN69.laz"),
    ] {
        if let Some(data) = data() {
            copc(&octrees, name, &data.join(file));
        }
    }
    let seen = drawn(&potree, &octrees);
    assert!(seen.len() >= 11, "{seen:?}");
    for (name, seen) in seen {
        assert!(seen["nodes"].as_u64() > Some(1), "{name}: {seen}");
    }
}

#[test]
fn the_potree_viewer_draws_every_octree() {
    let Some(potree) = potree() else { return };
    let folder = tempfile::tempdir().unwrap();
    let octrees = folder.path().join("octrees");
    fs::create_dir(&octrees).unwrap();
    let input = folder.path().join("a.las");
    let corner = [500_000.0, 5_400_000.0, 300.0];
    let compound =
        format!("COMPD_CS[\"x\",{},VERT_CS[\"v\",UNIT[\"m\",1]]]", crs::named("EPSG:25832").unwrap());
    let oregon = "PROJCS[\"own\",GEOGCS[\"g\",DATUM[\"d\",SPHEROID[\"s\",6378137,298.257222101]],PRIMEM[\"p\",0]],\
                  PROJECTION[\"Lambert_Conformal_Conic\"],PARAMETER[\"Standard_Parallel_1\",44],\
                  PARAMETER[\"Central_Meridian\",-120],PARAMETER[\"Latitude_Of_Origin\",44],UNIT[\"foot\",0.3048]]";
    let wkt = crs::named("EPSG:27700").unwrap();
    for (name, wkt) in [
        ("none", ""),
        ("wkt", wkt.as_str()),
        ("compound", &compound),
        ("own", oregon),
        ("unknown", "PROJCS[\"x\"]"),
    ] {
        let crs = if wkt.is_empty() { Vec::new() } else { vec![Vlr::wkt(wkt)] };
        let options = LasOptions { crs, offset: corner, ..options_of(2, false) };
        tile(&input, &options, &surface(2, 30_000, 1), &[]);
        octree(&octrees, name, &input);
    }
    // By its EPSG code alone.
    let code: [u16; 8] = [1, 1, 0, 1, 3072, 0, 1, 26995];
    let keys = Vlr {
        user: "LASF_Projection".into(),
        id: 34735,
        data: code.iter().flat_map(|word| word.to_le_bytes()).collect(),
    };
    tile(
        &input,
        &LasOptions { crs: vec![keys], offset: corner, ..options_of(2, false) },
        &surface(2, 30_000, 1),
        &[],
    );
    octree(&octrees, "code", &input);
    // Every name that viewers know otherwise, as an extra byte each.
    let names = ["RGBA", "color", "indices", "NORMAL", "INDICES", "spacing", "constructor", "__proto__"];
    let extra = names.iter().enumerate().map(|(number, name)| ExtraField {
        name: name.to_string(),
        description: String::new(),
        scalar: Scalar::U8,
        elements: 1,
        position: 26 + number,
        scale: Vec::new(),
        offset: Vec::new(),
    });
    // As long as the records of format 3.
    let options = LasOptions { extra: extra.collect(), offset: corner, ..options_of(2, false) };
    tile(&input, &options, &surface(3, 30_000, 1), &[]);
    octree(&octrees, "names", &input);
    for name in ["c18_RGBA_u4", "c18_color_u2", "c13_b_userdef_tm"] {
        if let Some(path) = case(&format!("{name}.las")) {
            octree(&octrees, name, &path);
        }
    }
    let seen = drawn(&potree, &octrees);
    assert!(seen.len() >= 7, "{seen:?}");
    for name in ["wkt", "compound", "own", "code"] {
        assert!(seen[name]["projection"].as_str().unwrap().starts_with("+proj="), "{}", seen[name]);
    }
    for name in ["none", "unknown"] {
        assert_eq!(seen[name]["projection"], "", "{}", seen[name]);
    }
}
