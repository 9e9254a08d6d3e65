//! `/octrees/…`: the published octrees, read-only, with Range and CORS, as
//! viewers on other pages need them. Nothing outside of the folder, nothing whose
//! name begins with a dot, and no folder listings. Where a token is needed, a viewer
//! that cannot send one is given a link to one octree, see `pages::share`.

use std::time::Duration;

use axum::Router;
use axum::extract::{Path, RawQuery, State as Extract};
use axum::http::{HeaderMap, HeaderValue, Method, header};
use axum::response::Response;
use axum::routing::get;
use tower_http::cors::{Any, CorsLayer};

use super::shared::AppState;
use super::{files, previews};
use crate::serve::job::Job;

/// For copies that may be kept and are asked for again each time: a name may stand
/// for another octree tomorrow.
const ASK_AGAIN: HeaderValue = HeaderValue::from_static("no-cache");
const ASK_AGAIN_ALONE: HeaderValue = HeaderValue::from_static("private, no-cache");

pub(super) fn router() -> Router<AppState> {
    Router::new().route("/octrees/{*path}", get(serve))
}

async fn serve(
    Extract(shared): Extract<AppState>,
    Path(path): Path<String>,
    RawQuery(query): RawQuery,
    asked: HeaderMap,
) -> Response {
    let Some(file) = files::below(&shared.config.octrees(), &path) else { return files::missing() };
    let cache = if previews::is_of_pictures(&path) {
        previews::cache(query.as_deref())
    } else if shared.config.access.token.is_some() {
        ASK_AGAIN_ALONE
    } else {
        ASK_AGAIN
    };
    files::answer(&file, &asked, cache).await
}

/// What viewers on other pages need; around the guard, so that they can read why
/// they are refused, and need no token to ask what they may send.
pub(super) fn cors() -> CorsLayer {
    CorsLayer::new()
        .allow_origin(Any)
        .allow_methods([Method::GET, Method::HEAD])
        // Loaders of Potree and potree-core send a content type with their ranges.
        .allow_headers([
            header::RANGE,
            header::AUTHORIZATION,
            header::CONTENT_TYPE,
            header::ACCEPT,
            header::CACHE_CONTROL,
            header::PRAGMA,
            header::IF_MATCH,
            header::IF_NONE_MATCH,
            header::IF_MODIFIED_SINCE,
            header::IF_RANGE,
        ])
        .expose_headers([header::CONTENT_RANGE, header::CONTENT_LENGTH, header::ACCEPT_RANGES, header::ETAG])
        // Browsers ask before a page of the internet reads from a private network.
        .allow_private_network(true)
        .max_age(Duration::from_secs(7200))
}

/// What a job made, as its report says.
pub(super) struct JobOutputs {
    /// Whether an octree is there.
    pub octree: bool,
    /// The name of the COPC file, where there is one.
    pub copc: Option<String>,
}

impl JobOutputs {
    pub fn of(job: &Job) -> JobOutputs {
        let copc = job.result.as_ref().map(|report| &report["copc"]);
        let file = copc.and_then(|copc| copc["file"].as_str()).map(str::to_string);
        let alone = copc.is_some_and(|copc| copc["alone"] == true);
        JobOutputs { octree: !alone, copc: file }
    }

    /// The file that a viewer is told of, as a part of an address.
    pub fn entry(&self) -> String {
        match &self.copc {
            Some(file) if !self.octree => encoded_part(file),
            _ => "metadata.json".to_string(),
        }
    }
}

/// Where an octree's files are served; `base` is in front of every path of ours.
pub(super) fn folder(base: &str, name: &str) -> String {
    format!("{base}/octrees/{}", encoded_part(name))
}

/// A name as a part of a path.
pub(super) fn encoded_part(name: &str) -> String {
    encoded(name).replace('/', "%2F")
}

/// A path as the value of a query.
pub(super) fn encoded(path: &str) -> String {
    let mut text = String::new();
    for byte in path.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_' | b'~' | b'.' | b'/' => {
                text.push(byte as char)
            }
            _ => text.push_str(&format!("%{byte:02X}")),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_safe_addresses() {
        assert_eq!(folder("", "größe 1"), "/octrees/gr%C3%B6%C3%9Fe%201");
        assert_eq!(folder("/base", "a/../b?#"), "/base/octrees/a%2F..%2Fb%3F%23");
    }

    #[test]
    fn viewers_are_told_of_the_octree_before_copc() {
        let copc = Some("a b.copc.laz".to_string());
        for (octree, copc, entry) in [
            (true, None, "metadata.json"),
            (true, copc.clone(), "metadata.json"),
            (false, copc, "a%20b.copc.laz"),
        ] {
            assert_eq!(JobOutputs { octree, copc }.entry(), entry);
        }
    }
}
