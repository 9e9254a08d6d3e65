//! The command line: arguments in, exit code out. One file a command.

mod config;
mod convert;
mod export;
mod info;
mod jobs;
mod logging;
mod output;
mod preview;
mod progress;
mod report;
mod serve;
mod sheet;
mod shell;
mod synth;
mod verify;
mod vpc;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::platform::limits;
use crate::serve::config::logging::LogFormat;
use crate::serve::init;

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
    /// What to log, as in `info`, `debug` or `lodestone::serve::scheduler=debug` [default: info].
    #[arg(long, global = true, env = "LODESTONE_LOG", value_name = "FILTER")]
    log: Option<String>,
    /// How to log: for people, or a JSON object a line [default: auto].
    #[arg(long, global = true, ignore_case = true, env = "LODESTONE_LOG_FORMAT", value_name = "FORMAT")]
    log_format: Option<LogFormat>,
}

#[derive(Debug, Subcommand)]
enum Command {
    Convert(convert::Arguments),
    Verify(verify::Arguments),
    Preview(preview::Arguments),
    Export(export::Arguments),
    Vpc(vpc::Arguments),
    Info(info::Arguments),
    Serve(serve::Arguments),
    Config(config::Arguments),
    Jobs(jobs::Arguments),
    Synth(synth::Arguments),
    Report(report::Arguments),
    Completions(shell::Completions),
    Man(shell::Man),
}

/// Parses the arguments, runs the command, and turns its end into an exit code.
pub fn run() -> ExitCode {
    let mut arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        // Help and the version are results, told on stdout.
        Err(text) if !text.use_stderr() => {
            output::check(text.print());
            return ExitCode::from(output::after(Exit::Done) as u8);
        }
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(Exit::Usage as u8);
        }
    };
    let (log, format) = (arguments.log.take(), arguments.log_format);
    let (log, format) = match &mut arguments.command {
        Command::Serve(serve) => serve.logging(log, format),
        Command::Config(config) => config.serve.logging(log, format),
        _ => (log, format),
    };
    logging::start(log.as_deref(), format);
    if matches!(arguments.command, Command::Serve(_)) && init::is_needed() {
        return init::run().map_or_else(|error| ExitCode::from(failed(&error) as u8), ExitCode::from);
    }
    let exit = match arguments.command {
        Command::Convert(arguments) => convert::run(arguments),
        Command::Verify(arguments) => verify::run(arguments),
        Command::Preview(arguments) => preview::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Vpc(arguments) => vpc::run(arguments),
        Command::Info(arguments) => info::run(arguments),
        Command::Serve(arguments) => serve::run(arguments),
        Command::Config(arguments) => config::run(arguments),
        Command::Jobs(arguments) => jobs::run(arguments),
        Command::Synth(arguments) => synth::run(arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Completions(arguments) => shell::completions(arguments),
        Command::Man(arguments) => shell::man(arguments),
    };
    ExitCode::from(output::after(exit) as u8)
}

/// Threads to work with; all that the machine or container grants if their number is not
/// given.
fn pool(threads: Option<u16>) -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    let threads = threads.map_or_else(limits::threads, usize::from);
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()
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

    /// All arguments of all commands.
    fn arguments_of(command: &clap::Command, all: &mut Vec<(String, clap::Arg)>) {
        let name = command.get_name().to_string();
        all.extend(command.get_arguments().map(|argument| (name.clone(), argument.clone())));
        command.get_subcommands().for_each(|command| arguments_of(command, all));
    }

    #[test]
    fn every_choice_is_taken_in_any_letter_case() {
        use clap::CommandFactory;
        let mut all = Vec::new();
        arguments_of(&Arguments::command(), &mut all);
        let choices: Vec<_> = all
            .iter()
            .filter(|(_, argument)| {
                argument.get_action().takes_values() && !argument.get_possible_values().is_empty()
            })
            .collect();
        assert!(choices.len() > 20, "{}", choices.len());
        for (command, argument) in choices {
            let (id, values) = (argument.get_id(), argument.get_possible_values());
            assert!(argument.is_ignore_case_set(), "{command} {id}");
            // Yes and no are read as people write them, not by clap's own two words.
            assert!(!values.iter().any(|value| value.get_name() == "true"), "{command} {id}");
        }
    }

    #[test]
    fn the_description_of_the_command_line_is_sound() {
        use clap::CommandFactory;
        Arguments::command().debug_assert();
    }

    #[test]
    fn digits_stand_in_groups() {
        assert_eq!(
            (grouped(5), grouped(1234), grouped(10_653_336)),
            ("5".into(), "1 234".into(), "10 653 336".into())
        );
    }
}
