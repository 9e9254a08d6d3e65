//! `/octrees/…`: the published octrees, read-only, with Range and CORS, as
//! viewers on other pages need them. Nothing outside of the folder, nothing whose
//! name begins with a dot, and no folder listings.

use axum::Router;
use axum::extract::Request;
use axum::http::{Method, StatusCode, header};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse, Response};
use tower_http::cors::{Any, CorsLayer};
use tower_http::services::ServeDir;

use super::{Shared, previews};
use crate::config::Config;

pub(super) fn router(config: &Config) -> Router<Shared> {
    let files = ServeDir::new(config.octrees()).append_index_html_on_directories(false);
    let cors = CorsLayer::new()
        .allow_origin(Any)
        .allow_methods([Method::GET, Method::HEAD])
        .allow_headers([header::RANGE, header::AUTHORIZATION])
        .expose_headers([header::CONTENT_RANGE, header::CONTENT_LENGTH, header::ACCEPT_RANGES]);
    Router::new()
        .nest_service("/octrees", files)
        .layer(from_fn(previews::keep))
        .layer(from_fn(no_dots))
        .layer(cors)
}

/// Staging lies behind a dot.
async fn no_dots(request: Request, next: Next) -> Response {
    let path = request.uri().path().to_ascii_lowercase();
    if path.contains("/.") || path.contains("%2e") || path.contains("%2f") {
        return StatusCode::NOT_FOUND.into_response();
    }
    next.run(request).await
}

/// Where an octree's metadata is served: the address that viewers are given.
pub(super) fn url(name: &str) -> String {
    folder(name) + "/metadata.json"
}

/// Where an octree's files are served.
pub(super) fn folder(name: &str) -> String {
    let mut url = String::from("/octrees/");
    for byte in name.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_' | b'~' | b'.' => url.push(byte as char),
            _ => url.push_str(&format!("%{byte:02X}")),
        }
    }
    url
}

#[cfg(test)]
mod tests {
    #[test]
    fn names_become_safe_addresses() {
        assert_eq!(super::url("größe 1"), "/octrees/gr%C3%B6%C3%9Fe%201/metadata.json");
        assert_eq!(super::url("a/../b?#"), "/octrees/a%2F..%2Fb%3F%23/metadata.json");
    }
}
