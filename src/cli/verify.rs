//! `lodestone verify`.

use std::path::PathBuf;
use std::time::Instant;

use super::arguments;
use super::exit::Exit;
use super::output::{failed, say};
use crate::convert::options::Damaged;
use crate::platform::limits;
use crate::verify::{self, SpacingRule, VerifyRequest};

/// Check an octree, alone or against the files that it was made of
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The octree's folder
    octree: PathBuf,
    /// Hold it against these LAS or LAZ files, folders that hold some, or @LIST: the same points
    /// with the same attributes, to the last bit
    #[arg(long, num_args = 1.., value_name = "INPUT")]
    against: Vec<PathBuf>,
    /// How the octree was made of INPUT where it is cut or damaged: `keep` holds it against what can
    /// be read of it
    #[arg(long, ignore_case = true, default_value = "fail", value_name = "MODE")]
    damaged: Damaged,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
    /// Whether the rule of sampling is a must: for Lodestone's own octrees, for any, or only told
    #[arg(long, ignore_case = true, default_value = "auto", value_name = "WHEN")]
    spacing: SpacingRule,
    /// Threads to work with; all that the machine or container grants if not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory to work with, as in 512M or 16G; a quarter of what there is if not given
    #[arg(long, value_name = "BYTES", value_parser = arguments::parse_bytes)]
    memory_limit: Option<u64>,
}

pub fn run(arguments: Arguments) -> Exit {
    let pool = match arguments::pool(arguments.threads) {
        Ok(pool) => pool,
        Err(error) => return failed(&error),
    };
    let request = VerifyRequest {
        octree: arguments.octree,
        against: arguments.against,
        damaged: arguments.damaged == Damaged::Keep,
        memory_limit: arguments.memory_limit.unwrap_or_else(limits::default_memory_limit),
        spacing: arguments.spacing,
    };
    let started = Instant::now();
    let mut report = match pool.install(|| verify::verify(&request)) {
        Ok(report) => report,
        Err(error) => return failed(&error),
    };
    report.seconds = started.elapsed().as_secs_f64();
    if arguments.json {
        match serde_json::to_string_pretty(&report) {
            Ok(json) => say!("{json}"),
            Err(error) => return failed(&error),
        }
    } else {
        say!("{report}");
    }
    match (report.ok, report.dropped()) {
        (false, _) => Exit::Failed,
        (true, 0) => Exit::Done,
        (true, _) => Exit::SetAside,
    }
}
