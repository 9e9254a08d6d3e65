//! The command line: arguments in, exit code out. One file a command.

mod config;
mod convert;
mod info;
mod jobs;
mod output;
mod preview;
mod progress;
mod report;
mod serve;
mod sheet;
mod synth;
mod verify;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// How a command ended; the numbers are what scripts rely on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    Done = 0,
    Failed = 1,
    Usage = 2,
    /// Done, but points were set aside, or are missing from damaged inputs.
    SetAside = 3,
}

#[derive(Debug, Parser)]
#[command(name = "lodestone", version, about, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// What to log, as in `info`, `debug` or `lodestone::engine=debug`.
    #[arg(long, global = true, env = "LODESTONE_LOG", default_value = "info", value_name = "FILTER")]
    log: String,
    /// How to log: for people, or a JSON object a line.
    #[arg(long, global = true, env = "LODESTONE_LOG_FORMAT", default_value = "auto", value_name = "FORMAT")]
    log_format: LogFormat,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum LogFormat {
    Auto,
    Plain,
    Json,
}

#[derive(Debug, Subcommand)]
enum Command {
    Convert(convert::Arguments),
    Verify(verify::Arguments),
    Preview(preview::Arguments),
    Info(info::Arguments),
    Serve(serve::Arguments),
    Config(config::Arguments),
    Jobs(jobs::Arguments),
    Synth(synth::Arguments),
    Report(report::Arguments),
}

/// Parses the arguments, runs the command, and turns its end into an exit code.
pub fn run() -> ExitCode {
    let arguments = Arguments::parse();
    start_logging(&arguments);
    let exit = match arguments.command {
        Command::Convert(arguments) => convert::run(arguments),
        Command::Verify(arguments) => verify::run(arguments),
        Command::Preview(arguments) => preview::run(arguments),
        Command::Info(arguments) => info::run(arguments),
        Command::Serve(arguments) => serve::run(arguments),
        Command::Config(arguments) => config::run(arguments),
        Command::Jobs(arguments) => jobs::run(arguments),
        Command::Synth(arguments) => synth::run(arguments),
        Command::Report(arguments) => report::run(arguments),
    };
    ExitCode::from(output::after(exit) as u8)
}

/// Logs go to stderr, so that stdout stays for results.
fn start_logging(arguments: &Arguments) {
    use std::io::IsTerminal;
    use tracing_subscriber::filter::{LevelFilter, Targets};
    use tracing_subscriber::prelude::*;

    let filter = arguments.log.parse().unwrap_or_else(|error| {
        output::complain(format_args!(
            "--log {:?} is no filter ({error}); logging what \"info\" does",
            arguments.log
        ));
        Targets::new().with_default(LevelFilter::INFO)
    });
    // A log that cannot be written must not end the program.
    let layer = tracing_subscriber::fmt::layer().with_writer(|| output::Stderr).log_internal_errors(false);
    let layer = match arguments.log_format {
        LogFormat::Json => layer.json().boxed(),
        LogFormat::Plain => layer.with_ansi(false).with_target(false).boxed(),
        LogFormat::Auto => layer.with_ansi(std::io::stderr().is_terminal()).with_target(false).boxed(),
    };
    tracing_subscriber::registry().with(layer.with_filter(filter)).init();
}

/// Prints an error with its causes and says that the command failed.
fn failed(error: &dyn std::error::Error) -> Exit {
    output::complain(format_args!("{error}"));
    Exit::Failed
}

/// Bytes from `512M`, `16GiB`, `1.5g` or a plain number; K, M, G and T are
/// powers of 1024.
fn parse_bytes(text: &str) -> Result<u64, String> {
    let lower = text.trim().to_ascii_lowercase();
    let digits = lower.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match lower[digits.len()..].trim_end_matches('b').trim_end_matches('i') {
        "" => 1u64,
        "k" => 1 << 10,
        "m" => 1 << 20,
        "g" => 1 << 30,
        "t" => 1 << 40,
        unit => return Err(format!("{unit:?} is no unit of memory; use K, M, G or T")),
    };
    let number: f64 =
        digits.trim().parse().map_err(|_| format!("{text:?} is no amount of memory, such as 512M"))?;
    let bytes = number * factor as f64;
    if !(1.0..9e18).contains(&bytes) {
        return Err(format!("{text:?} is no sensible amount of memory"));
    }
    Ok(bytes as u64)
}

/// A number with its digits in groups of three.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_read_as_people_write_it() {
        assert_eq!(parse_bytes("512M"), Ok(512 << 20));
        assert_eq!(parse_bytes("16GiB"), Ok(16 << 30));
        assert_eq!(parse_bytes("1.5g"), Ok(3 << 29));
        assert_eq!(parse_bytes("1000"), Ok(1000));
        assert!(
            parse_bytes("12 parsecs").is_err() && parse_bytes("-1G").is_err() && parse_bytes("").is_err()
        );
    }

    #[test]
    fn digits_stand_in_groups() {
        assert_eq!(
            (grouped(5), grouped(1234), grouped(10_653_336)),
            ("5".into(), "1 234".into(), "10 653 336".into())
        );
    }
}
