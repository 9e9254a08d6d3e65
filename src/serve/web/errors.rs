//! Every error of the API is JSON with the one key `error`, whoever refused the
//! request: a handler, the router (404, 405), a limit (408, 413), an extractor (400,
//! 422) or the guard. Done in one place, from what they answer in plain text.

use axum::Json;
use axum::body::to_bytes;
use axum::extract::Request;
use axum::http::{Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde_json::json;

/// Bytes of a refusal's text; none of ours is longer.
const LONGEST: usize = 64 << 10;

/// The outermost layer of all routes.
pub(super) async fn as_json(request: Request, next: Next) -> Response {
    let path = request.uri().path().to_string();
    let method = request.method().clone();
    let answer = next.run(request).await;
    let status = answer.status();
    let is_api = path == "/api" || path.starts_with("/api/");
    if !is_api || !(status.is_client_error() || status.is_server_error()) || is_json(&answer) {
        return answer;
    }
    let (mut parts, body) = answer.into_parts();
    let text = to_bytes(body, LONGEST).await.unwrap_or_default();
    let text = match String::from_utf8_lossy(&text).trim() {
        // The limit's own words do not say of what.
        _ if status == StatusCode::PAYLOAD_TOO_LARGE => explain(status, &method, &path),
        "" => explain(status, &method, &path),
        text => text.to_string(),
    };
    parts.headers.remove(header::CONTENT_TYPE);
    parts.headers.remove(header::CONTENT_LENGTH);
    let mut answer = (status, Json(json!({ "error": text }))).into_response();
    // A challenge, `Allow`, `Retry-After`, and what browsers of other origins need.
    answer.headers_mut().extend(parts.headers);
    answer
}

fn is_json(answer: &Response) -> bool {
    answer
        .headers()
        .get(header::CONTENT_TYPE)
        .is_some_and(|kind| kind.as_bytes().starts_with(b"application/json"))
}

/// What is said of a refusal that came without words.
fn explain(status: StatusCode, method: &Method, path: &str) -> String {
    match status {
        StatusCode::NOT_FOUND => {
            format!("there is nothing at {path}; see /api/openapi.json for the addresses of the API")
        }
        StatusCode::METHOD_NOT_ALLOWED => {
            format!("{path} does not take {method}; the header `Allow` names what it takes")
        }
        StatusCode::REQUEST_TIMEOUT => "the request took too long; try again later".to_string(),
        StatusCode::PAYLOAD_TOO_LARGE => "the request's body is too large".to_string(),
        status => status.to_string(),
    }
}
