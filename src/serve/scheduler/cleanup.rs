//! The janitor clears scratch and staging folders of jobs that have no work
//! before them. Only folders whose names are ours to give: the number of a job.

use std::path::Path;

use super::folders;
use crate::platform::disk::Disk;
use crate::serve::config::Config;
use crate::serve::job::JobId;

/// Jobs that have something in scratch or staging.
pub fn present(config: &Config) -> Vec<JobId> {
    let mut jobs = Vec::new();
    for (folder, prefix) in [(config.scratch(), "job-"), (folders::staging_area(config), "")] {
        let Ok(entries) = std::fs::read_dir(folder) else { continue };
        let names = entries.flatten().map(|entry| entry.file_name());
        jobs.extend(names.filter_map(|name| job_of(name.to_str()?, prefix)));
    }
    jobs
}

/// Clears what does not belong to one of the `open` jobs, and says so.
pub fn sweep(config: &Config, disk: &Disk, open: &[JobId]) {
    sweep_folder(&config.scratch(), "job-", disk, open);
    sweep_folder(&folders::staging_area(config), "", disk, open);
}

fn sweep_folder(folder: &Path, prefix: &str, disk: &Disk, open: &[JobId]) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let number = name.to_str().and_then(|name| job_of(name, prefix));
        if number.is_some_and(|job| !open.contains(&job)) {
            match disk.remove_dir_all(&entry.path()) {
                Ok(()) => tracing::info!(path = %entry.path().display(), "cleared what a job left behind"),
                Err(error) => tracing::warn!(%error, "left-over of a job"),
            }
        }
    }
}

/// `job-17`, or `17` and `17.something` in staging.
fn job_of(name: &str, prefix: &str) -> Option<JobId> {
    let rest = name.trim_start_matches('.').strip_prefix(prefix)?;
    let digits = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
    let follows = rest[digits..].chars().next();
    if follows.is_some_and(|c| c != '.' && c != '-') { None } else { rest[..digits].parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_that_are_ours_are_cleared() {
        for (name, prefix, job) in [
            ("job-17", "job-", Some(17)),
            ("17", "", Some(17)),
            ("17.old", "", Some(17)),
            (".17.tmp", "", Some(17)),
            ("17th-street", "", None),
            ("city", "", None),
            ("", "", None),
            ("job-", "job-", None),
            ("my-job-3", "job-", None),
        ] {
            assert_eq!(job_of(name, prefix), job, "{name}");
        }
    }
}
