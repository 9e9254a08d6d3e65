//! `lodestone synth`: a scene into a LAS or LAZ file, in constant memory.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::arguments;
use super::exit::Exit;
use super::output::failed;
use crate::format::las::{LasError, LasOptions, LasWriter, Vlr};
use crate::lab::synth::{Recipe, SceneError, SceneFile, SceneKind, SyntheticScene};

/// Make a synthetic cloud: the same bytes from the same seed on every machine.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The scene.
    #[arg(ignore_case = true)]
    scene: SceneKind,
    /// The file to write (it is replaced if it exists); for `strips` a folder.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// How many points; 20M and 2G are understood.
    #[arg(long, value_name = "N", default_value = "1M", value_parser = arguments::count)]
    points: u64,
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// The LAS point format.
    #[arg(long, value_name = "0..10", default_value_t = 7, value_parser = clap::value_parser!(u8).range(0..=10))]
    format: u8,
    /// Compress (a file named .laz is compressed anyway).
    #[arg(long)]
    laz: bool,
    /// Of `duplicates`: the share of the points that lie at one position.
    #[arg(long, value_name = "SHARE", default_value_t = 0.2)]
    share: f64,
    /// Of `duplicates`: pairs at one position each instead of one crowd.
    #[arg(long)]
    twins: bool,
    /// Of `town`: a stone of 1 cm in 10 km of country instead of a street in a village.
    #[arg(long)]
    teapot: bool,
    /// Of `outliers`: the side of the box that they span; 780 is the paper's. Where it is 0, they
    /// lie 200 to 700 km from the middle.
    #[arg(long, value_name = "KM", default_value_t = 0.0)]
    span: f64,
}

/// Points that one thread makes at a time.
const SLICE: u64 = 1 << 17;

#[derive(Debug, thiserror::Error)]
enum SynthError {
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Las(#[from] LasError),
    #[error("could not make the folder {}: {source} (choose another place with -o)", path.display())]
    Folder { path: PathBuf, source: std::io::Error },
}

pub fn run(arguments: Arguments) -> Exit {
    match write(&arguments) {
        Ok(()) => Exit::Done,
        Err(error) => failed(&error),
    }
}

fn write(arguments: &Arguments) -> Result<(), SynthError> {
    let recipe = Recipe {
        kind: arguments.scene,
        points: arguments.points,
        seed: arguments.seed,
        share: arguments.share,
        twins: arguments.twins,
        teapot: arguments.teapot,
        span: arguments.span,
    };
    let scene = SyntheticScene::new(recipe)?;
    if arguments.scene != SceneKind::Strips {
        return scene
            .tiles()
            .iter()
            .try_for_each(|tile| write_tile(arguments, &scene, tile, &arguments.output));
    }
    let folder = &arguments.output;
    std::fs::create_dir_all(folder).map_err(|source| SynthError::Folder { path: folder.clone(), source })?;
    for tile in scene.tiles() {
        let ending = if arguments.laz { "laz" } else { "las" };
        write_tile(arguments, &scene, tile, &folder.join(format!("{}.{ending}", tile.name)))?;
    }
    Ok(())
}

fn write_tile(
    arguments: &Arguments,
    scene: &SyntheticScene,
    tile: &SceneFile,
    path: &Path,
) -> Result<(), SynthError> {
    let mut writer = LasWriter::create(path, &options(arguments, scene, tile, path))?;
    let threads = rayon::current_num_threads() as u64;
    let mut ready = Vec::new();
    let mut first = tile.points.start;
    // One batch is written while the next is made.
    while first < tile.points.end || !ready.is_empty() {
        let end = tile.points.end.min(first + 2 * threads * SLICE);
        let (written, next) =
            rayon::join(|| write_all(&mut writer, &ready), || make(scene, first, end, arguments.format));
        written?;
        ready = next?;
        first = end;
    }
    Ok(writer.finish()?)
}

fn write_all(writer: &mut LasWriter, slices: &[Vec<u8>]) -> Result<(), LasError> {
    slices.iter().try_for_each(|records| writer.write(records))
}

fn make(scene: &SyntheticScene, first: u64, end: u64, format: u8) -> Result<Vec<Vec<u8>>, SceneError> {
    let slices = (end - first).div_ceil(SLICE);
    (0..slices)
        .into_par_iter()
        .map(|n| {
            let from = first + n * SLICE;
            scene.slice(from, SLICE.min(end - from), format)
        })
        .collect()
}

fn options(arguments: &Arguments, scene: &SyntheticScene, tile: &SceneFile, path: &Path) -> LasOptions {
    let named_laz = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("laz"));
    LasOptions {
        version: match arguments.format {
            // More than the 32 bits of older versions count. Every format may stand in 1.4.
            _ if tile.points.end - tile.points.start > u64::from(u32::MAX) => (1, 4),
            0..=3 => (1, 2),
            4 | 5 => (1, 3),
            _ => (1, 4),
        },
        point_format: arguments.format,
        scale: tile.lattice.scale,
        offset: tile.lattice.offset,
        compressed: arguments.laz || named_laz,
        extra: Vec::new(),
        crs: scene.is_on_earth().then(|| Vlr::wkt(UTM_32)).into_iter().collect(),
        software: format!("lodestone {}", env!("CARGO_PKG_VERSION")),
    }
}

/// ETRS89 / UTM zone 32N, EPSG 25832, as OGC WKT 1.
const UTM_32: &str = r#"PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["European_Terrestrial_Reference_System_1989",SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1],AUTHORITY["EPSG","25832"]]"#;

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    #[test]
    fn a_file_is_of_a_version_that_counts_its_points() {
        let version = |scene: &str, points: &str, format: &str| {
            let line = ["synth", scene, "-o", "x", "--points", points, "--format", format];
            let arguments = Line::parse_from(line).arguments;
            let recipe = Recipe::new(arguments.scene, arguments.points, 1);
            let scene = SyntheticScene::new(recipe).unwrap();
            options(&arguments, &scene, &scene.tiles()[0], &arguments.output).version
        };
        assert_eq!(version("terrain", "4294967295", "3"), (1, 2));
        for format in ["0", "3", "5", "10"] {
            assert_eq!(version("terrain", "4294967296", format), (1, 4));
        }
        // What counts is the tile.
        assert_eq!(version("strips", "5G", "4"), (1, 3));
    }
}
