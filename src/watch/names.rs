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

/// Most file systems end at 255 bytes; some room for a number and a suffix.
const LONGEST: usize = 200;

/// A name that is one component of a path and nothing else. It never begins with a
/// dot: such names are hidden, are not served, and some of them are ours.
pub fn plain(name: &str) -> String {
    let cleaned: String =
        name.chars().map(|c| if is_invisible(c) || matches!(c, '/' | '\\') { '_' } else { c }).collect();
    // Dots and blanks in any mixture: a dot behind a blank would begin the name.
    let cleaned = cleaned.trim_start_matches(|c: char| c == '.' || c.is_whitespace());
    let mut end = cleaned.len().min(LONGEST);
    while !cleaned.is_char_boundary(end) {
        end -= 1;
    }
    match cleaned[..end].trim_end() {
        "" => "unnamed".to_string(),
        name => name.to_string(),
    }
}

/// Breaks lines, turns text around, or cannot be seen.
fn is_invisible(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200B}' | '\u{200E}' | '\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2066}'..='\u{2069}' | '\u{FEFF}')
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

    #[test]
    fn dots_behind_blanks_do_not_begin_a_name() {
        for (wished, name) in [
            (" . .previews", "previews"),
            (". .", "unnamed"),
            (". .hid", "hid"),
            (".\t.\n. .staged", "_._. .staged"),
            ("\u{3000}.\u{a0}..x", "x"),
            ("\u{feff}.bom", "_.bom"),
            ("..", "unnamed"),
            ("", "unnamed"),
            ("a/../../b", "a_.._.._b"),
            ("\u{202e}gnp", "_gnp"),
        ] {
            assert_eq!(plain(wished), name, "{wished:?}");
        }
    }

    /// What holds of every name that leaves this room.
    fn is_sound(name: &str) -> bool {
        !name.is_empty()
            && name.len() <= LONGEST
            && !name.starts_with('.')
            && name.trim() == name
            && !name.contains(|c: char| c == '/' || c == '\\' || is_invisible(c))
            && Path::new(name).components().count() == 1
            && plain(name) == name
    }

    proptest! {
        #[test]
        fn no_name_leaves_the_folder(text in ".*") {
            prop_assert!(is_sound(&plain(&text)));
        }

        /// Dots, blanks and what looks like them, in any order.
        #[test]
        fn no_mixture_of_dots_and_blanks_hides(text in "[. \\t\u{a0}\u{3000}/\\\\a\0]{0,12}\\PC{0,3}") {
            prop_assert!(is_sound(&plain(&text)), "{:?}", plain(&text));
        }

        /// Names of files are bytes.
        #[test]
        fn any_bytes_give_a_sound_name(
            bytes in prop::collection::vec(any::<u8>(), 0..300),
            is_folder in any::<bool>(),
            ending in prop::sample::select(vec!["", ".las", ".LAZ", ".copc.laz", "ü.las"]),
        ) {
            use std::os::unix::ffi::OsStrExt;
            let bytes = [bytes.as_slice(), ending.as_bytes()].concat();
            let path = Path::new("/in").join(std::ffi::OsStr::from_bytes(&bytes));
            prop_assert!(is_sound(&octree_name(&path, is_folder)));
        }
    }
}
