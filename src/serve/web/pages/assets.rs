//! The page's own files: one stylesheet, a few modules of script, the icon. They
//! are part of the program; an address carries a hash of the content, so it may be
//! kept for ever and is never stale.

use std::sync::LazyLock;

use axum::extract::Path;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};

const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Name, media type, content.
const FILES: [(&str, &str, &str); 5] = [
    ("style.css", CSS, include_str!("assets/style.css")),
    ("page.js", SCRIPT, include_str!("assets/page.js")),
    ("live.js", SCRIPT, include_str!("assets/live.js")),
    ("upload.js", SCRIPT, include_str!("assets/upload.js")),
    ("icon.svg", "image/svg+xml", include_str!("assets/icon.svg")),
];

/// One stamp for all: modules name each other without one.
static STAMP: LazyLock<String> = LazyLock::new(|| {
    let mut hasher = blake3::Hasher::new();
    FILES.iter().for_each(|(_, _, content)| {
        hasher.update(content.as_bytes());
    });
    hasher.finalize().to_hex()[..16].to_string()
});

/// Where a file is served, below the page's base.
pub(super) fn url(base: &str, name: &str) -> String {
    format!("{base}/page/{}/{name}", *STAMP)
}

pub(super) async fn serve(Path((stamp, name)): Path<(String, String)>, headers: HeaderMap) -> Response {
    let Some((_, kind, content)) = FILES.iter().find(|(known, ..)| *known == name) else {
        return (StatusCode::NOT_FOUND, "the page has no such file\n").into_response();
    };
    let tag = format!("\"{}\"", *STAMP);
    let keep = if stamp == *STAMP { "public, max-age=31536000, immutable" } else { "no-cache" };
    let known = [(header::ETAG, tag.clone()), (header::CACHE_CONTROL, keep.to_string())];
    let has = headers.get(header::IF_NONE_MATCH).and_then(|value| value.to_str().ok());
    if has.is_some_and(|list| list.split(',').any(|one| one.trim().trim_start_matches("W/") == tag)) {
        return (StatusCode::NOT_MODIFIED, known).into_response();
    }
    (known, [(header::CONTENT_TYPE, *kind)], *content).into_response()
}

/// For browsers that ask before they have read the page.
pub(super) async fn icon() -> Response {
    let keep = [(header::CACHE_CONTROL, "public, max-age=86400"), (header::CONTENT_TYPE, "image/svg+xml")];
    (keep, include_str!("assets/icon.svg")).into_response()
}
