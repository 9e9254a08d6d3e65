//! Before a job is started: is there a lane, room and input for it? What does not
//! fit is held with a reason, and what is behind it and fits goes first.

use std::io;
use std::ops::RangeInclusive;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};

use super::folders;
use super::tools::EngineContext;
use crate::serve::config::size::Size;
use crate::serve::config::{Config, LEAST_MEMORY};
use crate::serve::job::{Job, QueuedFile};
use crate::serve::watch::fingerprint::{SourceChange, difference};

/// Bytes of disk a point may need at worst while it is converted: its record in
/// a run and in the octree, and the sampled levels above.
const BYTES_A_POINT: u64 = 80;
/// The same by bytes of input where no header tells the points; LAZ is packed
/// about one to eight.
const BYTES_A_BYTE: u64 = 16;

/// Large data sets do not stand in the way of small ones: each has its lane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SizeClass {
    Heavy,
    Light,
}

impl SizeClass {
    pub fn of(job: &Job, config: &Config) -> SizeClass {
        if config.light_jobs > 0 && SizeClass::Light.sizes(config).contains(&job.bytes) {
            SizeClass::Light
        } else {
            SizeClass::Heavy
        }
    }

    /// Bytes of input of the jobs in it.
    pub fn sizes(self, config: &Config) -> RangeInclusive<u64> {
        match self {
            SizeClass::Heavy if config.light_jobs == 0 => 0..=u64::MAX,
            SizeClass::Heavy => config.light_bytes.saturating_add(1)..=u64::MAX,
            SizeClass::Light => 0..=config.light_bytes,
        }
    }

    /// Jobs that may run side by side in it.
    pub fn width(self, config: &Config) -> usize {
        match self {
            SizeClass::Heavy => config.heavy_jobs,
            SizeClass::Light => config.light_jobs,
        }
    }

    /// Bytes of memory for one job: the light lane has a quarter of it all, but
    /// enough to work with.
    pub fn memory(self, config: &Config) -> u64 {
        let light_jobs = config.light_jobs as u64;
        let light = (config.memory_limit / 4 / light_jobs.max(1)).max(LEAST_MEMORY);
        match self {
            SizeClass::Light => light,
            SizeClass::Heavy => {
                let rest = config.memory_limit.saturating_sub(light * light_jobs);
                (rest / config.heavy_jobs as u64).max(LEAST_MEMORY)
            }
        }
    }
}

/// Bytes of disk that a job may need.
pub(super) fn room(job: &Job) -> u64 {
    match job.points {
        0 => job.bytes.saturating_mul(BYTES_A_BYTE),
        points => points.saturating_mul(BYTES_A_POINT),
    }
}

/// Why a job's inputs cannot be read as they were queued, if so.
pub(super) fn input_trouble(inputs: &[QueuedFile]) -> Option<String> {
    inputs.iter().find_map(|input| match difference(input)? {
        SourceChange::Missing => Some(format!("{} is not there (a missing mount?)", input.path.display())),
        SourceChange::Changed => {
            Some(format!("{} has changed; waiting until it is quiet", input.path.display()))
        }
    })
}

/// Why a job must wait for its disks, if so.
pub(super) fn disk_trouble(job: &Job, in_hand: &[(SizeClass, u64)], tools: &EngineContext) -> Option<String> {
    // What runs in the heavy lane has room set apart for all of its work, though
    // part of that is used already: rather wait than run into a full disk. A
    // light job needs too little to be held by that.
    let set_apart: u64 = match SizeClass::of(job, &tools.config) {
        SizeClass::Heavy => in_hand.iter().map(|(_, room)| *room).fold(0, u64::saturating_add),
        SizeClass::Light => 0,
    };
    // What an earlier attempt left, this one goes on from: a job must not be kept
    // from its end by its own beginning.
    let taken: u64 = [folders::scratch_of(&tools.config, job.id), folders::staging(&tools.config, job.id)]
        .iter()
        .map(|folder| allocated(folder))
        .sum();
    let wanted = room(job).saturating_sub(taken);
    let needed = wanted.saturating_add(set_apart).saturating_add(tools.config.disk_reserve);
    for folder in [tools.config.scratch(), tools.config.octrees()] {
        // Somebody took it away: what was in it is lost, the next job need not be.
        if !folder.is_dir()
            && let Err(error) = tools.disk.create_dir_all(&folder)
        {
            return Some(error.to_string());
        }
        // As after an I/O error, when the system mounts it anew for reading only:
        // then no job should fail for it, one after the other.
        if let Err(errno) = access(&folder, Access::WRITE_OK) {
            return Some(format!("{} cannot be written to: {}", folder.display(), io::Error::from(errno)));
        }
        match tools.disk.free_space(&folder) {
            Ok(free) if free < needed => {
                // Without what changes all the time: that would be news at each look.
                return Some(format!(
                    "needs up to {} on the disk of {}, more than is free there beside the {} that are kept \
                     free and what running jobs may need",
                    Size(wanted),
                    folder.display(),
                    Size(tools.config.disk_reserve),
                ));
            }
            Ok(_) => {}
            Err(error) => return Some(error.to_string()),
        }
    }
    None
}

/// Bytes of disk that a folder's files take up; zero where there is none.
fn allocated(folder: &Path) -> u64 {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let bytes = entries.flatten().filter_map(|entry| {
        let metadata = entry.metadata().ok()?;
        Some(if metadata.is_dir() { allocated(&entry.path()) } else { metadata.blocks() * 512 })
    });
    bytes.sum()
}

/// The first input that is not what it was when the job was queued. One that is
/// gone was read to its end before, and does not matter.
pub(super) fn changed(inputs: &[QueuedFile]) -> Option<PathBuf> {
    // A file that was only renamed or given to somebody else was read all the same;
    // its content is proved where more than an octree hangs on it.
    let changed = inputs.iter().find(|input| {
        let plain = QueuedFile { inode: 0, ctime_ns: 0, ..(*input).clone() };
        difference(&plain) == Some(SourceChange::Changed)
    });
    changed.map(|input| input.path.clone())
}
