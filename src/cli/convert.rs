//! `lodestone convert`.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::arguments;
use super::exit::Exit;
use super::output::{complain, failed, say};
use super::progress::{self, ProgressFormat};
use crate::convert::context::{Cancel, Context, Progress};
use crate::convert::folder_names::{staging_folder, within_a_name};
use crate::convert::formats::Formats;
use crate::convert::options::{Damaged, Encoding, GuardMode, LodColor, Options, Sampling};
use crate::convert::run::{self, ConversionOutcome, ConversionRequest};
use crate::format::crs;
use crate::platform::disk::Disk;
use crate::words::{Plain, grouped};

/// Convert LAS/LAZ files or folders into one Potree 2.0 octree, one COPC file, or both
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// LAS or LAZ files, folders that hold some, or @LIST, a file that names one of these a line
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// The folder that becomes the octree
    #[arg(short, long, visible_alias = "outdir", value_name = "DIR")]
    output: PathBuf,
    /// What is written: a Potree octree, a COPC file, or both: potree, copc, or potree,copc
    #[arg(long, value_name = "FORMATS", default_value = "potree")]
    format: Formats,
    /// How coarse levels choose their points
    #[arg(short = 'm', long, visible_alias = "method", ignore_case = true, default_value = "poisson")]
    sampling: Sampling,
    /// How points are stored
    #[arg(long, ignore_case = true, default_value = "default")]
    encoding: Encoding,
    /// Colours of coarse levels: those of their points, or means of what these stand for, in an
    /// attribute of their own or in `rgb`
    #[arg(long, ignore_case = true, default_value = "keep", value_name = "MODE")]
    lod_color: LodColor,
    /// What becomes of a few points so far away that the octree would be built for them
    #[arg(long, ignore_case = true, default_value = "set-aside", value_name = "MODE")]
    outliers: GuardMode,
    /// What becomes of points at one position beyond the first 10 000
    #[arg(long, ignore_case = true, default_value = "set-aside", value_name = "MODE")]
    duplicates: GuardMode,
    /// What becomes of files that are cut, or of which a part cannot be decoded: nothing is
    /// converted, or what can be read of them is
    #[arg(long, ignore_case = true, default_value = "fail", value_name = "MODE")]
    damaged: Damaged,
    /// What becomes of records that equal another in every attribute
    #[arg(long, ignore_case = true, default_value = "keep", value_name = "MODE")]
    twins: GuardMode,
    /// Attributes to keep, by name, separated by commas; `auto` for those that are not zero throughout; all if not given
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    attributes: Vec<String>,
    /// The octree's name in its metadata; the output folder's if not given
    #[arg(long, visible_alias = "title")]
    name: Option<String>,
    /// The coordinate reference system, whatever the files say: an EPSG code, as in EPSG:25832, or WKT
    #[arg(long, value_name = "CRS", value_parser = |text: &str| crs::named(text))]
    crs: Option<String>,
    /// Threads to work with; all that the machine or container grants if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory to work with, as in 512M or 16G; a quarter of what there is if not given
    #[arg(long, value_name = "BYTES", value_parser = arguments::parse_bytes)]
    memory_limit: Option<u64>,
    /// Where intermediate files go; beside the output if not given
    #[arg(long, value_name = "DIR")]
    temp_dir: Option<PathBuf>,
    /// Replace an octree that is there already, once the new one is complete
    #[arg(long)]
    overwrite: bool,
    /// How to show progress (on stderr)
    #[arg(long, ignore_case = true, default_value = "auto", value_name = "STYLE")]
    progress: ProgressFormat,
}

pub fn run(arguments: Arguments) -> Exit {
    let output = arguments.output.clone();
    let name = output.file_name().map(|n| n.to_string_lossy().into_owned());
    let Some(name) = name else {
        complain(format_args!("{} is no name for a new folder", output.display()));
        return Exit::Usage;
    };
    let scratch_root = arguments.temp_dir.or_else(|| output.parent().map(PathBuf::from)).unwrap_or_default();
    let context = Context {
        disk: Disk::new(),
        scratch: scratch_root.join(scratch_name(&name, &output)),
        threads: arguments.threads.map_or_else(crate::platform::limits::threads, usize::from),
        memory_limit: arguments.memory_limit.unwrap_or_else(crate::platform::limits::default_memory_limit),
        cancel: Cancel::default(),
        progress: Arc::new(Progress::default()),
    };
    let request = ConversionRequest {
        inputs: arguments.inputs,
        output,
        overwrite: arguments.overwrite,
        keep_scratch: false,
        options: Options {
            sampling: arguments.sampling,
            encoding: arguments.encoding,
            lod_color: arguments.lod_color,
            outliers: arguments.outliers,
            duplicates: arguments.duplicates,
            damaged: arguments.damaged,
            twins: arguments.twins,
            attributes: arguments.attributes,
            name: arguments.name,
            crs: arguments.crs,
            format: arguments.format,
        },
        // Hashing would read every file once more.
        hashes: HashMap::new(),
    };
    crate::serve::signals::cancel_on_signal(&context.cancel);
    let style = arguments.progress;
    let result = progress::shown(style, &context.progress, || run::convert(&request, &context));
    match result {
        Ok(outcome) => {
            progress::finished(style, &outcome);
            if style != ProgressFormat::Json {
                print_outcome(&request, &outcome);
            }
            if outcome.points_set_aside > 0 || outcome.points_missing > 0 {
                Exit::SetAside
            } else {
                Exit::Done
            }
        }
        Err(error) => {
            progress::failed(style, &error);
            let exit = failed(&error);
            if style != ProgressFormat::Json {
                tell_what_remains(&request, &context, error.is_cancelled());
            }
            exit
        }
    }
}

/// Says what a conversion that did not end leaves, and how to go on.
fn tell_what_remains(request: &ConversionRequest, context: &Context, stopped: bool) {
    let (output, staging) = (request.output.display(), staging_folder(&request.output));
    if context.scratch.exists() {
        complain(format_args!(
            "what is done is kept in {} and {}: the same command goes on from there",
            context.scratch.display(),
            staging.display()
        ));
    } else if stopped {
        let stands = match request.output.exists() {
            true => format!("{output} is as it was"),
            false => format!("{output} was not made"),
        };
        complain(format_args!("nothing remains of it, and {stands}: the same command begins anew"));
    }
}

/// The same for the same output, so that a conversion finds what it has done,
/// and another for every other, so that many can share one folder.
fn scratch_name(name: &str, output: &Path) -> String {
    let output = std::path::absolute(output).unwrap_or_else(|_| output.to_path_buf());
    let hash = blake3::hash(output.as_os_str().as_encoded_bytes()).to_hex();
    format!(".{}-{}.scratch", within_a_name(name), &hash[..8])
}

fn print_outcome(request: &ConversionRequest, outcome: &ConversionOutcome) {
    for note in outcome.repairs.iter().chain(&outcome.notes) {
        say!("note: {}", Plain(note));
    }
    let seconds: f64 = outcome.seconds_by_stage.values().sum();
    say!(
        "{}: {} points in {} nodes, {} levels, {:.1} MB, in {:.2} s ({:.2} million points a second)",
        Plain(request.output.display()),
        grouped(outcome.points_out),
        grouped(outcome.nodes),
        outcome.depth + 1,
        outcome.output_bytes as f64 / 1e6,
        seconds,
        outcome.points_out as f64 / seconds / 1e6,
    );
    if let Some(copc) = &outcome.copc {
        say!(
            "{}: COPC of {} nodes, point format {}, {:.1} MB",
            Plain(request.output.join(&copc.file).display()),
            grouped(copc.nodes),
            copc.point_format,
            copc.bytes as f64 / 1e6,
        );
    }
    match outcome.lod_color {
        LodColor::Keep if request.options.lod_color == LodColor::Keep => {}
        LodColor::Keep => say!("no colours were averaged, for there is no `rgb`"),
        LodColor::Attribute => say!("`rgb average` holds averages; `rgb` is as in the input"),
        LodColor::Average => say!("`rgb` holds averages; the originals are in `rgb original`"),
    }
    match outcome.exact {
        true => say!("every position is exactly where the input has it"),
        false => say!(
            "positions were rounded, by at most {:.4} of the finest input's units; the notes say why",
            outcome.max_error_units
        ),
    }
}
