//! Laws that every scene keeps.

use super::*;
use crate::format::las;

fn record_length(format: u8) -> usize {
    las::record_length(format).unwrap()
}

fn scene(kind: SceneKind, points: u64) -> SyntheticScene {
    SyntheticScene::new(Recipe::new(kind, points, 1)).unwrap()
}

/// The stored coordinates of records.
fn positions(records: &[u8], format: u8) -> Vec<[i32; 3]> {
    let number = |bytes: &[u8]| i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let record = |r: &[u8]| [number(r), number(&r[4..]), number(&r[8..])];
    records.chunks_exact(record_length(format)).map(record).collect()
}

fn extent(positions: &[[i32; 3]]) -> [i64; 3] {
    [0, 1, 2].map(|axis| {
        let of = |p: &[i32; 3]| i64::from(p[axis]);
        positions.iter().map(of).max().unwrap() - positions.iter().map(of).min().unwrap()
    })
}

/// A hash here changes only where a scene is changed on purpose: figures that
/// were measured on the old one can then not be compared any more.
#[test]
fn the_same_seed_gives_the_same_bytes_everywhere() {
    let mut found = String::new();
    for kind in SceneKind::ALL {
        let records = scene(kind, 10_000).slice(0, 10_000, 7).unwrap();
        assert_eq!(records.len(), 10_000 * 36, "{kind:?}");
        found += &format!("{kind:?} {}\n", &blake3::hash(&records).to_hex()[..16]);
    }
    assert_eq!(found, PINNED, "\n{found}");
}

const PINNED: &str = "\
Terrain 70d4e91c098aa0d4
Town d9dcb99b7c35df7d
Interior 799b79257015c479
Object c4e3ce5cad6d0e31
Volume 88831f1d016c6729
Duplicates a67e17b907da7d69
Outliers b6e5352b2614821b
Flat ca43ae29021cdf97
Line f4a265dee09056ac
Dot 37ddd315b403b813
Strips 490cca05cd700207
Far ae5f02336fa1af68
";

#[test]
fn slices_do_not_depend_on_where_they_are_cut() {
    for kind in SceneKind::ALL {
        for twins in [false, true] {
            let recipe = Recipe { twins, ..Recipe::new(kind, 30_011, 3) };
            let scene = SyntheticScene::new(recipe).unwrap();
            let whole = scene.slice(0, u64::MAX, 6).unwrap();
            let mut pieces = Vec::new();
            let (mut first, mut step) = (0, 1);
            while first < scene.points() {
                pieces.extend(scene.slice(first, step, 6).unwrap());
                first += step;
                step = step * 3 % 4099 + 1;
            }
            assert_eq!(whole.len(), 30_011 * record_length(6), "{kind:?}");
            assert!(whole == pieces, "{kind:?} depends on its slices");
            assert!(scene.slice(30_011, 5, 6).unwrap().is_empty());
        }
    }
}

#[test]
fn seeds_and_sizes_make_other_clouds() {
    for kind in SceneKind::ALL {
        let of = |points, seed| {
            SyntheticScene::new(Recipe::new(kind, points, seed)).unwrap().slice(0, 500, 7).unwrap()
        };
        assert!(of(1000, 1) != of(1000, 2), "{kind:?} ignores its seed");
    }
}

#[test]
fn any_number_of_points_can_be_had() {
    for kind in SceneKind::ALL {
        for points in [1, 2, 3, 7, 100, 1000, 123_457] {
            let scene = scene(kind, points);
            let records = scene.slice(0, points, 0).unwrap();
            assert_eq!(records.len() as u64, points * 20, "{kind:?} with {points} points");
            let tiles = scene.tiles();
            assert_eq!(tiles.last().unwrap().points.end, points, "{kind:?}");
            assert!(tiles.windows(2).all(|pair| pair[0].points.end == pair[1].points.start));
        }
        // The last points of a cloud that no memory would hold.
        let records = scene(kind, 3_000_000_000).slice(2_999_999_990, 100, 10).unwrap();
        assert_eq!(records.len(), 10 * 67, "{kind:?}");
    }
    assert!(SyntheticScene::new(Recipe::new(SceneKind::Dot, 0, 1)).is_err());
    assert!(scene(SceneKind::Dot, 1).slice(0, 1, 11).is_err());
}

#[test]
fn scenes_have_the_extent_they_are_named_for() {
    let extent_of = |kind, points| {
        let scene = scene(kind, points);
        extent(&positions(&scene.slice(0, points, 0).unwrap(), 0))
    };
    assert_eq!(extent_of(SceneKind::Dot, 5000), [0, 0, 0]);
    let line = extent_of(SceneKind::Line, 5000);
    assert!(line[0] > 40_000 && line[1..] == [0, 0], "{line:?}");
    let flat = extent_of(SceneKind::Flat, 5000);
    assert!(flat[0] > 3000 && flat[1] > 3000 && flat[2] == 0, "{flat:?}");
    assert_eq!(extent_of(SceneKind::Volume, 8000), [950, 950, 950]);
    let far = extent_of(SceneKind::Far, 20_000);
    assert!(far[0] > 4_294_000_000 && far[1] > 4_294_000_000, "{far:?}");
    let outliers = extent_of(SceneKind::Outliers, 20_000);
    assert!(outliers[0] > 40_000_000, "{outliers:?}");
    // 8 points a square metre: 250 000 points on 2 hectares and a half.
    let terrain = extent_of(SceneKind::Terrain, 250_000);
    assert!((14_000..22_000).contains(&terrain[0]), "{terrain:?}");
    assert!((14_000..22_000).contains(&terrain[1]), "{terrain:?}");
}

#[test]
fn outliers_are_six_and_duplicates_as_many_as_asked() {
    let outliers = positions(&scene(SceneKind::Outliers, 50_000).slice(0, 50_000, 0).unwrap(), 0);
    let away = outliers.iter().filter(|p| p[0].abs() > 1_000_000 || p[1].abs() > 1_000_000);
    assert_eq!(away.count(), 6);

    let distinct = |recipe: Recipe| {
        let records = SyntheticScene::new(recipe).unwrap().slice(0, u64::MAX, 0).unwrap();
        let mut positions = positions(&records, 0);
        positions.sort_unstable();
        positions.dedup();
        positions.len() as f64 / recipe.points as f64
    };
    let crowd = Recipe::new(SceneKind::Duplicates, 50_000, 1);
    let plain = distinct(Recipe { share: 0.0, ..crowd });
    assert!((distinct(Recipe { share: 0.6, ..crowd }) - plain * 0.4).abs() < 0.02);
    let twins = distinct(Recipe { twins: true, ..crowd });
    assert!((0.46..=0.5).contains(&twins), "{twins}");
}

#[test]
fn terrain_looks_like_an_aerial_survey() {
    let scene = scene(SceneKind::Terrain, 2_000_000);
    let records = scene.slice(0, 2_000_000, 7).unwrap();
    let (mut classes, mut returns, mut strips) = ([0u32; 256], [0u32; 16], [0u32; 16]);
    let mut time = 0.0;
    for record in records.chunks_exact(36) {
        returns[usize::from(record[14] >> 4)] += 1;
        assert!(record[14] & 15 >= 1 && record[14] & 15 <= record[14] >> 4);
        classes[usize::from(record[16])] += 1;
        strips[usize::from(record[20])] += 1;
        let now = f64::from_le_bytes(record[22..30].try_into().unwrap());
        assert!(now >= time, "points in the order of their time");
        time = now;
    }
    for class in [2, 3, 5, 6, 11] {
        assert!(classes[class] > 2000, "class {class} has {} points", classes[class]);
    }
    for n in 1..=3 {
        assert!(returns[n] > 10_000, "{returns:?}");
    }
    assert_eq!(strips.iter().filter(|&&n| n > 0).count(), 4, "{strips:?}");
    let extent = extent(&positions(&records, 7));
    assert!((1500..12_000).contains(&extent[2]), "{extent:?}");
}

#[test]
fn a_town_is_far_denser_in_its_middle() {
    let scene = scene(SceneKind::Town, 400_000);
    let positions = positions(&scene.slice(0, 400_000, 7).unwrap(), 7);
    let within = |metres: i64| {
        positions.iter().filter(|p| i64::from(p[0].abs().max(p[1].abs())) < metres * 1000).count()
    };
    assert!(within(40) > 200_000 && within(70) < 380_000, "{} and {}", within(40), within(70));
}

#[test]
fn half_of_a_town_can_be_a_teapot() {
    let recipe = Recipe { teapot: true, ..Recipe::new(SceneKind::Town, 40_000, 1) };
    let places = positions(&SyntheticScene::new(recipe).unwrap().slice(0, u64::MAX, 0).unwrap(), 0);
    let [x, y, _] = extent(&places);
    // 10 km in units of 2.5 µm, nearly all that 32 bits hold.
    assert!((3_900_000_000..4_294_000_000).contains(&x), "{x}");
    assert!((3_900_000_000..4_294_000_000).contains(&y), "{y}");
    let stone = places.iter().filter(|p| p.iter().all(|c| c.abs() < 4000)).count();
    assert!((20_000..20_010).contains(&stone), "{stone} points in the middle centimetres");
}

#[test]
fn strips_agree_on_one_fine_lattice() {
    let scene = scene(SceneKind::Strips, 40_000);
    assert_eq!(scene.tiles().len(), 4);
    let lattices: Vec<_> = scene.tiles().iter().map(|tile| tile.lattice).collect();
    for (i, a) in lattices.iter().enumerate() {
        assert!(lattices[..i].iter().all(|b| a.scale != b.scale && a.offset != b.offset));
        for axis in 0..3 {
            for number in [a.scale[axis], a.offset[axis] - lattices[0].offset[axis]] {
                let units = number / 0.0005;
                assert!((units - units.round()).abs() < 1e-6, "{number} in half millimetres");
            }
        }
    }
    // Neighbouring tiles lie beside each other in the world.
    let middle = |tile: &SceneFile| {
        let count = tile.points.end - tile.points.start;
        let positions = positions(&scene.slice(tile.points.start, count, 0).unwrap(), 0);
        let sum: f64 = positions.iter().map(|p| f64::from(p[0])).sum();
        sum / count as f64 * tile.lattice.scale[0] + tile.lattice.offset[0]
    };
    let middles: Vec<f64> = scene.tiles().iter().map(middle).collect();
    assert!(middles.windows(2).all(|pair| (4.0..40.0).contains(&(pair[1] - pair[0]))), "{middles:?}");
}

#[test]
fn outliers_span_the_box_that_was_asked_for() {
    for span in [780.0, 5.0] {
        let recipe = Recipe { span, ..Recipe::new(SceneKind::Outliers, 30_000, 1) };
        let all = positions(&SyntheticScene::new(recipe).unwrap().slice(0, 30_000, 0).unwrap(), 0);
        let side = |axis: usize| {
            let along = all.iter().map(|p| i64::from(p[axis]));
            along.clone().max().unwrap() - along.min().unwrap()
        };
        assert_eq!(side(0), (span * 1e5) as i64, "in centimetres");
        assert!(side(1) <= side(0));
    }
    for span in [0.5, -1.0, f64::NAN, 1e9] {
        assert!(SyntheticScene::new(Recipe { span, ..Recipe::new(SceneKind::Outliers, 100, 1) }).is_err());
    }
}
