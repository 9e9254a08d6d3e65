//! The page's own files: one stylesheet, a few modules of script, the icon. They
//! are part of the program; an address carries a hash of the content, so it may be
//! kept for ever and is never stale.

use std::sync::LazyLock;

use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const SHADER: &str = "text/plain; charset=utf-8";

/// What a script may do that is a thread of its own: the viewer's fetches what it shows.
const OF_WORKERS: &str = "default-src 'none'; script-src 'self'; connect-src 'self'";

/// Name, media type, content. Modules and shaders name each other without a path.
const FILES: [(&str, &str, &str); 29] = [
    ("style.css", CSS, include_str!("assets/style.css")),
    ("page.js", SCRIPT, include_str!("assets/page.js")),
    ("live.js", SCRIPT, include_str!("assets/live.js")),
    ("upload.js", SCRIPT, include_str!("assets/upload.js")),
    ("icon.svg", "image/svg+xml", include_str!("assets/icon.svg")),
    ("viewer.css", CSS, include_str!("assets/viewer/viewer.css")),
    ("viewer.js", SCRIPT, include_str!("assets/viewer/viewer.js")),
    ("camera.js", SCRIPT, include_str!("assets/viewer/camera.js")),
    ("controls.js", SCRIPT, include_str!("assets/viewer/controls.js")),
    ("fallback.js", SCRIPT, include_str!("assets/viewer/fallback.js")),
    ("frame.js", SCRIPT, include_str!("assets/viewer/frame.js")),
    ("gpu.js", SCRIPT, include_str!("assets/viewer/gpu.js")),
    ("hierarchy.js", SCRIPT, include_str!("assets/viewer/hierarchy.js")),
    ("loader.js", SCRIPT, include_str!("assets/viewer/loader.js")),
    ("marks.js", SCRIPT, include_str!("assets/viewer/marks.js")),
    ("nodes.js", SCRIPT, include_str!("assets/viewer/nodes.js")),
    ("panel.js", SCRIPT, include_str!("assets/viewer/panel.js")),
    ("scene.js", SCRIPT, include_str!("assets/viewer/scene.js")),
    ("selection.js", SCRIPT, include_str!("assets/viewer/selection.js")),
    ("worker.js", SCRIPT, include_str!("assets/viewer/worker.js")),
    ("frame.wgsl", SHADER, include_str!("../../../../shaders/frame.wgsl")),
    ("clear.wgsl", SHADER, include_str!("../../../../shaders/clear.wgsl")),
    ("project.wgsl", SHADER, include_str!("../../../../shaders/project.wgsl")),
    ("depth.wgsl", SHADER, include_str!("../../../../shaders/depth.wgsl")),
    ("shade.wgsl", SHADER, include_str!("../../../../shaders/shade.wgsl")),
    ("resolve.wgsl", SHADER, include_str!("../../../../shaders/resolve.wgsl")),
    ("fill.wgsl", SHADER, include_str!("../../../../shaders/fill.wgsl")),
    ("light.wgsl", SHADER, include_str!("../../../../shaders/light.wgsl")),
    ("present.wgsl", SHADER, include_str!("../../../../shaders/present.wgsl")),
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
    let mut answer = (known, [(header::CONTENT_TYPE, *kind)], *content).into_response();
    if *kind == SCRIPT {
        answer.headers_mut().insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(OF_WORKERS));
    }
    answer
}

/// For browsers that ask before they have read the page.
pub(super) async fn icon() -> Response {
    let keep = [(header::CACHE_CONTROL, "public, max-age=86400"), (header::CONTENT_TYPE, "image/svg+xml")];
    (keep, include_str!("assets/icon.svg")).into_response()
}
