//! What the viewer in the browser asks for: an octree's description, pages of its
//! hierarchy, points of its nodes, and all that is known of one point.
//!
//! The same handlers stand at two addresses: `/api/octrees/{name}/…` for whoever may read,
//! and `/share/{token}/data/…` for whoever has a link to that octree. All but the
//! description name the octree's revision and may be kept for ever; of an octree that was
//! replaced they are gone (410), and the viewer asks for the description of the new one.

use std::sync::Arc;

use axum::extract::{FromRequestParts, Query, RawPathParams, State as Extract};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, RequestPartsExt, Router};
use serde::Deserialize;
use serde_json::json;

use super::files;
use super::refusal::ApiError;
use super::shared::AppState;

use crate::serve::viewer::{View, ViewError};

const FOR_EVER: HeaderValue = HeaderValue::from_static("private, max-age=31536000, immutable");
const ASK_AGAIN: HeaderValue = HeaderValue::from_static("private, no-cache");
/// Pixels of a picture's side that a start is computed for.
const LARGEST_SIDE: u32 = 16_384;

/// The same for whoever has a link to an octree.
pub(super) fn shared_router() -> Router<AppState> {
    Router::new()
        .route("/share/{token}/data/view", get(description))
        .route("/share/{token}/data/pages/{node}", get(page))
        .route("/share/{token}/data/nodes/{node}", get(points))
        .route("/share/{token}/data/nodes/{node}/points/{place}", get(point))
}

/// The octree that an address names, by its name or by a link to it; and what else is in
/// the address.
pub(super) struct Place {
    name: String,
    node: String,
    place: String,
}

impl FromRequestParts<AppState> for Place {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, shared: &AppState) -> Result<Place, ApiError> {
        let none = || ApiError::new(StatusCode::NOT_FOUND, ViewError::NoOctree.to_string());
        let params = parts.extract::<RawPathParams>().await.map_err(|_| none())?;
        let part = |key| params.iter().find(|(name, _)| *name == key).map(|(_, value)| value.to_string());
        let name = match part("token") {
            Some(token) => shared.store.shared(&token).await?,
            None => part("name"),
        };
        let name = name.filter(|name| !name.contains('/')).ok_or_else(none)?;
        let [node, place] = ["node", "place"].map(|key| part(key).unwrap_or_default());
        Ok(Place { name, node, place })
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Size {
    width: Option<u32>,
    height: Option<u32>,
}

#[derive(Debug, Deserialize)]
pub(super) struct OfRevision {
    revision: String,
}

#[derive(Debug, Deserialize)]
pub(super) struct Wanted {
    revision: String,
    #[serde(default)]
    from: u32,
    to: u32,
    #[serde(default = "auto")]
    by: String,
    /// Only the colors, for whoever has the positions.
    #[serde(default)]
    colors: bool,
}

fn auto() -> String {
    "auto".to_string()
}

impl From<ViewError> for ApiError {
    fn from(error: ViewError) -> ApiError {
        let status = match &error {
            ViewError::NoOctree | ViewError::Missing(_) => StatusCode::NOT_FOUND,
            ViewError::Replaced => StatusCode::GONE,
            ViewError::Unreadable(error) => {
                tracing::warn!(%error, "an octree could not be shown");
                StatusCode::UNPROCESSABLE_ENTITY
            }
        };
        ApiError::new(status, error.to_string())
    }
}

/// Does what reads on a thread apart, when there is a place for it.
async fn reading<T: Send + 'static>(
    shared: &AppState,
    name: &str,
    revision: Option<String>,
    read: impl FnOnce(Arc<View>) -> Result<T, ViewError> + Send + 'static,
) -> Result<T, ApiError> {
    let folder = files::below(&shared.config.octrees(), name).ok_or(ViewError::NoOctree)?;
    let viewer = shared.viewer.clone();
    let broken = || ApiError::new(StatusCode::INTERNAL_SERVER_ERROR, "reading the octree broke off");
    let place = viewer.places.clone().acquire_owned().await.map_err(|_| broken())?;
    let done = tokio::task::spawn_blocking(move || {
        // Held until the reading is done, also for a request that was given up.
        let _place = place;
        let view = match revision {
            Some(revision) => viewer.open_revision(&folder, &revision)?,
            None => viewer.open(&folder)?,
        };
        read(view)
    });
    Ok(done.await.map_err(|_| broken())??)
}

pub(super) async fn description(
    Extract(shared): Extract<AppState>,
    place: Place,
    Query(size): Query<Size>,
    asked: HeaderMap,
) -> Result<Response, ApiError> {
    let size = [size.width, size.height].map(|side| side.unwrap_or(512).clamp(1, LARGEST_SIDE));
    let described = move |view: Arc<View>| Ok((view.revision().to_string(), view.description(size)));
    let (revision, description) = reading(&shared, &place.name, None, described).await?;
    let tag = format!("\"{revision}-{}x{}\"", size[0], size[1]);
    let headers = [(header::CACHE_CONTROL, ASK_AGAIN), (header::ETAG, tag_of(&tag))];
    let known = asked.get(header::IF_NONE_MATCH).and_then(|value| value.to_str().ok());
    if known.is_some_and(|known| known.split(',').any(|one| one.trim().trim_start_matches("W/") == tag)) {
        return Ok((StatusCode::NOT_MODIFIED, headers).into_response());
    }
    let mut value = json!(description);
    (value["name"], value["revision"]) = (place.name.into(), revision.into());
    Ok((headers, Json(value)).into_response())
}

fn tag_of(tag: &str) -> HeaderValue {
    HeaderValue::from_str(tag).unwrap_or(HeaderValue::from_static("\"\""))
}

pub(super) async fn page(
    Extract(shared): Extract<AppState>,
    place: Place,
    Query(asked): Query<OfRevision>,
) -> Result<Response, ApiError> {
    let node = node(&place)?;
    Ok(bytes(reading(&shared, &place.name, Some(asked.revision), move |view| view.page(node)).await?))
}

pub(super) async fn points(
    Extract(shared): Extract<AppState>,
    place: Place,
    Query(asked): Query<Wanted>,
) -> Result<Response, ApiError> {
    let node = node(&place)?;
    let Wanted { revision, from, to, by, colors } = asked;
    let read = move |view: Arc<View>| view.points(node, from..to, &by, !colors);
    Ok(bytes(reading(&shared, &place.name, Some(revision), read).await?))
}

pub(super) async fn point(
    Extract(shared): Extract<AppState>,
    place: Place,
    Query(asked): Query<OfRevision>,
) -> Result<Response, ApiError> {
    let node = node(&place)?;
    let number = place.place.parse::<u32>();
    let number = number.map_err(|_| ApiError::new(StatusCode::BAD_REQUEST, "a point is a whole number"))?;
    let read = move |view: Arc<View>| view.point(node, number);
    let point = reading(&shared, &place.name, Some(asked.revision), read).await?;
    let attributes: Vec<_> =
        point.attributes.into_iter().map(|(name, value)| json!({ "name": name, "value": value })).collect();
    let answer = json!({ "position": point.position, "attributes": attributes });
    Ok(([(header::CACHE_CONTROL, FOR_EVER)], Json(answer)).into_response())
}

fn node(place: &Place) -> Result<crate::serve::viewer::NodeName, ApiError> {
    place.node.parse().map_err(|error| ApiError::new(StatusCode::BAD_REQUEST, format!("{error}")))
}

fn bytes(bytes: Vec<u8>) -> Response {
    let kind = HeaderValue::from_static("application/octet-stream");
    ([(header::CACHE_CONTROL, FOR_EVER), (header::CONTENT_TYPE, kind)], bytes).into_response()
}
