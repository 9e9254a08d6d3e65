//! The pages: what a person sees of Lodestone, and steers it by.
//!
//! Plain HTML that works without scripts: lists are links, orders are forms that
//! answer with the page they came from. A little script ([`assets`]) keeps a page
//! as the daemon has it, by fetching it again when [`live`] says that something
//! changed. All is made by `maud`, which escapes whatever is put into a page.

mod assets;
mod attributes;
mod charts;
mod crs;
pub(super) mod figures;
mod frame;
mod job;
mod list;
pub(super) mod live;
pub(super) mod login;
mod orders;
mod overview;
mod parts;
mod result;
pub(super) mod share;
pub(super) mod subscribers;
pub(super) mod upload;
mod verified;
mod view;
mod words;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::from_fn_with_state;
use axum::routing::{get, post};

use super::octrees;
use super::shared::AppState;

pub use figures::Figures;
pub use subscribers::Live;

/// Pages and forms that answer at once.
pub(super) fn router(shared: &AppState) -> Router<AppState> {
    Router::new()
        .route("/", get(list::page))
        .route("/jobs/{id}", get(job::page))
        .route("/view/{name}", get(view::page))
        .route("/jobs/{id}/order", post(orders::one))
        .route("/jobs/order", post(orders::many))
        .route("/queue/order", post(orders::all))
        .layer(from_fn_with_state(shared.clone(), frame::explain))
}

/// Uploads: as long and as large as the configuration allows.
pub(super) fn upload_router(shared: &AppState) -> Router<AppState> {
    Router::new()
        .route("/upload", post(upload::receive).layer(DefaultBodyLimit::disable()))
        .layer(from_fn_with_state(shared.clone(), frame::explain))
}

/// What anybody may have: it tells nothing.
pub(super) fn open_router() -> Router<AppState> {
    Router::new()
        .route("/share/{token}", get(share::page))
        .route("/share/{token}/view", get(view::shared_page))
        .route("/share/{token}/octree/{*path}", get(share::file).layer(octrees::cors()))
        .route("/page/{stamp}/{name}", get(assets::serve))
        .route("/favicon.ico", get(assets::icon))
}
