//! A real daemon whose conversions can be held: what is to be seen of a run while it
//! lasts is then there for as long as it takes to look, however fast or busy the machine.

use std::fs;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use clap::Parser;
use lodestone::convert::context::{Context, Stage};
use lodestone::serve::config::{Config, Layer};
use lodestone::serve::log::JobLines;
use lodestone::serve::scheduler::converter::{Conduct, ConversionResult, Converter, Failure, Work};
use tracing_subscriber::prelude::*;

use super::{Daemon, arguments};

/// Set for the process that is to be the daemon: its flags, a line each.
const FLAGS: &str = "LODESTONE_HELD_FLAGS";

pub struct Held {
    daemon: Daemon,
    holds: PathBuf,
}

impl Deref for Held {
    type Target = Daemon;

    fn deref(&self) -> &Daemon {
        &self.daemon
    }
}

impl Held {
    /// Starts it in a process of its own: this program again, with nothing but the test
    /// of this full name, which is to call [`serve`].
    pub fn start_with(test: &str, root: &Path, more: &[&str]) -> Held {
        let holds = root.with_extension("holds");
        fs::create_dir_all(&holds).expect("made");
        let mut command = Command::new(std::env::current_exe().expect("this program"));
        command.args(["--exact", test, "--nocapture"]).env(FLAGS, arguments(root, more).join("\n"));
        Held { daemon: Daemon::begin(command, root), holds }
    }

    /// Holds every run of the data set of this name, at this percent of its survey, as
    /// long as the file is there that this returns; the percent are what the file says.
    pub fn hold(&self, name: &str, percent: u8) -> PathBuf {
        let hold = self.holds.join(name);
        fs::write(&hold, percent.to_string()).expect("written");
        hold
    }
}

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    layer: Layer,
}

/// Is the daemon, where [`Held`] started this process to be one.
pub fn serve() {
    let Ok(flags) = std::env::var(FLAGS) else { return };
    let log = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_ansi(false);
    tracing_subscriber::registry()
        .with(log.with_filter(tracing_subscriber::filter::LevelFilter::INFO))
        .with(JobLines)
        .init();
    let layer = Line::parse_from(["lodestone"].into_iter().chain(flags.lines())).layer;
    let config = Config::from_layer(layer).expect("a configuration");
    let holds = config.root.with_extension("holds");
    lodestone::serve::run(config, Arc::new(Holding { holds })).expect("a good end");
}

struct Holding {
    holds: PathBuf,
}

impl Converter for Holding {
    fn convert(&self, work: &Work, context: &Context) -> Result<ConversionResult, Failure> {
        let name = work.inputs.first().and_then(|input| input.file_stem()).unwrap_or_default();
        let hold = self.holds.join(name);
        let mut done = 0;
        context.progress.begin(Stage::Survey, 100);
        while let Ok(percent) = fs::read_to_string(&hold) {
            // Half written it is no number.
            let percent = percent.parse().unwrap_or(done).max(done);
            context.progress.advance(percent - done);
            done = percent;
            if context.cancel.is_cancelled() {
                return Err(Failure { message: "cancelled".into(), may_pass: true, panicked: false });
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Conduct.convert(work, context)
    }
}
