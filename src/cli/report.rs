//! `lodestone report`: what the program is worth on this machine, measured. A
//! long-running command.

use std::path::{Path, PathBuf};

use indicatif::{ProgressBar, ProgressStyle};

use super::{Exit, failed};
use crate::measure::stability::{self, Row, Step, Wishes};
use crate::stage::context::Cancel;
use crate::stage::machine;
use crate::synth::Kind;

/// Measure this program: scenes that break converters, beside one that does not
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The stability table: every scene by both samplers, what became of it and what it cost
    #[arg(long, required = true)]
    stability: bool,
    /// Points of each scene; 20M is understood
    #[arg(long, value_name = "N", default_value = "5M", value_parser = super::synth::count)]
    points: u64,
    /// Also the failing scenes as large as the papers have them: up to 40 million points, and half
    /// an hour
    #[arg(long)]
    full: bool,
    /// Only these scenes
    #[arg(long, value_delimiter = ',', value_name = "SCENES")]
    scenes: Vec<Kind>,
    /// Conversions a row; their median counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=99))]
    rounds: u16,
    /// Write the table as a page of Markdown
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write the figures as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
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
    let wishes = Wishes {
        program,
        points: arguments.points,
        full: arguments.full,
        scenes: arguments.scenes,
        rounds: usize::from(arguments.rounds),
        folder: arguments.temp_dir.unwrap_or_else(std::env::temp_dir),
        threads: arguments.threads.map_or_else(machine::threads, usize::from),
        cancel: Cancel::default(),
    };
    // Clouds of gigabytes are not to stay behind when somebody has waited enough.
    crate::daemon::signals::cancel_on_signal(&wishes.cancel);
    let bar = bar();
    let say = |step: Step| {
        bar.set_length(step.of as u64);
        bar.set_position(step.done as u64);
        bar.set_message(step.what);
    };
    let shown = |row: &Row| bar.suspend(|| println!("{}", stability::plain(row)));
    let table = stability::measure(&wishes, &say, &shown);
    bar.finish_and_clear();
    let table = match table {
        Ok(table) => table,
        Err(error) => return failed(&error),
    };
    let json = serde_json::to_string_pretty(&table).unwrap_or_default() + "\n";
    let written = [(arguments.output, stability::markdown(&table)), (arguments.json, json)];
    for (path, text) in written.into_iter().filter_map(|(path, text)| Some((path?, text))) {
        if let Err(exit) = write(&path, &text) {
            return exit;
        }
    }
    // A miss is a finding, not a failure; a point lost or a scene not done is.
    match table.rows.iter().all(|row| row.exact) {
        true => Exit::Done,
        false => Exit::Failed,
    }
}

fn write(path: &Path, text: &str) -> Result<(), Exit> {
    std::fs::write(path, text).map_err(|error| {
        eprintln!("lodestone: could not write {}: {error}", path.display());
        Exit::Failed
    })
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{pos:>3} of {len} rows {bar:30} {elapsed}  {msg}") {
        bar.set_style(style.progress_chars("━╸─"));
    }
    bar
}
