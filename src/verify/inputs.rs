//! The files that an octree was made of: found, opened, and read slice by slice
//! on all threads, each record turned into what the octree should hold for it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::error::VerifyError;
use super::mapping::{Converted, Mapping};
use super::octree::OctreeUnderTest;
use crate::format::las::{GpsEpoch, LasFile, Slice};
use crate::format::potree::Metadata;

/// Points that a thread takes at once.
const SLICE: u32 = 100_000;

/// Bytes of records that a thread decodes at once, however large a chunk says it is.
const MOST_SLICE: u64 = 16 << 20;

/// An input file, open, with the way from its records to the octree's.
pub struct VerifyInput {
    pub file: Arc<LasFile>,
    pub mapping: Mapping,
}

impl VerifyInput {
    fn open(path: &Path, octree: &OctreeUnderTest) -> Result<VerifyInput, VerifyError> {
        let file = match octree.readable.get(path) {
            Some(file) => file.clone(),
            None => {
                let mut file = LasFile::open(path)?;
                file.count_times_from(gps_time(&octree.metadata));
                file.bound_slices(MOST_SLICE);
                Arc::new(file)
            }
        };
        let mapping = Mapping::new(file.header(), octree);
        Ok(VerifyInput { file, mapping })
    }
}

/// What an octree's GPS times count from, if they are not seconds of the week.
fn gps_time(metadata: &Metadata) -> GpsEpoch {
    metadata.gps_time_offset.map_or(GpsEpoch::ADJUSTED, |offset| GpsEpoch::Standard { offset })
}

/// Opens files for what can be read of them, each once for all passes: LAZ is
/// decoded to the end for that.
pub fn readable(
    files: &[PathBuf],
    metadata: &Metadata,
) -> Result<HashMap<PathBuf, Arc<LasFile>>, VerifyError> {
    let mut opened = HashMap::new();
    for path in files {
        let mut file = LasFile::open_readable(path)?;
        file.bound_slices(MOST_SLICE);
        file.leave_out_damaged(|_| true)?;
        file.count_times_from(gps_time(metadata));
        opened.insert(path.clone(), Arc::new(file));
    }
    Ok(opened)
}

/// A slice's records as the octree should hold them.
pub struct RecordBlock<'a> {
    pub input: &'a VerifyInput,
    pub records: &'a [u8],
    pub converted: Converted,
}

/// Reads all files and folds their blocks. Slices are handed out in their order,
/// as some LAZ files can only be decoded from front to back; memory is a slice a
/// thread.
pub fn fold<A: Send>(
    files: &[PathBuf],
    octree: &OctreeUnderTest,
    start: impl Fn() -> A + Sync + Send,
    each: impl Fn(&mut A, RecordBlock) + Sync + Send,
    merge: impl Fn(A, A) -> A + Sync + Send,
) -> Result<A, VerifyError> {
    let slices = files.iter().flat_map(|path| slices(path, octree));
    slices
        .par_bridge()
        .try_fold(
            || (start(), Vec::new(), Vec::new()),
            |(mut state, mut raw, mut records), slice| {
                let (input, slice) = slice?;
                input.file.read(slice, &mut raw)?;
                let converted = input.mapping.convert(&raw, &mut records);
                each(&mut state, RecordBlock { input: &input, records: &records, converted });
                Ok::<_, VerifyError>((state, raw, records))
            },
        )
        .map(|folded| folded.map(|(state, ..)| state))
        .try_reduce(&start, |a, b| Ok(merge(a, b)))
}

type InputSlice = Result<(Arc<VerifyInput>, Slice), VerifyError>;

/// The slices of a file, or why it cannot be read.
fn slices(path: &Path, octree: &OctreeUnderTest) -> Vec<InputSlice> {
    match VerifyInput::open(path, octree) {
        Ok(input) => {
            let slices = input.file.slices(SLICE);
            let input = Arc::new(input);
            slices.into_iter().map(|slice| Ok((input.clone(), slice))).collect()
        }
        Err(error) => vec![Err(error)],
    }
}
