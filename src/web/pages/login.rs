//! `/login`: where a browser gives the token, for which it gets a cookie.

use axum::extract::{Query, State as Extract};
use axum::http::StatusCode;
use axum::response::Response;
use maud::html;
use serde::Deserialize;

use super::super::Shared;
use super::frame;

#[derive(Deserialize)]
pub(super) struct Asked {
    /// The page that was asked for.
    next: Option<String>,
    /// Whether a token was given that is none.
    wrong: Option<String>,
}

pub(super) async fn page(Extract(shared): Extract<Shared>, Query(asked): Query<Asked>) -> Response {
    // Never to another site: a path, and not one that names a host.
    let next = asked.next.filter(|next| next.starts_with('/') && !next.starts_with("//") && !next.contains('\\'));
    form(frame::base(&shared), next.as_deref().unwrap_or("/"), asked.wrong.is_some())
}

/// The form that asks for the token; where one was wrong, it says so.
pub(super) fn form(base: &str, next: &str, wrong: bool) -> Response {
    let status = if wrong { StatusCode::UNAUTHORIZED } else { StatusCode::OK };
    frame::bare(
        base,
        "Log in · Lodestone",
        status,
        html! {
            form.card.login method="post" action={ (base) "/login" } {
                h1 { "Lodestone" }
                p { "This daemon is locked. Its token stands in its configuration (" code { "token" } ")." }
                @if wrong {
                    p.banner.bad role="alert" { "That is not the token. Look for blanks at its ends." }
                }
                label for="token" { "Token" }
                input #token type="password" name="token" autocomplete="current-password" required autofocus;
                input type="hidden" name="next" value=(next);
                button.primary { "Log in" }
            }
        },
    )
}
