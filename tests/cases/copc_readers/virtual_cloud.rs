//! `lodestone vpc`: a folder of COPC files as one virtual point cloud.

use std::fs;

use super::{convert, lodestone, noisy, run};

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
    let vpc: serde_json::Value =
        serde_json::from_slice(&fs::read(clouds.join("clouds.vpc")).unwrap()).unwrap();
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
