//! The clouds of the model: a few contents, light and heavy, good and bad, and
//! what a data set on disk holds.

use std::fs;
use std::path::Path;

use crate::daemon_support::las;

/// How a conversion of a content goes when nothing else is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Nature {
    Good,
    Hopeless,
    Panics,
}

/// Numbers of contents: below this they are good.
const GOOD: usize = 6;
pub const CONTENTS: usize = 11;
/// A copy whose middle is still missing: its headers say that it is whole.
pub const HOLLOW: usize = 10;
/// Two that are of one size.
pub const ALIKE: [usize; 2] = [2, 5];

pub fn bytes(content: usize) -> Vec<u8> {
    match content {
        // Cut: may become whole, so it waits for its patience to end.
        8 => las(3, 80)[..250].to_vec(),
        // Never a cloud.
        HOLLOW => {
            let mut bytes = las(60, 90);
            bytes[627..1_227].fill(0);
            bytes
        }
        9 => b"this is no cloud at all, whatever its name".to_vec(),
        // Heavy, by the model's configuration.
        _ if content % 3 == 2 => las(60, content as u64 + 1),
        _ => las(1 + content as u32, content as u64 + 1),
    }
}

/// What tells one data set's content from another's.
pub fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..16].to_string()
}

/// The nature of a data set, by the hashes of its files.
pub fn nature(hashes: &str) -> Nature {
    let known: Vec<String> = (0..CONTENTS).map(|content| hash(&bytes(content))).collect();
    let mut nature = Nature::Good;
    for file in hashes.split(',') {
        match known.iter().position(|hash| hash == file) {
            Some(content) if content < GOOD || content == HOLLOW => {}
            Some(7) => return Nature::Panics,
            _ => nature = Nature::Hopeless,
        }
    }
    nature
}

/// The hashes of a data set's files, in the order of their paths; nothing where
/// there is none.
pub fn on_disk(path: &Path) -> Option<String> {
    if path.is_file() {
        return Some(hash(&fs::read(path).ok()?));
    }
    let mut files: Vec<_> = fs::read_dir(path).ok()?.flatten().map(|entry| entry.path()).collect();
    let hidden = |file: &Path| file.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    files.retain(|file| file.extension().is_some_and(|end| end == "las") && !hidden(file));
    files.sort();
    let hashes: Vec<String> = files.iter().map(|file| hash(&fs::read(file).expect("readable"))).collect();
    (!hashes.is_empty()).then(|| hashes.join(","))
}
