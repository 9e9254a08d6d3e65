//! The folder beside the output in which the octree grows. It takes the output's
//! name when it is whole; until then an older octree of that name stays as it
//! was.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::checkpoint::scratch::Scratch;
use super::context::Context;
use super::copc;
use super::error::{Result, StageError};
use super::octree_writer::{COPC, OCTREE, OutputFiles, Target};
use super::options::{Encoding, Options};
use super::survey::Survey;
use crate::format::potree;
use crate::platform::disk::{self, DirLock, Disk};

/// The folder beside `output` in which the octree grows.
pub fn staging_folder(output: &Path) -> PathBuf {
    let name = output.file_name().map(|n| n.to_string_lossy()).unwrap_or_default();
    output.with_file_name(format!(".{}.building", within_a_name(&name)))
}

/// Bytes of a file's name that most file systems take (255), less what we put
/// around it.
const LONGEST: usize = 200;

/// The name, or where there is no room to put something around it, its beginning
/// and a hash.
pub fn within_a_name(name: &str) -> String {
    if name.len() <= LONGEST {
        return name.to_string();
    }
    let hash = blake3::hash(name.as_bytes()).to_hex();
    format!("{}-{}", &name[..name.floor_char_boundary(LONGEST - 20)], &hash[..16])
}

/// The folder, locked: no second conversion makes the same octree meanwhile.
pub struct Staging {
    pub folder: PathBuf,
    pub lock: Arc<DirLock>,
}

impl Staging {
    pub fn open(disk: &Disk, output: &Path) -> Result<Staging> {
        let folder = staging_folder(output);
        let lock = disk.lock_dir(&folder)?.ok_or_else(|| StageError::Busy(folder.clone()))?;
        disk.clear_replaced(&folder)?;
        Ok(Staging { folder, lock: Arc::new(lock) })
    }

    /// Where the points of each file go.
    fn points(&self, options: &Options, output: &Path) -> [PathBuf; 2] {
        [self.folder.join(potree::OCTREE), self.folder.join(copc::file_name(options, output))]
    }

    /// Whether as much of the files of points is here as receipts vouch for.
    pub fn holds(&self, scratch: &Scratch, options: &Options, output: &Path) -> bool {
        let ends = scratch.past.ends().files;
        self.points(options, output).iter().zip(ends).all(|(path, end)| {
            let file = std::fs::metadata(path);
            end == 0 || file.is_ok_and(|meta| meta.len() >= end)
        })
    }

    /// Opens the files of points if there is room for them: new ones, or those that
    /// receipts vouch for.
    pub fn output_files(
        &self,
        survey: &Survey,
        scratch: Option<&Arc<Scratch>>,
        options: &Options,
        output: &Path,
        context: &Context,
    ) -> Result<OutputFiles> {
        let disk = &context.disk;
        let goes_on = scratch.is_some_and(|scratch| !scratch.past.built.is_empty());
        if !goes_on {
            disk.empty_dir(&self.folder)?;
        }
        let paths = self.points(options, output);
        let bytes = survey.points * survey.unified.schema.record_size() as u64;
        let mut missing = 0;
        let mut open = |file: usize, start: u64, needed: u64| -> Result<Target> {
            let opened = disk.reopen(&paths[file])?;
            missing += needed.saturating_sub(opened.allocated()?);
            Ok(Target { file: opened, start })
        };
        let mut targets = [None, None];
        if options.format.potree {
            // Brotli needs at least a fifth of the plain bytes; less is not worth a try.
            let needed = match options.encoding {
                Encoding::Default => bytes,
                Encoding::Brotli => bytes / 5,
            };
            targets[OCTREE] = Some(open(OCTREE, 0, needed)?);
        }
        if let Some(plan) = &survey.copc {
            // LAZ needs at least a tenth.
            targets[COPC] = Some(open(COPC, plan.points_start, bytes / 10)?);
        }
        check_room(disk, &self.folder, missing)?;
        Ok(OutputFiles::new(targets, scratch.cloned(), context.memory_limit / 8))
    }

    /// What tells this folder from the one whose name it will take.
    pub fn inode(&self) -> Result<u64> {
        disk::inode(&self.folder)
            .map_err(|_| StageError::Inconsistent(format!("{} is gone", self.folder.display())))
    }
}

/// Refuses to begin what has no room to end.
pub fn check_room(disk: &Disk, folder: &Path, needed: u64) -> Result<()> {
    let free = disk.free_space(folder)?;
    if free < needed {
        return Err(StageError::NoRoom { folder: folder.to_path_buf(), needed, free });
    }
    Ok(())
}
