//! The HTTP API: what the queue holds, how far the jobs are, whether the daemon
//! is well, and the octrees themselves for viewers.
//!
//! Nothing here works the queue: an order is written into it as a wish, which the
//! engine's next tick reads. Loopback by default; see [`crate::serve::config`] for what
//! another address needs. Bodies, times and connections are bounded.

mod api;
mod auth;
mod errors;
mod events;
mod files;
mod headers;
mod health;
mod login;
mod octrees;
mod pages;
mod previews;
mod refusal;
mod seats;
mod server;
mod session;
mod shared;
mod steering;
mod streams;
mod views;
mod watched;

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use axum::http::StatusCode;
use axum::middleware::from_fn_with_state;
use axum::routing::{delete, get, post};
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;

pub use pages::upload::{folder as uploads, places as upload_places};
pub use pages::{Figures, Live};
pub use server::serve;
pub use shared::{AppState, Health};
pub use streams::Streams;

/// No request but an upload needs a body of more than a few words.
const LONGEST_BODY: usize = 64 * 1024;
const LONGEST_REQUEST: Duration = Duration::from_secs(30);

/// All routes, as they are without the public address's path and below it: some
/// proxies take it away, and others do not.
pub fn router(shared: AppState) -> Router {
    let base: Arc<str> = shared.config.access.base().into();
    let inner = routes(shared);
    if base.is_empty() {
        return inner;
    }
    // A path can be changed before it is routed only.
    let strip = move |request: Request| std::future::ready(without_base(request, &base));
    Router::new().fallback_service(inner).layer(axum::middleware::map_request(strip))
}

fn without_base(mut request: Request, base: &str) -> Request {
    let Some(path) = request.uri().path_and_query() else { return request };
    let stripped = match path.as_str().strip_prefix(base) {
        Some(rest) if rest.starts_with('/') => rest.to_string(),
        Some(rest) if rest.is_empty() || rest.starts_with('?') => format!("/{rest}"),
        _ => return request,
    };
    if let Ok(uri) = stripped.parse() {
        *request.uri_mut() = uri;
    }
    request
}

fn routes(shared: AppState) -> Router {
    let guard = from_fn_with_state(shared.clone(), auth::guard);
    let site = from_fn_with_state(shared.clone(), auth::site);
    let body = RequestBodyLimitLayer::new(LONGEST_BODY);
    let limit = TimeoutLayer::with_status_code(StatusCode::REQUEST_TIMEOUT, LONGEST_REQUEST);
    // Streams last as long as they are listened to.
    let streams = Router::new()
        .route("/api/events", get(events::all))
        .route("/api/jobs/{id}/events", get(events::one))
        .route("/live", get(pages::live::stream))
        .layer(from_fn_with_state(shared.clone(), auth::own_pages));
    let jobs = Router::new()
        .route("/metrics", get(health::metrics))
        .route("/api/jobs", get(api::list))
        .route("/api/jobs/purge", post(api::purge))
        .route("/api/jobs/{id}", get(api::show))
        .route("/api/jobs/{id}/retry", post(api::retry))
        .route("/api/jobs/{id}/cancel", post(api::cancel))
        .route("/api/jobs/{id}/pause", post(api::pause))
        .route("/api/jobs/{id}/resume", post(api::resume))
        .route("/api/jobs/{id}/priority", post(api::priority))
        .route("/api/jobs/{id}/preview", post(api::preview))
        .route("/api/jobs/{id}/verify", get(steering::verified).post(steering::verify))
        .route("/api/jobs/{id}/log", get(steering::log))
        .route("/api/jobs/{id}/links", get(steering::links).post(steering::link))
        .route("/api/jobs/{id}/links/{link}", delete(steering::revoke))
        .route("/api/queue", get(steering::queue).post(steering::set_queue))
        .route("/api/watch", get(api::watch))
        .route("/api/octrees/{name}/view", get(views::description))
        .route("/api/octrees/{name}/pages/{node}", get(views::page))
        .route("/api/octrees/{name}/nodes/{node}", get(views::points))
        .route("/api/octrees/{name}/nodes/{node}/points/{place}", get(views::point))
        .route("/api/openapi.json", get(steering::openapi))
        .merge(pages::router(&shared))
        .layer(limit)
        .layer(body)
        .merge(streams)
        .merge(pages::upload_router(&shared))
        .layer(guard.clone());
    // What anybody may have, and what the form needs before anybody is known.
    let open = pages::open_router()
        .merge(views::shared_router())
        .route("/login", get(login::form).post(login::log_in))
        .route("/logout", post(login::log_out))
        .layer(limit)
        .layer(body);
    let octrees = octrees::router().layer(limit).layer(guard).layer(site.clone()).layer(octrees::cors());
    // Whoever asks whether the daemon lives need not know a secret.
    Router::new()
        .route("/healthz", get(health::healthz))
        .route("/readyz", get(health::readyz))
        .merge(jobs.merge(open).layer(site))
        .merge(octrees)
        .layer(axum::middleware::from_fn(errors::as_json))
        .layer(axum::middleware::from_fn(headers::add))
        .with_state(shared)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_public_path_is_taken_away_where_it_is_there() {
        for (path, routed) in [
            ("/x/y/api/jobs?limit=1", "/api/jobs?limit=1"),
            ("/api/jobs?limit=1", "/api/jobs?limit=1"),
            ("/x/y", "/"),
            ("/x/y/", "/"),
            ("/x/y?a=/x/y", "/?a=/x/y"),
            ("/x/yz", "/x/yz"),
        ] {
            let request = Request::builder().uri(path).body(axum::body::Body::empty()).expect("a request");
            assert_eq!(without_base(request, "/x/y").uri().to_string(), routed, "{path}");
        }
    }
}
