//! `/api/queue`, links to octrees, and what the API tells of verifications and logs.

use axum::Json;
use axum::extract::{Path, State as Extract};
use axum::http::StatusCode;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::pages;
use super::refusal::ApiError;
use super::shared::AppState;
use crate::serve::job::{Job, JobId};
use crate::serve::queue::{QueueMode, Share};

/// The description of the API; a test holds it to the routes.
pub(super) async fn openapi() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], include_str!("openapi.json")).into_response()
}

/// Whether jobs are started, and how many there are.
pub(super) async fn queue(Extract(shared): Extract<AppState>) -> Result<Response, ApiError> {
    let counts = shared.store.shown_counts().await?;
    let jobs: Map<String, Value> =
        counts.into_iter().map(|(shown, jobs)| (shown.name().to_string(), jobs.into())).collect();
    let mode = shared.store.mode().await?;
    Ok(Json(json!({ "mode": mode, "jobs": jobs, "points_per_second": shared.board.rates() })).into_response())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    mode: QueueMode,
}

pub(super) async fn set_queue(
    Extract(shared): Extract<AppState>,
    Json(wanted): Json<Wanted>,
) -> Result<Response, ApiError> {
    shared.store.set_mode(wanted.mode).await?;
    tracing::info!(mode = wanted.mode.name(), "set by an operator");
    shared.bell.notify_one();
    queue(Extract(shared)).await
}

pub(super) async fn verify(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    shared.store.order_verification(id, shared.clock.now()).await?;
    shared.bell.notify_one();
    let verification = shared.store.verification(id).await?;
    Ok((StatusCode::ACCEPTED, Json(verification)).into_response())
}

pub(super) async fn verified(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    shared.store.job(id).await?;
    Ok(Json(shared.store.verification(id).await?).into_response())
}

pub(super) async fn log(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    shared.store.job(id).await?;
    Ok(Json(json!({ "lines": shared.store.lines(id).await? })).into_response())
}

/// A link to an octree as the API tells it.
#[derive(Serialize)]
struct LinkView {
    id: i64,
    /// A page with its picture, for people.
    page: String,
    /// What viewers are given, on other pages too: metadata.json, or the COPC file where
    /// that alone was made.
    file: String,
    created_at: i64,
}

fn link_view(shared: &AppState, share: &Share, job: &Job) -> LinkView {
    let [page, file] = pages::share::addresses(shared.config.access.base(), share, job);
    LinkView { id: share.id, page, file, created_at: share.created_at }
}

/// The links to a job's octree that hold.
pub(super) async fn links(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    let job = shared.store.job(id).await?;
    let shares = shared.store.shares(&job.name).await?;
    let links: Vec<LinkView> = shares.iter().map(|share| link_view(&shared, share, &job)).collect();
    Ok(Json(json!({ "links": links })).into_response())
}

/// A new one.
pub(super) async fn link(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    let share = shared.store.share_of(id, shared.clock.now()).await?;
    let job = shared.store.job(id).await?;
    Ok((StatusCode::CREATED, Json(link_view(&shared, &share, &job))).into_response())
}

/// Takes one back.
pub(super) async fn revoke(
    Extract(shared): Extract<AppState>,
    Path((id, link)): Path<(JobId, i64)>,
) -> Result<Response, ApiError> {
    let name = shared.store.job(id).await?.name;
    if shared.store.revoke_share(link, &name, shared.clock.now()).await? {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    Err(ApiError::new(
        StatusCode::NOT_FOUND,
        format!("there is no link {link} to the octree of job {id} that still holds"),
    ))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    /// Path and method of every route of the API in the source.
    fn routes(source: &str) -> BTreeSet<(String, String)> {
        let mut routes = BTreeSet::new();
        for call in source.split(".route(\"").skip(1) {
            let (path, rest) = call.split_once('"').expect("a path");
            // To the end of this call's arguments.
            let mut depth = 1;
            let end = rest.find(|c| {
                depth += i32::from(c == '(') - i32::from(c == ')');
                depth == 0
            });
            let handlers = &rest[..end.expect("an end")];
            let told = path.starts_with("/api/") || ["/metrics", "/healthz", "/readyz"].contains(&path);
            for method in ["get", "post", "delete"].into_iter().filter(|_| told) {
                if handlers.contains(&format!("{method}(")) {
                    routes.insert((path.to_string(), method.to_string()));
                }
            }
        }
        routes
    }

    #[test]
    fn the_description_tells_of_every_route() {
        let description: Value = serde_json::from_str(include_str!("openapi.json")).expect("JSON");
        let paths = description["paths"].as_object().expect("paths");
        let mut told = BTreeSet::new();
        for (path, methods) in paths {
            for (method, operation) in methods.as_object().expect("methods") {
                told.insert((path.clone(), method.clone()));
                assert!(operation["summary"].is_string() && operation["responses"].is_object(), "{path}");
                let named = operation["parameters"].as_array().into_iter().flatten();
                let in_path = named.filter(|parameter| parameter["in"] == "path").count();
                assert_eq!(in_path, path.matches('{').count(), "{path}");
            }
        }
        assert_eq!(told, routes(include_str!("mod.rs")));
    }

    #[test]
    fn every_reference_of_the_description_leads_somewhere() {
        let description: Value = serde_json::from_str(include_str!("openapi.json")).expect("JSON");
        let mut open = vec![&description];
        let mut references = 0;
        while let Some(value) = open.pop() {
            match value {
                Value::Object(object) => {
                    if let Some(Value::String(to)) = object.get("$ref") {
                        let pointer = to.trim_start_matches('#');
                        assert!(description.pointer(pointer).is_some(), "{to}");
                        references += 1;
                    }
                    open.extend(object.values());
                }
                Value::Array(array) => open.extend(array),
                _ => {}
            }
        }
        assert!(references > 20);
    }
}
