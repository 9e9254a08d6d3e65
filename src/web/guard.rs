//! Who may come in: with a token configured, whoever brings it; without one,
//! whoever reaches the address, but no web page of somebody else. A page that a
//! person has open may send requests to loopback, and must not control the queue.

use axum::extract::{Request, State as Extract};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::Shared;

pub(super) async fn guard(Extract(shared): Extract<Shared>, request: Request, next: Next) -> Response {
    if let Some(token) = &shared.config.token
        && !brings(request.headers(), token)
    {
        let challenge = [(header::WWW_AUTHENTICATE, "Bearer")];
        return (StatusCode::UNAUTHORIZED, challenge, "this needs `Authorization: Bearer <token>`\n")
            .into_response();
    }
    if request.method() == Method::POST && is_foreign(request.headers()) {
        return (StatusCode::FORBIDDEN, "orders from another site's page are refused\n").into_response();
    }
    if shared.config.listen.ip().is_loopback() && !names_loopback(request.headers()) {
        // A foreign name that was made to point here (DNS rebinding).
        return (StatusCode::FORBIDDEN, "this address is served under its own name only\n").into_response();
    }
    next.run(request).await
}

fn brings(headers: &HeaderMap, token: &str) -> bool {
    let value = headers.get(header::AUTHORIZATION).map(|value| value.as_bytes());
    let brought = value.and_then(|value| value.strip_prefix(b"Bearer "));
    // Hashes are compared, so that the time tells nothing of the token.
    brought.is_some_and(|brought| blake3::hash(brought) == blake3::hash(token.as_bytes()))
}

/// A browser names the page's origin; other programs send none.
fn is_foreign(headers: &HeaderMap) -> bool {
    let Some(origin) = headers.get(header::ORIGIN) else { return false };
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or("");
    origin.to_str().ok().and_then(|origin| origin.split_once("://")).is_none_or(|(_, from)| from != host)
}

fn names_loopback(headers: &HeaderMap) -> bool {
    let Some(host) = headers.get(header::HOST) else { return true };
    let host = host.to_str().unwrap_or("");
    let name = match host.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or(""),
        None => host.split(':').next().unwrap_or(""),
    };
    let is_loopback = name.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback());
    is_loopback || name.eq_ignore_ascii_case("localhost")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(header::HeaderName, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.clone(), value.parse().expect("a value"))).collect()
    }

    #[test]
    fn only_the_whole_token_opens() {
        for (value, opens) in [
            ("Bearer secret-token", true),
            ("Bearer secret-toke", false),
            ("Bearer ", false),
            ("secret-token", false),
            ("Basic secret-token", false),
        ] {
            assert_eq!(brings(&headers(&[(header::AUTHORIZATION, value)]), "secret-token"), opens, "{value}");
        }
        assert!(!brings(&HeaderMap::new(), "secret-token"));
    }

    #[test]
    fn pages_of_other_sites_are_foreign() {
        let host = (header::HOST, "127.0.0.1:7700");
        assert!(!is_foreign(&headers(std::slice::from_ref(&host))));
        assert!(!is_foreign(&headers(&[host.clone(), (header::ORIGIN, "http://127.0.0.1:7700")])));
        assert!(is_foreign(&headers(&[host.clone(), (header::ORIGIN, "https://evil.example")])));
        assert!(is_foreign(&headers(&[host, (header::ORIGIN, "null")])));
    }

    #[test]
    fn rebound_names_are_not_loopback() {
        for (host, fine) in [
            ("127.0.0.1:7700", true),
            ("localhost:7700", true),
            ("[::1]:7700", true),
            ("evil.example:7700", false),
            ("192.168.0.7", false),
        ] {
            assert_eq!(names_loopback(&headers(&[(header::HOST, host)])), fine, "{host}");
        }
    }
}
