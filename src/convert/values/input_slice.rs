//! Inputs, and the slices in which they are gone through.

use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::format::las::{LasFile, Slice};
use crate::octree::lattice::Requantise;
use crate::octree::record::RecordFormat;

/// One input file that has points.
pub struct ConversionInput {
    pub las: LasFile,
    pub source: RecordFormat,
    pub requantise: Requantise,
    /// Records of inputs that share this number can stand in one file.
    pub layout: usize,
}

/// A slice of an input, and its records where they were kept.
pub struct InputSlice {
    pub input: usize,
    pub slice: Slice,
    /// Where its records lie in the scratch, if they do.
    pub at: u64,
    pub kept: Mutex<CachedRecords>,
}

/// Where a slice's decoded records are.
#[derive(Debug)]
pub enum CachedRecords {
    /// In the input alone.
    Nowhere,
    Memory(Vec<u8>),
    /// In the scratch, at the unit's place.
    Scratch,
}

impl InputSlice {
    pub fn kept(&self) -> MutexGuard<'_, CachedRecords> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
