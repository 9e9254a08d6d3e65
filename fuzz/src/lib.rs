//! The readers, and how libFuzzer hears of what they do.

#[path = "../../tests/fuzz_smoke/readers.rs"]
mod readers;

pub use readers::*;

/// Ends the process where a reader panics.
pub fn try_one(reader: fn(&[u8]), bytes: &[u8]) {
    if let Err(message) = attempt(reader, bytes) {
        eprintln!("{message}");
        std::process::abort();
    }
}
