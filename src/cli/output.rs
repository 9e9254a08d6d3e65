//! Results on stdout, such that a reader who leaves and a disk that is full are
//! what they are: `… | head` has seen enough, and a result that could not be
//! written is a failure. `println!` panics at both.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use indicatif::ProgressBar;

use super::Exit;

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
    check(io::stdout().lock().write_fmt(text));
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
    tell(format_args!("lodestone: {text}"));
}

/// A line on stderr; where that is closed or full nobody is left to be told.
pub(super) fn tell(line: fmt::Arguments) {
    // In one piece, so that lines of two threads do not mix.
    let _ = Stderr.write_all(format!("{line}\n").as_bytes());
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

/// A line of the result.
macro_rules! say {
    ($($text:tt)*) => {
        $crate::cli::output::write(format_args!("{}\n", format_args!($($text)*)))
    };
}
pub(super) use say;
