//! Orders from the pages: forms that are sent by POST and answered with the page
//! that tells what came of it.

use axum::extract::{Form, Path, State as Extract};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Redirect, Response};

use super::super::refusal::ApiError;
use super::super::shared::AppState;
use super::frame;
use crate::serve::job::{Event, JobId};
use crate::serve::queue::{Listing, QueueMode, Shown};

/// Jobs that one order of all reaches.
const MOST: i64 = 200_000;

/// The fields of a form; one may stand more than once.
type FormFields = Vec<(String, String)>;

fn field<'a>(fields: &'a FormFields, name: &str) -> Option<&'a str> {
    fields.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
}

fn event(order: &str) -> Option<Event> {
    Some(match order {
        "retry" => Event::Retry,
        "cancel" => Event::Cancel,
        "pause" => Event::Pause,
        "resume" => Event::Resume,
        _ => return None,
    })
}

fn unknown() -> ApiError {
    ApiError::new(StatusCode::BAD_REQUEST, "this order is none of the page's; reload it and try again")
}

/// An order to one job.
pub(super) async fn one(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
    Form(fields): Form<FormFields>,
) -> Result<Response, ApiError> {
    let (now, order) = (shared.clock.now(), field(&fields, "order").unwrap_or(""));
    match order {
        "priority" => {
            let wanted = field(&fields, "priority").and_then(|value| value.trim().parse().ok());
            let wanted = wanted.ok_or_else(|| {
                ApiError::new(StatusCode::BAD_REQUEST, "a priority is a whole number; higher goes first")
            })?;
            shared.store.set_priority(id, wanted, now).await?;
        }
        "preview" => {
            if !shared.config.preview {
                let text = "this daemon makes no pictures (`preview = false` in its configuration)";
                return Err(ApiError::new(StatusCode::CONFLICT, text));
            }
            shared.store.order_preview(id, now).await?;
        }
        "verify" => shared.store.order_verification(id, now).await?,
        "share" => drop(shared.store.share_of(id, now).await?),
        "revoke" => {
            let link = field(&fields, "link").and_then(|value| value.parse().ok()).ok_or_else(unknown)?;
            let name = shared.store.job(id).await?.name;
            shared.store.revoke_share(link, &name, now).await?;
        }
        "dismiss" => {
            shared.store.job(id).await?;
            shared.store.dismiss(&[id], now).await?;
        }
        order => {
            shared.store.order(id, event(order).ok_or_else(unknown)?, now).await?;
        }
    }
    shared.bell.notify_one();
    shared.figures.forget().await;
    Ok(Redirect::to(&format!("{}/jobs/{id}?said={order}", frame::base(&shared))).into_response())
}

/// An order to the jobs that were chosen, to all in a state, or to those of them that
/// failed for one reason.
pub(super) async fn many(
    Extract(shared): Extract<AppState>,
    Form(fields): Form<FormFields>,
) -> Result<Response, ApiError> {
    let (now, order) = (shared.clock.now(), field(&fields, "order").unwrap_or(""));
    let jobs: Vec<JobId> = match field(&fields, "all") {
        Some(all) => {
            let shown = Shown::parse(all).ok_or_else(unknown)?;
            match field(&fields, "reason") {
                Some(reason) => shared.store.failed_for(shown, reason, MOST).await?,
                None => {
                    let listing = Listing { shown: Some(shown), ..Listing::default() };
                    shared.store.listed(&listing, MOST).await?
                }
            }
        }
        None => {
            let chosen = fields.iter().filter(|(key, _)| key == "job");
            chosen.filter_map(|(_, value)| value.parse().ok()).collect()
        }
    };
    let reached = match order {
        "dismiss" => shared.store.dismiss(&jobs, now).await?,
        order => shared.store.order_all(&jobs, event(order).ok_or_else(unknown)?, now).await?,
    };
    shared.bell.notify_one();
    shared.figures.forget().await;
    let state =
        field(&fields, "state").and_then(Shown::parse).map(|shown| format!("&state={}", shown.name()));
    let said = if reached == 0 { "none" } else { order };
    let to = format!("{}/?said={said}&n={reached}{}", frame::base(&shared), state.unwrap_or_default());
    Ok(Redirect::to(&to).into_response())
}

/// Whether jobs are started.
pub(super) async fn all(
    Extract(shared): Extract<AppState>,
    Form(fields): Form<FormFields>,
) -> Result<Response, ApiError> {
    let mode = field(&fields, "mode").and_then(QueueMode::parse).ok_or_else(unknown)?;
    shared.store.set_mode(mode).await?;
    tracing::info!(mode = mode.name(), "set by an operator");
    shared.bell.notify_one();
    shared.figures.forget().await;
    Ok(Redirect::to(&format!("{}/?said=mode-{}", frame::base(&shared), mode.name())).into_response())
}
