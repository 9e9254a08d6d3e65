//! Who holds a file open for writing? Linux tells it in `/proc`, for the
//! processes that we may look at. What we may not see, and other machines behind
//! a network file system, stay unknown: this only ever adds a reason to wait.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

/// All files that a visible process holds open for writing.
pub(super) fn open_for_writing() -> HashSet<PathBuf> {
    let mut written = HashSet::new();
    let Ok(processes) = fs::read_dir("/proc") else { return written };
    for process in processes.flatten() {
        let name = process.file_name();
        let is_process = name.to_string_lossy().bytes().all(|b| b.is_ascii_digit());
        if is_process {
            of_process(&process.path(), &mut written);
        }
    }
    written
}

fn of_process(process: &Path, written: &mut HashSet<PathBuf>) {
    let Ok(descriptors) = fs::read_dir(process.join("fd")) else { return };
    for descriptor in descriptors.flatten() {
        let Ok(target) = fs::read_link(descriptor.path()) else { continue };
        // Sockets, pipes and the like are no paths; only clouds are of interest.
        let is_cloud = target.file_name().and_then(|name| name.to_str()).is_some_and(super::names::is_cloud);
        if is_cloud && is_writer(process, &descriptor.file_name().to_string_lossy()) {
            written.insert(target);
        }
    }
}

/// The `flags:` line is octal; its lowest two bits are the access mode, of which
/// 0 is reading only.
fn is_writer(process: &Path, descriptor: &str) -> bool {
    let Ok(info) = fs::read_to_string(process.join("fdinfo").join(descriptor)) else { return false };
    let flags = info.lines().find_map(|line| line.strip_prefix("flags:"));
    flags.and_then(|flags| u32::from_str_radix(flags.trim(), 8).ok()).is_some_and(|flags| flags & 3 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_writer_is_seen_and_a_reader_is_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path().canonicalize().expect("a path");
        let (written, read) = (folder.join("w.laz"), folder.join("r.laz"));
        let writer = fs::File::create(&written).expect("created");
        fs::write(&read, b"x").expect("written");
        let _reader = fs::File::open(&read).expect("opened");
        let open = open_for_writing();
        assert!(open.contains(&written) && !open.contains(&read));
        drop(writer);
        assert!(!open_for_writing().contains(&written));
    }
}
