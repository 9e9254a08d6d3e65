//! What makes two jobs the same: the content of their inputs, in order, and the
//! options that change the octree's bytes. Not the names, not the times.

use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;

use super::{FileStamp, Found};
use crate::disk::others::{self, Links};
use crate::job::Input;
use crate::stage::options::Options;

/// Changes whenever the same input and options give other bytes than before.
const FORMAT: &str = "lodestone octree 1";

/// What is known of a data set after all its bytes were read once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fingerprint {
    pub content_key: String,
    pub inputs: Vec<Input>,
}

/// Reads all files of a data set. Nothing is returned where one changed
/// meanwhile: then it is not quiet, and the watcher will see that.
pub fn fingerprint(found: &Found, options: &Options) -> Option<Fingerprint> {
    let inputs: Option<Vec<Input>> = found.files.iter().map(input).collect();
    let inputs = inputs?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(FORMAT.as_bytes());
    // Field order makes the JSON of equal options equal.
    hasher.update(serde_json::to_string(options).unwrap_or_default().as_bytes());
    for input in &inputs {
        hasher.update(&input.size.to_le_bytes());
        hasher.update(input.hash.as_bytes());
        if input.hash.is_empty() {
            // Unreadable: alike only to itself.
            hasher.update(input.path.as_os_str().as_encoded_bytes());
            hasher.update(&input.mtime_ns.to_le_bytes());
        }
    }
    Some(Fingerprint { content_key: hasher.finalize().to_hex().to_string(), inputs })
}

fn input(file: &FileStamp) -> Option<Input> {
    let hash = match hash(file) {
        Ok(hash) => hash,
        // The conversion will fail on it and say why.
        Err(error) => {
            tracing::warn!(path = %file.path.display(), %error, "cannot be read");
            String::new()
        }
    };
    is_unchanged(file).then(|| Input {
        path: file.path.clone(),
        size: file.size,
        mtime_ns: file.mtime_ns,
        hash,
    })
}

fn hash(stamp: &FileStamp) -> io::Result<String> {
    let (file, _) = others::open_file(&stamp.path, Links::Refused)?;
    // What grows as fast as it is read has changed, and need not be read to its end.
    let mut file = file.take(stamp.size.saturating_add(1));
    let mut hasher = blake3::Hasher::new();
    let mut block = vec![0u8; 1 << 20];
    loop {
        match file.read(&mut block)? {
            0 => return Ok(hasher.finalize().to_hex().to_string()),
            read => hasher.update(&block[..read]),
        };
    }
}

fn is_unchanged(file: &FileStamp) -> bool {
    others::look_at(&file.path, Links::Refused).is_ok_and(|meta| {
        let mtime_ns = meta.mtime().saturating_mul(1_000_000_000).saturating_add(meta.mtime_nsec());
        meta.is_file() && meta.len() == file.size && mtime_ns == file.mtime_ns
    })
}

/// How an input differs from what it was when it was taken, where it does.
pub fn difference(input: &Input) -> Option<Difference> {
    if !input.path.exists() {
        return Some(Difference::Missing);
    }
    let then = FileStamp { path: input.path.clone(), size: input.size, mtime_ns: input.mtime_ns };
    (!is_unchanged(&then)).then_some(Difference::Changed)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Difference {
    Missing,
    Changed,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::options::Sampling;
    use std::path::Path;

    fn found(folder: &Path, files: &[(&str, &[u8])]) -> Found {
        let files = files
            .iter()
            .map(|(name, bytes)| {
                let path = folder.join(name);
                std::fs::write(&path, bytes).expect("written");
                let meta = std::fs::metadata(&path).expect("there");
                let mtime_ns = meta.mtime() * 1_000_000_000 + meta.mtime_nsec();
                FileStamp { path, size: meta.len(), mtime_ns }
            })
            .collect();
        let (path, name, stamp) = (folder.to_path_buf(), String::new(), String::new());
        Found { path, is_folder: true, name, files, stamp, marker: None, points: 0 }
    }

    #[test]
    fn content_and_options_make_the_key_and_names_do_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let key = |files: &[(&str, &[u8])], options: &Options| {
            fingerprint(&found(folder.path(), files), options).expect("quiet").content_key
        };
        let plain = Options::default();
        let random = Options { sampling: Sampling::Random, ..Options::default() };
        let one = key(&[("a", b"12"), ("b", b"3")], &plain);
        assert_eq!(one, key(&[("c", b"12"), ("d", b"3")], &plain));
        assert_ne!(one, key(&[("a", b"1"), ("b", b"23")], &plain), "the border between files counts");
        assert_ne!(one, key(&[("a", b"3"), ("b", b"12")], &plain), "so does their order");
        assert_ne!(one, key(&[("a", b"12"), ("b", b"3")], &random));
    }

    #[test]
    fn a_file_that_changed_meanwhile_is_not_taken() {
        let folder = tempfile::tempdir().expect("a folder");
        let data_set = found(folder.path(), &[("a", b"12")]);
        std::fs::write(folder.path().join("a"), b"123").expect("written");
        assert_eq!(fingerprint(&data_set, &Options::default()), None);
    }
}
