//! Who may come in: with a token configured, whoever brings it; without one,
//! whoever reaches the address, but no web page of somebody else. A page that a
//! person has open may send requests to loopback, or have its own name point
//! there, and must not control the queue.

use std::net::IpAddr;

use axum::extract::{Request, State as Extract};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Redirect, Response};

use super::refusal::ApiError;
use super::session::RequestIdentity;
use super::shared::AppState;
use super::{octrees, pages};
use crate::serve::config::Config;
use crate::serve::config::access::{host_of, is_loopback};

/// Lets requests in that no foreign page can have caused: the name under which we
/// are asked is one of ours, and what changes something comes from a page of ours or
/// from no page. Notes who asks among the request's extensions.
pub(super) async fn site(Extract(shared): Extract<AppState>, mut request: Request, next: Next) -> Response {
    let config = &shared.config;
    let identity = RequestIdentity::of(request.headers(), &config.access, shared.clock.now());
    // Who knows the token was not tricked into asking.
    if !matches!(identity, RequestIdentity::Token(_)) && !is_our_name(request.headers(), config) {
        let host = request.headers().get(header::HOST).map(|host| String::from_utf8_lossy(host.as_bytes()));
        let text = format!(
            "the daemon is not served under the name {:?}; its setting `allowed_hosts` lists names that it answers to",
            host.unwrap_or_default()
        );
        return ApiError::new(StatusCode::FORBIDDEN, text).into_response();
    }
    if !is_safe(request.method())
        && let Err(refusal) = check_origin(request.headers(), config)
    {
        return refusal.into_response();
    }
    request.extensions_mut().insert(identity);
    next.run(request).await
}

/// Lets in who may read, or, where something changes, operate; and notes the role
/// among the request's extensions.
pub(super) async fn guard(Extract(shared): Extract<AppState>, mut request: Request, next: Next) -> Response {
    let identity = request.extensions().get::<RequestIdentity>().copied().unwrap_or(RequestIdentity::Nobody);
    let Some(role) = identity.role() else { return unknown(&shared, &request) };
    if !is_safe(request.method()) && !role.may_operate() {
        let text = "the read token allows to look, not to give orders";
        return ApiError::new(StatusCode::FORBIDDEN, text).into_response();
    }
    request.extensions_mut().insert(role);
    next.run(request).await
}

/// For what a page of somebody else must not even read in the background, as
/// event streams, of which there are few.
pub(super) async fn own_pages(Extract(shared): Extract<AppState>, request: Request, next: Next) -> Response {
    match check_origin(request.headers(), &shared.config) {
        Ok(()) => next.run(request).await,
        Err(refusal) => refusal.into_response(),
    }
}

/// A person is asked for the token, a program is told.
fn unknown(shared: &AppState, request: &Request) -> Response {
    let path = request.uri().path();
    let is_person = accepts_html(request.headers())
        && matches!(*request.method(), Method::GET | Method::HEAD)
        && !path.starts_with("/api/");
    if !is_person {
        let refusal = ApiError::new(StatusCode::UNAUTHORIZED, "this needs `Authorization: Bearer <token>`");
        return ([(header::WWW_AUTHENTICATE, "Bearer")], refusal).into_response();
    }
    let base = shared.config.access.base();
    let here = format!("{base}{}", request.uri().path_and_query().map_or("/", |path| path.as_str()));
    if request.headers().get("sec-fetch-site").is_some_and(|site| site == "cross-site") {
        // A link on another page: the browser keeps its strict cookie back. Followed
        // from a page of ours, it sends it.
        return pages::login::once_more(&here);
    }
    let here = octrees::encoded(&here);
    Redirect::to(&format!("{base}/login?next={here}")).into_response()
}

fn accepts_html(headers: &HeaderMap) -> bool {
    let accept = headers.get(header::ACCEPT).and_then(|accept| accept.to_str().ok()).unwrap_or("");
    accept.to_ascii_lowercase().contains("text/html")
}

/// Whether a method changes nothing.
fn is_safe(method: &Method) -> bool {
    matches!(*method, Method::GET | Method::HEAD | Method::OPTIONS)
}

/// Whether we are asked under a name that can only be meant for us. On loopback any
/// other was made to point here (DNS rebinding). On other addresses that matters
/// for what a browser's page does there, see [`check_origin`], unless the
/// operator listed the names.
fn is_our_name(headers: &HeaderMap, config: &Config) -> bool {
    // Browsers always send one.
    let Some(host) = headers.get(header::HOST) else { return true };
    let host = host.to_str().unwrap_or("");
    let access = &config.access;
    if is_loopback(config.listen.ip()) {
        return names_loopback(host) || access.names(host);
    }
    access.allowed_hosts.is_empty() || access.names(host) || cannot_be_rebound(host)
}

fn names_loopback(authority: &str) -> bool {
    let name = host_of(authority);
    let name = name.strip_suffix('.').unwrap_or(name).to_ascii_lowercase();
    name.parse().is_ok_and(is_loopback) || name == "localhost" || name.ends_with(".localhost")
}

/// Addresses, and names that nobody can have point here from outside.
fn cannot_be_rebound(authority: &str) -> bool {
    let name = host_of(authority).to_ascii_lowercase();
    let is_local = [".local", ".internal", ".home.arpa", ".localhost"].iter().any(|end| name.ends_with(end));
    name.parse::<IpAddr>().is_ok() || is_local || (!name.is_empty() && !name.contains('.'))
}

/// Refuses what a page of somebody else has a browser send. Browsers name the page's
/// origin, or at least how foreign it is; other programs send neither.
fn check_origin(headers: &HeaderMap, config: &Config) -> Result<(), ApiError> {
    let foreign = |from: &str| {
        let text = format!(
            "refused, since a page of another site ({from}) asks for it; if it is yours, name its host in \
             `allowed_hosts`, or set `public_url`"
        );
        Err(ApiError::new(StatusCode::FORBIDDEN, text))
    };
    let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or("unreadable"));
    match text(header::ORIGIN) {
        Some(origin) => {
            let Some((_, from)) = origin.split_once("://") else { return foreign(origin) };
            let host = text(header::HOST).unwrap_or("");
            // Without a token, a page whose own name was made to point here has the same host as we.
            let is_ours = from.eq_ignore_ascii_case(host)
                && (config.access.token.is_some() || names_loopback(host) || cannot_be_rebound(host));
            if is_ours || config.access.names(from) { Ok(()) } else { foreign(origin) }
        }
        None => match headers.get("sec-fetch-site").map(|site| site.to_str().unwrap_or("unreadable")) {
            None | Some("same-origin" | "none") => Ok(()),
            Some(site) => foreign(site),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::config::Layer;

    fn headers(pairs: &[(&str, &str)]) -> HeaderMap {
        let pair = |(name, value): &(&str, &str)| {
            (name.parse::<header::HeaderName>().expect("a name"), value.parse().expect("a value"))
        };
        pairs.iter().map(pair).collect()
    }

    fn config(toml: &str) -> Config {
        let layer: Layer = toml::from_str(toml).expect("a layer");
        Config::from_layer(layer).expect("a configuration")
    }

    fn is_ours(toml: &str, pairs: &[(&str, &str)]) -> bool {
        check_origin(&headers(pairs), &config(toml)).is_ok()
    }

    #[test]
    fn pages_of_other_sites_are_foreign() {
        let host = ("host", "127.0.0.1:7700");
        assert!(is_ours("", &[host]));
        for (name, value, ours) in [
            ("origin", "http://127.0.0.1:7700", true),
            ("origin", "https://evil.example", false),
            ("origin", "http://127.0.0.1:3000", false),
            ("origin", "null", false),
            ("sec-fetch-site", "same-origin", true),
            ("sec-fetch-site", "none", true),
            ("sec-fetch-site", "same-site", false),
            ("sec-fetch-site", "cross-site", false),
        ] {
            assert_eq!(is_ours("", &[host, (name, value)]), ours, "{name}: {value}");
        }
    }

    #[test]
    fn a_page_of_the_proxy_is_ours() {
        let toml = "public_url = 'https://scans.example/x'\nallowed_hosts = ['other.example']";
        for (origin, ours) in [
            ("https://scans.example", true),
            ("https://other.example:8443", true),
            ("https://evil.example", false),
            ("https://scans.example:8443", false),
        ] {
            assert_eq!(is_ours(toml, &[("host", "127.0.0.1:7700"), ("origin", origin)]), ours, "{origin}");
        }
    }

    #[test]
    fn a_rebound_page_gives_no_orders() {
        let open = "listen = '0.0.0.0:7700'\nopen_to_network = true";
        let token = "listen = '0.0.0.0:7700'\ntoken = 'a great secret'";
        for (host, ours) in
            [("evil.example:7700", false), ("10.0.0.7:7700", true), ("nas:7700", true), ("nas.local", true)]
        {
            let pairs = [("host", host), ("origin", &format!("http://{host}"))];
            assert_eq!(is_ours(open, &pairs), ours, "{host}");
            // Such a page has no cookie of ours.
            assert!(is_ours(token, &pairs), "{host}");
        }
    }

    #[test]
    fn rebound_names_are_not_loopback() {
        for listen in ["127.0.0.1:7700", "[::1]:7700", "[::ffff:127.0.0.1]:7700"] {
            let config = config(&format!("listen = '{listen}'\nallowed_hosts = ['scans.example.com']"));
            for (host, fine) in [
                ("127.0.0.1:7700", true),
                ("localhost:7700", true),
                ("LOCALHOST", true),
                ("[::1]:7700", true),
                ("[::ffff:127.0.0.1]:7700", true),
                ("scans.example.com", true),
                ("evil.example:7700", false),
                ("evil.example#localhost", false),
                ("127.0.0.1.evil.example", false),
                ("192.168.0.7", false),
                ("", false),
            ] {
                assert_eq!(is_our_name(&headers(&[("host", host)]), &config), fine, "{listen}: {host}");
            }
        }
        assert!(is_our_name(&HeaderMap::new(), &config("")));
    }

    #[test]
    fn listed_names_count_on_every_address() {
        let listed =
            config("listen = '0.0.0.0:7700'\ntoken = 'a great secret'\nallowed_hosts = ['a.example']");
        let free = config("listen = '0.0.0.0:7700'\ntoken = 'a great secret'");
        for (host, fine) in [("a.example", true), ("b.example", false), ("10.0.0.7", true), ("nas", true)] {
            assert_eq!(is_our_name(&headers(&[("host", host)]), &listed), fine, "{host}");
            assert!(is_our_name(&headers(&[("host", host)]), &free), "{host}");
        }
    }

    #[test]
    fn browsers_ask_for_pages() {
        assert!(accepts_html(&headers(&[("accept", "text/html,application/xhtml+xml,*/*;q=0.8")])));
        assert!(!accepts_html(&headers(&[("accept", "*/*")])) && !accepts_html(&HeaderMap::new()));
    }
}
