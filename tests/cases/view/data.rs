//! What a viewer is sent, against the octree that it comes from.

use super::{all_pages, octree_of};
use lodestone::convert::options::{Encoding, Options};
use lodestone::lab::synth::SceneKind;
use lodestone::render::color::{ColorBy, ColorMapper};
use lodestone::render::octree::Octree;
use lodestone::render::sample::CoarseSample;
use lodestone::render::viewer::attributes::{Legend, offers};
use lodestone::render::viewer::description::Point;
use lodestone::render::viewer::points::{STEPS, dequantized, encode};
use lodestone::render::viewer::{Description, Paint};

/// Every node of the pages, and each of its points, where and of which color it is in the
/// octree; in pieces as in one.
fn is_faithful(path: &std::path::Path) {
    let mut octree = Octree::open(path).unwrap();
    let sample = CoarseSample::take(&mut octree).unwrap();
    let paint = Paint::by(&octree, &sample, "auto").unwrap();
    let painter = ColorMapper::choose(&octree, &sample, ColorBy::Auto).unwrap();
    let (_, nodes) = all_pages(&mut octree, 40);
    let all: u64 = nodes.values().map(|points| u64::from(*points)).sum();
    assert_eq!(all, octree.metadata.points);
    for (name, points) in nodes {
        let node = octree.node(name).unwrap().unwrap();
        let (cube, records) = (octree.cube(name), octree.range(&node, 0..points).unwrap());
        let sent = encode(&octree, &node, 0..u32::MAX, &paint, true).unwrap();
        assert_eq!(sent.len(), 9 * points as usize, "{name}");
        let (positions, colors) = sent.split_at(6 * points as usize);
        let each = positions.chunks_exact(6).zip(colors.chunks_exact(3));
        for (record, (steps, color)) in records.chunks_exact(octree.schema.record_size()).zip(each) {
            let steps = [0, 2, 4].map(|at| u16::from_le_bytes([steps[at], steps[at + 1]]));
            let (back, position) = (dequantized(steps, cube), octree.position(record));
            for axis in 0..3 {
                // What lies on the upper face of its cube is in the last step.
                let step = cube.1[axis] / STEPS;
                assert!(
                    (back[axis] - position[axis]).abs() <= 0.51 * step + 1e-9,
                    "{name} {position:?} {back:?}"
                );
            }
            assert_eq!(color, painter.paint(record, position[2]));
        }
        let middle = points / 3;
        let pieces = [0..middle, middle..points]
            .map(|piece| encode(&octree, &node, piece, &paint, true).unwrap())
            .map(|piece| piece.split_at(piece.len() / 9 * 6).0.to_vec());
        assert_eq!(pieces.concat(), positions, "{name} in pieces");
        assert_eq!(encode(&octree, &node, 0..points, &paint, false).unwrap(), colors);
        assert!(encode(&octree, &node, points..u32::MAX, &paint, true).unwrap().is_empty());
    }
}

#[test]
fn what_is_sent_is_the_octrees_own() {
    for (kind, encoding) in [
        (SceneKind::Terrain, Encoding::Default),
        (SceneKind::Interior, Encoding::Brotli),
        (SceneKind::Volume, Encoding::Default),
    ] {
        let folder = tempfile::tempdir().unwrap();
        is_faithful(&octree_of(kind, 60_000, folder.path(), &Options { encoding, ..Options::default() }));
    }
}

/// Nodes of a COPC file lie along the flight line, but come in an even order.
#[test]
fn copc_is_sent_from_coarse_to_fine() {
    let Some(data) = crate::common::data() else { return };
    let path = data.join("single/lone-star.copc.laz");
    let mut octree = Octree::open(&path).unwrap();
    assert!(octree.has_prefixes());
    let (_, nodes) = all_pages(&mut octree, 1024);
    assert_eq!(nodes.values().map(|points| u64::from(*points)).sum::<u64>(), octree.metadata.points);
    let (name, points) = nodes.iter().max_by_key(|(_, points)| **points).unwrap();
    let node = octree.node(*name).unwrap().unwrap();
    let size = octree.schema.record_size();
    let mut all: Vec<Vec<u8>> =
        octree.range(&node, 0..*points).unwrap().chunks_exact(size).map(<[u8]>::to_vec).collect();
    let mut stored: Vec<Vec<u8>> =
        octree.records(&node, *points).unwrap().chunks_exact(size).map(<[u8]>::to_vec).collect();
    assert_ne!(all, stored);
    all.sort();
    stored.sort();
    assert_eq!(all, stored);
}

#[test]
fn pages_of_any_size_tell_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = octree_of(SceneKind::Town, 200_000, folder.path(), &Options::default());
    let mut octree = Octree::open(&path).unwrap();
    let (one, nodes) = all_pages(&mut octree, 1_000_000);
    assert_eq!(one.len(), 1);
    for size in [9, 33, 100] {
        octree.forget_nodes();
        let (pages, same) = all_pages(&mut octree, size);
        assert!(pages.len() > nodes.len() / size, "{} pages of {size}", pages.len());
        assert_eq!(same, nodes);
    }
}

#[test]
fn every_attribute_can_be_colored_by() {
    let folder = tempfile::tempdir().unwrap();
    let path = octree_of(SceneKind::Town, 30_000, folder.path(), &Options::default());
    let mut octree = Octree::open(&path).unwrap();
    let sample = CoarseSample::take(&mut octree).unwrap();
    let offers = offers(&octree, &sample);
    let named: Vec<&str> = offers.iter().map(|offer| offer.by.as_str()).collect();
    assert_eq!(named[..2], ["auto", "height"]);
    for attribute in octree.schema.attributes.iter().filter(|attribute| attribute.name != "position") {
        assert!(named.contains(&attribute.name.as_str()), "{} in {named:?}", attribute.name);
    }
    let root = octree.node("r".parse().unwrap()).unwrap().unwrap();
    for offer in &offers {
        let paint = Paint::by(&octree, &sample, &offer.by).unwrap();
        let colors = encode(&octree, &root, 0..root.points, &paint, false).unwrap();
        assert_eq!(colors.len(), 3 * root.points as usize, "{}", offer.by);
        match &offer.legend {
            Legend::Gradient { low, high, stops } => {
                assert!(low < high && stops.len() > 2, "{offer:?}");
            }
            // Every color on the screen is in the legend.
            Legend::Classes { classes } => {
                let known = |color: &[u8]| classes.iter().any(|class| class.color == color);
                assert!(colors.chunks_exact(3).all(known), "{classes:?}");
            }
            Legend::Own => assert!(["auto", "rgb"].contains(&offer.by.as_str()), "{offer:?}"),
        }
    }
    for none in ["", "nothing", "intensity[1]", "position", "rgb[0]x"] {
        assert_eq!(Paint::by(&octree, &sample, none), None, "{none}");
    }
}

#[test]
fn a_picked_point_has_its_own_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = octree_of(SceneKind::Terrain, 5_000, folder.path(), &Options::default());
    let mut octree = Octree::open(&path).unwrap();
    let node = octree.node("r".parse().unwrap()).unwrap().unwrap();
    let at = node.points - 1;
    let point = Point::at(&octree, &node, at).unwrap().unwrap();
    let record = octree.range(&node, at..at + 1).unwrap();
    assert_eq!(point.position, octree.position(&record));
    let value = |name: &str| &point.attributes.iter().find(|(known, _)| known == name).unwrap().1;
    let offset = octree.schema.offset_of("intensity").unwrap();
    assert_eq!(value("intensity"), u16::from_le_bytes([record[offset], record[offset + 1]]));
    let class = octree.schema.offset_of("classification").unwrap();
    assert_eq!(value("classification"), record[class]);
    assert_eq!(value("rgb").as_array().unwrap().len(), 3);
    assert_eq!(Point::at(&octree, &node, node.points).unwrap(), None);
}

/// The start is that of the octree's picture, for the shape of one's own window.
#[test]
fn a_description_says_where_to_stand() {
    let folder = tempfile::tempdir().unwrap();
    let path = octree_of(SceneKind::Terrain, 20_000, folder.path(), &Options::default());
    let mut octree = Octree::open(&path).unwrap();
    let sample = CoarseSample::take(&mut octree).unwrap();
    let [wide, tall] = [[1600, 400], [300, 700]].map(|size| Description::of(&octree, &sample, size));
    assert!(tall.start.distance > wide.start.distance * 0.5 && tall.start != wide.start);
    assert_eq!(wide.points, 20_000);
    for axis in 0..3 {
        assert!(wide.bounds[0][axis] >= wide.low[axis] && wide.bounds[1][axis] <= wide.low[axis] + wide.side);
    }
}
