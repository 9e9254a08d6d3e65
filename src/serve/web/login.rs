//! `/login` and `/logout`: how a browser brings the token. A form sends it once
//! and gets a cookie for it.

use std::time::Duration;

use axum::Form;
use axum::extract::{Extension, Query, State as Extract};
use axum::http::header;
use axum::response::{IntoResponse, Redirect, Response};
use serde::Deserialize;

use super::pages;
use super::session::{self, RequestIdentity};
use super::shared::AppState;

/// Before a wrong token is answered, so that guessing is slow.
const PAUSE: Duration = Duration::from_millis(300);

#[derive(Deserialize)]
pub(super) struct LoginForm {
    next: Option<String>,
}

#[derive(Deserialize)]
pub(super) struct Brought {
    token: String,
    next: Option<String>,
}

/// The form; who is logged in goes on at once.
pub(super) async fn form(
    Extract(shared): Extract<AppState>,
    Extension(identity): Extension<RequestIdentity>,
    Query(asked): Query<LoginForm>,
) -> Response {
    let next = local(asked.next.as_deref(), shared.config.access.base());
    if identity.role().is_some() {
        return Redirect::to(&next).into_response();
    }
    pages::login::form(shared.config.access.base(), &next, false)
}

/// Takes the token and sets the cookie.
pub(super) async fn log_in(Extract(shared): Extract<AppState>, Form(brought): Form<Brought>) -> Response {
    let access = &shared.config.access;
    let next = local(brought.next.as_deref(), access.base());
    let token = brought.token.trim();
    if access.token.is_none() {
        return Redirect::to(&next).into_response();
    }
    if session::role_of_token(token.as_bytes(), access).is_none() {
        tokio::time::sleep(PAUSE).await;
        return pages::login::form(access.base(), &next, true);
    }
    let cookie = session::log_in(token, access, shared.clock.now());
    ([(header::SET_COOKIE, cookie)], Redirect::to(&next)).into_response()
}

/// Has the browser forget its cookie.
pub(super) async fn log_out(Extract(shared): Extract<AppState>) -> Response {
    let access = &shared.config.access;
    let form = format!("{}/login", access.base());
    ([(header::SET_COOKIE, session::log_out(access))], Redirect::to(&form)).into_response()
}

/// A path of this site, or our first page: nobody is led elsewhere by a link to
/// the form.
fn local(next: Option<&str>, base: &str) -> String {
    let is_local = |path: &&str| {
        path.starts_with('/')
            && !path.starts_with("//")
            && path.bytes().all(|byte| byte.is_ascii_graphic() && !b"\\\"'<>".contains(&byte))
    };
    next.filter(is_local).map_or_else(|| format!("{base}/"), str::to_string)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_is_led_to_another_site() {
        for fine in ["/", "/jobs/7?x=%20y", "/lodestone/octrees/a%20b/metadata.json"] {
            assert_eq!(local(Some(fine), "/base"), fine);
        }
        for evil in [
            "",
            "evil",
            "https://evil.example",
            "//evil.example",
            "/\\evil.example",
            "/\t/evil",
            "/a\r\nb: c",
            "/'><b>",
        ] {
            assert_eq!(local(Some(evil), "/base"), "/base/", "{evil}");
        }
        assert_eq!(local(None, ""), "/");
    }
}
