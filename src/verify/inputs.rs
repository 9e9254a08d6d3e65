//! The files that an octree was made of: found, opened, and read slice by slice
//! on all threads, each record turned into what the octree should hold for it.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::VerifyError;
use super::mapping::{Converted, Mapping};
use super::octree::Octree;
use crate::format::las::{LasFile, Slice};

/// Points that a thread takes at once.
const SLICE: u32 = 100_000;

/// All LAS and LAZ files that paths mean: files as they are, folders with all
/// below them, `@list` the lines of a file.
pub fn find(paths: &[PathBuf]) -> Result<Vec<PathBuf>, VerifyError> {
    let mut files = Vec::new();
    for path in paths {
        match path.to_str().and_then(|text| text.strip_prefix('@')) {
            Some(list) => {
                let text = fs::read_to_string(list).map_err(|e| VerifyError::input(Path::new(list), e))?;
                let lines = text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
                lines.map(Path::new).try_for_each(|line| gather(line, true, &mut files))?;
            }
            None => gather(path, true, &mut files)?,
        }
    }
    if files.is_empty() {
        return Err(VerifyError::NoInputs);
    }
    Ok(files)
}

fn gather(path: &Path, is_named: bool, files: &mut Vec<PathBuf>) -> Result<(), VerifyError> {
    let failed = |error| VerifyError::input(path, error);
    if fs::metadata(path).map_err(failed)?.is_dir() {
        let mut entries = fs::read_dir(path)
            .and_then(|entries| entries.map(|entry| entry.map(|e| e.path())).collect::<Result<Vec<_>, _>>())
            .map_err(failed)?;
        entries.sort();
        return entries.iter().try_for_each(|entry| gather(entry, false, files));
    }
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if is_named || matches!(extension.as_deref(), Some("las" | "laz")) {
        files.push(path.to_path_buf());
    }
    Ok(())
}

/// An input file, open, with the way from its records to the octree's.
pub struct Input {
    pub file: LasFile,
    pub mapping: Mapping,
}

impl Input {
    fn open(path: &Path, octree: &Octree) -> Result<Input, VerifyError> {
        let file = LasFile::open(path)?;
        let mapping = Mapping::new(file.header(), &octree.metadata, &octree.schema);
        Ok(Input { file, mapping })
    }
}

/// A slice's records as the octree should hold them.
pub struct Block<'a> {
    pub input: &'a Input,
    pub records: &'a [u8],
    pub converted: Converted,
}

/// Reads all files and folds their blocks. Slices are handed out in their order,
/// as some LAZ files can only be decoded from front to back; memory is a slice a
/// thread.
pub fn fold<A: Send>(
    files: &[PathBuf],
    octree: &Octree,
    start: impl Fn() -> A + Sync + Send,
    each: impl Fn(&mut A, Block) + Sync + Send,
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
                each(&mut state, Block { input: &input, records: &records, converted });
                Ok::<_, VerifyError>((state, raw, records))
            },
        )
        .map(|folded| folded.map(|(state, ..)| state))
        .try_reduce(&start, |a, b| Ok(merge(a, b)))
}

type InputSlice = Result<(Arc<Input>, Slice), VerifyError>;

/// The slices of a file, or why it cannot be read.
fn slices(path: &Path, octree: &Octree) -> Vec<InputSlice> {
    match Input::open(path, octree) {
        Ok(input) => {
            let slices = input.file.slices(SLICE);
            let input = Arc::new(input);
            slices.into_iter().map(|slice| Ok((input.clone(), slice))).collect()
        }
        Err(error) => vec![Err(error)],
    }
}
