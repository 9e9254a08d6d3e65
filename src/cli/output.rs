//! Results on stdout, such that a reader who leaves and a disk that is full are
//! what they are: `… | head` has seen enough, and a result that could not be
//! written is a failure. `println!` panics at both.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use indicatif::ProgressBar;

use super::exit::Exit;
use crate::words::{Lines, Plain};

/// Whether something could not be written, told once.
static LOST: AtomicBool = AtomicBool::new(false);

/// Writes a result; the exit code that the command has then.
pub(super) fn print(text: &str, exit: Exit) -> Exit {
    write(format_args!("{text}"));
    after(exit)
}

/// The command's exit code, in the light of what became of its output.
pub(super) fn after(exit: Exit) -> Exit {
    check(io::stdout().flush());
    if LOST.load(Ordering::SeqCst) { Exit::Failed } else { exit }
}

/// What `print!` does, without the panic; see [`after`].
pub(super) fn write(text: fmt::Arguments) {
    check(io::stdout().lock().write_fmt(format_args!("{}", Lines(text))));
}

/// Takes note of what became of something written to stdout.
pub(super) fn check(result: io::Result<()>) {
    match result {
        Ok(()) => {}
        // A reader that has seen enough is no failure.
        Err(error) if error.kind() == ErrorKind::BrokenPipe => {}
        Err(error) => {
            if !LOST.swap(true, Ordering::SeqCst) {
                complain(format_args!("the result could not be written to stdout: {error}"));
            }
        }
    }
}

/// A message on stderr.
pub(super) fn complain(text: fmt::Arguments) {
    tell(format_args!("lodestone: {}", Plain(text)));
}

/// Prints an error with its causes and says that the command failed.
pub(super) fn failed(error: &dyn std::error::Error) -> Exit {
    complain(format_args!("{error}"));
    Exit::Failed
}

/// Says that the settings are wrong; with the lines of a file that show where.
pub(super) fn misused(error: &dyn std::error::Error) -> Exit {
    tell(format_args!("lodestone: {error}"));
    Exit::Usage
}

/// A line on stderr; where that is closed or full nobody is left to be told.
pub(super) fn tell(line: fmt::Arguments) {
    // In one piece, so that lines of two threads do not mix.
    let _ = Stderr.write_all(format!("{}\n", Lines(line)).as_bytes());
}

/// The progress bar that stands on the terminal's last line, while one does.
static BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Lines on stderr go above this bar from now on.
pub(super) fn keep_clear_of(bar: Option<ProgressBar>) {
    *BAR.lock().unwrap_or_else(PoisonError::into_inner) = bar;
}

/// Standard error, for lines that neither end in a progress bar nor are drawn over
/// by it: the log's too.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stderr;

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let bar = BAR.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match bar {
            Some(bar) => bar.suspend(|| io::stderr().lock().write(bytes)),
            None => io::stderr().lock().write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().lock().flush()
    }
}

/// The log's way to stderr: an event is one line, whatever paths and names it tells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Log {
    /// Whether the log itself colors what it writes.
    pub colors: bool,
}

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        let (line, end) = match text.strip_suffix('\n') {
            Some(line) => (line, "\n"),
            None => (&*text, ""),
        };
        Stderr.write_all(format!("{}{end}", escaped(line, self.colors)).as_bytes())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Stderr.flush()
    }
}

/// A line of the log without controls but its own colors; in fields and messages
/// these are escaped before.
fn escaped(line: &str, colors: bool) -> String {
    let mut parts = line.split('\u{1b}');
    let mut out = Plain(parts.next().unwrap_or_default()).to_string();
    for part in parts {
        let digits = part
            .strip_prefix('[')
            .map(|rest| rest.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';'));
        let is_color = digits.is_some_and(|rest| rest.starts_with('m'));
        out += if colors && is_color { "\u{1b}" } else { "\\u001b" };
        out += &Plain(part).to_string();
    }
    out
}

/// A line of the result.
macro_rules! say {
    ($($text:tt)*) => {
        $crate::cli::output::write(format_args!("{}\n", format_args!($($text)*)))
    };
}
pub(super) use say;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_stays_one_line_with_its_own_colors_alone() {
        let line = "\u{1b}[32m INFO\u{1b}[0m queued path=a\nb\u{1b}]0;title\u{7}\u{1b}[2J";
        assert_eq!(
            escaped(line, true),
            "\u{1b}[32m INFO\u{1b}[0m queued path=a\\nb\\u001b]0;title\\u0007\\u001b[2J"
        );
        assert!(!escaped(line, false).contains(char::is_control));
    }
}
