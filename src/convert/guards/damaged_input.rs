//! Cut and damaged inputs: what can be read of them where that is asked for, and
//! otherwise an error that says how much that would be.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::convert::context::{Context, Stage};
use crate::convert::error::{Result, StageError};
use crate::convert::options::Damaged;
use crate::convert::workers;
use crate::format::las::{Checked, LasError, LasFile};

/// Opens an input. Where what can be read is kept, how much that is shows in
/// [`leave_out`].
pub fn open(path: &Path, damaged: Damaged, context: &Context) -> Result<LasFile> {
    let links = context.disk.links();
    let mut file = match damaged {
        Damaged::Fail => LasFile::open_with(path, links).map_err(|error| explained(error, context))?,
        Damaged::Keep => LasFile::open_readable_with(path, links)?,
    };
    file.bound_slices(most_slice(context));
    Ok(file)
}

/// Bytes of a slice's records: every thread has one, and they are not to be more than a
/// part of the memory. Chunks of the usual size fit at any limit.
fn most_slice(context: &Context) -> u64 {
    (context.memory_limit / (4 * context.threads.max(1) as u64)).max(8 << 20)
}

/// Leaves out of the inputs what cannot be decoded. Every LAZ chunk is decoded
/// once for that, because no LAZ file says which of its chunks are sound, and
/// all that follows rests on the number of points.
pub fn leave_out(files: Vec<LasFile>, context: &Context) -> Result<Vec<LasFile>> {
    context.progress.begin(Stage::Survey, files.iter().map(|file| file.header().points).sum());
    let files: Vec<Mutex<LasFile>> = files.into_iter().map(Mutex::new).collect();
    workers::in_order(
        context.threads,
        files.len(),
        &context.cancel,
        || (),
        |(), i| leave_out_of(&mut files[i].lock().unwrap_or_else(PoisonError::into_inner), context),
    )?;
    Ok(files.into_iter().map(|file| file.into_inner().unwrap_or_else(PoisonError::into_inner)).collect())
}

fn leave_out_of(file: &mut LasFile, context: &Context) -> Result<()> {
    let checked = file.leave_out_damaged(|points| {
        context.progress.advance(points);
        !context.cancel.is_cancelled()
    })?;
    match checked {
        Checked::Whole => Ok(()),
        Checked::Stopped => Err(StageError::Cancelled),
    }
}

/// Says of a damaged file how many points could be read, and how to allow it.
pub fn explain(error: StageError, context: &Context) -> StageError {
    match error {
        StageError::Las(error) => explained(error, context),
        other => other,
    }
}

fn explained(error: LasError, context: &Context) -> StageError {
    match &error {
        LasError::Cut { readable: 1.., .. } | LasError::Contradiction { .. } => {
            StageError::Damaged { error, readable: None }
        }
        LasError::Damaged { path, .. } => match readable(path, context) {
            Ok((there @ 1.., all)) => StageError::Damaged { error, readable: Some((there, all)) },
            Err(StageError::Cancelled) => StageError::Cancelled,
            // Then what was wrong in the first place is all that can be said.
            Ok(_) | Err(_) => error.into(),
        },
        _ => error.into(),
    }
}

/// Points that can be read, and those that are promised.
fn readable(path: &Path, context: &Context) -> Result<(u64, u64)> {
    let mut file = LasFile::open_readable_with(path, context.disk.links())?;
    file.bound_slices(most_slice(context));
    context.progress.begin(Stage::Survey, file.header().points);
    leave_out_of(&mut file, context)?;
    Ok((file.header().points, file.header().points + file.header().missing))
}
