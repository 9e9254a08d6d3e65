//! The log of a command, on stderr, so that stdout stays for results.

use std::io::IsTerminal;

use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

use super::output;
use crate::serve::config::logging::{DEFAULT_FILTER, LogFormat};

/// Starts it; a filter that is none is told, and what `info` logs is logged.
pub(super) fn start(log: Option<&str>, format: Option<LogFormat>) {
    let filter = filter(log.unwrap_or(DEFAULT_FILTER)).unwrap_or_else(|error| {
        output::complain(format_args!("{error}; logging what `{DEFAULT_FILTER}` does"));
        Targets::new().with_default(LevelFilter::INFO)
    });
    // A log that cannot be written must not end the program.
    let format = format.unwrap_or_default();
    let colors = format == LogFormat::Auto && std::io::stderr().is_terminal();
    let writer = move || output::Log { colors };
    let layer = tracing_subscriber::fmt::layer().with_writer(writer).log_internal_errors(false);
    let layer = match format {
        LogFormat::Json => layer.json().boxed(),
        LogFormat::Plain => layer.with_ansi(false).with_target(false).boxed(),
        LogFormat::Auto => layer.with_ansi(colors).with_target(false).boxed(),
    };
    // What is kept with jobs does not hang on what is written now.
    let of_jobs = Targets::new().with_target("lodestone", LevelFilter::DEBUG);
    let jobs = crate::serve::log::JobLines.with_filter(of_jobs);
    tracing_subscriber::registry().with(layer.with_filter(filter)).with(jobs).init();
}

/// A level, or parts of the program with theirs. A word alone that is no level would
/// be taken for a part, of which nothing is ever logged.
fn filter(text: &str) -> Result<Targets, String> {
    let stray = text.split(',').map(str::trim).find(|word| {
        !word.is_empty()
            && !word.contains(['=', ':', '_'])
            && word.parse::<LevelFilter>().is_err()
            && *word != "lodestone"
    });
    if let Some(word) = stray {
        return Err(format!(
            "the log filter {text:?} names no level with `{word}`; there are off, error, warn, info, debug and trace"
        ));
    }
    text.parse().map_err(|error| format!("the log filter {text:?} is none ({error})"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_read_in_any_letter_case() {
        for text in
            ["info", "DEBUG", "Off", "lodestone::serve::scheduler=Debug", "warn,lodestone=trace", "lodestone"]
        {
            assert!(filter(text).is_ok(), "{text}");
        }
        for (text, word) in [("inof", "`inof`"), ("info,verbose", "`verbose`"), ("lodestone=loud", "none")] {
            let error = filter(text).expect_err("no filter");
            assert!(error.contains(word), "{error}");
        }
    }
}
