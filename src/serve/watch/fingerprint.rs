//! What makes two jobs the same: the content of their inputs, in order, and the
//! options that change the octree's bytes. Not the names, not the times.

use std::io::{self, Read};

use super::file_stamp::FileStamp;
use super::found::FoundDataSet;
use super::settle::NotYet;
use super::waiting::WaitingKind;
use super::zeros::ZeroRun;
use crate::convert::options::Options;
use crate::format::las::Layout;
use crate::platform::disk::others::{self, Links};
use crate::serve::job::QueuedFile;

/// Changes whenever the same input and options give other bytes than before.
const FORMAT: &str = "lodestone octree 1";

/// What is known of a data set after all its bytes were read once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fingerprint {
    pub content_key: String,
    pub inputs: Vec<QueuedFile>,
    /// Why it may not be whole, though its headers say so.
    pub hollow: Option<NotYet>,
}

/// Reads all files of a data set. Nothing is returned where one changed
/// meanwhile: then it is not quiet, and the watcher will see that.
pub fn fingerprint(found: &FoundDataSet, options: &Options) -> Option<Fingerprint> {
    let read: Option<Vec<(QueuedFile, Option<NotYet>)>> = found.files.iter().map(input).collect();
    let (inputs, gaps): (Vec<QueuedFile>, Vec<Option<NotYet>>) = read?.into_iter().unzip();
    let mut hasher = blake3::Hasher::new();
    hasher.update(FORMAT.as_bytes());
    // Field order makes the JSON of equal options equal.
    hasher.update(serde_json::to_string(options).unwrap_or_default().as_bytes());
    if let Some(refusal) = &found.refusal {
        hasher.update(refusal.as_bytes());
    }
    for input in &inputs {
        hasher.update(&input.size.to_le_bytes());
        hasher.update(input.hash.as_bytes());
        if input.hash.is_empty() {
            // Unreadable: alike only to itself.
            hasher.update(input.path.as_os_str().as_encoded_bytes());
            hasher.update(&input.mtime_ns.to_le_bytes());
        }
    }
    let hollow = gaps.into_iter().flatten().next();
    Some(Fingerprint { content_key: hasher.finalize().to_hex().to_string(), inputs, hollow })
}

fn input(file: &FileStamp) -> Option<(QueuedFile, Option<NotYet>)> {
    let (hash, gap) = match hash(file) {
        Ok(read) => read,
        // The conversion will fail on it and say why.
        Err(error) => {
            tracing::warn!(path = %file.path.display(), %error, "cannot be read");
            (String::new(), None)
        }
    };
    let input = QueuedFile {
        path: file.path.clone(),
        size: file.size,
        mtime_ns: file.mtime_ns,
        hash,
        inode: file.inode,
        ctime_ns: file.ctime_ns,
    };
    is_unchanged(&input).then_some((input, gap))
}

/// Reads a file once: for its hash, and for points that are nothing but zeros.
fn hash(stamp: &FileStamp) -> io::Result<(String, Option<NotYet>)> {
    let (file, _) = others::open_file(&stamp.path, Links::Refused)?;
    let mut zeros = Layout::read(&file).map(|layout| ZeroRun::new(layout, stamp.size));
    // What grows as fast as it is read has changed, and need not be read to its end.
    let mut file = file.take(stamp.size.saturating_add(1));
    let mut hasher = blake3::Hasher::new();
    let mut block = vec![0u8; 1 << 20];
    loop {
        let read = fill(&mut file, &mut block)?;
        if read == 0 {
            break;
        }
        hasher.update(&block[..read]);
        if let Some(zeros) = &mut zeros {
            zeros.feed(&block[..read]);
        }
    }
    let gap = zeros.and_then(|zeros| zeros.found()).map(|run| {
        NotYet::new(
            WaitingKind::Zeros,
            format!(
                "{} has nothing but zeros where points should be, from byte {} to {}, as of a copy that goes on",
                stamp.path.display(),
                run.start,
                run.end
            ),
        )
    });
    Ok((hasher.finalize().to_hex().to_string(), gap))
}

/// Reads a whole block, or what is left.
fn fill(file: &mut impl Read, block: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < block.len() {
        match file.read(&mut block[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}

fn is_unchanged(then: &QueuedFile) -> bool {
    others::look_at(&then.path, Links::Refused).is_ok_and(|meta| {
        let now = FileStamp::new(&then.path, &meta);
        meta.is_file() && then.is(now.size, now.mtime_ns, now.inode, now.ctime_ns)
    })
}

/// How an input differs from what it was when it was taken, where it does.
pub fn difference(input: &QueuedFile) -> Option<SourceChange> {
    if !input.path.exists() {
        return Some(SourceChange::Missing);
    }
    (!is_unchanged(input)).then_some(SourceChange::Changed)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SourceChange {
    Missing,
    Changed,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::options::Sampling;
    use std::path::Path;

    fn found(folder: &Path, files: &[(&str, &[u8])]) -> FoundDataSet {
        let files = files
            .iter()
            .map(|(name, bytes)| {
                let path = folder.join(name);
                std::fs::write(&path, bytes).expect("written");
                FileStamp::new(&path, &std::fs::metadata(&path).expect("there"))
            })
            .collect();
        let (path, name, stamp) = (folder.to_path_buf(), String::new(), String::new());
        FoundDataSet {
            path,
            is_folder: true,
            name,
            files,
            stamp,
            marker: None,
            points: 0,
            doubt: None,
            refusal: None,
        }
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
