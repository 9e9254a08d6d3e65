//! A job's own folders.

use std::path::PathBuf;

use crate::serve::config::Config;
use crate::serve::job::JobId;

/// Where octrees wait to be published.
pub(super) fn staging_area(config: &Config) -> PathBuf {
    config.octrees().join(".staged")
}

/// Where a job's octree is made.
pub(super) fn staging(config: &Config, job: JobId) -> PathBuf {
    staging_area(config).join(job.to_string())
}

/// A job's own folder for intermediate files.
pub fn scratch_of(config: &Config, job: JobId) -> PathBuf {
    config.scratch().join(format!("job-{job}"))
}
