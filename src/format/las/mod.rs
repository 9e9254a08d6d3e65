//! LAS and LAZ: the only module that knows the `las` and `laz` crates.

mod coding;
mod error;
mod extra_bytes;
mod source;
mod vlr;
mod writer;

pub use error::LasError;
pub use writer::{LasOptions, LasWriter};

/// Bytes that a record of a point format has without extra ones (LAS 1.4 R15,
/// tables 7 to 17).
pub fn record_length(point_format: u8) -> Option<usize> {
    const LENGTHS: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
    LENGTHS.get(usize::from(point_format)).copied()
}
