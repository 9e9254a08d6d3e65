//! What pictures show of clouds whose colors, intensities or shapes are odd.

use std::path::{Path, PathBuf};

use lodestone::convert::options::{GuardMode, Options};
use lodestone::format::las::{LasOptions, Vlr};
use lodestone::render::color::ColorBy;
use lodestone::render::frame::{Background, Picture};
use lodestone::render::framing::View;
use lodestone::render::octree_renderer::{OctreeRenderer, Quality};
use lodestone::render::renderer::Choice;

use crate::cases;
use crate::common::{self, mix, options_of, write_las};

const SIZE: [u32; 2] = [160, 120];

/// A point of a hilly field of 100 by 100: position, intensity and color.
type Point = ([f64; 3], u16, [u16; 3]);

fn field(points: u64, of: impl Fn([f64; 3], u64) -> (u16, [u16; 3])) -> Vec<Point> {
    let share = |dice: u64| (dice % 100_003) as f64 / 100_003.0;
    (0..points)
        .map(|n| {
            let dice = mix(n);
            let (x, y) = (share(dice) * 100.0, share(dice >> 32) * 100.0);
            let at = [x, y, 3.0 * (x / 15.0).sin() * (y / 20.0).cos()];
            let (intensity, color) = of(at, mix(dice));
            (at, intensity, color)
        })
        .collect()
}

fn octree(folder: &Path, points: &[Point]) -> PathBuf {
    let mut records = Vec::new();
    for (at, intensity, color) in points {
        at.iter().for_each(|c| records.extend_from_slice(&((c * 100.0) as i32).to_le_bytes()));
        records.extend_from_slice(&intensity.to_le_bytes());
        records.extend_from_slice(&[0b1001, 1, 0, 0, 0, 0]);
        color.iter().for_each(|value| records.extend_from_slice(&value.to_le_bytes()));
    }
    let file = folder.join("a.las");
    write_las(&file, &options_of(2, false), &records);
    let octree = folder.join("octree");
    let options = Options { outliers: GuardMode::Keep, ..Options::default() };
    common::convert(&[file], &octree, &options).expect("converted");
    octree
}

/// What an octree is colored by, and its picture without a background.
fn drawn(octree: &Path) -> (&'static str, Picture) {
    let mut studio = OctreeRenderer::open(octree, ColorBy::Auto, Choice::Cpu).expect("opened");
    let quality = Quality { background: Background::Transparent, ..Quality::default() };
    let (picture, _) = studio.still(SIZE, View::Overview, &quality).expect("drawn");
    (studio.shows(), picture)
}

fn picture(points: &[Point]) -> (&'static str, Picture) {
    let folder = tempfile::tempdir().expect("a folder");
    drawn(&octree(folder.path(), points))
}

fn solid(picture: &Picture) -> Vec<[u8; 4]> {
    picture.pixels.iter().filter(|pixel| pixel[3] == 255).copied().collect()
}

/// Shares of the covered pixels that are as good as black, and that are grey.
fn black_and_grey(picture: &Picture) -> (f64, f64) {
    let pixels = solid(picture);
    let share =
        |is: fn(&[u8; 4]) -> bool| pixels.iter().filter(|p| is(p)).count() as f64 / pixels.len() as f64;
    (
        share(|p| p[..3].iter().all(|c| *c < 16)),
        share(|p| p[..3].iter().max().unwrap_or(&0) - p[..3].iter().min().unwrap_or(&0) < 6),
    )
}

fn rainbow([x, y, _]: [f64; 3]) -> [u16; 3] {
    [(127.0 + 120.0 * (x / 9.0).sin()) as u16, (127.0 + 120.0 * (y / 9.0).cos()) as u16, 80]
}

fn waves([x, y, _]: [f64; 3]) -> u16 {
    (1000.0 + 900.0 * (x / 5.0).sin() * (y / 7.0).cos()) as u16
}

#[test]
fn eight_and_sixteen_bits_lie_in_one_cloud() {
    for wide in [256, 257] {
        let (shows, picture) = picture(&field(30_000, |at, _| {
            let color = rainbow(at);
            (0, if at[0] < 60.0 { color } else { color.map(|c| c * wide) })
        }));
        let (black, grey) = black_and_grey(&picture);
        assert!(shows == "rgb" && black < 0.02 && grey < 0.2, "{shows} {black} {grey}");
    }
    if let Some(cases) = cases() {
        let folder = tempfile::tempdir().expect("a folder");
        let octree = folder.path().join("octree");
        common::convert(&[cases.join("c28h_tiles")], &octree, &Options::default()).expect("converted");
        let (shows, picture) = drawn(&octree);
        assert!(shows == "rgb" && black_and_grey(&picture).0 < 0.02, "{shows}");
    }
}

#[test]
fn shadows_of_sixteen_bits_stay_dark() {
    // A twentieth of the cloud is darker than 256 of 65535.
    let (shows, picture) = picture(&field(30_000, |at, dice| {
        let dark = at[0] < 5.0;
        (0, if dark { [(dice % 90) as u16, 40, 70] } else { rainbow(at).map(|c| c * 256) })
    }));
    let (black, _) = black_and_grey(&picture);
    assert!(shows == "rgb" && black > 0.02, "{black}");
}

#[test]
fn tiles_without_colors_are_grey_among_colored_ones() {
    let half = |intensity: fn([f64; 3]) -> u16| {
        picture(&field(30_000, |at, _| (intensity(at), if at[0] < 60.0 { rainbow(at) } else { [0; 3] })))
    };
    type Intensity = fn([f64; 3]) -> u16;
    let intensities: [(&str, Intensity); 2] = [("waves", waves), ("nothing", |_| 0)];
    for (what, intensity) in intensities {
        let (shows, picture) = half(intensity);
        let (black, grey) = black_and_grey(&picture);
        assert!(shows == "rgb" && black < 0.02 && (0.2..0.7).contains(&grey), "{what}: {black} {grey}");
    }
}

#[test]
fn a_few_colored_points_are_no_color() {
    let (shows, picture) =
        picture(&field(30_000, |at, dice| (waves(at), if dice % 100 == 0 { rainbow(at) } else { [0; 3] })));
    assert_eq!((shows, black_and_grey(&picture).1 > 0.99), ("intensity", true));
}

#[test]
fn intensity_that_is_noise_gives_way_to_height() {
    type Intensity = fn([f64; 3], u64) -> u16;
    let intensities: [(&str, &str, Intensity); 5] = [
        ("noise", "height", |_, dice| (dice % 2000) as u16),
        ("coins", "height", |_, dice| 100 + 900 * (dice % 2) as u16),
        ("waves", "intensity", |at, _| waves(at)),
        ("grainy", "intensity and height", |at, dice| waves(at) + (dice % 1500) as u16),
        ("cut off", "intensity and height", |at, dice| if dice % 12 == 0 { 2000 } else { waves(at) }),
    ];
    for (what, shows, of) in intensities {
        let (told, picture) = picture(&field(30_000, |at, dice| (of(at, dice), [0; 3])));
        assert_eq!(told, shows, "{what}");
        let grey = black_and_grey(&picture).1;
        assert_eq!(grey > 0.9, shows == "intensity", "{what}: {grey}");
    }
}

/// How much of the picture's height and width the field takes that lies below.
fn taken(picture: &Picture) -> [f64; 2] {
    let [width, height] = SIZE.map(|side| side as usize);
    let covered = |x: usize, y: usize| picture.pixels[y * width + x][3] == 255;
    let columns = (0..width).filter(|x| (0..height).filter(|y| covered(*x, *y)).count() > 3).count();
    let rows = (0..height).filter(|y| (0..width).filter(|x| covered(*x, *y)).count() > 12).count();
    [columns as f64 / width as f64, rows as f64 / height as f64]
}

#[test]
fn lone_noise_takes_neither_the_frame_nor_the_colors() {
    let plain = field(30_000, |_, _| (0, [0; 3]));
    let alone = picture(&plain).1;
    for (count, from, reach) in [(1, 150.0, 0.0), (60, 60.0, 90.0), (400, 60.0, 60.0), (60, -140.0, 60.0)] {
        let noise = field(count, |_, _| (0, [0; 3]));
        let noise = noise.iter().zip(1..).map(|(point, n)| {
            let [x, y, _] = point.0;
            ([x, y, from + reach * (mix(n) % 1000) as f64 / 1000.0], 0, [0; 3])
        });
        let (_, picture) = picture(&plain.iter().copied().chain(noise).collect::<Vec<_>>());
        for (now, before) in taken(&picture).iter().zip(taken(&alone)) {
            assert!(*now > 0.8 * before, "{count} from {from}: {now} {before}");
        }
        // The field has all colors of the scale, not those of its end alone.
        let pixels = solid(&picture);
        let has = |is: fn(&[u8; 4]) -> bool| pixels.iter().filter(|p| is(p)).count() * 50 > pixels.len();
        assert!(
            has(|p| p[0] > 150 && p[2] < 100) && has(|p| p[2] > p[0] && p[2] > 60),
            "{count} from {from}"
        );
    }
}

#[test]
fn a_crowd_at_one_place_hides_nothing() {
    let mut points = field(60, |_, _| (0, [0; 3]));
    points.extend(std::iter::repeat_n(([5000.0, 5000.0, 9.0], 0, [0; 3]), 3000));
    let (_, picture) = picture(&points);
    assert!(solid(&picture).len() > 50, "{}", solid(&picture).len());
}

#[test]
fn stray_points_are_no_large_discs() {
    // A road of points, and strays beside it that are no lone ones in its frame.
    let mut road = field(40_000, |_, _| (0, [0; 3]));
    road.iter_mut().for_each(|point| point.0[1] *= 0.05);
    let without = solid(&picture(&road).1).len();
    // Alone, by twos and by threes: near each other they are no surface either.
    for together in [1, 2, 3] {
        let mut points = road.clone();
        for ([x, y, _], ..) in field(24, |_, _| (0, [0; 3])) {
            let near = (0..together).map(|n| ([x + 0.2 * f64::from(n), 10.0 + y * 0.25, 0.0], 0, [0; 3]));
            points.extend(near);
        }
        let with = solid(&picture(&points).1).len();
        assert!(with < without + 24 * 30, "{without} pixels and {with} with strays by {together}");
    }
}

#[test]
fn points_lost_at_the_origin_take_no_frame() {
    // A tile in meters, most of whose points a writer left at zero.
    for (lost, left) in [(10_000, 61), (300, 40), (1, 3_000)] {
        let tile = field(left, |_, _| (0, [0; 3]));
        let alone = picture(&tile).1;
        let far = tile.iter().map(|([x, y, z], ..)| ([x + 637_000.0, y + 849_000.0, z + 400.0], 0, [0; 3]));
        let points: Vec<Point> = far.chain((0..lost).map(|_| ([0.0; 3], 0, [0; 3]))).collect();
        let (_, picture) = picture(&points);
        let (seen, expected) = (solid(&picture).len(), solid(&alone).len());
        assert!(
            seen * 4 > expected * 3 && seen < expected * 2,
            "{lost} lost: {seen} pixels, {expected} without"
        );
    }
}

#[test]
fn a_lone_plane_fills_its_frame() {
    let plane = |a: [f64; 3], b: [f64; 3]| -> Vec<Point> {
        let flat = field(20_000, |_, _| (0, [0; 3]));
        let at = |s: f64, t: f64| std::array::from_fn(|i| a[i] * s + b[i] * t);
        flat.iter().map(|(p, ..)| (at(p[0] / 100.0, p[1] / 100.0), 0, [0; 3])).collect()
    };
    for (what, a, b) in [
        ("level", [100.0, 0.0, 0.0], [0.0, 100.0, 0.0]),
        ("a wall to the east", [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]),
        ("a wall to the south", [100.0, 0.0, 0.0], [0.0, 0.0, 100.0]),
        ("a roof to the north", [100.0, 0.0, 0.0], [0.0, 100.0, -120.0]),
        ("a roof to the south", [100.0, 0.0, 0.0], [0.0, 100.0, 120.0]),
        ("a roof over a corner", [100.0, 0.0, 120.0], [0.0, 100.0, 80.0]),
    ] {
        let (_, picture) = picture(&plane(a, b));
        let pixels = solid(&picture);
        let share = pixels.len() as f64 / picture.pixels.len() as f64;
        // Over a corner it is a rhombus that stands on its tip.
        assert!(share > 0.18, "{what}: {share}");
        assert!(pixels.iter().any(|p| p[..3].iter().any(|c| *c > 90)), "{what} is dark");
    }
}

/// A field of 2 by 1 kilometers with hills, at a place given in degrees.
fn in_degrees(folder: &Path, points: u64, [longitude, latitude]: [f64; 2]) -> PathBuf {
    let wkt = "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],\
               PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]";
    let mut records = Vec::new();
    for n in 0..points {
        let dice = mix(n);
        let (x, y) = ((dice % 100_003) as f64 / 100_003.0, ((dice >> 32) % 100_003) as f64 / 100_003.0);
        let z = 40.0 * (x * 13.0).sin() * (y * 7.0).cos();
        let east = 2000.0 * (x - 0.5) / (111_320.0 * latitude.to_radians().cos());
        let north = 1000.0 * (y - 0.5) / 111_132.0;
        for (at, scale) in [(east, 1e-7), (north, 1e-7), (z, 0.01)] {
            records.extend_from_slice(&((at / scale).round() as i32).to_le_bytes());
        }
        records.extend_from_slice(&[0, 0, 0b1001, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    }
    let file = folder.join("degrees.las");
    let options = LasOptions {
        scale: [1e-7, 1e-7, 0.01],
        offset: [longitude, latitude, 200.0],
        crs: vec![Vlr::wkt(wkt)],
        ..options_of(2, false)
    };
    write_las(&file, &options, &records);
    let octree = folder.join("octree");
    let options = Options { outliers: GuardMode::Keep, ..Options::default() };
    common::convert(&[file], &octree, &options).expect("converted");
    octree
}

#[test]
fn degrees_are_drawn_in_meters() {
    // From the equator, where a degree is as wide as high, to where it is a quarter.
    for (points, place) in [(3_000, [-94.67, 31.04]), (60_000, [11.5, 0.2]), (30_000, [25.7, 75.0])] {
        let folder = tempfile::tempdir().expect("a folder");
        let octree = in_degrees(folder.path(), points, place);
        let mut studio = OctreeRenderer::open(&octree, ColorBy::Auto, Choice::Cpu).expect("opened");
        let quality = Quality { background: Background::Transparent, ..Quality::default() };
        let (picture, _) = studio.still([200, 200], View::Top, &quality).expect("drawn");
        let covered = |x: usize, y: usize| picture.pixels[y * 200 + x][3] > 0;
        let columns = (0..200).filter(|x| (0..200).any(|y| covered(*x, y))).count();
        let rows = (0..200).filter(|y| (0..200).any(|x| covered(x, *y))).count();
        let aspect = columns as f64 / rows as f64;
        assert!((aspect - 2.0).abs() < 0.1, "{place:?}: {columns} by {rows}");
        // A surface without gaps, and none of it beyond the frame.
        let solid = solid(&picture).len() as f64 / (columns * rows) as f64;
        assert!(columns < 199 && columns > 160 && solid > 0.7, "{place:?}: {columns}, {solid}");
        let (overview, _) = studio.still([200, 200], View::Overview, &quality).expect("drawn");
        let rim = (0..200).filter(|i| {
            [i * 200, i * 200 + 199, *i, 199 * 200 + i].iter().any(|at| overview.pixels[*at][3] > 0)
        });
        assert_eq!(rim.count(), 0, "{place:?} is cut off");
    }
}
