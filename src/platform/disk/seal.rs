//! What tells the octree in a folder from any other: so that none is replaced, and
//! no source removed, by a name alone.

use std::io::Read;
use std::path::Path;

use super::others::{self, Links};

/// The files that make an octree; a COPC file may stand beside them, or alone.
const FILES: [&str; 3] = ["metadata.json", "hierarchy.bin", "octree.bin"];
/// How the name of a COPC file ends.
const COPC: &str = ".copc.laz";
/// Bytes at the beginning of one that describe it: its header, with bounds and counts,
/// and what stands between that and its points.
const COPC_HEAD: u64 = 64 << 10;
/// No description of an octree is longer.
const LONGEST: u64 = 16 << 20;

/// A word for the octree in this folder: its description, which holds its bounds,
/// its points and the ranges of all attributes, and the sizes of its files. A copy
/// of it, as from a backup, has the same. Empty where something else lies there;
/// nothing where nothing does.
pub fn seal(folder: &Path) -> Option<String> {
    folder.symlink_metadata().ok()?;
    Some(sealed(folder).unwrap_or_default())
}

fn sealed(folder: &Path) -> Option<String> {
    let mut hasher = blake3::Hasher::new();
    let files = copc_files(folder)?;
    let metadata = folder.join(FILES[0]);
    if files.is_empty() || metadata.symlink_metadata().is_ok() {
        let (file, _) = others::open_file(&metadata, Links::Followed).ok()?;
        hasher.update_reader(file.take(LONGEST)).ok()?;
        for name in FILES {
            let size = std::fs::symlink_metadata(folder.join(name)).map_or(u64::MAX, |meta| meta.len());
            hasher.update(&size.to_le_bytes());
        }
    }
    for name in files {
        let (file, meta) = others::open_file(&folder.join(&name), Links::Followed).ok()?;
        hasher.update(name.as_bytes());
        hasher.update(&meta.len().to_le_bytes());
        hasher.update_reader(file.take(COPC_HEAD)).ok()?;
    }
    Some(hasher.finalize().to_hex()[..32].to_string())
}

/// The names of the COPC files in a folder, sorted.
fn copc_files(folder: &Path) -> Option<Vec<String>> {
    let names =
        std::fs::read_dir(folder).ok()?.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut files: Vec<String> =
        names.filter(|name| name.ends_with(COPC) && !name.starts_with('.')).collect();
    files.sort();
    Some(files)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_copc_file_is_known_again_alone_and_beside_an_octree() {
        let root = tempfile::tempdir().expect("a folder");
        let folder = root.path().join("a");
        fs::create_dir(&folder).expect("made");
        let file = folder.join("a.copc.laz");
        fs::write(&file, "LASF 1").expect("written");
        let alone = seal(&folder).expect("there");
        assert_eq!(alone.len(), 32);
        fs::write(&file, "LASF 2").expect("another");
        assert_ne!(seal(&folder).as_ref(), Some(&alone));
        fs::write(&file, "LASF 1").expect("the first again");
        assert_eq!(seal(&folder).as_ref(), Some(&alone));
        fs::write(folder.join("report.json"), "{}").expect("written");
        assert_eq!(seal(&folder).as_ref(), Some(&alone));
        fs::write(folder.join("metadata.json"), "{}").expect("written");
        let both = seal(&folder).expect("there");
        assert_ne!(both, alone);
        fs::remove_file(&file).expect("removed");
        assert_ne!(seal(&folder).as_ref(), Some(&both));
    }

    #[test]
    fn an_octree_is_known_again_and_nothing_else_is() {
        let root = tempfile::tempdir().expect("a folder");
        let (a, b) = (root.path().join("a"), root.path().join("b"));
        assert_eq!(seal(&a), None);
        fs::create_dir(&a).expect("made");
        assert_eq!(seal(&a).as_deref(), Some(""), "no octree");
        fs::write(a.join("metadata.json"), "{\"points\": 7}").expect("written");
        fs::write(a.join("octree.bin"), "1234567").expect("written");
        let known = seal(&a).expect("there");
        assert_eq!(known.len(), 32);
        fs::create_dir(a.join("preview")).expect("made");
        fs::write(a.join("report.json"), "{}").expect("written");
        fs::rename(&a, &b).expect("renamed");
        assert_eq!(seal(&b).as_ref(), Some(&known), "pictures and names are beside the point");
        fs::write(b.join("octree.bin"), "123456").expect("cut");
        assert_ne!(seal(&b).as_ref(), Some(&known));
        fs::write(b.join("octree.bin"), "1234567").expect("mended");
        fs::write(b.join("metadata.json"), "{\"points\": 8}").expect("another");
        assert_ne!(seal(&b).as_ref(), Some(&known));
    }
}
