//! One file of an octree as an answer, with ranges and conditions as RFC 9110 has
//! them. The tag is of the very file that is open: an octree that replaces another
//! has files of its own, so a browser's copy is never taken for the new one, and
//! ranges of the two are never mixed.

use std::io::SeekFrom;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use rustix::fs::OFlags;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;

use super::refusal::ApiError;

/// Read at a time.
const BLOCK: usize = 64 * 1024;

/// What part of a file is asked for.
#[derive(Debug, PartialEq, Eq)]
enum RequestedPart {
    Whole,
    /// From the first byte to the last, both included.
    Range(u64, u64),
    /// No byte of the range is in the file.
    Outside,
}

/// The path below `root` that a decoded address means; none where it is no address
/// of ours: nothing leads out of the folder, and what begins with a dot is not served.
pub(super) fn below(root: &Path, address: &str) -> Option<PathBuf> {
    let mut path = root.to_path_buf();
    for part in address.split('/') {
        if part.is_empty() || part.starts_with('.') || part.contains('\0') {
            return None;
        }
        path.push(part);
    }
    Some(path)
}

/// Answers a request for a file; `cache` is what its copies are good for.
pub(super) async fn answer(path: &Path, asked: &HeaderMap, cache: HeaderValue) -> Response {
    let mut options = std::fs::OpenOptions::new();
    // A pipe would otherwise be waited for.
    options.read(true).custom_flags(OFlags::NONBLOCK.bits() as i32);
    let opened = tokio::fs::OpenOptions::from(options).open(path).await;
    let Ok(file) = opened else { return missing() };
    let Ok(metadata) = file.metadata().await else { return missing() };
    if !metadata.is_file() {
        return missing();
    }
    let size = metadata.len();
    let time = i128::from(metadata.mtime()) * 1_000_000_000 + i128::from(metadata.mtime_nsec());
    let tag = format!("\"{:x}-{size:x}-{time:x}\"", metadata.ino());
    let mut headers = HeaderMap::new();
    headers.insert(header::CACHE_CONTROL, cache);
    headers.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    if let Ok(tag) = HeaderValue::from_str(&tag) {
        headers.insert(header::ETAG, tag);
    }
    if let Some(status) = condition(asked, &tag) {
        return (status, headers).into_response();
    }
    let (status, first, length) = match part(asked, &tag, size) {
        RequestedPart::Whole => (StatusCode::OK, 0, size),
        RequestedPart::Range(first, last) => {
            headers.insert(header::CONTENT_RANGE, number(format!("bytes {first}-{last}/{size}")));
            (StatusCode::PARTIAL_CONTENT, first, last - first + 1)
        }
        RequestedPart::Outside => {
            headers.insert(header::CONTENT_RANGE, number(format!("bytes */{size}")));
            return (StatusCode::RANGE_NOT_SATISFIABLE, headers).into_response();
        }
    };
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type(path)));
    headers.insert(header::CONTENT_LENGTH, HeaderValue::from(length));
    let mut file = file;
    if first > 0 && file.seek(SeekFrom::Start(first)).await.is_err() {
        return ApiError::new(StatusCode::INTERNAL_SERVER_ERROR, "the file cannot be read").into_response();
    }
    let body = Body::from_stream(ReaderStream::with_capacity(file.take(length), BLOCK));
    (status, headers, body).into_response()
}

pub(super) fn missing() -> Response {
    ApiError::new(StatusCode::NOT_FOUND, "there is no such file").into_response()
}

fn number(text: String) -> HeaderValue {
    HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static(""))
}

fn media_type(path: &Path) -> &'static str {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("json") => "application/json",
        Some("vpc") => "application/geo+json",
        Some("png") => "image/png",
        Some("webp") => "image/webp",
        Some("mp4") => "video/mp4",
        _ => "application/octet-stream",
    }
}

/// The answer that the request's conditions ask for instead of the file.
fn condition(asked: &HeaderMap, tag: &str) -> Option<StatusCode> {
    let lists = |name| asked.get_all(name).iter().filter_map(|value| value.to_str().ok());
    if asked.contains_key(header::IF_MATCH) {
        let strong = lists(header::IF_MATCH).any(|list| has(list, tag, false));
        if !strong {
            return Some(StatusCode::PRECONDITION_FAILED);
        }
    }
    let known = lists(header::IF_NONE_MATCH).any(|list| has(list, tag, true));
    known.then_some(StatusCode::NOT_MODIFIED)
}

/// Whether a list of tags has this one; with `weak` also as a weak one.
fn has(list: &str, tag: &str, weak: bool) -> bool {
    list.split(',').map(str::trim).any(|one| {
        let one = if weak { one.strip_prefix("W/").unwrap_or(one) } else { one };
        one == tag || one == "*"
    })
}

fn part(asked: &HeaderMap, tag: &str, size: u64) -> RequestedPart {
    let Some(range) = asked.get(header::RANGE).and_then(|range| range.to_str().ok()) else {
        return RequestedPart::Whole;
    };
    // A date says too little, and another tag means other bytes.
    if asked.get(header::IF_RANGE).is_some_and(|known| known != tag) {
        return RequestedPart::Whole;
    }
    ranged(range, size)
}

/// A range of bytes. Several at once, and what is no range, are answered with the
/// whole, as the standard allows.
fn ranged(range: &str, size: u64) -> RequestedPart {
    let Some((unit, range)) = range.split_once('=') else { return RequestedPart::Whole };
    if !unit.trim().eq_ignore_ascii_case("bytes") || range.contains(',') {
        return RequestedPart::Whole;
    }
    let Some((first, last)) = range.trim().split_once('-') else { return RequestedPart::Whole };
    let (first, last) = (first.trim(), last.trim());
    let count = |digits: &str| {
        let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
        // A number that is too large is beyond every file.
        is_number.then(|| digits.parse().unwrap_or(u64::MAX))
    };
    match (count(first), count(last)) {
        (Some(first), _) if last.is_empty() => within(first, u64::MAX, size),
        (Some(first), Some(last)) if first <= last => within(first, last, size),
        (None, Some(suffix)) if first.is_empty() => match suffix {
            0 => RequestedPart::Outside,
            // One that is longer than the file is the whole of it.
            suffix => within(size.saturating_sub(suffix), u64::MAX, size),
        },
        _ => RequestedPart::Whole,
    }
}

fn within(first: u64, last: u64, size: u64) -> RequestedPart {
    if first >= size { RequestedPart::Outside } else { RequestedPart::Range(first, last.min(size - 1)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(header::HeaderName, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.clone(), value.parse().expect("a value"))).collect()
    }

    #[test]
    fn ranges_are_understood_as_the_standard_has_them() {
        for (range, part) in [
            ("bytes=0-0", RequestedPart::Range(0, 0)),
            ("bytes=10-29", RequestedPart::Range(10, 29)),
            ("bytes=90-200", RequestedPart::Range(90, 99)),
            ("bytes=90-", RequestedPart::Range(90, 99)),
            ("BYTES = 90-", RequestedPart::Range(90, 99)),
            ("bytes=-16", RequestedPart::Range(84, 99)),
            ("bytes=-100", RequestedPart::Range(0, 99)),
            ("bytes=-999999999", RequestedPart::Range(0, 99)),
            ("bytes=-99999999999999999999999", RequestedPart::Range(0, 99)),
            ("bytes=100-", RequestedPart::Outside),
            ("bytes=99999999999999999999999-", RequestedPart::Outside),
            ("bytes=-0", RequestedPart::Outside),
            ("bytes=20-10", RequestedPart::Whole),
            ("bytes=0-1,4-5", RequestedPart::Whole),
            ("bytes=a-b", RequestedPart::Whole),
            ("bytes=-", RequestedPart::Whole),
            ("bytes=+1-2", RequestedPart::Whole),
            ("lines=0-1", RequestedPart::Whole),
            ("bytes", RequestedPart::Whole),
        ] {
            assert_eq!(ranged(range, 100), part, "{range}");
        }
        assert_eq!(ranged("bytes=0-", 0), RequestedPart::Outside);
        assert_eq!(ranged("bytes=-5", 0), RequestedPart::Outside);
    }

    #[test]
    fn a_range_of_another_octree_is_answered_with_the_whole() {
        let of = |condition: &str| {
            part(&headers(&[(header::RANGE, "bytes=0-15"), (header::IF_RANGE, condition)]), "\"a\"", 100)
        };
        assert_eq!(of("\"a\""), RequestedPart::Range(0, 15));
        for other in ["\"b\"", "W/\"a\"", "Wed, 21 Oct 2015 07:28:00 GMT"] {
            assert_eq!(of(other), RequestedPart::Whole, "{other}");
        }
    }

    #[test]
    fn tags_are_known_again_in_any_list() {
        let of = |name: header::HeaderName, list: &str| condition(&headers(&[(name, list)]), "\"a\"");
        for (list, status) in [
            ("\"a\"", Some(StatusCode::NOT_MODIFIED)),
            ("\"b\", W/\"a\"", Some(StatusCode::NOT_MODIFIED)),
            ("*", Some(StatusCode::NOT_MODIFIED)),
            ("\"ab\"", None),
        ] {
            assert_eq!(of(header::IF_NONE_MATCH, list), status, "{list}");
        }
        for (list, status) in [
            ("\"a\"", None),
            ("*", None),
            ("W/\"a\"", Some(StatusCode::PRECONDITION_FAILED)),
            ("\"b\"", Some(StatusCode::PRECONDITION_FAILED)),
        ] {
            assert_eq!(of(header::IF_MATCH, list), status, "{list}");
        }
    }

    #[test]
    fn nothing_leads_out_of_the_folder() {
        let root = Path::new("/o");
        assert_eq!(below(root, "a b/octree.bin"), Some(PathBuf::from("/o/a b/octree.bin")));
        for out in ["", "/", "a//b", "../x", "a/../../x", ".staged/1", "a/.hid", "a/", "/etc/passwd", "a/b\0"]
        {
            assert_eq!(below(root, out), None, "{out}");
        }
    }

    #[tokio::test]
    async fn pipes_and_folders_are_no_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = folder.path().join("pipe");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR).expect("a pipe");
        for path in [pipe.as_path(), folder.path(), &folder.path().join("none")] {
            let cache = HeaderValue::from_static("no-cache");
            let answer = answer(path, &HeaderMap::new(), cache).await;
            assert_eq!(answer.status(), StatusCode::NOT_FOUND, "{}", path.display());
        }
    }
}
