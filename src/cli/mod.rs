//! The command line: arguments in, exit code out. One file a command.

mod arguments;
mod config;
mod convert;
mod exit;
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

use clap::{CommandFactory, Parser, Subcommand};

use crate::serve::config::logging::LogFormat;
use crate::serve::init;
use exit::Exit;
use output::failed;

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
        Command::Completions(arguments) => shell::completions(arguments, Arguments::command()),
        Command::Man(arguments) => shell::man(arguments, Arguments::command()),
    };
    ExitCode::from(output::after(exit) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All arguments of all commands.
    fn arguments_of(command: &clap::Command, all: &mut Vec<(String, clap::Arg)>) {
        let name = command.get_name().to_string();
        all.extend(command.get_arguments().map(|argument| (name.clone(), argument.clone())));
        command.get_subcommands().for_each(|command| arguments_of(command, all));
    }

    #[test]
    fn every_choice_is_taken_in_any_letter_case() {
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
        Arguments::command().debug_assert();
    }
}
