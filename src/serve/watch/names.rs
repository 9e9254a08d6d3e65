//! What names tell: which files are clouds, which are still being written, which
//! are none of ours, and what the octree of a data set is called.

use std::path::Path;

use crate::words::is_invisible;

/// Endings under which browsers, sync tools and people write what is not
/// finished.
const PARTIAL: [&str; 21] = [
    ".part",
    ".partial",
    ".tmp",
    ".temp",
    ".filepart",
    ".crdownload",
    ".download",
    ".opdownload",
    ".!ut",
    ".!qb",
    ".!sync",
    ".aria2",
    ".swp",
    ".gstmp",
    ".cyberducksegment",
    ".inprogress",
    ".incomplete",
    ".upload",
    ".uploading",
    ".lftp-pget-status",
    "~",
];

/// Beginnings of the same.
const PARTIAL_STARTS: [&str; 4] = [".", "~syncthing~", "~$", "__incomplete"];

/// Folders in which a copy keeps files under their last names until they are
/// whole, by a word in their hidden names: rsync's `.~tmp~`, `.rsync-partial`.
const TRANSFER_FOLDERS: [&str; 5] = ["tmp", "temp", "part", "incomplete", "upload"];

/// Files and folders that systems leave beside everybody's files.
const JUNK: [&str; 17] = [
    ".ds_store",
    "thumbs.db",
    "ehthumbs.db",
    "desktop.ini",
    "__macosx",
    "@eadir",
    ".appledouble",
    ".appledb",
    ".spotlight-v100",
    ".trashes",
    ".fseventsd",
    ".temporaryitems",
    ".directory",
    "$recycle.bin",
    "system volume information",
    "lost+found",
    ".@__thumb",
];

/// What follows a cloud's whole name and is not a copy's mark: `a.laz.md5`.
const BESIDE: [&str; 12] = [
    "md5sum",
    "sha1sum",
    "sha224",
    "sha256",
    "sha384",
    "sha512",
    "sha256sum",
    "sha512sum",
    "backup",
    "metadata",
    "properties",
    "geojson",
];

/// Whether a file or folder is none of ours and none of the user's either: what
/// macOS, Windows and network drives put beside everything.
pub fn is_junk(name: &str) -> bool {
    let lower = name.to_lowercase();
    JUNK.contains(&lower.as_str())
        || lower.ends_with(":zone.identifier")
        || lower.ends_with(":afp_afpinfo")
        || lower.ends_with("@synoeastream")
        || is_apple_double(&lower)
}

/// `._a.laz` is what macOS knows of `a.laz` besides its content. A copy of a
/// file `_a.laz` on its way, `._a.laz.Qx7GhZ`, is something else.
fn is_apple_double(lower: &str) -> bool {
    let Some(owner) = lower.strip_prefix("._") else { return false };
    !owner.is_empty() && !is_partial_cloud(owner)
}

/// Whether the name says that the file is not finished, or not meant for us.
pub fn is_partial(name: &str) -> bool {
    let lower = name.to_lowercase();
    PARTIAL.iter().any(|end| lower.ends_with(end))
        || PARTIAL_STARTS.iter().any(|start| lower.starts_with(start))
        || has_random_ending(&lower)
}

/// `a.laz.6eF38d5B`, as some tools that fetch from object stores name it.
fn has_random_ending(lower: &str) -> bool {
    let Some((cloud, end)) = lower.rsplit_once('.') else { return false };
    (cloud.ends_with(".las") || cloud.ends_with(".laz"))
        && (6..=12).contains(&end.len())
        && end.bytes().all(|b| b.is_ascii_alphanumeric())
        && !BESIDE.contains(&end)
}

/// Whether the name, without a partial ending, is that of a cloud: a folder
/// that holds such a file is not complete yet.
pub fn is_partial_cloud(name: &str) -> bool {
    let lower = name.to_lowercase();
    is_partial(name) && !is_junk(name) && (lower.contains(".las") || lower.contains(".laz"))
}

/// Whether a copy may have something of this name under way: a cloud by its
/// name, or a partial ending that tells nothing of what it is to become.
pub fn is_under_way(name: &str) -> bool {
    is_partial_cloud(name) || (is_partial(name) && !name.starts_with('.') && !is_junk(name))
}

/// Whether a name that tells nothing may be one under which some tool writes a cloud:
/// it is hidden, has no ending, or has a cloud's name in it. Copies that people keep
/// have their own.
pub fn may_be_temporary(name: &str) -> bool {
    let lower = name.to_lowercase();
    let kept = [".bak", ".backup", ".old", ".orig"].iter().any(|end| lower.ends_with(end));
    let of_a_cloud = lower.contains(".las") || lower.contains(".laz");
    !is_junk(name)
        && !is_cloud(name)
        && !kept
        && (of_a_cloud || lower.starts_with('.') || !lower.contains('.'))
}

/// Whether a hidden folder is one that copies keep their files in until they
/// are whole.
pub fn is_transfer_folder(name: &str) -> bool {
    let lower = name.to_lowercase();
    lower.starts_with('.') && TRANSFER_FOLDERS.iter().any(|word| lower.contains(word)) && !is_junk(name)
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
            "a.laz.6eF38d5B",
            "._a.laz.Qx7GhZ",
        ] {
            assert!(is_partial(name) && !is_cloud(name), "{name}");
            assert!(is_partial_cloud(name), "{name}");
        }
        for name in ["a.las", "A.LAZ", "größe und maß.Laz", "b.copc.laz", "part.las"] {
            assert!(is_cloud(name), "{name}");
        }
        for name in ["notes.txt", "las", "a.lasx", "a.laz.md5", "a.laz.sha256", "a.las.xml"] {
            assert!(!is_cloud(name) && !is_under_way(name), "{name}");
        }
        for name in ["a.las.bc!", ".goutputstream-X1Y2Z3", "part-a.las.xltd", "upload17", "a.laz.tmp.12345"] {
            assert!(may_be_temporary(name), "{name}");
        }
        for name in ["a.las", "a.laz.bak", "notes.txt", ".DS_Store", "._a.laz", "photo.jpg"] {
            assert!(!may_be_temporary(name), "{name}");
        }
        assert!(!is_cloud(".las"));
        assert!(is_under_way("upload.part") && !is_under_way(".sync.db"));
        assert!(is_transfer_folder(".~tmp~") && !is_transfer_folder(".git") && !is_transfer_folder("tmp"));
    }

    #[test]
    fn what_systems_leave_behind_is_nothing() {
        for name in [
            "._a.laz",
            "._.DS_Store",
            ".DS_Store",
            "Thumbs.db",
            "__MACOSX",
            "a.las:Zone.Identifier",
            "@eaDir",
            "a.las@SynoEAStream",
            "desktop.ini",
        ] {
            assert!(is_junk(name) && !is_cloud(name) && !is_under_way(name), "{name}");
        }
        for name in ["a.laz", "._a.laz.Qx7GhZ", ".a.laz.Qx7GhZ", "_.laz", "city", ".~tmp~"] {
            assert!(!is_junk(name), "{name}");
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
