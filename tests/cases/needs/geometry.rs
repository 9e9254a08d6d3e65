//! The pains of geometry, each as a test: whatever a cloud looks like, it ends,
//! and octree + set aside is the input (`docs/needs.md` has the whole list; crowds
//! and outliers are also in `set_aside.rs`).

use std::fs;
use std::path::Path;

use crate::common::judge::{
    Held, IN_CORE, field, held, held_under, held_with, patch, write_points, write_scene,
};
use crate::common::{convert, octree_bytes};
use lodestone::convert::options::{GuardMode, Options, Sampling};
use lodestone::convert::values::record_range::SetAsideReason;
use lodestone::lab::synth::{Recipe, SceneKind};
use lodestone::octree::chunk_plan::chunk_limit;
use lodestone::octree::node::LEAF_LIMIT;
use lodestone::octree::node_limit::NODE_LIMIT;

const MILLIMETRE: [f64; 3] = [0.001; 3];
const ORIGIN: [f64; 3] = [0.0; 3];

fn of(points: &[[i32; 3]], folder: &Path) -> Held {
    let input = folder.join("cloud.las");
    write_points(&input, MILLIMETRE, ORIGIN, points);
    held(&input, &folder.join("octree"))
}

fn aside(held: &Held, reason: SetAsideReason) -> u64 {
    held.outcome.set_aside.get(&reason).copied().unwrap_or(0)
}

#[test]
fn identical_points_end_whatever_their_number() {
    let folder = tempfile::tempdir().unwrap();
    for points in [2, LEAF_LIMIT, LEAF_LIMIT + 1, 250_000] {
        let held = of(&vec![[77, -3, 12]; points], folder.path());
        assert_eq!(aside(&held, SetAsideReason::Duplicate) as usize, points.saturating_sub(LEAF_LIMIT));
        assert_eq!((held.outcome.depth, held.outcome.nodes), (0, 1), "no level for a single position");
    }
    let keep = Options { duplicates: GuardMode::Keep, ..Options::default() };
    let held = held_under(&folder.path().join("cloud.las"), &folder.path().join("octree"), &keep);
    assert_eq!((held.outcome.points_out, held.outcome.depth), (250_000, 0));
}

#[test]
fn ninety_nine_of_a_hundred_points_at_one_position() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = |share| Recipe { share, ..Recipe::new(SceneKind::Duplicates, 300_000, 1) };
    let input = write_scene(recipe(0.99), folder.path());
    let held = held(&input, &folder.path().join("octree"));
    let beyond = (300_000.0 * 0.99) as u64 - LEAF_LIMIT as u64;
    assert!(aside(&held, SetAsideReason::Duplicate).abs_diff(beyond) < 1000, "{:?}", held.outcome);
    // The other 3000 lie on half a hectare.
    assert!(held.outcome.depth <= 9, "{} levels for 13 000 points", held.outcome.depth);
}

#[test]
fn duplicates_that_appear_only_after_quantisation() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    // Distinct to the micrometre, in a patch of a third of a millimetre; beside
    // a tile a thousand kilometres away no lattice of 32 bits tells them apart.
    let patch: Vec<[i32; 3]> = (0..30_000).map(|i| [i % 300, i / 300, 0]).collect();
    write_points(&tiles.join("near.las"), [1e-6; 3], ORIGIN, &patch);
    write_points(&tiles.join("far.las"), [1e-6; 3], [1e6, 0.0, 0.0], &field(30_000, [0; 3], 1_000_000_000));
    let held = held(&tiles, &folder.path().join("octree"));
    assert!(!held.outcome.exact);
    let [x, y, z] = held.outcome.max_error;
    assert!((x - 128e-6).abs() < 1e-12 && y + z == 0.0, "{:?}", held.outcome.max_error);
    assert_eq!(held.outcome.max_error_units, 128.0);
    let moved = held.report.against.as_ref().unwrap().position.world[0];
    assert!(moved > 1e-4 && moved < x * 1.001, "{moved}, and {x} was told");
    let told = "x was rounded to 0.000256, by at most 0.000128, 128 of the finest input's units";
    assert!(held.outcome.notes.iter().any(|note| note.contains(told)), "{:?}", held.outcome.notes);
    assert!(aside(&held, SetAsideReason::Duplicate) >= 10_000, "{:?}", held.outcome);
    assert_eq!(aside(&held, SetAsideReason::Outlier), 0);
}

#[test]
fn a_chunk_at_its_limit_and_one_point_around_it() {
    let folder = tempfile::tempdir().unwrap();
    let limit = chunk_limit(1);
    for points in [limit - 1, limit, limit + 1] {
        let input = folder.path().join("cloud.las");
        write_points(&input, MILLIMETRE, ORIGIN, &field(points as usize, [0; 3], 400_000));
        let held = held_with(&input, &folder.path().join("octree"), &Options::default(), IN_CORE);
        assert_eq!(held.outcome.chunks > 1, points > limit, "{points}: {} chunks", held.outcome.chunks);
    }
}

#[test]
fn one_outlier_a_thousand_kilometres_away() {
    let folder = tempfile::tempdir().unwrap();
    let mut points = field(30_000, [0; 3], 400_000);
    let without = of(&points, folder.path());
    points.push([1_000_000_000, 0, 0]);
    let with = of(&points, folder.path());
    assert_eq!(aside(&with, SetAsideReason::Outlier), 1);
    assert_eq!(with.outcome.depth, without.outcome.depth);
    assert_eq!(with.metadata.spacing, without.metadata.spacing);
}

#[test]
fn two_clusters_a_thousand_kilometres_apart_are_one_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let clusters = [field(20_000, [0; 3], 400_000), field(20_000, [1_000_000_000, 0, 0], 400_000)].concat();
    let held = of(&clusters, folder.path());
    assert_eq!(held.outcome.points_set_aside, 0);
    assert!(held.outcome.exact);
}

#[test]
fn tiles_that_do_not_adjoin() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    for (number, x) in [0.0, 50_000.0, 190_000.0].into_iter().enumerate() {
        let path = tiles.join(format!("{number}.las"));
        write_points(&path, MILLIMETRE, [x, x / 3.0 - 0.001, 0.0], &field(12_000, [0; 3], 900_000));
    }
    let held = held(&tiles, &folder.path().join("octree"));
    assert_eq!((held.outcome.points_out, held.outcome.points_set_aside), (36_000, 0));
}

#[test]
fn a_regular_grid_keeps_its_nodes_within_their_bound() {
    let folder = tempfile::tempdir().unwrap();
    let input = write_scene(Recipe::new(SceneKind::Volume, 64 * 64 * 64, 1), folder.path());
    for sampling in [Sampling::Poisson, Sampling::Random] {
        let options = Options { sampling, ..Options::default() };
        let held = held_with(&input, &folder.path().join("octree"), &options, IN_CORE);
        let largest = held.nodes.iter().map(|node| node.points).max().unwrap();
        assert!(largest as usize <= NODE_LIMIT, "{sampling:?}: a node of {largest} points");
        assert_eq!(held.outcome.points_set_aside, 0);
    }
}

#[test]
fn a_flat_cloud_a_line_and_a_single_position() {
    let folder = tempfile::tempdir().unwrap();
    // A quarter of the points each level down on a plane, half on a line.
    for (kind, depth) in [(SceneKind::Flat, 4), (SceneKind::Line, 5), (SceneKind::Dot, 0)] {
        let input = write_scene(Recipe::new(kind, 60_000, 1), folder.path());
        let held = held(&input, &folder.path().join("octree"));
        assert!(held.outcome.depth <= depth, "{kind:?}: {} levels", held.outcome.depth);
        let crowd = if kind == SceneKind::Dot { 60_000 - LEAF_LIMIT as u64 } else { 0 };
        assert_eq!(held.outcome.points_set_aside, crowd, "{kind:?}");
    }
}

#[test]
fn a_scale_or_offset_that_is_no_number_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("odd.las");
    for (at, value, word) in [
        (131, f64::NAN, "scale of x is NaN"),
        (139, f64::INFINITY, "scale of y is inf"),
        (147, 0.0, "scale of z is 0"),
        (155, f64::NAN, "offset of x is NaN"),
        (171, f64::NEG_INFINITY, "offset of z is -inf"),
    ] {
        write_points(&input, MILLIMETRE, ORIGIN, &field(100, [0; 3], 1000));
        patch(&input, &[(at, &value.to_le_bytes())]);
        let inputs = [input.clone()];
        let error = convert(&inputs, &folder.path().join("o"), &Options::default()).unwrap_err();
        let text = error.to_string();
        assert!(text.contains(word) && text.contains("odd.las"), "{text}");
        assert!(!error.retry_can_help());
    }
}

#[test]
fn a_point_exactly_on_the_maximum_is_in() {
    let folder = tempfile::tempdir().unwrap();
    // Around powers of two, where a cube of that side ends just before its
    // corner; and the ends of 32 bits.
    for side in [1, 2, 1023, 1024, 1025, 1 << 20] {
        let mut points = field(500, [-5; 3], side);
        points.extend([[-5; 3], [side - 5; 3], [side - 5, -5, -5], [-5, -5, side - 5]]);
        let held = of(&points, folder.path());
        assert_eq!(held.outcome.points_out, 504);
    }
    let held = of(&[[i32::MIN; 3], [i32::MAX; 3], [0; 3], [i32::MAX, i32::MIN, -1]], folder.path());
    assert!(held.outcome.exact && held.outcome.points_out == 4);
}

#[test]
fn a_header_s_box_may_say_anything() {
    let folder = tempfile::tempdir().unwrap();
    let (input, octree) = (folder.path().join("cloud.las"), folder.path().join("octree"));
    write_points(&input, MILLIMETRE, ORIGIN, &field(30_000, [1000; 3], 400_000));
    held(&input, &octree);
    let right = octree_bytes(&octree);
    // In the header the greatest comes before the least, axis by axis.
    let boxes = [
        [0.0; 6],
        [1.0, 401.0, 1.0, 401.0, 1.0, 401.0],
        [10.0, 9.0, 10.0, 9.0, 10.0, 9.0],
        [1e300, -1e300, 1e300, -1e300, 1e300, -1e300],
        [4e6, -4e6, 4e6, -4e6, 4e6, -4e6],
        [f64::NAN; 6],
        [f64::INFINITY, f64::NEG_INFINITY, 0.0, 0.0, f64::NAN, 1.0],
    ];
    for said in boxes {
        patch(&input, &[(179, &said.map(f64::to_le_bytes).concat())]);
        let held = held(&input, &octree);
        assert!(octree_bytes(&octree) == right, "a header's box of {said:?} changed the octree");
        let told = held
            .outcome
            .repairs
            .iter()
            .filter(|repair| repair.contains("cloud.las: the header's bounding box"));
        assert_eq!(told.count(), 1, "{said:?}: {:?}", held.outcome.repairs);
    }
}

/// Eight tiles in a row. Of one the box is wrong within that of all, which shows
/// in nothing but the points; and of all.
#[test]
fn of_every_tile_whose_box_is_wrong_it_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (tiles, octree) = (folder.path().join("tiles"), folder.path().join("octree"));
    fs::create_dir(&tiles).unwrap();
    let tile = |number: i32| tiles.join(format!("tile-{number}.las"));
    for number in 0..8 {
        write_points(&tile(number), MILLIMETRE, ORIGIN, &field(500, [number * 1000, 0, 0], 1000));
    }
    let repairs = || held_with(&tiles, &octree, &Options::default(), IN_CORE).outcome.repairs;
    assert_eq!(repairs(), Vec::<String>::new());
    patch(&tile(3), &[(187, &3.5f64.to_le_bytes())]);
    let told = repairs();
    assert!(told.len() == 1 && told[0].contains("tile-3.las: the header's bounding box"), "{told:?}");
    (0..8).for_each(|number| patch(&tile(number), &[(187, &3.5f64.to_le_bytes())]));
    let told = repairs();
    assert!(told.len() == 6 && told[5].contains("and 3 more files"), "{told:?}");
}

#[test]
fn a_scale_of_a_hundred_millionth_that_fills_32_bits() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.laz");
    let spread = |c: i32| c.wrapping_mul(0x9E37_79B1_u32 as i32);
    let points: Vec<[i32; 3]> = (0..30_000).map(|i| [spread(i), spread(i + 40_000), spread(i * 3)]).collect();
    write_points(&input, [1e-8; 3], [-12.5, 3e5, 0.0], &points);
    let held = held(&input, &folder.path().join("octree"));
    assert!(held.outcome.exact);
    assert_eq!(held.metadata.scale, [1e-8; 3]);
    assert_eq!(held.outcome.points_set_aside, 0);
}

#[test]
fn a_fine_scale_with_an_offset_of_utm() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    for scale in [1e-4, 1e-5, 1e-6] {
        for offset in [[500_000.0, 5_400_000.0, 400.0], [499_999.123_456_7, 5_399_999.9, -0.1]] {
            write_points(&input, [scale; 3], offset, &field(5000, [1_000_000_000; 3], 400_000));
            let held = held(&input, &folder.path().join("octree"));
            assert!(held.outcome.exact, "{scale} {offset:?}");
            assert_eq!(held.report.against.unwrap().position.input_units, 0.0);
        }
    }
}

#[test]
fn strips_of_different_scale_and_offset_meet_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let input = write_scene(Recipe::new(SceneKind::Strips, 60_000, 1), folder.path());
    let held = held(&input, &folder.path().join("octree"));
    assert!(held.outcome.exact && held.outcome.files >= 4);
    assert_eq!(held.outcome.points_out, 60_000);
}

#[test]
fn degrees_and_geocentric_coordinates() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    // Degrees beside metres of height: the axes differ in scale.
    write_points(&input, [1e-7, 1e-7, 0.01], [8.0, 47.0, 0.0], &field(30_000, [5_000_000; 3], 90_000));
    let degrees = held(&input, &folder.path().join("octree"));
    assert!(degrees.outcome.exact);
    assert_eq!(degrees.metadata.scale, [1e-7, 1e-7, 0.01]);
    // Metres from the earth's middle, where x, y and z are all large.
    write_points(&input, MILLIMETRE, [4.2e6, 6e5, 4.7e6], &field(30_000, [-2_000_000; 3], 3_000_000));
    let geocentric = held(&input, &folder.path().join("octree"));
    assert!(geocentric.outcome.exact);
    assert_eq!(geocentric.outcome.points_set_aside, 0);
}

#[test]
fn a_cloud_of_no_points_and_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    for ending in ["las", "laz"] {
        let empty = tiles.join(format!("empty.{ending}"));
        write_points(&empty, MILLIMETRE, ORIGIN, &[]);
        let error = convert(&[empty], &folder.path().join("o"), &Options::default()).unwrap_err();
        assert!(error.to_string().contains("holds no points"), "{error}");
        assert!(!folder.path().join("o").exists() && !error.retry_can_help());
    }
    // A tile of none beside another is worth a word, and one point is a cloud.
    write_points(&tiles.join("one.las"), MILLIMETRE, [1.0, 2.0, 3.0], &[[4, -5, 6]]);
    let held = held(&tiles, &folder.path().join("octree"));
    assert_eq!((held.outcome.points_out, held.outcome.nodes, held.outcome.depth), (1, 1, 0));
    let notes = held.outcome.notes.join("\n");
    assert!(notes.contains("empty.las: holds no points"), "{notes}");
    assert_eq!(held.metadata.attributes[0].min, held.metadata.attributes[0].max);
}
