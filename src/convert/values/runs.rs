//! Runs: the records of each slice of the input, sorted by chunk.

use std::sync::Arc;

use super::record_range::{ExcludedRange, RunSegment};
use crate::convert::error::{Result, StageError};
use crate::platform::disk::DiskFile;

/// Where a run's records are.
pub enum RunStorage {
    Memory(Vec<u8>),
    /// From this byte of the scratch file.
    Scratch(u64),
}

/// One slice's records, chunk by chunk.
pub struct Run {
    pub input: usize,
    pub place: RunStorage,
}

/// All runs, and each chunk's parts in the order of the input.
pub struct Runs {
    pub runs: Vec<Run>,
    pub parts: Vec<Vec<RunSegment>>,
    /// What lies outside the survey's region.
    pub outliers: Vec<ExcludedRange>,
    /// The scratch file of runs, out of core.
    pub file: Option<Arc<DiskFile>>,
}

impl Runs {
    /// The raw records of a part, of so many bytes each: where they lie, or in
    /// `buffer`.
    pub fn records<'a>(
        &'a self,
        part: RunSegment,
        length: usize,
        buffer: &'a mut Vec<u8>,
    ) -> Result<&'a [u8]> {
        let (from, bytes) = (part.first as usize * length, part.points as usize * length);
        match (&self.runs[part.run as usize].place, &self.file) {
            (RunStorage::Memory(records), _) => Ok(&records[from..from + bytes]),
            (RunStorage::Scratch(at), Some(file)) => {
                buffer.resize(bytes, 0);
                file.read_exact_at(buffer, at + from as u64)?;
                Ok(buffer)
            }
            (RunStorage::Scratch(_), None) => {
                Err(StageError::Inconsistent(format!("run {} is nowhere", part.run)))
            }
        }
    }
}
