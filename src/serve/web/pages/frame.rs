//! What every page has around it.

use axum::body::to_bytes;
use axum::extract::{Request, State as Extract};
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use maud::{DOCTYPE, Markup, html};

use super::super::session::Role;
use super::super::shared::AppState;
use super::{assets, parts};

/// The path under which all is served, as behind a proxy; empty, or without a
/// slash at its end.
pub(super) fn base(shared: &AppState) -> &str {
    shared.config.access.base()
}

/// A whole page around `main`. Whoever may only read is shown no order: all of them
/// are forms that are sent by POST, which the stylesheet hides.
pub(super) fn page(shared: &AppState, role: Role, title: &str, main: Markup) -> Response {
    let base = base(shared);
    let body = html! {
        (head(base, title))
        body.reader[!role.may_operate()] data-base=(base) data-now=(shared.clock.now()) {
            a.skip href="#main" { "Skip to the content" }
            header.top {
                a.brand href={ (base) "/" } {
                    img src=(assets::url(base, "icon.svg")) alt="" width="28" height="28";
                    "Lodestone"
                }
                @if !role.may_operate() { span.badge { "read only" } }
                nav aria-label="Site" {
                    a href={ (base) "/" } { "Jobs" }
                    a href={ (base) "/api/openapi.json" } { "API" }
                    button #notify.quiet type="button" hidden aria-pressed="false" { "Notify me" }
                    @if shared.config.access.token.is_some() {
                        form.stays method="post" action={ (base) "/logout" } {
                            button.quiet { "Log out" }
                        }
                    }
                }
            }
            div #gone.banner.bad role="alert" hidden {
                "Lodestone does not answer: it was stopped, or the connection is cut. What you see is from before; \
                 the page goes on by itself as soon as it is back."
            }
            main #main tabindex="-1" { (main) }
            footer { "Lodestone " (env!("CARGO_PKG_VERSION")) }
        }
    };
    answer(StatusCode::OK, html! { (DOCTYPE) html lang="en" { (body) } })
}

/// A page without what needs to be let in, as the one that asks for the token.
pub(in super::super) fn bare(base: &str, title: &str, status: StatusCode, main: Markup) -> Response {
    let body = html! {
        (head(base, title))
        body.bare { main #main { (main) } }
    };
    answer(status, html! { (DOCTYPE) html lang="en" { (body) } })
}

/// A page that is all picture: the viewer, with a stylesheet and a script of its own.
pub(super) fn full(base: &str, title: &str, body: Markup) -> Response {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                (common_head(base, title))
                link rel="stylesheet" href=(assets::url(base, "viewer.css"));
                script type="module" src=(assets::url(base, "viewer.js")) {}
            }
            (body)
        }
    };
    answer(StatusCode::OK, page)
}

/// A page that leads to `path` at once.
pub(super) fn leading(path: &str, main: Markup) -> Response {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="refresh" content={ "0;url=" (path) };
                title { "Lodestone" }
            }
            body.bare { main #main { (main) } }
        }
    };
    answer(StatusCode::UNAUTHORIZED, page)
}

fn head(base: &str, title: &str) -> Markup {
    html! {
        head {
            (common_head(base, title))
            script type="module" src=(assets::url(base, "page.js")) {}
        }
    }
}

fn common_head(base: &str, title: &str) -> Markup {
    html! {
        meta charset="utf-8";
        meta name="viewport" content="width=device-width, initial-scale=1";
        meta name="color-scheme" content="light dark";
        meta name="referrer" content="same-origin";
        title { (title) }
        link rel="icon" type="image/svg+xml" href=(assets::url(base, "icon.svg"));
        link rel="stylesheet" href=(assets::url(base, "style.css"));
    }
}

fn answer(status: StatusCode, page: Markup) -> Response {
    let headers = [(header::CONTENT_TYPE, "text/html; charset=utf-8"), (header::CACHE_CONTROL, "no-store")];
    (status, headers, page.into_string()).into_response()
}

/// Bytes of a refusal.
const LONGEST_REFUSAL: usize = 64 * 1024;

/// Turns the refusal of a request, which is JSON, into a page for people.
pub(super) async fn explain(Extract(shared): Extract<AppState>, request: Request, next: Next) -> Response {
    let accepts = request.headers().get(header::ACCEPT);
    let wants_json = accepts.is_some_and(|value| value.as_bytes().starts_with(b"application/json"));
    let answer = next.run(request).await;
    let status = answer.status();
    if wants_json || !(status.is_client_error() || status.is_server_error()) {
        return answer;
    }
    let bytes = to_bytes(answer.into_body(), LONGEST_REFUSAL).await.unwrap_or_default();
    let json: serde_json::Value = serde_json::from_slice(&bytes).unwrap_or_default();
    let text = match json["error"].as_str() {
        Some(text) => text.to_string(),
        None => String::from_utf8_lossy(&bytes).trim().to_string(),
    };
    let base = base(&shared);
    let title = match status {
        StatusCode::NOT_FOUND => "Not here",
        StatusCode::CONFLICT => "Not now",
        _ => "That did not work",
    };
    bare(
        base,
        &format!("{title} · Lodestone"),
        status,
        html! {
            div.card.login {
                h1 { (title) }
                p { (parts::text(&text)) }
                p { a.button href={ (base) "/" } { "All jobs" } }
            }
        },
    )
}

/// What came of an order, at the head of the page that follows it.
pub(super) fn said(code: Option<&str>, count: Option<u64>) -> Markup {
    // Codes only: whoever makes up an address must not put words into our mouth.
    let many = count.unwrap_or(1);
    let jobs = || if many == 1 { "One job".to_string() } else { format!("{many} jobs") };
    let text = match code {
        Some("retry") => format!("{} will be tried again.", jobs()),
        Some("cancel") => format!("{} called off.", jobs()),
        Some("pause") => format!("{} paused.", jobs()),
        Some("resume") => format!("{} resumed.", jobs()),
        Some("dismiss") => format!("{} dismissed.", jobs()),
        Some("priority") => "The priority is set.".to_string(),
        Some("preview") => "New pictures will be made.".to_string(),
        Some("verify") => "It will be verified as soon as there is time for it.".to_string(),
        Some("share") => "There is a new link.".to_string(),
        Some("revoke") => "The link opens nothing any more.".to_string(),
        Some("uploaded") if many == 1 => "One upload arrived.".to_string(),
        Some("uploaded") => format!("{many} uploads arrived."),
        Some("mode-run") => "Jobs are started as they come.".to_string(),
        Some("mode-drain") => "What runs goes on to its end; nothing new is started.".to_string(),
        Some("mode-pause") => "Everything is paused.".to_string(),
        Some("none") => "Nothing to do: no job was chosen, or none is in a state for that.".to_string(),
        _ => return html! {},
    };
    html! { p.banner.good role="status" { (text) } }
}
