//! Averaged colours of coarse levels: nothing of the input is lost for them, they
//! are what they are said to be, and the checker sees where they are not.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::judge::{self, IN_CORE, OUT_OF_CORE, held_with};
use crate::common::{all_records, context, octree_bytes, options_of, request, surface, write_las};
use lodestone::convert::options::{Encoding, LodColor, Options, Sampling};
use lodestone::convert::run;
use lodestone::format::potree::{Metadata, Node, OCTREE};
use lodestone::lab::flip;
use lodestone::lab::synth::{Recipe, SceneKind};
use lodestone::octree::attribute::{ExtraField, Scalar};
use lodestone::render::color::ColorBy;
use lodestone::render::framing::View;
use lodestone::render::octree_renderer::{OctreeRenderer, Quality};
use lodestone::render::renderer::Choice;
use lodestone::verify;

const MODES: [LodColor; 2] = [LodColor::Attribute, LodColor::Average];

fn with(lod_color: LodColor) -> Options {
    Options { lod_color, name: Some("cloud".into()), ..Options::default() }
}

/// A cloud of point format 3; its colours are noise.
fn cloud(folder: &Path, points: u64) -> PathBuf {
    let input = folder.join("cloud.las");
    write_las(&input, &options_of(3, false), &surface(3, points, 1));
    input
}

/// The same, flat, so that every level has neighbours to average.
fn flat(points: u64) -> Vec<u8> {
    let mut records = surface(3, points, 1);
    records.chunks_exact_mut(34).for_each(|record| record[8..12].copy_from_slice(&[7, 0, 0, 0]));
    records
}

/// The attributes of a point's own colour and of its mean.
fn names(lod_color: LodColor) -> [&'static str; 2] {
    match lod_color {
        LodColor::Average => ["rgb original", "rgb"],
        LodColor::Attribute => ["rgb", "rgb average"],
        LodColor::Keep => ["rgb", "rgb"],
    }
}

/// A point's position, its own colour, and the mean.
type Point = ([u8; 12], [u16; 3], [u16; 3]);

/// The points of an octree, node by node.
fn points(octree: &Path, lod_color: LodColor) -> Vec<(Node, Vec<Point>)> {
    let (metadata, nodes) = all_records(octree);
    let schema = metadata.schema().unwrap();
    let [own, mean] = names(lod_color).map(|name| schema.offset_of(name).unwrap());
    let colour = |record: &[u8], at: usize| {
        [0, 2, 4].map(|channel| u16::from_le_bytes([record[at + channel], record[at + channel + 1]]))
    };
    let point = |record: &[u8]| (record[..12].try_into().unwrap(), colour(record, own), colour(record, mean));
    let points = |records: Vec<u8>| records.chunks_exact(schema.record_size()).map(point).collect();
    nodes.into_iter().map(|(node, records)| (node, points(records))).collect()
}

fn report(octree: &Path, input: &Path) -> verify::VerifyReport {
    verify::verify(&verify::VerifyRequest {
        octree: octree.to_path_buf(),
        against: vec![input.to_path_buf()],
        damaged: false,
        memory_limit: 1 << 30,
        spacing: verify::SpacingRule::Auto,
    })
    .unwrap()
}

#[test]
fn the_same_bytes_whatever_the_threads_and_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    let input = cloud(folder.path(), 450_000);
    for (lod_color, sampling) in
        [(LodColor::Average, Sampling::Poisson), (LodColor::Attribute, Sampling::Random)]
    {
        let options = Options { sampling, ..with(lod_color) };
        let mut first = None;
        for (threads, memory) in [(1, IN_CORE), (2, IN_CORE), (4, IN_CORE), (2, OUT_OF_CORE)] {
            let output = folder.path().join(format!("{sampling:?}-{threads}-{memory}"));
            let wanted = request(std::slice::from_ref(&input), &output, &options);
            let outcome = run::convert(&wanted, &context(folder.path(), threads, memory)).unwrap();
            assert_eq!(outcome.scratch_bytes > 0, memory == OUT_OF_CORE);
            assert!(outcome.chunks > 1);
            let bytes = octree_bytes(&output);
            assert!(
                first.get_or_insert_with(|| bytes.clone()) == &bytes,
                "{threads} threads, {memory} bytes"
            );
            fs::remove_dir_all(&output).unwrap();
        }
    }
}

/// Each way of converting, held against the input; and all of them put the same
/// points into the same nodes, with the same two colours.
#[test]
fn every_mode_keeps_every_colour_of_the_input_and_every_point_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (cloud(folder.path(), 120_000), folder.path().join("octree"));
    for sampling in [Sampling::Poisson, Sampling::Random] {
        held_with(&input, &output, &Options { sampling, ..with(LodColor::Keep) }, IN_CORE);
        let kept = points(&output, LodColor::Keep);
        let mut first = None;
        for lod_color in MODES {
            for encoding in [Encoding::Default, Encoding::Brotli] {
                let options = Options { sampling, encoding, ..with(lod_color) };
                let held = held_with(&input, &output, &options, IN_CORE);
                assert_eq!(held.outcome.lod_color, lod_color);
                let said = held.report.to_string();
                assert!(said.contains("holds averages") && said.contains("averages  "), "{said}");
                // Brotli nodes are in Morton order, so all are compared sorted.
                let mut points = points(&output, lod_color);
                points.iter_mut().for_each(|(_, points)| points.sort_unstable());
                assert!(points.iter().zip(&kept).all(|((node, points), (kept, owns))| {
                    let mut owns: Vec<_> = owns.iter().map(|(place, own, _)| (place, own)).collect();
                    owns.sort_unstable();
                    node.name == kept.name && points.iter().map(|(place, own, _)| (place, own)).eq(owns)
                }));
                let points: Vec<_> = points.into_iter().map(|(node, points)| (node.name, points)).collect();
                assert!(first.get_or_insert_with(|| points.clone()) == &points, "{lod_color:?} {encoding:?}");
            }
        }
    }
}

/// What averaging is for: noise calms down towards the root, and stays what it is
/// in the leaves.
#[test]
fn coarse_levels_are_calmer_and_leaves_are_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("flat.las"), folder.path().join("octree"));
    write_las(&input, &options_of(3, false), &flat(300_000));
    held_with(&input, &output, &with(LodColor::Average), IN_CORE);
    let nodes = points(&output, LodColor::Average);
    assert!(nodes.len() > 30);
    let unrest = |colour: fn(&Point) -> [u16; 3], points: &[Point]| {
        let values = points.iter().flat_map(colour).map(|value| (f64::from(value) - 32_767.5).abs());
        values.sum::<f64>() / (3 * points.len()) as f64
    };
    let mut inner = 0;
    for (node, points) in nodes.iter().filter(|(node, _)| node.points > 0) {
        if node.child_mask == 0 {
            assert!(points.iter().all(|(_, own, mean)| own == mean), "{}", node.name);
        } else {
            inner += 1;
            assert!(unrest(|p| p.2, points) < 0.8 * unrest(|p| p.1, points), "{}", node.name);
        }
    }
    assert!(inner > 4, "{inner} inner nodes");
    let (_, root) = &nodes[0];
    assert!(unrest(|p| p.2, root) < 0.4 * unrest(|p| p.1, root), "the root is calmest");
}

/// What reads our octrees by themselves sees both modes alike: pictures show the
/// means wherever they stand.
#[test]
fn pictures_show_the_means_of_either_mode() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (cloud(folder.path(), 60_000), folder.path().join("octree"));
    let [kept, beside, instead] = [LodColor::Keep, LodColor::Attribute, LodColor::Average].map(|lod_color| {
        held_with(&input, &output, &with(lod_color), IN_CORE);
        let mut studio = OctreeRenderer::open(&output, ColorBy::Auto, Choice::Cpu).unwrap();
        assert_eq!(studio.shows(), "rgb");
        studio.still([64, 64], View::Overview, &Quality::default()).unwrap().0
    });
    assert!(beside == instead);
    assert!(beside != kept);
}

/// And they come nearer to the picture of all points than the points' own colours.
#[test]
fn a_picture_of_few_points_is_nearer_to_that_of_all() {
    let folder = tempfile::tempdir().unwrap();
    let noise = folder.path().join("noise.las");
    write_las(&noise, &options_of(3, false), &flat(400_000));
    let scenes = [SceneKind::Terrain, SceneKind::Town, SceneKind::Interior];
    let scenes = scenes.map(|kind| judge::write_scene(Recipe::new(kind, 400_000, 3), folder.path()));
    for input in [noise].into_iter().chain(scenes) {
        let drawn = |lod_color: LodColor, quality: &Quality| {
            let output = folder.path().join("octree");
            held_with(&input, &output, &with(lod_color), IN_CORE);
            let mut studio = OctreeRenderer::open(&output, ColorBy::Rgb, Choice::Cpu).unwrap();
            studio.still([64, 64], View::Overview, quality).unwrap().0
        };
        let all = drawn(LodColor::Keep, &Quality::full());
        let error = |lod_color| {
            let few = drawn(lod_color, &Quality::default());
            (flip::pixel_error(&all.pixels, &few.pixels), flip::mean(64, &all.pixels, &few.pixels))
        };
        let (own, mean) = (error(LodColor::Keep), error(LodColor::Attribute));
        println!("{}: own {own:?}, mean {mean:?}", input.display());
        assert!(mean.0 < own.0 && mean.1 < own.1, "{}: {own:?} {mean:?}", input.display());
    }
}

/// Changes bytes of points that `is_meant` chooses, and gives the checker's word.
fn spoiled(
    octree: &Path,
    input: &Path,
    name: &str,
    is_meant: impl Fn(&Node) -> bool,
) -> verify::VerifyReport {
    let (metadata, nodes) = all_records(octree);
    let schema = metadata.schema().unwrap();
    let (node, _) = nodes.iter().filter(|(node, _)| node.points > 0 && is_meant(node)).last().unwrap();
    let at = node.offset as usize + schema.offset_of(name).unwrap();
    let right = fs::read(octree.join(OCTREE)).unwrap();
    let mut wrong = right.clone();
    wrong[at] ^= 1;
    fs::write(octree.join(OCTREE), wrong).unwrap();
    let report = report(octree, input);
    fs::write(octree.join(OCTREE), right).unwrap();
    report
}

#[test]
fn a_changed_original_or_a_leaf_s_changed_average_does_not_pass() {
    let folder = tempfile::tempdir().unwrap();
    let (input, octree) = (cloud(folder.path(), 60_000), folder.path().join("octree"));
    for lod_color in MODES {
        held_with(&input, &octree, &with(lod_color), IN_CORE);
        let [own, mean] = names(lod_color);
        for of_leaf in [true, false] {
            let is_meant = |node: &Node| (node.child_mask == 0) == of_leaf;
            let changed = spoiled(&octree, &input, own, is_meant);
            assert!(!changed.ok, "{changed}");
            let against = changed.against.as_ref().unwrap();
            assert_eq!((against.missing, against.extra), (1, 1), "{changed}");
            assert!(changed.to_string().contains(&format!("{own}: ")), "{changed}");
        }
        let changed = spoiled(&octree, &input, mean, |node| node.child_mask == 0);
        let against = changed.against.as_ref().unwrap();
        assert!(!changed.ok && against.missing == 0, "{changed}");
        assert!(changed.to_string().contains("averages that cannot be"), "{changed}");
        // A mean of a coarse level cannot be told from another by the octree alone.
        assert!(spoiled(&octree, &input, mean, |node| node.child_mask != 0).ok);
        // What is not said to be an average is not excused.
        let mut metadata = Metadata::read(&octree).unwrap();
        metadata.generator.as_mut().unwrap().lod_color = None;
        fs::write(octree.join("metadata.json"), metadata.to_json()).unwrap();
        assert!(!report(&octree, &input).ok);
    }
}

/// Fields of an input that are called like our attributes are fields of an input.
#[test]
fn extra_bytes_of_the_same_names_are_kept_and_compared() {
    let folder = tempfile::tempdir().unwrap();
    let (input, octree) = (folder.path().join("in.las"), folder.path().join("octree"));
    let extra: Vec<ExtraField> = ["rgb average", "rgb original"]
        .into_iter()
        .zip([26, 32])
        .map(|(name, position)| ExtraField {
            name: name.into(),
            description: String::new(),
            scalar: Scalar::U16,
            elements: 3,
            position,
            scale: vec![],
            offset: vec![],
        })
        .collect();
    let noise = surface(2, 30_000, 3);
    let records: Vec<u8> = noise
        .chunks_exact(26)
        .zip(noise.chunks_exact(26).rev())
        .flat_map(|(record, other)| [record, &other[12..24]].concat())
        .collect();
    write_las(&input, &lodestone::format::las::LasOptions { extra, ..options_of(2, false) }, &records);
    for lod_color in [LodColor::Keep, LodColor::Attribute, LodColor::Average] {
        held_with(&input, &octree, &with(lod_color), IN_CORE);
        for name in ["rgb average (2)", "rgb original (2)"] {
            let changed = spoiled(&octree, &input, name, |_| true);
            assert_eq!(changed.against.as_ref().unwrap().missing, 1, "{lod_color:?}: {changed}");
        }
    }
}

/// Without colours there is nothing to average, and nothing is added.
#[test]
fn clouds_without_colours_come_out_as_without_the_option() {
    let folder = tempfile::tempdir().unwrap();
    let (colourless, coloured) = (folder.path().join("a.las"), folder.path().join("b.las"));
    write_las(&colourless, &options_of(1, false), &surface(1, 20_000, 5));
    let mut black = surface(2, 20_000, 5);
    black.chunks_exact_mut(26).for_each(|record| record[20..].fill(0));
    write_las(&coloured, &options_of(2, false), &black);
    for (input, attributes) in [(&colourless, ""), (&coloured, "intensity"), (&coloured, "auto")] {
        let octree = |lod_color| {
            let attributes = [attributes.to_string()].into_iter().filter(|name| !name.is_empty()).collect();
            let output = folder.path().join("octree");
            let held = held_with(input, &output, &Options { attributes, ..with(lod_color) }, IN_CORE);
            assert_eq!(held.outcome.lod_color, LodColor::Keep);
            octree_bytes(&output)
        };
        let kept = octree(LodColor::Keep);
        assert!(MODES.into_iter().all(|lod_color| octree(lod_color) == kept), "{attributes}");
    }
}

/// Guards take points away; the means are those of what is left.
#[test]
fn what_is_set_aside_is_not_averaged_and_not_lost() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("crowded.las");
    let mut records = surface(3, 60_000, 7);
    let (crowd, place) = (25_000, 31 * 34);
    let place: [u8; 12] = records[place..place + 12].try_into().unwrap();
    records.chunks_exact_mut(34).take(crowd).for_each(|record| record[..12].copy_from_slice(&place));
    // A stray point, far above.
    let last = records.len() - 34;
    records[last + 8..last + 12].copy_from_slice(&i32::MAX.to_le_bytes());
    write_las(&input, &options_of(3, false), &records);
    for lod_color in MODES {
        let held = judge::held_under(&input, &folder.path().join("octree"), &with(lod_color));
        assert_eq!(held.outcome.points_set_aside, crowd as u64 - 10_000 + 1);
    }
}

#[test]
fn the_program_says_where_the_originals_are() {
    let folder = tempfile::tempdir().unwrap();
    let (input, octree) = (cloud(folder.path(), 2_000), folder.path().join("octree"));
    let lodestone = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_lodestone")).args(arguments).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let (from, to) = (input.to_str().unwrap(), octree.to_str().unwrap());
    let said = lodestone(&["convert", from, "-o", to, "--lod-color", "AVERAGE", "--progress", "plain"]);
    assert!(said.contains("`rgb` holds averages; the originals are in `rgb original`"), "{said}");
    assert!(lodestone(&["info", to]).contains("rgb original the points' own"));
    assert!(lodestone(&["verify", to, "--against", from]).contains("the originals are in 'rgb original'"));
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(octree.join("report.json")).unwrap()).unwrap();
    assert_eq!(
        (&report["options"]["lod_color"], &report["lod_color"]),
        (&"average".into(), &"average".into())
    );
    let none = lodestone(&[
        "convert",
        from,
        "-o",
        to,
        "--overwrite",
        "--lod-color",
        "average",
        "--attributes",
        "intensity",
    ]);
    assert!(none.contains("no colours were averaged"), "{none}");
}

/// Real colours, of eight bits and of sixteen.
#[test]
fn real_clouds_keep_their_colours() {
    let Some(data) = crate::common::data() else { return };
    let folder = tempfile::tempdir().unwrap();
    for name in ["single/autzen_trim.laz", "single/append-bug.laz", "single/lion_takanawa.copc.laz"] {
        for (lod_color, encoding) in
            [(LodColor::Average, Encoding::Brotli), (LodColor::Attribute, Encoding::Default)]
        {
            let options = Options { encoding, ..with(lod_color) };
            let held = held_with(&data.join(name), &folder.path().join("octree"), &options, IN_CORE);
            assert_eq!(held.outcome.lod_color, lod_color, "{name}");
            println!("{name}: {} points, {lod_color:?}\n{}", held.outcome.points_out, held.report);
        }
    }
}
