//! Scales below zero, and coordinates at the limit of their integers.

use std::fs;

use lodestone::format::potree::Metadata;

use super::super::common::judge::{field, write_points};
use super::super::common::{all_records, options_of, surface};
use super::{case, octree_of, tile, told};

/// World coordinates of all points of an octree, sorted.
fn world(folder: &std::path::Path) -> Vec<[i64; 3]> {
    let (metadata, nodes) = all_records(folder);
    let size = metadata.schema().unwrap().record_size();
    let place = |record: &[u8]| -> [i64; 3] {
        std::array::from_fn(|a| {
            let stored = i32::from_le_bytes(record[4 * a..4 * a + 4].try_into().unwrap());
            // In tenths of millimeters.
            ((f64::from(stored) * metadata.scale[a] + metadata.offset[a]) * 1e4).round() as i64
        })
    };
    let mut all: Vec<[i64; 3]> =
        nodes.iter().flat_map(|(_, records)| records.chunks_exact(size)).map(place).collect();
    all.sort_unstable();
    all
}

#[test]
fn negative_scales_mirror_every_axis_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let points = field(3000, [-7, 11, 1000], 5000);
    for mirrored in 1..8u8 {
        let sign = [0, 1, 2].map(|a| if mirrored >> a & 1 == 1 { -1.0 } else { 1.0 });
        let input = folder.path().join("cloud.las");
        write_points(&input, sign.map(|s| s * 0.01), [500.0, 600.0, -3.0], &points);
        let held = octree_of(&input, folder.path());
        assert!(held.metadata.scale.iter().all(|scale| *scale > 0.0), "{:?}", held.metadata.scale);
        let mut right: Vec<[i64; 3]> = points
            .iter()
            .map(|p| {
                std::array::from_fn(|a| {
                    let world = f64::from(p[a]) * sign[a] * 0.01 + [500.0, 600.0, -3.0][a];
                    (world * 1e4).round() as i64
                })
            })
            .collect();
        right.sort_unstable();
        assert!(world(&folder.path().join("octree")) == right, "axes {mirrored:03b}");
        assert_eq!(held.outcome.repairs, [""; 0], "axes {mirrored:03b}");
    }
}

#[test]
fn mirrored_tiles_meet_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    let points = field(2000, [0, 0, 0], 4000);
    write_points(&tiles.join("a.las"), [0.01; 3], [0.0; 3], &points);
    write_points(&tiles.join("b.laz"), [-0.01, 0.01, -0.001], [40.0, 40.0, 0.0], &points);
    // The lowest integer has no mirror in 32 bits.
    write_points(
        &tiles.join("c.las"),
        [-0.001; 3],
        [i32::MIN as f64 * 0.001; 3],
        &[[i32::MIN; 3], [-2147480000; 3]],
    );
    let held = octree_of(&tiles, folder.path());
    assert_eq!(held.outcome.points_in, 4002);
    let against = held.report.against.as_ref().unwrap();
    assert_eq!(against.position.octree_units, 0.0, "nothing is rounded");
}

#[test]
fn a_scale_of_zero_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    tile(&input, &options_of(1, false), &surface(1, 10, 1), &[(147, &0f64.to_le_bytes())]);
    let error = lodestone::format::las::LasFile::open(&input).unwrap_err().to_string();
    assert!(error.contains("the scale of z is 0"), "{error}");
}

#[test]
fn a_given_negative_scale_is_a_mirror() {
    let Some(path) = case("c12a_negative_scale_z.las") else { return };
    let folder = tempfile::tempdir().unwrap();
    let held = octree_of(&path, folder.path());
    let position = &held.metadata.attributes[0];
    assert_eq!(held.outcome.points_in, 500);
    // Its box has heights of the other sign, and is wrong.
    assert_eq!((position.min[2], position.max[2]), (-114.861, -85.004));
    assert_eq!(held.metadata.scale[2], 0.001);
}

#[test]
fn coordinates_at_the_limit_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    let mut points = field(2000, [0, 0, 0], 4000);
    write_points(&tiles.join("good.las"), [0.01; 3], [0.0; 3], &points);
    points[0][0] = i32::MAX;
    points[7][2] = i32::MIN;
    points[8] = [i32::MIN; 3];
    write_points(&tiles.join("cut.las"), [0.01; 3], [0.0; 3], &points);
    let held = octree_of(&tiles, folder.path());
    assert!(
        told(&held.outcome.notes, &["3 points of", "cut.las", "limit of 32-bit"]),
        "{:?}",
        held.outcome.notes
    );
    assert!(!told(&held.outcome.notes, &["good.las"]));
}

#[test]
fn a_given_saturated_file_is_converted() {
    let Some(path) = case("c32a_saturated_all.las") else { return };
    let folder = tempfile::tempdir().unwrap();
    let held = octree_of(&path, folder.path());
    assert_eq!(held.outcome.points_in, 20_000);
    assert!(told(&held.outcome.notes, &["20000 points of", "limit of 32-bit"]), "{:?}", held.outcome.notes);
    assert_eq!(Metadata::read(&folder.path().join("octree")).unwrap().points, held.outcome.points_out);
}
