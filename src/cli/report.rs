//! `lodestone report`: what the program is worth on this machine, measured. A
//! long-running command.

use std::path::{Path, PathBuf};

use indicatif::{ProgressBar, ProgressStyle};

use super::arguments;
use super::exit::Exit;
use super::output::{self, failed, say};
use crate::convert::context::Cancel;
use crate::lab::compare;
use crate::lab::settings::{BenchmarkSettings, MeasureError, Step};
use crate::lab::stability::{self, Row};
use crate::lab::synth::SceneKind;
use crate::platform::limits;

/// Measure this program: speed against accuracy of its methods, or its stability
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// LAS or LAZ files, or folders that hold some, to be measured beside the scenes
    #[arg(value_name = "CLOUD", conflicts_with = "stability")]
    clouds: Vec<PathBuf>,
    /// For an impression: scenes of 2 million points, in minutes (this is the default)
    #[arg(long, conflicts_with = "full")]
    quick: bool,
    /// For the record: scenes of 20 million points, in an hour. With --stability also the failing
    /// scenes as large as the papers have them, up to 40 million points
    #[arg(long)]
    full: bool,
    /// Instead: the stability table, every scene that breaks converters by both samplers, what became
    /// of it and what it cost
    #[arg(long)]
    stability: bool,
    /// Points of each scene; 20M is understood
    #[arg(long, value_name = "N", value_parser = arguments::count)]
    points: Option<u64>,
    /// Only these scenes
    #[arg(long, ignore_case = true, value_delimiter = ',', value_name = "SCENES")]
    scenes: Vec<SceneKind>,
    /// Conversions a method or row; their median counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=99))]
    rounds: u16,
    /// The page to write: HTML, by default lodestone-report.html; with --stability Markdown
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// The figures as JSON; by default beside the page
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// The main chart as a picture of its own, SVG
    #[arg(long, value_name = "FILE", conflicts_with = "stability")]
    chart: Option<PathBuf>,
    /// Measure nothing: make the page of the figures of an earlier report
    #[arg(long, value_name = "FILE", conflicts_with_all = ["clouds", "stability", "full", "points", "scenes", "json"])]
    from: Option<PathBuf>,
    /// Figures of an earlier report, to be shown beside the new ones
    #[arg(long, value_name = "FILE", conflicts_with = "stability")]
    against: Option<PathBuf>,
    /// Where clouds and octrees go until they are measured; the system's folder for temporary
    /// files if not given
    #[arg(long, value_name = "DIR")]
    temp_dir: Option<PathBuf>,
    /// Threads to convert with; all that the machine or container grants if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub fn run(arguments: Arguments) -> Exit {
    let program = match std::env::current_exe() {
        Ok(program) => program,
        Err(error) => return failed(&error),
    };
    let means = BenchmarkSettings {
        program,
        threads: arguments.threads.map_or_else(limits::threads, usize::from),
        rounds: usize::from(arguments.rounds),
        folder: arguments.temp_dir.clone().unwrap_or_else(std::env::temp_dir),
        cancel: Cancel::default(),
    };
    // Clouds of gigabytes are not to stay behind when somebody has waited enough.
    crate::serve::signals::cancel_on_signal(&means.cancel);
    let outcome = match arguments.stability {
        true => stability(arguments, means),
        false => comparison(arguments, means),
    };
    outcome.unwrap_or_else(|error| failed(&error))
}

fn comparison(arguments: Arguments, means: BenchmarkSettings) -> Result<Exit, MeasureError> {
    let mut options = match arguments.full {
        true => compare::CompareOptions::full(means),
        false => compare::CompareOptions::quick(means),
    };
    options.points = arguments.points.unwrap_or(options.points);
    options.clouds = arguments.clouds;
    if !arguments.scenes.is_empty() {
        options.scenes = arguments.scenes;
    }
    // Read first: an hour is too long to find out that it is no report.
    let before = arguments.against.as_deref().map(compare::read).transpose()?;
    let page = arguments.output.unwrap_or_else(|| PathBuf::from("lodestone-report.html"));
    let mut json = arguments.json.unwrap_or_else(|| page.with_extension("json"));
    let report = match arguments.from {
        Some(earlier) => {
            json = earlier;
            compare::read(&json)?
        }
        None => {
            let bar = bar();
            let report = compare::measure(&options, &|step| show(&bar, step));
            done(&bar);
            let report = report?;
            write(&json, &json_of(&report))?;
            report
        }
    };
    write(&page, &compare::page(&report, before.as_ref()).html())?;
    if let (Some(path), Some(chart)) = (&arguments.chart, compare::main_chart(&report)) {
        write(path, &chart.svg_standalone())?;
    }
    for finding in compare::findings(&report) {
        say!("{} {}", if finding.holds { "holds        " } else { "DOES NOT HOLD" }, finding.words);
    }
    say!("the page is {}, its figures are in {}", page.display(), json.display());
    Ok(Exit::Done)
}

fn stability(arguments: Arguments, means: BenchmarkSettings) -> Result<Exit, MeasureError> {
    let options = stability::StabilityOptions {
        means,
        points: arguments.points.unwrap_or(5_000_000),
        full: arguments.full,
        scenes: arguments.scenes,
    };
    let bar = bar();
    let shown = |row: &Row| bar.suspend(|| say!("{}", stability::plain(row)));
    let table = stability::measure(&options, &|step| show(&bar, step), &shown);
    done(&bar);
    let table = table?;
    let written = [(arguments.output, stability::markdown(&table)), (arguments.json, json_of(&table))];
    for (path, text) in written.into_iter().filter_map(|(path, text)| Some((path?, text))) {
        write(&path, &text)?;
    }
    // A miss is a finding, not a failure; a point lost or a scene not done is.
    match table.rows.iter().all(|row| row.exact) {
        true => Ok(Exit::Done),
        false => Ok(Exit::Failed),
    }
}

fn json_of(figures: &impl serde::Serialize) -> String {
    serde_json::to_string_pretty(figures).unwrap_or_default() + "\n"
}

fn write(path: &Path, text: &str) -> Result<(), MeasureError> {
    std::fs::write(path, text).map_err(|source| MeasureError::Write { path: path.to_path_buf(), source })
}

fn show(bar: &ProgressBar, step: Step) {
    bar.set_length(step.of as u64);
    bar.set_position(step.done as u64);
    bar.set_message(step.what);
}

fn done(bar: &ProgressBar) {
    bar.finish_and_clear();
    output::keep_clear_of(None);
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{pos:>3} of {len} steps {bar:30} {elapsed}  {msg}") {
        bar.set_style(style.progress_chars("━╸─"));
    }
    output::keep_clear_of(Some(bar.clone()));
    bar
}
