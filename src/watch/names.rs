//! What names tell: which files are clouds, which are still being written, and
//! what the octree of a data set is called.

use std::path::Path;

/// Endings under which browsers, sync tools and people write what is not
/// finished.
const PARTIAL: [&str; 12] = [
    ".part",
    ".partial",
    ".tmp",
    ".temp",
    ".filepart",
    ".crdownload",
    ".download",
    ".opdownload",
    ".!ut",
    ".aria2",
    ".swp",
    "~",
];

/// Beginnings of the same.
const PARTIAL_STARTS: [&str; 4] = [".", "~syncthing~", "~$", "__incomplete"];

/// Whether the name says that the file is not finished, or not meant for us.
pub fn is_partial(name: &str) -> bool {
    let lower = name.to_lowercase();
    PARTIAL.iter().any(|end| lower.ends_with(end))
        || PARTIAL_STARTS.iter().any(|start| lower.starts_with(start))
}

/// Whether the name, without a partial ending, is that of a cloud: a folder
/// that holds such a file is not complete yet.
pub fn is_partial_cloud(name: &str) -> bool {
    let lower = name.to_lowercase();
    is_partial(name) && (lower.contains(".las") || lower.contains(".laz"))
}

/// Whether the name is that of a LAS or LAZ file.
pub fn is_cloud(name: &str) -> bool {
    let lower = name.to_lowercase();
    !is_partial(name) && (lower.ends_with(".las") || lower.ends_with(".laz")) && name.len() > 4
}

/// The name of the octree made from a file or folder of this name: without the
/// ending, and safe as the name of a folder and in a URL's path.
pub fn octree_name(path: &Path, is_folder: bool) -> String {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = match is_folder {
        true => name.as_str(),
        false => name.get(..name.len().saturating_sub(4)).unwrap_or(&name),
    };
    let copc = stem.len().saturating_sub(5);
    let stem = match stem.get(copc..) {
        Some(end) if !is_folder && copc > 0 && end.eq_ignore_ascii_case(".copc") => &stem[..copc],
        _ => stem,
    };
    plain(stem)
}

/// A name that is one component of a path and nothing else.
pub fn plain(name: &str) -> String {
    let cleaned: String = name
        .chars()
        .map(|c| if c.is_control() || matches!(c, '/' | '\\' | '\0') { '_' } else { c })
        .collect();
    let cleaned = cleaned.trim().trim_start_matches('.').trim();
    // Most file systems end at 255 bytes; some room for a number and a suffix.
    let mut end = cleaned.len().min(200);
    while !cleaned.is_char_boundary(end) {
        end -= 1;
    }
    if end == 0 { "unnamed".to_string() } else { cleaned[..end].trim_end().to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn partial_names_are_known() {
        for name in [
            "a.laz.part",
            "a.las.tmp",
            "a.laz.partial",
            "a.laz.filepart",
            "a.laz.crdownload",
            "~syncthing~a.laz.tmp",
            ".a.laz.x7Gh2",
            "~$a.laz",
            "a.laz~",
            "A.LAZ.PART",
        ] {
            assert!(is_partial(name) && !is_cloud(name), "{name}");
            assert!(is_partial_cloud(name), "{name}");
        }
        for name in ["a.las", "A.LAZ", "größe und maß.Laz", "b.copc.laz", "part.las"] {
            assert!(is_cloud(name), "{name}");
        }
        for name in ["notes.txt", "las", ".las", "a.lasx", "a.laz.md5"] {
            assert!(!is_cloud(name), "{name}");
        }
    }

    #[test]
    fn octrees_are_named_after_their_source() {
        for (path, folder, name) in [
            ("/in/a.las", false, "a"),
            ("/in/Tile 7.LAZ", false, "Tile 7"),
            ("/in/lone-star.copc.laz", false, "lone-star"),
            ("/in/größe.laz", false, "größe"),
            ("/in/a.b.c.las", false, "a.b.c"),
            ("/in/city.las", true, "city.las"),
        ] {
            assert_eq!(octree_name(Path::new(path), folder), name);
        }
    }

    proptest! {
        #[test]
        fn no_name_leaves_the_folder(text in "\\PC*") {
            let name = plain(&text);
            prop_assert!(!name.is_empty() && name.len() <= 200);
            prop_assert!(!name.contains(['/', '\\', '\0']) && !name.starts_with('.'));
            prop_assert_eq!(Path::new(&name).components().count(), 1);
            let path = Path::new("/in").join(format!("{}.laz", name));
            octree_name(&path, false);
        }
    }
}
