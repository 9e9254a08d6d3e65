//! `lodestone vpc`: a folder of COPC files as one virtual point cloud.

use std::fs;
use std::path::Path;

use lodestone::format::copc::CopcFile;

use super::{READERS, convert, is_wanted, lodestone, noisy, readers_agree, run};

fn read(list: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(list).unwrap()).unwrap()
}

/// The overviews that a list names, one for each item.
fn overviews(list: &Path) -> Vec<Option<String>> {
    let href =
        |feature: &serde_json::Value| feature["assets"]["overview"]["href"].as_str().map(str::to_string);
    read(list)["features"].as_array().unwrap().iter().map(href).collect()
}

#[test]
fn a_folder_is_one_virtual_cloud() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format, points) in [("a", 7, 3_000), ("b", 6, 2_000)] {
        let input = folder.path().join(format!("{name}.las"));
        noisy(&input, format, points, false);
        convert(&[input], &folder.path().join("clouds").join(name), &[]);
    }
    let clouds = folder.path().join("clouds");
    fs::write(clouds.join("broken.copc.laz"), b"LASF").unwrap();
    let ran = lodestone().arg("vpc").arg(&clouds).output().unwrap();
    assert!(String::from_utf8_lossy(&ran.stderr).contains("broken.copc.laz is left out"));
    fs::remove_file(clouds.join("broken.copc.laz")).unwrap();
    assert!(run(lodestone().arg("vpc").arg(&clouds)).contains("2 COPC files with 5 000 points"));
    let vpc = read(&clouds.join("clouds.vpc"));
    assert_eq!(vpc["type"], "FeatureCollection");
    let features = vpc["features"].as_array().unwrap();
    assert_eq!(features.len(), 2);
    for (feature, (name, points)) in features.iter().zip([("a", 3_000), ("b", 2_000)]) {
        assert_eq!(
            (feature["type"].as_str(), feature["stac_version"].as_str()),
            (Some("Feature"), Some("1.0.0"))
        );
        let properties = &feature["properties"];
        assert_eq!(properties["pc:count"], points);
        let href = feature["assets"]["data"]["href"].as_str().unwrap();
        assert!(href.starts_with(&format!("./{name}/")) && clouds.join(href).is_file(), "{href}");
        assert!(properties["proj:wkt2"].as_str().unwrap().starts_with("PROJCS"));
        let native = properties["proj:bbox"].as_array().unwrap();
        let degrees = feature["bbox"].as_array().unwrap();
        assert!(native[0].as_f64().unwrap() >= 1_000.0 && native.len() == 6);
        // Some hundred kilometers west of the zone's middle at 15 degrees, on the equator.
        let west = degrees[0].as_f64().unwrap();
        assert!((10.0..11.0).contains(&west) && degrees[1].as_f64().unwrap() < 0.1, "{degrees:?}");
        let statistics = properties["pc:statistics"].as_array().unwrap();
        let x = statistics.iter().find(|one| one["name"] == "X").unwrap();
        assert_eq!(x["count"], points);
        let name_of = |one: &serde_json::Value| {
            properties["pc:schemas"][one["position"].as_u64().unwrap() as usize]["name"].clone()
        };
        assert!(statistics.iter().all(|one| name_of(one) == one["name"]));
        assert!(properties["datetime"].as_str().unwrap().ends_with('Z'));
    }
}

#[test]
fn an_overview_shows_all_members_and_follows_them() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    // Strips of one terrain, in one system, and a cloud of no system.
    run(lodestone().args(["synth", "strips", "--points", "400K", "-o"]).arg(&tiles));
    let clouds = folder.path().join("clouds");
    for tile in fs::read_dir(&tiles).unwrap().map(|entry| entry.unwrap().path()) {
        let name = tile.file_stem().unwrap().to_string_lossy().into_owned();
        convert(&[tile], &clouds.join(&name), &["--name", &name, "--crs", "EPSG:25832"]);
    }
    let other = folder.path().join("other.las");
    noisy(&other, 0, 1_000, false);
    convert(&[other], &clouds.join("other"), &["--name", "other"]);
    let (list, overview) = (clouds.join("clouds.vpc"), clouds.join("clouds-overview.copc.laz"));
    let make = |options: &[&str]| run(lodestone().arg("vpc").arg(&clouds).args(options));

    make(&[]);
    let named = Some("./clouds-overview.copc.laz".to_string());
    let count = fs::read_dir(&tiles).unwrap().count();
    assert!(count > 1);
    let shown = overviews(&list);
    assert_eq!(shown.iter().filter(|one| **one == named).count(), count, "{shown:?}");
    assert_eq!(shown.iter().filter(|one| one.is_none()).count(), 1, "one file is its own overview");
    let file = CopcFile::open(&overview, 1 << 30).unwrap();
    let points = file.front.points;
    assert!((50_000..=100_000 + 100).contains(&points), "a quarter of all: {points}");
    assert!(file.header.crs.as_ref().unwrap().text.contains("25832"));
    let text = run(lodestone().arg("verify").arg(&overview).arg("--json"));
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["ok"], true, "{text}");
    // It reaches as far as its members.
    let reach = |path: &Path| {
        let front = CopcFile::open(path, 1 << 30).unwrap().front;
        (front.min, front.max)
    };
    let (low, high) = reach(&overview);
    for feature in read(&list)["features"].as_array().unwrap() {
        let name = feature["id"].as_str().unwrap();
        if name != "other" {
            let (a, b) = reach(&clouds.join(feature["assets"]["data"]["href"].as_str().unwrap()));
            for axis in 0..2 {
                let part = (high[axis] - low[axis]) / 50.0;
                assert!(
                    low[axis] <= a[axis] + part && b[axis] - part <= high[axis],
                    "{name}: {low:?} {high:?}"
                );
            }
        }
    }
    // Made again, it is the same, and no member of itself.
    let bytes = fs::read(&overview).unwrap();
    make(&[]);
    assert!(fs::read(&overview).unwrap() == bytes && overviews(&list) == shown);
    assert_eq!(make(&["--print"]).trim(), fs::read_to_string(&list).unwrap().trim());
    if is_wanted() {
        readers_agree(std::slice::from_ref(&overview));
        // A picture of it, to be looked at.
        let pictures = READERS.join("pictures");
        let mut preview = lodestone();
        preview.arg("preview").arg(&overview).args(["--frames", "0", "-o"]).arg(&pictures);
        run(&mut preview);
    }
    // A file of that name which is not ours stays, and is a member.
    fs::remove_file(&list).unwrap();
    make(&[]);
    assert!(fs::read(&overview).unwrap() == bytes);
    assert_eq!(overviews(&list)[0].as_deref(), Some("./clouds-overview-2.copc.laz"));
    fs::remove_file(&overview).unwrap();
    // Members go, and so does what showed them.
    make(&[]);
    let second = Some("./clouds-overview-2.copc.laz".to_string());
    assert_eq!(overviews(&list).iter().filter(|one| **one == second).count(), count);
    assert!(make(&["--no-overview"]).contains("COPC files"));
    assert!(overviews(&list).iter().all(Option::is_none));
    let is_overview = |entry: &fs::DirEntry| entry.file_name().to_string_lossy().contains("overview");
    assert_eq!(fs::read_dir(&clouds).unwrap().flatten().filter(is_overview).count(), 0);
}

#[test]
fn an_overview_that_is_given_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format) in [("a", 7), ("b", 6), ("thin", 6)] {
        let input = folder.path().join(format!("{name}.las"));
        noisy(&input, format, 2_000, false);
        convert(&[input], &folder.path().join("clouds").join(name), &[]);
    }
    let clouds = folder.path().join("clouds");
    let given = clouds.join("thin/thin.copc.laz");
    // Paths of other spellings mean the same file.
    let spelled = clouds.join("../clouds/thin/thin.copc.laz");
    run(lodestone().arg("vpc").arg(&clouds).arg("--overview").arg(spelled));
    let list = clouds.join("clouds.vpc");
    let overviews = overviews(&list);
    assert_eq!(overviews.len(), 2, "it is no member");
    for href in overviews {
        let path = clouds.join(href.unwrap());
        assert_eq!(fs::canonicalize(path).unwrap(), fs::canonicalize(&given).unwrap());
    }
}

#[test]
fn times_of_two_kinds_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let clouds = folder.path().join("clouds");
    // Format 0 has no times, which count as seconds of the week; format 6 standard times.
    for (name, format) in [("a", 1), ("b", 7)] {
        let input = folder.path().join(format!("{name}.las"));
        noisy(&input, format, 4_000, false);
        convert(&[input], &clouds.join(name), &["--crs", "EPSG:25832"]);
    }
    run(lodestone().arg("vpc").arg(&clouds));
    let overview = clouds.join("clouds-overview.copc.laz");
    let kinds = ["a/a.copc.laz", "b/b.copc.laz"]
        .map(|name| CopcFile::open(&clouds.join(name), 1 << 30).unwrap().header.gps_time);
    let file = CopcFile::open(&overview, 1 << 30).unwrap();
    assert!((2_000..2_010).contains(&file.front.points), "{}", file.front.points);
    if kinds[0] != kinds[1] {
        assert_eq!(file.front.info.time, (0.0, 0.0));
    }
}
