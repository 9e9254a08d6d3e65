//! What every answer says to browsers: believe the content type, show us in no
//! frame, tell no other site our addresses, and run nothing that is not ours.

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;

/// For our pages. Whoever needs more sets its own.
const OF_PAGES: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; \
     connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'";
/// For data, which a browser may be led to as if it were a page.
const OF_DATA: &str =
    "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox";

pub(super) async fn add(request: Request, next: Next) -> Response {
    let mut answer = next.run(request).await;
    complete(answer.headers_mut());
    answer
}

fn complete(headers: &mut HeaderMap) {
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    // With `no-referrer` browsers would send forms with the origin `null`.
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("same-origin"));
    let is_page =
        headers.get(header::CONTENT_TYPE).is_some_and(|kind| kind.as_bytes().starts_with(b"text/html"));
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(if is_page {
        OF_PAGES
    } else {
        OF_DATA
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_and_data_get_their_policy() {
        let policy = |kind: Option<&'static str>| {
            let mut headers = HeaderMap::new();
            if let Some(kind) = kind {
                headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
            }
            complete(&mut headers);
            assert_eq!(headers[header::X_CONTENT_TYPE_OPTIONS], "nosniff");
            headers[header::CONTENT_SECURITY_POLICY].to_str().expect("text").to_string()
        };
        assert_eq!(policy(Some("text/html; charset=utf-8")), OF_PAGES);
        assert_eq!(policy(Some("application/json")), OF_DATA);
        assert_eq!(policy(None), OF_DATA);
        assert!(!OF_PAGES.contains("unsafe"));
        let mut own =
            HeaderMap::from_iter([(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static("x"))]);
        complete(&mut own);
        assert_eq!(own[header::CONTENT_SECURITY_POLICY], "x");
    }
}
