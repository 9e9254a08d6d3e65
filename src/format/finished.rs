//! What a path means as a finished cloud: an octree's folder, or a COPC file, which may be
//! the only one in a folder without an octree.

use std::path::{Path, PathBuf};

use super::copc::{ENDING, is_copc};
use super::potree::METADATA;

/// A finished cloud, not opened yet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Finished {
    /// The folder of an octree.
    Octree(PathBuf),
    /// A COPC file.
    Copc(PathBuf),
    /// Neither, or a folder of which it is not clear which file is meant.
    Neither,
}

/// What a path means: an octree's folder or its metadata.json, a COPC file of any name, or a
/// folder with one COPC file and no octree in it.
pub fn find(path: &Path) -> Finished {
    if path.file_name().is_some_and(|name| name == METADATA) {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        return Finished::Octree(folder.unwrap_or(Path::new(".")).to_path_buf());
    }
    if !path.is_dir() {
        return if is_copc(path) { Finished::Copc(path.to_path_buf()) } else { Finished::Neither };
    }
    if path.join(METADATA).exists() {
        return Finished::Octree(path.to_path_buf());
    }
    match copc_in(path).as_slice() {
        [only] => Finished::Copc(only.clone()),
        _ => Finished::Neither,
    }
}

/// The COPC files of a folder by their names, in any letter case, sorted; hidden ones are
/// passed over.
pub fn copc_in(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_named_so = |path: &PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase());
        name.is_some_and(|name| name.ends_with(ENDING) && !name.starts_with('.'))
    };
    let mut files: Vec<PathBuf> = entries.filter(is_named_so).filter(|path| path.is_file()).collect();
    files.sort();
    files
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn paths_mean_octrees_or_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        assert_eq!(find(folder.path()), Finished::Neither);
        let mut front = vec![0; 600];
        front[..4].copy_from_slice(b"LASF");
        front[377..381].copy_from_slice(b"copc");
        front[393] = 1;
        for name in ["a.COPC.laz", ".b.copc.laz"] {
            fs::write(at(name), &front).expect("written");
        }
        assert_eq!(find(folder.path()), Finished::Copc(at("a.COPC.laz")), "hidden ones do not count");
        fs::write(at("any.name"), &front).expect("written");
        assert_eq!(find(&at("any.name")), Finished::Copc(at("any.name")));
        fs::write(at("c.copc.laz"), &front).expect("written");
        assert_eq!(find(folder.path()), Finished::Neither, "which of two?");
        fs::write(at(METADATA), "{}").expect("written");
        for path in [folder.path().to_path_buf(), at(METADATA)] {
            assert_eq!(find(&path), Finished::Octree(folder.path().to_path_buf()));
        }
        assert_eq!(find(&at("none")), Finished::Neither);
    }
}
