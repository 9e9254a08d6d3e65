//! The command line: arguments in, exit code out. One file a command.

mod config;
mod convert;
mod info;
mod serve;
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
    /// Done, but points were set aside.
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
    Info(info::Arguments),
    Serve(serve::Arguments),
    Config(config::Arguments),
    Synth(synth::Arguments),
}

/// Parses the arguments, runs the command, and turns its end into an exit code.
pub fn run() -> ExitCode {
    let arguments = Arguments::parse();
    start_logging(&arguments);
    let exit = match arguments.command {
        Command::Convert(arguments) => convert::run(arguments),
        Command::Verify(arguments) => verify::run(arguments),
        Command::Info(arguments) => info::run(arguments),
        Command::Serve(arguments) => serve::run(arguments),
        Command::Config(arguments) => config::run(arguments),
        Command::Synth(arguments) => synth::run(arguments),
    };
    ExitCode::from(exit as u8)
}

/// Logs go to stderr, so that stdout stays for results.
fn start_logging(arguments: &Arguments) {
    use std::io::IsTerminal;
    use tracing_subscriber::EnvFilter;

    let filter = EnvFilter::try_new(&arguments.log).unwrap_or_else(|_| EnvFilter::new("info"));
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    match arguments.log_format {
        LogFormat::Json => builder.json().init(),
        LogFormat::Plain => builder.with_ansi(false).with_target(false).init(),
        LogFormat::Auto => builder.with_ansi(std::io::stderr().is_terminal()).with_target(false).init(),
    }
}

/// Prints an error with its causes and says that the command failed.
fn failed(error: &dyn std::error::Error) -> Exit {
    eprintln!("lodestone: {error}");
    Exit::Failed
}
