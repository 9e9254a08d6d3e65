//! Room on the disk, looked at before work begins.

use std::path::Path;

use super::error::{Result, StageError};
use crate::platform::disk::Disk;

/// Refuses to begin what has no room to end.
pub fn check_free_space(disk: &Disk, folder: &Path, needed: u64) -> Result<()> {
    let free = disk.free_space(folder)?;
    if free < needed {
        return Err(StageError::NoRoom { folder: folder.to_path_buf(), needed, free });
    }
    Ok(())
}
