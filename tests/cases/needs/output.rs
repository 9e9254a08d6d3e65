//! The pains of what is written, each as a test: counts that agree, bytes that
//! are all accounted for, boxes that are right, the same every time
//! (`docs/needs.md` has the whole list).

use std::fs;
use std::path::Path;

use crate::common::judge::{Held, IN_CORE, field, held, held_with, write_points, write_scene};
use crate::common::{all_records, listing, octree_bytes};
use lodestone::convert::options::{Encoding, Options, Sampling};
use lodestone::format::potree;
use lodestone::lab::synth::{Recipe, SceneKind};

/// A cloud with a crowd and an outlier, at integers that a test can know.
fn eventful(path: &Path) -> Vec<[i32; 3]> {
    let mut points = field(60_000, [100, -4000, 7], 300_000);
    points.extend([[150_000, 0, 500]; 15_000]);
    points.push([1_900_000_000, 0, 0]);
    write_points(path, [0.001; 3], [10.0, 20.0, 30.0], &points);
    points
}

#[test]
fn hierarchy_metadata_and_outcome_count_the_same_and_the_rest_has_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    let points = eventful(&input).len() as u64;
    let Held { outcome, metadata, nodes, .. } = held(&input, &folder.path().join("octree"));
    let counted: u64 = nodes.iter().map(|node| u64::from(node.points)).sum();
    assert_eq!((counted, metadata.points), (outcome.points_out, outcome.points_out));
    assert_eq!(outcome.points_in, points);
    assert_eq!(points, counted + outcome.set_aside.values().sum::<u64>());
    assert_eq!(outcome.set_aside.len(), 2, "outliers and duplicates: {:?}", outcome.set_aside);
    assert_eq!(nodes.len() as u64, outcome.nodes);
}

#[test]
fn every_byte_of_the_octree_belongs_to_a_node() {
    let folder = tempfile::tempdir().unwrap();
    let input = write_scene(Recipe::new(SceneKind::Town, 150_000, 1), folder.path());
    let octree = folder.path().join("octree");
    for encoding in [Encoding::Default, Encoding::Brotli] {
        let options = Options { encoding, ..Options::default() };
        let Held { mut nodes, metadata, .. } = held_with(&input, &octree, &options, IN_CORE);
        nodes.sort_by_key(|node| node.offset);
        let mut end = 0;
        let record = metadata.schema().unwrap().record_size() as u64;
        for node in &nodes {
            assert_eq!(node.offset, end, "{} leaves a gap or lies on another", node.name);
            end += node.size;
            assert!(encoding == Encoding::Brotli || node.size == u64::from(node.points) * record);
        }
        assert_eq!(fs::metadata(octree.join(potree::OCTREE)).unwrap().len(), end);
        assert!(listing(&octree).iter().all(|name| !name.starts_with('.')), "{:?}", listing(&octree));
    }
}

#[test]
fn no_inner_node_is_empty_so_that_a_viewer_stops_there() {
    let folder = tempfile::tempdir().unwrap();
    for kind in [SceneKind::Terrain, SceneKind::Interior, SceneKind::Volume, SceneKind::Line, SceneKind::Far]
    {
        let input = write_scene(Recipe::new(kind, 40_000, 1), folder.path());
        for sampling in [Sampling::Poisson, Sampling::Random] {
            let options = Options { sampling, ..Options::default() };
            let held = held_with(&input, &folder.path().join("octree"), &options, IN_CORE);
            for node in &held.nodes {
                assert!(node.points > 0 && node.size > 0, "{kind:?}: {} is empty", node.name);
            }
        }
    }
}

#[test]
fn cube_spacing_and_bounds_are_those_of_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    let points = field(60_000, [100, -4000, 7], 300_000);
    write_points(&input, [0.001; 3], [10.0, 20.0, 30.0], &points);
    let octree = folder.path().join("octree");
    let metadata = held(&input, &octree).metadata;
    let bound = |least: bool| -> [f64; 3] {
        std::array::from_fn(|axis| {
            let all = points.iter().map(|point| point[axis]);
            let stored = if least { all.min() } else { all.max() }.unwrap();
            f64::from(stored).mul_add(0.001, [10.0, 20.0, 30.0][axis])
        })
    };
    let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
    let position = &metadata.attributes[0];
    for axis in 0..3 {
        assert!(near(position.min[axis], bound(true)[axis]) && near(position.max[axis], bound(false)[axis]));
        let (low, high) = (metadata.bounding_box.min[axis], metadata.bounding_box.max[axis]);
        assert!(low <= position.min[axis] && position.max[axis] <= high, "the cube holds the points");
        assert!(near(high - low, metadata.bounding_box.max[0] - metadata.bounding_box.min[0]), "a cube");
    }
    let side = metadata.bounding_box.max[0] - metadata.bounding_box.min[0];
    assert!(near(metadata.spacing * 128.0, side), "{} and {side}", metadata.spacing);
    // The smallest of a power of two of units, so no level above the cloud.
    let longest = (0..3).map(|a| position.max[a] - position.min[a]).fold(0.0, f64::max);
    assert!(side < longest * 2.0 + 0.002, "a side of {side} for {longest}");
    assert_eq!(all_records(&octree).0.points, 60_000);
}

#[test]
fn the_same_input_twice_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    eventful(&input);
    let options = Options { name: Some("cloud".into()), ..Options::default() };
    let both = ["one", "two"].map(|name| {
        let octree = folder.path().join(name);
        let held = held_with(&input, &octree, &options, IN_CORE);
        let aside: Vec<Vec<u8>> =
            held.outcome.files_aside.iter().map(|file| fs::read(octree.join(file)).unwrap()).collect();
        assert_eq!(aside.len(), 1);
        (octree_bytes(&octree), aside)
    });
    assert!(both[0] == both[1]);
}
