//! The form that asks for the token, and a page that leads on.

use axum::http::StatusCode;
use axum::response::Response;
use maud::html;

use super::frame;

/// The form that asks for the token; where one was wrong, it says so.
pub(in super::super) fn form(base: &str, next: &str, wrong: bool) -> Response {
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
                // Browsers keep a secret with a name only.
                input type="text" name="username" value="lodestone" autocomplete="username" hidden;
                label for="token" { "Token" }
                input #token type="password" name="token" autocomplete="current-password" required autofocus;
                input type="hidden" name="next" value=(next);
                button.primary { "Log in" }
            }
        },
    )
}

/// A page that leads to `path` at once, as if from a page of ours.
pub(in super::super) fn once_more(path: &str) -> Response {
    frame::leading(
        path,
        html! {
            div.card.login {
                h1 { "Lodestone" }
                p { a.button href=(path) { "Go on" } }
            }
        },
    )
}
