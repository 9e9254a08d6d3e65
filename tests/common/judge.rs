//! The verifier as the judge: a cloud is converted by both samplers, in core and
//! out of core, and each octree is held against its input.

use std::fs;
use std::path::{Path, PathBuf};

use lodestone::convert::options::{Options, Sampling};
use lodestone::convert::run::{self, ConversionOutcome};
use lodestone::format::las::{LasOptions, LasWriter};
use lodestone::format::potree::{self, Metadata};
use lodestone::lab::synth::{Recipe, SyntheticScene};
use lodestone::verify::{self, VerifyReport};

use super::{context, mix, octree_bytes, options_of, request};

/// Enough for all of the tests' clouds, and too little for those above a
/// quarter of a million points.
pub const IN_CORE: u64 = 2 << 30;
pub const OUT_OF_CORE: u64 = 45 << 20;

/// A conversion that was found to be right.
pub struct Held {
    pub outcome: ConversionOutcome,
    pub report: VerifyReport,
    pub metadata: Metadata,
    pub nodes: Vec<potree::Node>,
}

/// Converts an input with these options and holds the octree against it.
pub fn held_with(input: &Path, output: &Path, options: &Options, memory: u64) -> Held {
    let _ = fs::remove_dir_all(output);
    let inputs = [input.to_path_buf()];
    let means = context(output.parent().unwrap(), 2, memory);
    let outcome = run::convert(&request(&inputs, output, options), &means).unwrap();
    let report = verify::verify(&verify::VerifyRequest {
        octree: output.to_path_buf(),
        against: inputs.to_vec(),
        memory_limit: 1 << 30,
        spacing: verify::SpacingRule::Auto,
        damaged: Default::default(),
    })
    .unwrap();
    assert!(report.ok, "{report}");
    let against = report.against.as_ref().unwrap();
    assert_eq!((against.missing, against.extra), (0, 0), "{report}");
    assert_eq!(against.set_aside, outcome.points_set_aside);
    assert_eq!(outcome.points_in, outcome.points_out + outcome.points_set_aside);
    let metadata = Metadata::read(output).unwrap();
    let hierarchy = fs::read(output.join(potree::HIERARCHY)).unwrap();
    let nodes = potree::read_hierarchy(&hierarchy, metadata.hierarchy.first_chunk_size).unwrap();
    Held { outcome, report, metadata, nodes }
}

/// Converts an input in every way and gives what Poisson made of it.
pub fn held(input: &Path, output: &Path) -> Held {
    held_under(input, output, &Options::default())
}

/// The same with options, but for the sampler.
pub fn held_under(input: &Path, output: &Path, options: &Options) -> Held {
    let mut last = None;
    for sampling in [Sampling::Random, Sampling::Poisson] {
        let options = Options { sampling, name: Some("cloud".into()), ..options.clone() };
        let mut first = None;
        for memory in [OUT_OF_CORE, IN_CORE] {
            last = Some(held_with(input, output, &options, memory));
            let bytes = octree_bytes(output);
            assert!(first.get_or_insert_with(|| bytes.clone()) == &bytes, "memory changed the bytes");
        }
    }
    last.unwrap()
}

/// LAS of format 1 (or LAZ, by its name) with points at these integers; all else
/// is noise, so that no two records are the same.
pub fn write_points(path: &Path, scale: [f64; 3], offset: [f64; 3], points: &[[i32; 3]]) {
    let mut records = Vec::new();
    for (number, point) in points.iter().enumerate() {
        point.iter().for_each(|c| records.extend_from_slice(&c.to_le_bytes()));
        records.extend_from_slice(&mix(number as u64).to_le_bytes());
        records.extend_from_slice(&mix(!(number as u64)).to_le_bytes());
    }
    let options = LasOptions { scale, offset, ..options_of(1, path.extension().is_some_and(|e| e == "laz")) };
    super::write_las(path, &options, &records);
}

/// A bumpy surface `side` units wide, with its corner at `corner`.
pub fn field(points: usize, corner: [i32; 3], side: i32) -> Vec<[i32; 3]> {
    (0..points as u64)
        .map(|i| {
            let dice = mix(i);
            let [x, y] =
                [dice as u32, (dice >> 32) as u32].map(|d| ((u64::from(d) * side as u64) >> 32) as i32);
            [corner[0] + x, corner[1] + y, corner[2] + (x / 7 + y / 5) % (side / 8 + 1)]
        })
        .collect()
}

/// A scene in a folder: a file, or of several tiles a folder of them.
pub fn write_scene(recipe: Recipe, folder: &Path) -> PathBuf {
    let scene = SyntheticScene::new(recipe).unwrap();
    let place = folder.join(format!("{:?}", recipe.kind).to_lowercase());
    fs::create_dir_all(&place).unwrap();
    for tile in scene.tiles() {
        let options =
            LasOptions { scale: tile.lattice.scale, offset: tile.lattice.offset, ..options_of(3, false) };
        let mut writer = LasWriter::create(&place.join(format!("{}.las", tile.name)), &options).unwrap();
        let count = tile.points.end - tile.points.start;
        writer.write(&scene.slice(tile.points.start, count, 3).unwrap()).unwrap();
        writer.finish().unwrap();
    }
    place
}

/// Overwrites bytes of a file.
pub fn patch(path: &Path, changes: &[(usize, &[u8])]) {
    let mut bytes = fs::read(path).unwrap();
    for (at, change) in changes {
        bytes[*at..at + change.len()].copy_from_slice(change);
    }
    fs::write(path, bytes).unwrap();
}
