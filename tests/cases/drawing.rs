//! Pictures of octrees: of clouds that have nothing to show or show it oddly,
//! of octrees that are damaged or another's, and what they cost.

use std::path::{Path, PathBuf};

use crate::common::judge::{patch, write_points, write_scene};
use crate::common::{mix, options_of, write_las};
use lodestone::convert::options::{Encoding, Options};
use lodestone::convert::preview::{self, preview};
use lodestone::format::potree::{self, Metadata};
use lodestone::lab::flip;
use lodestone::lab::synth::{Recipe, SceneKind};
use lodestone::render::RenderError;
use lodestone::render::color::ColorBy;
use lodestone::render::frame::{Background, Picture};
use lodestone::render::framing::View;
use lodestone::render::octree_renderer::{OctreeRenderer, Quality};
use lodestone::render::renderer::Choice;

const SIZE: [u32; 2] = [128, 128];

fn open(octree: &Path) -> OctreeRenderer {
    OctreeRenderer::open(octree, ColorBy::Auto, Choice::Cpu).unwrap()
}

fn shown(octree: &Path, quality: &Quality) -> Picture {
    open(octree).still(SIZE, View::Overview, quality).unwrap().0
}

fn covered(picture: &Picture) -> usize {
    picture.pixels.iter().filter(|pixel| pixel[3] > 0).count()
}

fn clear() -> Quality {
    Quality { background: Background::Transparent, ..Quality::default() }
}

/// An octree of a scene.
fn scene(kind: SceneKind, points: u64, folder: &Path, options: &Options) -> PathBuf {
    let cloud = write_scene(Recipe::new(kind, points, 3), folder);
    let output = folder.join("octree");
    crate::common::convert(&[cloud], &output, options).unwrap();
    output
}

/// An octree of records of point format 2, which has a colour.
fn colored(folder: &Path, color: impl Fn(u64) -> [u16; 3]) -> PathBuf {
    let mut records = Vec::new();
    for number in 0..3000u64 {
        let dice = mix(number);
        for coordinate in [dice as u32 % 10_000, (dice >> 32) as u32 % 10_000, number as u32 % 7] {
            records.extend_from_slice(&(coordinate as i32).to_le_bytes());
        }
        // Intensity, returns, class, angle, user data, source.
        records.extend_from_slice(&[0, 0, 0b1001, 2, 0, 0, 0, 0]);
        color(number).iter().for_each(|value| records.extend_from_slice(&value.to_le_bytes()));
    }
    write_las(&folder.join("a.las"), &options_of(2, false), &records);
    let output = folder.join("octree");
    crate::common::convert(&[folder.join("a.las")], &output, &Options::default()).unwrap();
    output
}

/// Of the pixels that the cloud covers, the brightest channel.
fn brightest(picture: &Picture) -> u8 {
    let solid = picture.pixels.iter().filter(|pixel| pixel[3] == 255);
    solid.flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).max().unwrap_or(0)
}

#[test]
fn clouds_without_extent_or_far_away_are_shown() {
    let row: Vec<[i32; 3]> = (0..500).map(|n| [n * 20, 0, 0]).collect();
    let wall: Vec<[i32; 3]> = (0..900).map(|n| [n % 30 * 100, 0, n / 30 * 100]).collect();
    let clouds: [(&str, Vec<[i32; 3]>, f64); 6] = [
        ("one point", vec![[0; 3]], 0.0),
        ("twice the same", vec![[5; 3]; 2], 0.0),
        ("a line", row.clone(), 0.0),
        ("a plane", wall.clone(), 0.0),
        ("a plane far away", wall, 1e7),
        ("a line far away", row, -1e7),
    ];
    for (what, points, offset) in clouds {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.las");
        write_points(&file, [0.001; 3], [offset; 3], &points);
        let octree = folder.path().join("octree");
        crate::common::convert(&[file], &octree, &Options::default()).unwrap();
        for view in [View::Overview, View::Top, View::Grazing, View::Close, View::Inside] {
            let (picture, _) = open(&octree).still(SIZE, view, &clear()).unwrap();
            let seen = covered(&picture);
            // From within or above a line one may see next to nothing of it.
            assert!(seen > 0 || view == View::Inside || view == View::Close, "{what}, {view:?}");
            assert!(seen < picture.pixels.len(), "{what}, {view:?}");
            // Whoever looks at it finds it.
            assert!(seen >= 50 || view != View::Overview, "{what}: {seen} pixels");
        }
    }
}

#[test]
fn black_and_missing_colours_give_way_to_what_is_there() {
    let by = |color: fn(u64) -> [u16; 3]| {
        let folder = tempfile::tempdir().unwrap();
        open(&colored(folder.path(), color)).shows()
    };
    assert_eq!(by(|_| [0; 3]), "classification", "black, and intensity all zero");
    assert_eq!(by(|_| [700; 3]), "classification", "one colour for all");
    assert_eq!(by(|n| [n as u16, 0, 0]), "rgb");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.las");
    write_points(&file, [0.01; 3], [0.0; 3], &crate::common::judge::field(2000, [0; 3], 9000));
    crate::common::convert(&[file], &folder.path().join("octree"), &Options::default()).unwrap();
    // Its intensity is noise, and shows nothing.
    assert_eq!(open(&folder.path().join("octree")).shows(), "height");
    let asked = OctreeRenderer::open(&folder.path().join("octree"), ColorBy::Rgb, Choice::Cpu);
    assert!(matches!(asked, Err(RenderError::NoAttribute { attribute: "rgb", .. })));
}

/// Eight bits in a field of sixteen, all sixteen, and a few bits at the bottom:
/// each is as bright as it is meant.
#[test]
fn colours_are_as_bright_as_they_are_meant() {
    let of = |color: fn(u64) -> [u16; 3]| {
        let folder = tempfile::tempdir().unwrap();
        brightest(&shown(&colored(folder.path(), color), &clear()))
    };
    assert!(of(|n| [n as u16 % 256, 90, 90]) > 180, "eight bits");
    assert!(of(|n| [(n as u16 % 256) << 8, 90 << 8, 90 << 8]) > 180, "sixteen bits");
    assert!(of(|n| [n as u16 % 4096, 900, 900]) > 150, "twelve bits");
}

/// Any number of threads, any order of the points that is left open, any
/// repetition: the same bytes.
#[test]
fn a_picture_does_not_show_how_it_was_made() {
    let folder = tempfile::tempdir().unwrap();
    let octree = scene(SceneKind::Town, 150_000, folder.path(), &Options::default());
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| shown(&octree, &Quality::default()))
    };
    let first = with(1);
    for threads in [2, 5] {
        assert_eq!(with(threads), first, "{threads} threads");
    }
}

/// A picture reads what its pixels can show: hardly more of four times as many
/// points, and never more than its budget.
#[test]
fn a_picture_costs_what_its_pixels_cost() {
    let effort = |points: u64, quality: &Quality| {
        let folder = tempfile::tempdir().unwrap();
        let octree = scene(SceneKind::Terrain, points, folder.path(), &Options::default());
        open(&octree).still([64, 64], View::Overview, quality).unwrap().1
    };
    let (small, large) = (effort(200_000, &Quality::default()), effort(800_000, &Quality::default()));
    assert!(large.points < 60_000, "{large:?}");
    assert!(large.bytes_read as f64 <= 1.3 * small.bytes_read as f64, "{small:?} {large:?}");
    let bound = effort(200_000, &Quality { budget: 20_000, spacing: 0.0, ..Quality::default() });
    assert!(bound.points <= 20_000 && bound.points > 10_000, "{bound:?}");
    let all = effort(200_000, &Quality::full());
    assert!(all.points > 190_000, "{all:?}");
}

/// The default is close to the picture of all points.
#[test]
fn few_points_show_nearly_what_all_of_them_do() {
    for kind in [SceneKind::Terrain, SceneKind::Interior, SceneKind::Object] {
        let folder = tempfile::tempdir().unwrap();
        let octree = scene(kind, 1_000_000, folder.path(), &Options::default());
        let full = shown(&octree, &Quality::full());
        let usual = shown(&octree, &Quality::default());
        let (error, flips) =
            (flip::pixel_error(&full.pixels, &usual.pixels), flip::mean(128, &full.pixels, &usual.pixels));
        assert!(error < 6.0 && flips < 0.06, "{kind:?}: {error} {flips}");
    }
}

/// Octrees of others have no order within their nodes; compressed ones cannot
/// be read in part. Both show the same.
#[test]
fn other_octrees_show_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let ours = scene(SceneKind::Terrain, 200_000, folder.path(), &Options::default());
    let picture = shown(&ours, &Quality::default());
    let mut metadata = Metadata::read(&ours).unwrap();
    metadata.generator = None;
    std::fs::write(ours.join(potree::METADATA), metadata.to_json()).unwrap();
    let theirs = shown(&ours, &Quality::default());
    assert!(flip::mean(128, &picture.pixels, &theirs.pixels) < 0.06);
    let folder = tempfile::tempdir().unwrap();
    let options = Options { encoding: Encoding::Brotli, ..Options::default() };
    let compressed = scene(SceneKind::Terrain, 200_000, folder.path(), &options);
    let compressed = shown(&compressed, &Quality::default());
    assert!(flip::mean(128, &picture.pixels, &compressed.pixels) < 0.06);
}

/// Every byte of the hierarchy turned, one at a time, and files cut: a picture
/// or an error, never a panic, never memory without bound.
#[test]
fn damaged_octrees_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let octree = scene(SceneKind::Terrain, 30_000, folder.path(), &Options::default());
    let hierarchy = octree.join(potree::HIERARCHY);
    let bytes = std::fs::read(&hierarchy).unwrap();
    let mut refused = 0;
    for at in 0..bytes.len().min(600) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1 << (mix(at as u64) % 8);
        std::fs::write(&hierarchy, damaged).unwrap();
        let drawn = OctreeRenderer::open(&octree, ColorBy::Auto, Choice::Cpu)
            .and_then(|mut studio| studio.still([32, 32], View::Overview, &Quality::full()));
        refused += usize::from(drawn.is_err());
    }
    assert!(refused > 50, "only {refused} were noticed");
    std::fs::write(&hierarchy, &bytes[..bytes.len() / 2]).unwrap();
    assert!(OctreeRenderer::open(&octree, ColorBy::Auto, Choice::Cpu).is_err());
    std::fs::write(&hierarchy, &bytes).unwrap();
    patch(&octree.join(potree::METADATA), &[(0, b"[")]);
    let error = OctreeRenderer::open(&octree, ColorBy::Auto, Choice::Cpu).err().unwrap().to_string();
    assert!(error.contains("metadata"), "{error}");
}

#[test]
fn the_folder_tells_what_it_holds() {
    let folder = tempfile::tempdir().unwrap();
    let octree = scene(SceneKind::Object, 60_000, folder.path(), &Options::default());
    let into = folder.path().join("pictures");
    let turntable = Some(preview::Turntable { size: [64, 64], frames: 6, mp4: false });
    let options = preview::PreviewOptions { turntable, ..preview::PreviewOptions::default() };
    let context = crate::common::context(folder.path(), 2, 1 << 30);
    let made = preview(&octree, &into, &options, &context).unwrap();
    let told: preview::PreviewManifest =
        serde_json::from_slice(&std::fs::read(into.join(preview::INDEX)).unwrap()).unwrap();
    assert_eq!(told, made);
    let names: Vec<&str> = told.assets.iter().map(|asset| asset.href.as_str()).collect();
    assert_eq!(names, ["thumbnail.png", "overview.png", "turntable.webp"]);
    for asset in &told.assets {
        assert_eq!(std::fs::metadata(into.join(&asset.href)).unwrap().len(), asset.bytes);
    }
    let bytes = std::fs::read(into.join("thumbnail.png")).unwrap();
    let reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (512, 512));
    let bytes = std::fs::read(into.join("turntable.webp")).unwrap();
    let frames: Vec<_> = webp_animation::Decoder::new(&bytes).unwrap().into_iter().collect();
    assert_eq!(frames.len(), 6);
    assert!(frames.iter().all(|frame| frame.dimensions() == (64, 64)));
    assert_ne!(frames[0].data(), frames[3].data(), "it turns");
}
