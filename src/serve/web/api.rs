//! `/api/…`: jobs as JSON, and orders to them.

use axum::Json;
use axum::body::Bytes;
use axum::extract::{Path, Query, State as Extract};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::octrees;
use super::previews::PreviewView;
use super::refusal::ApiError;
use super::shared::AppState;
use crate::serve::config::age::Age;
use crate::serve::job::facts::Facts;
use crate::serve::job::{Event, Job, JobId, QueuedFile, State};
use crate::serve::queue::progress::ProgressReading;
use crate::serve::queue::{self, Attempt, Drawn, History, Preview};

const MONTH: Age = Age(30 * 86_400_000);

impl JobView {
    /// Whether what it made is published and was not replaced.
    pub fn stands(&self) -> bool {
        self.octree.is_some() || self.copc.is_some()
    }
}

/// A job as the API tells it.
#[derive(Serialize)]
pub(super) struct JobView {
    #[serde(flatten)]
    pub job: Job,
    /// Dates, duration, counts and warnings.
    #[serde(flatten)]
    pub facts: Facts,
    /// The stage it is in, from `queued` to `done`; none where it ended early.
    pub stage: Option<&'static str>,
    pub progress: Option<ProgressReading>,
    /// Where its octree is served, once it is published; none where only a COPC file was
    /// made.
    pub octree: Option<String>,
    /// Where its COPC file is served, where one was made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub copc: Option<String>,
    /// How far its pictures are, and where they are served.
    pub preview: Option<PreviewView>,
}

#[derive(Serialize)]
struct Details {
    #[serde(flatten)]
    view: JobView,
    inputs: Vec<QueuedFile>,
    attempts_log: Vec<Attempt>,
    history: Vec<History>,
}

/// Jobs as the API tells them.
pub(super) async fn views(shared: &AppState, jobs: Vec<Job>) -> queue::Result<Vec<JobView>> {
    let ids: Vec<JobId> = jobs.iter().map(|job| job.id).collect();
    let mut previews = shared.store.previews(&ids).await?;
    Ok(jobs
        .into_iter()
        .map(|job| {
            let preview = previews.remove(&job.id);
            view(shared, job, preview)
        })
        .collect())
}

fn view(shared: &AppState, job: Job, preview: Option<Preview>) -> JobView {
    let progress = match job.state {
        State::Running => shared.board.read(job.id, shared.clock.now()),
        _ => None,
    };
    let stage = match (job.state, &progress) {
        (State::Done, _) => Some("done"),
        (_, Some(reading)) => Some(reading.stage),
        (state, None) => state.is_open().then_some("queued"),
    };
    let published = job.state == State::Done && job.superseded_by.is_none();
    let access = &shared.config.access;
    let folder = octrees::folder(access.base(), &job.name);
    let made = octrees::JobOutputs::of(&job);
    let octree = (published && made.octree).then(|| format!("{folder}/metadata.json"));
    let copc = made.copc.as_ref().filter(|_| published);
    let copc = copc.map(|file| format!("{folder}/{}", octrees::encoded_part(file)));
    // Where nobody makes any, none are awaited.
    let preview = preview
        .filter(|preview| published && (shared.config.preview || preview.state != Drawn::Queued))
        .map(|preview| PreviewView::new(preview, &folder));
    let facts = Facts::of(&job, shared.clock.now());
    JobView { job, facts, stage, progress, octree, copc, preview }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Filter {
    state: Option<String>,
    /// The next page: jobs with a smaller number.
    before: Option<JobId>,
    limit: Option<i64>,
}

pub(super) async fn list(
    Extract(shared): Extract<AppState>,
    Query(filter): Query<Filter>,
) -> Result<Response, ApiError> {
    let state = match filter.state.as_deref() {
        None => None,
        Some(name) => Some(State::parse(&name.to_ascii_lowercase()).ok_or_else(|| {
            let names = State::ALL.map(State::name).join(", ");
            ApiError::new(StatusCode::BAD_REQUEST, format!("`{name}` is no state; there are {names}"))
        })?),
    };
    let limit = filter.limit.unwrap_or(200).clamp(1, 1000);
    let jobs = shared.store.jobs(state, filter.before, limit).await?;
    Ok(Json(json!({ "jobs": views(&shared, jobs).await? })).into_response())
}

pub(super) async fn show(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    let details = Details {
        view: one(&shared, id).await?,
        inputs: shared.store.inputs(id).await?,
        attempts_log: shared.store.attempts(id).await?,
        history: shared.store.history(id).await?,
    };
    Ok(Json(details).into_response())
}

/// One job as the API tells it.
pub(super) async fn one(shared: &AppState, id: JobId) -> queue::Result<JobView> {
    let job = shared.store.job(id).await?;
    let preview = shared.store.previews(&[id]).await?.remove(&id);
    Ok(view(shared, job, preview))
}

async fn order(shared: AppState, id: JobId, event: Event) -> Result<Response, ApiError> {
    let state = shared.store.order(id, event, shared.clock.now()).await?;
    shared.bell.notify_one();
    // A running job does as it is told at the next tick.
    let status = if state == State::Running { StatusCode::ACCEPTED } else { StatusCode::OK };
    Ok((status, Json(one(&shared, id).await?)).into_response())
}

pub(super) async fn retry(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    order(shared, id, Event::Retry).await
}

pub(super) async fn cancel(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    order(shared, id, Event::Cancel).await
}

pub(super) async fn pause(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    order(shared, id, Event::Pause).await
}

pub(super) async fn resume(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    order(shared, id, Event::Resume).await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Priority {
    priority: i64,
}

pub(super) async fn priority(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
    Json(wish): Json<Priority>,
) -> Result<Response, ApiError> {
    shared.store.set_priority(id, wish.priority, shared.clock.now()).await?;
    shared.bell.notify_one();
    Ok(Json(one(&shared, id).await?).into_response())
}

/// Makes the pictures of a job's octree, be it once more.
pub(super) async fn preview(
    Extract(shared): Extract<AppState>,
    Path(id): Path<JobId>,
) -> Result<Response, ApiError> {
    if !shared.config.preview {
        let text = "this daemon makes no pictures (`preview = false` in its configuration)";
        return Err(ApiError::new(StatusCode::CONFLICT, text.to_string()));
    }
    shared.store.order_preview(id, shared.clock.now()).await?;
    shared.bell.notify_one();
    Ok((StatusCode::ACCEPTED, Json(one(&shared, id).await?)).into_response())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Purge {
    older_than: Age,
}

/// Removes the records of jobs that ended long ago; 30 days where nothing is said.
pub(super) async fn purge(Extract(shared): Extract<AppState>, body: Bytes) -> Result<Response, ApiError> {
    let age = match body.trim_ascii() {
        [] => MONTH,
        body => {
            let wish: Purge = serde_json::from_slice(body).map_err(|e| {
                ApiError::new(StatusCode::UNPROCESSABLE_ENTITY, format!("no order to purge: {e}"))
            })?;
            wish.older_than
        }
    };
    let gone = shared.store.purge(shared.clock.now() - age.0, &shared.config.octrees()).await?;
    Ok(Json(json!({ "purged": gone })).into_response())
}

/// The watched folders: how news of them comes, what is missing, what waits.
pub(super) async fn watch(Extract(shared): Extract<AppState>) -> Response {
    let health = shared.health();
    let watched: Vec<_> = health
        .watched
        .iter()
        .map(|(path, mode)| {
            let missing = health.missing.contains(path);
            json!({ "path": path.to_string_lossy(), "mode": mode, "missing": missing })
        })
        .collect();
    Json(json!({ "watched": watched, "waiting": health.waiting, "last_scan": health.last_scan }))
        .into_response()
}
