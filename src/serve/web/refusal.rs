//! Answers that say what went wrong.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde_json::json;

use crate::serve::queue::StoreError;

/// An answer that says what went wrong.
pub(super) struct ApiError(StatusCode, String);

impl ApiError {
    pub fn new(status: StatusCode, what: impl Into<String>) -> ApiError {
        ApiError(status, what.into())
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        (self.0, Json(json!({ "error": self.1 }))).into_response()
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> ApiError {
        let status = match &error {
            StoreError::NoSuchJob(_) => StatusCode::NOT_FOUND,
            StoreError::Illegal { .. } => StatusCode::CONFLICT,
            StoreError::Open { .. }
            | StoreError::Missing { .. }
            | StoreError::Outdated { .. }
            | StoreError::NotAQueue { .. }
            | StoreError::Migrate { .. }
            | StoreError::Query(_)
            | StoreError::Unknown { .. } => {
                tracing::error!(%error, "an API request failed");
                StatusCode::SERVICE_UNAVAILABLE
            }
        };
        ApiError(status, error.to_string())
    }
}
