//! `/octrees/…`: the published octrees, read-only, with Range and CORS, as
//! viewers on other pages need them. Nothing outside of the folder, nothing whose
//! name begins with a dot, and no folder listings. Where a token is needed, each has
//! an address with a key of its own too, `/shared/<key>/<octree>/…`: Potree cannot
//! send a header, and finds an octree's other files by a path beside the metadata,
//! so that no query would reach them.

use std::time::Duration;

use axum::Router;
use axum::extract::{Path, RawQuery, State as Extract};
use axum::http::{HeaderMap, HeaderValue, Method, header};
use axum::response::Response;
use axum::routing::get;
use tower_http::cors::{Any, CorsLayer};

use super::{Shared, files, previews, session};
use crate::config::access::Access;
use crate::job::Job;
use crate::stage::formats::Formats;

/// For copies that may be kept and are asked for again each time: a name may stand
/// for another octree tomorrow.
const ASK_AGAIN: HeaderValue = HeaderValue::from_static("no-cache");
const ASK_AGAIN_ALONE: HeaderValue = HeaderValue::from_static("private, no-cache");

/// Octrees under their names, and each under a read-only address of its own.
pub(super) fn router() -> Router<Shared> {
    Router::new().route("/octrees/{*path}", get(by_name)).route("/shared/{key}/{*path}", get(by_key))
}

async fn by_name(
    Extract(shared): Extract<Shared>,
    Path(path): Path<String>,
    RawQuery(query): RawQuery,
    asked: HeaderMap,
) -> Response {
    serve(&shared, &path, query.as_deref(), &asked).await
}

async fn by_key(
    Extract(shared): Extract<Shared>,
    Path((_, path)): Path<(String, String)>,
    RawQuery(query): RawQuery,
    asked: HeaderMap,
) -> Response {
    serve(&shared, &path, query.as_deref(), &asked).await
}

async fn serve(shared: &Shared, path: &str, query: Option<&str>, asked: &HeaderMap) -> Response {
    let Some(file) = files::below(&shared.config.octrees(), path) else { return files::missing() };
    let cache = if previews::is_of_pictures(path) {
        previews::cache(query)
    } else if shared.config.access.token.is_some() {
        ASK_AGAIN_ALONE
    } else {
        ASK_AGAIN
    };
    files::answer(&file, asked, cache).await
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
pub(super) struct Made {
    /// Whether an octree is there.
    pub octree: bool,
    /// The name of the COPC file, where there is one.
    pub copc: Option<String>,
}

impl Made {
    pub fn of(job: &Job) -> Made {
        let report = job.result.as_ref();
        let file = report.and_then(|report| report["copc"]["file"].as_str());
        // Lists have reports and no options.
        let formats = report.and_then(|report| report["options"].get("format"));
        let formats = formats.cloned().map(serde_json::from_value::<Formats>);
        let formats = formats.and_then(Result::ok).unwrap_or_default();
        Made { octree: formats.potree, copc: file.map(str::to_string) }
    }

    /// The file that a viewer is told of.
    fn entry(&self) -> &str {
        match &self.copc {
            Some(file) if !self.octree => file,
            _ => "metadata.json",
        }
    }
}

/// The read-only address of what a job made, where a token is needed at all.
pub(super) fn shared_url(access: &Access, name: &str, made: &Made) -> Option<String> {
    let key = session::share_key(name, access)?;
    let entry = encoded_part(made.entry());
    Some(format!("{}/shared/{key}/{}/{entry}", access.base(), encoded_part(name)))
}

/// Whether a path lies under the read-only address of an octree.
pub(super) fn is_shared(path: &str, access: &Access) -> bool {
    let Some((key, rest)) = path.strip_prefix("/shared/").and_then(|rest| rest.split_once('/')) else {
        return false;
    };
    let name = rest.split('/').next().unwrap_or("");
    decoded(name).is_some_and(|name| session::opens(key, &name, access))
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

/// A part of a path as the name that it stands for.
fn decoded(part: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(part.len());
    let mut rest = part.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let digit = |byte: Option<u8>| byte.and_then(|byte| (byte as char).to_digit(16));
        let (high, low) = (digit(rest.next())?, digit(rest.next())?);
        bytes.push((high * 16 + low) as u8);
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_safe_addresses() {
        assert_eq!(folder("", "größe 1"), "/octrees/gr%C3%B6%C3%9Fe%201");
        assert_eq!(folder("/base", "a/../b?#"), "/base/octrees/a%2F..%2Fb%3F%23");
    }

    const OCTREE: Made = Made { octree: true, copc: None };

    #[test]
    fn a_copc_file_has_a_read_only_address_where_it_is_alone() {
        let access = Access { token: Some("a great secret".to_string()), ..Access::default() };
        let copc = |octree| Made { octree, copc: Some("a b.copc.laz".to_string()) };
        let url = |made: &Made| shared_url(&access, "a b", made).expect("an address");
        assert!(url(&copc(false)).ends_with("/a%20b/a%20b.copc.laz"), "{}", url(&copc(false)));
        assert!(url(&copc(true)).ends_with("/a%20b/metadata.json"));
        assert!(is_shared(&url(&copc(false)), &access));
    }

    #[test]
    fn read_only_addresses_open_their_octree_alone() {
        let access = Access { token: Some("a great secret".to_string()), ..Access::default() };
        let url = shared_url(&access, "größe 1", &OCTREE).expect("an address");
        assert!(is_shared(&url, &access), "{url}");
        assert!(is_shared(&url.replace("metadata.json", "octree.bin"), &access));
        for other in [
            url.replace("gr%C3", "or%C3"),
            url.replace("/shared/", "/shared/0"),
            url.replace("/shared/", "/octrees/"),
            "/shared/".to_string(),
            "/shared/x".to_string(),
            "/shared/x/%zz/metadata.json".to_string(),
        ] {
            assert!(!is_shared(&other, &access), "{other}");
        }
        assert_eq!(shared_url(&Access::default(), "a", &OCTREE), None);
    }
}
