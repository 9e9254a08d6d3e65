//! From the staging folder into `octrees/`, by one swap.
//!
//! A conversion's octree is made as `octrees/.staged/<job>`, on the same file
//! system. Its inode goes into the queue before the swap, so that after a crash
//! the two are told apart, the new octree and the old one that it replaces: the
//! swap exchanges their names, and looks the same from both sides.

use std::io::ErrorKind;
use std::path::Path;

use super::converter::Failure;
use super::folders::staging;
use super::tools::EngineContext;
use crate::platform::disk::{Disk, DiskError, inode};
use crate::serve::job::Job;
use crate::serve::queue::StoreError;

/// More names in a row are not taken away under our hands.
const TRIES: usize = 8;

/// Brings the octree whose folder has this inode into its place. May be called
/// again after a crash at any point. Where something stands there that must not be
/// replaced, the job gets another name first.
pub(super) async fn publish(tools: &EngineContext, job: &Job, staged: u64) -> Result<(), Failure> {
    let (from, octrees) = (staging(&tools.config, job.id), tools.config.octrees());
    let mut name = job.name.clone();
    for _ in 0..TRIES {
        let to = octrees.join(&name);
        let in_place = staged != 0 && inode(&to).ok() == Some(staged);
        let free = in_place || tools.store.may_publish(job.id, &name, &octrees).await.map_err(unanswered)?;
        if !free {
            let now = tools.clock.now();
            let new = tools.store.give_new_name(job.id, &octrees, now).await.map_err(unanswered)?;
            tracing::warn!(
                job = job.id,
                name,
                new,
                "what stands there is not to be replaced; another name is taken"
            );
            name = new;
            continue;
        }
        let (disk, from) = (tools.disk.clone(), from.clone());
        return match tokio::task::spawn_blocking(move || swap(&disk, &from, &to, staged)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => {
                // What is not there was taken away, and is made again.
                let may_pass = error.may_pass() || error.source.kind() == ErrorKind::NotFound;
                Err(Failure { message: error.to_string(), may_pass, panicked: false })
            }
            Err(error) => Err(Failure {
                message: format!("publishing failed: {error}"),
                may_pass: true,
                panicked: true,
            }),
        };
    }
    let message = format!("no free name was found for {name}");
    Err(Failure { message, may_pass: true, panicked: false })
}

fn unanswered(error: StoreError) -> Failure {
    Failure { message: error.to_string(), may_pass: true, panicked: false }
}

fn swap(disk: &Disk, from: &Path, to: &Path, staged: u64) -> Result<(), DiskError> {
    if inode(to).ok() == Some(staged) && staged != 0 {
        // It is in its place; what lies in staging is the old one.
        return disk.remove_dir_all(from);
    }
    let failed = |error: std::io::Error| DiskError::new("publish", to, error);
    if inode(from).map_err(failed)? != staged {
        return Err(failed(std::io::Error::other("the staged octree is not the one that was converted")));
    }
    disk.replace_dir(from, to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    use std::fs;

    fn octree(path: &Path, text: &str) -> u64 {
        fs::create_dir_all(path).expect("made");
        fs::write(path.join("metadata.json"), text).expect("written");
        inode(path).expect("there")
    }

    fn content(path: &Path) -> Option<String> {
        fs::read_to_string(path.join("metadata.json")).ok()
    }

    #[test]
    fn the_first_is_renamed_and_the_next_exchanged() {
        let root = tempfile::tempdir().expect("a folder");
        let (from, to) = (root.path().join("7"), root.path().join("a"));
        for text in ["one", "two"] {
            let staged = octree(&from, text);
            swap(&Disk::new(), &from, &to, staged).expect("published");
            assert_eq!(content(&to).as_deref(), Some(text));
            assert!(!from.exists());
        }
    }

    /// A crash right after the exchange leaves the old octree under the staging
    /// name; exchanging again would bring it back.
    #[test]
    fn publishing_again_after_a_crash_never_brings_back_the_old_octree() {
        let root = tempfile::tempdir().expect("a folder");
        let (from, to) = (root.path().join("7"), root.path().join("a"));
        octree(&to, "old");
        let staged = octree(&from, "new");
        renameat_with(CWD, &from, CWD, &to, RenameFlags::EXCHANGE).expect("exchanged, and here it crashed");
        swap(&Disk::new(), &from, &to, staged).expect("published");
        assert_eq!(content(&to).as_deref(), Some("new"));
        assert!(!from.exists());
    }

    #[test]
    fn nothing_is_published_in_place_of_what_was_converted() {
        let root = tempfile::tempdir().expect("a folder");
        let (from, to) = (root.path().join("7"), root.path().join("a"));
        assert!(swap(&Disk::new(), &from, &to, 12345).is_err());
        let staged = octree(&from, "x");
        assert!(swap(&Disk::new(), &from, &to, staged + 1).is_err());
        assert!(!to.exists());
    }
}
