//! Data sets that are ready for the queue.

use std::path::PathBuf;

use super::file_stamp::FileStamp;
use super::marker::Marker;

/// A data set that is quiet and whole (or will not get whole any more).
#[derive(Debug, Clone)]
pub struct FoundDataSet {
    /// The file or folder in the watched folder.
    pub path: PathBuf,
    pub is_folder: bool,
    /// The name that its octree should have.
    pub name: String,
    pub files: Vec<FileStamp>,
    /// All sizes and times in one word, to know the data set again.
    pub stamp: String,
    pub marker: Option<Marker>,
    /// Points that the headers claim.
    pub points: u64,
    /// Why it may not be whole, though its time was up: its sources stay.
    pub doubt: Option<String>,
    /// Why it cannot be converted as it was meant to be.
    pub refusal: Option<String>,
}
