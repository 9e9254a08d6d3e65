//! What tells the octree in a folder from any other: so that none is replaced, and
//! no source removed, by a name alone.

use std::io::Read;
use std::path::Path;

use super::others::{self, Links};

/// The files that make an octree.
const FILES: [&str; 3] = ["metadata.json", "hierarchy.bin", "octree.bin"];
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
    let (file, _) = others::open_file(&folder.join(FILES[0]), Links::Followed).ok()?;
    hasher.update_reader(file.take(LONGEST)).ok()?;
    for name in FILES {
        let size = std::fs::symlink_metadata(folder.join(name)).map_or(u64::MAX, |meta| meta.len());
        hasher.update(&size.to_le_bytes());
    }
    Some(hasher.finalize().to_hex()[..32].to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

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
