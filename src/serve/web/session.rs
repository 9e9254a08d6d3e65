//! Who asks: the bearer of a token, in a header or, for browsers, by a cookie
//! that proves the token without holding it.

use axum::http::{HeaderMap, header};

use crate::platform::clock::Millis;
use crate::serve::config::access::Access;

const COOKIE: &str = "lodestone";
/// How long a browser stays logged in, in seconds.
const LASTS: i64 = 30 * 86_400;
/// Separates this key from everything else that may be derived from a token.
const COOKIE_KEY: &str = "lodestone 2026-11 cookie of a browser session";

/// What a request may do. Handlers find it among the request's extensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// Reads everything and gives orders.
    Operator,
    /// Reads everything.
    Reader,
}

impl Role {
    pub fn may_operate(self) -> bool {
        self == Role::Operator
    }
}

/// How a request says who sends it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RequestIdentity {
    /// No token is configured: everybody is an operator.
    Open,
    /// By a token in a header, which no page can have a browser send.
    Token(Role),
    /// By a browser's cookie.
    Cookie(Role),
    Nobody,
}

impl RequestIdentity {
    pub fn of(headers: &HeaderMap, access: &Access, now: Millis) -> RequestIdentity {
        if access.token.is_none() {
            return RequestIdentity::Open;
        }
        if let Some(role) = bearer(headers).and_then(|token| role_of_token(token, access)) {
            return RequestIdentity::Token(role);
        }
        cookies(headers)
            .find_map(|value| role_of_cookie(value, access, now))
            .map_or(RequestIdentity::Nobody, RequestIdentity::Cookie)
    }

    pub fn role(self) -> Option<Role> {
        match self {
            RequestIdentity::Open => Some(Role::Operator),
            RequestIdentity::Token(role) | RequestIdentity::Cookie(role) => Some(role),
            RequestIdentity::Nobody => None,
        }
    }
}

/// The token of `Authorization: Bearer …`; the scheme in any letter case.
fn bearer(headers: &HeaderMap) -> Option<&[u8]> {
    let value = headers.get(header::AUTHORIZATION)?.as_bytes();
    let (scheme, rest) = value.split_at_checked(7)?;
    scheme.eq_ignore_ascii_case(b"bearer ").then(|| rest.trim_ascii())
}

/// The role that a token gives, if it is one of those configured.
pub(super) fn role_of_token(token: &[u8], access: &Access) -> Option<Role> {
    let is = |known: &Option<String>| {
        // Hashes are compared, in constant time, so that the time tells nothing of the token.
        known.as_ref().is_some_and(|known| blake3::hash(token) == blake3::hash(known.as_bytes()))
    };
    if is(&access.token) {
        return Some(Role::Operator);
    }
    is(&access.read_token).then_some(Role::Reader)
}

fn cookies(headers: &HeaderMap) -> impl Iterator<Item = &str> {
    let values = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    values
        .flat_map(|value| value.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .filter_map(|(name, value)| (name == COOKIE).then_some(value))
}

/// A cookie is its last second and a keyed hash of that; the key is derived from
/// the token, so a cookie outlives a restart and not its token.
fn role_of_cookie(value: &str, access: &Access, now: Millis) -> Option<Role> {
    let (until, mac) = value.split_once('.')?;
    let until: i64 = until.parse().ok()?;
    if until <= now / 1000 {
        return None;
    }
    let mac = blake3::Hash::from_hex(mac).ok()?;
    let proves = |token: &Option<String>| {
        token.as_ref().is_some_and(|token| keyed(COOKIE_KEY, token, until.to_string().as_bytes()) == mac)
    };
    if proves(&access.token) {
        return Some(Role::Operator);
    }
    proves(&access.read_token).then_some(Role::Reader)
}

fn keyed(purpose: &str, token: &str, text: &[u8]) -> blake3::Hash {
    blake3::keyed_hash(&blake3::derive_key(purpose, token.as_bytes()), text)
}

/// The header that logs a browser in as what this token allows.
pub(super) fn log_in(token: &str, access: &Access, now: Millis) -> String {
    let until = now / 1000 + LASTS;
    let mac = keyed(COOKIE_KEY, token, until.to_string().as_bytes());
    set_cookie(&format!("{until}.{}", mac.to_hex()), LASTS, access)
}

/// The header that has a browser forget its cookie.
pub(super) fn log_out(access: &Access) -> String {
    set_cookie("", 0, access)
}

fn set_cookie(value: &str, seconds: i64, access: &Access) -> String {
    let is_https = access.public_url.as_ref().is_some_and(|url| url.is_https);
    let secure = if is_https { "; Secure" } else { "" };
    let base = access.base();
    format!("{COOKIE}={value}; Path={base}/; Max-Age={seconds}; HttpOnly; SameSite=Strict{secure}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Millis = 1_800_000_000_000;

    fn access() -> Access {
        Access {
            token: Some("the operator's".to_string()),
            read_token: Some("the reader's".to_string()),
            ..Access::default()
        }
    }

    fn identity(name: header::HeaderName, value: &str, access: &Access) -> RequestIdentity {
        let headers = HeaderMap::from_iter([(name, value.parse().expect("a value"))]);
        RequestIdentity::of(&headers, access, NOW)
    }

    #[test]
    fn only_a_whole_token_opens() {
        let nobody = RequestIdentity::Nobody;
        for (value, who) in [
            ("Bearer the operator's", RequestIdentity::Token(Role::Operator)),
            ("bearer the operator's", RequestIdentity::Token(Role::Operator)),
            ("BEARER   the reader's ", RequestIdentity::Token(Role::Reader)),
            ("Bearer the operator", nobody),
            ("Bearer ", nobody),
            ("Bearer", nobody),
            ("the operator's", nobody),
            ("Basic the operator's", nobody),
        ] {
            assert_eq!(identity(header::AUTHORIZATION, value, &access()), who, "{value}");
        }
        assert_eq!(RequestIdentity::of(&HeaderMap::new(), &access(), NOW), nobody);
        assert_eq!(RequestIdentity::of(&HeaderMap::new(), &Access::default(), NOW), RequestIdentity::Open);
    }

    /// What a browser sends back of a Set-Cookie header.
    fn sent(set: &str) -> String {
        set.split(';').next().expect("a pair").to_string()
    }

    #[test]
    fn cookies_prove_their_token_until_it_changes() {
        let cookie = sent(&log_in("the reader's", &access(), NOW));
        assert!(!cookie.contains("reader"), "{cookie}");
        assert_eq!(identity(header::COOKIE, &cookie, &access()), RequestIdentity::Cookie(Role::Reader));
        let among = format!("a=b; lodestone=1.00; {cookie}; c=d");
        assert_eq!(identity(header::COOKIE, &among, &access()), RequestIdentity::Cookie(Role::Reader));
        let changed = Access { read_token: Some("another secret".to_string()), ..access() };
        assert_eq!(identity(header::COOKIE, &cookie, &changed), RequestIdentity::Nobody);
        let operator = sent(&log_in("the operator's", &access(), NOW));
        assert_eq!(identity(header::COOKIE, &operator, &access()), RequestIdentity::Cookie(Role::Operator));
        let old = sent(&log_in("the operator's", &access(), NOW - LASTS * 1000));
        assert_eq!(identity(header::COOKIE, &old, &access()), RequestIdentity::Nobody);
    }

    #[test]
    fn forged_cookies_open_nothing() {
        let cookie = sent(&log_in("the operator's", &access(), NOW));
        let (until, mac) = cookie.strip_prefix("lodestone=").and_then(|v| v.split_once('.')).expect("both");
        let later: i64 = until.parse::<i64>().expect("seconds") + 1;
        for forged in [
            format!("lodestone={later}.{mac}"),
            format!("lodestone={until}.{}", "0".repeat(64)),
            format!("lodestone={until}"),
            "lodestone=".to_string(),
            "lodestone=the operator's".to_string(),
            format!("other={until}.{mac}"),
        ] {
            assert_eq!(identity(header::COOKIE, &forged, &access()), RequestIdentity::Nobody, "{forged}");
        }
    }

    #[test]
    fn cookies_stay_below_the_public_address() {
        let public = |url: &str| {
            let toml = format!("token = 'the operator'\npublic_url = '{url}'");
            let layer: crate::serve::config::Layer = toml::from_str(&toml).expect("a layer");
            crate::serve::config::Config::from_layer(layer).expect("a configuration").access
        };
        let set = log_in("the operator", &public("https://a.example/x"), NOW);
        for part in ["; Path=/x/;", "; HttpOnly", "; SameSite=Strict", "; Secure"] {
            assert!(set.contains(part), "{set}");
        }
        let set = log_in("the operator", &public("http://a.example"), NOW);
        assert!(set.contains("; Path=/;") && !set.contains("Secure"), "{set}");
        assert!(log_out(&access()).contains("lodestone=; Path=/; Max-Age=0"));
    }
}
