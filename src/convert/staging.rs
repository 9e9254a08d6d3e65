//! The folder beside the output in which the octree grows. It takes the output's
//! name when it is whole; until then an older octree of that name stays as it
//! was.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::checkpoint::scratch::Scratch;
use super::context::Context;
use super::copc;
use super::error::{Result, StageError};
use super::folder_names::staging_folder;
use super::free_space::check_free_space;
use super::octree_writer::{OutputFiles, PointFile};
use super::options::{Encoding, Options};
use super::values::block::{COPC, OCTREE};
use super::values::counted_inputs::Survey;
use crate::format::potree;
use crate::platform::disk::{self, DirLock, Disk};

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
        let mut open = |file: usize, start: u64, needed: u64| -> Result<PointFile> {
            let opened = disk.reopen(&paths[file])?;
            missing += needed.saturating_sub(opened.allocated()?);
            Ok(PointFile { file: opened, start })
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
        check_free_space(disk, &self.folder, missing)?;
        Ok(OutputFiles::new(targets, scratch.cloned(), context.memory_limit / 8))
    }

    /// What tells this folder from the one whose name it will take.
    pub fn inode(&self) -> Result<u64> {
        disk::inode(&self.folder)
            .map_err(|_| StageError::Inconsistent(format!("{} is gone", self.folder.display())))
    }
}
