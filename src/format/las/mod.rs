//! LAS and LAZ: the only module that knows the `las` and `laz` crates. It turns
//! files into raw records and back, as ASPRS LAS 1.4 R15 and LASzip lay them
//! out, up to LAS 1.5; what a record means is not decided here.
//!
//! Nothing that a file says is believed before it is held against the file's
//! real bytes: counts, lengths and offsets lie in the wild. What can be read in
//! spite of a lie is read, and [`Header::notes`] says so; what cannot is an
//! error that says how much could be.

mod behind;
mod chunk_table;
mod chunks;
mod coding;
mod compatible;
mod count_times;
mod crs;
mod declared_counts;
mod error;
mod explore;
mod extra_bytes;
mod fields;
mod geo_keys;
mod gps_time;
mod header;
mod header_totals;
mod layout;
mod mend;
mod passed_on;
mod points;
mod pointwise;
mod reader;
mod recount;
mod recover;
mod sequential;
mod source;
mod stream;
mod text;
mod variable;
mod vlr;
mod writer;

pub use crs::{Crs, CrsSource};
pub use error::LasError;
pub use extra_bytes::UNDESCRIBED;
pub use gps_time::GpsEpoch;
pub use header::{Created, Header};
pub use header_totals::returns_of;
pub use layout::Layout;
pub use passed_on::PassedOn;
pub use reader::{LasFile, Slice};
pub use recover::Checked;
pub use text::get as field_text;
pub use variable::{chunk_table, laszip_record, read_chunk_table};
pub use vlr::Vlr;
pub use writer::{LasOptions, LasWriter};

/// How much a file is believed, and how much is made of one that is broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ReadMode {
    /// Nothing is mended: the file may still be on its way.
    Strict,
    /// All points that it promises, or an error.
    Whole,
    /// As many of them as there are.
    Readable,
}

/// Bytes that a record of a point format has without extra ones (LAS 1.4 R15,
/// tables 7 to 17).
pub fn record_length(point_format: u8) -> Option<usize> {
    const LENGTHS: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
    LENGTHS.get(usize::from(point_format)).copied()
}

#[cfg(test)]
mod tests;
