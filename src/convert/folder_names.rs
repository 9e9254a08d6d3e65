//! Names of the folders and files that a conversion makes beside its output.

use std::path::{Path, PathBuf};

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
