//! Answers that say what went wrong.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde_json::json;

use crate::serve::queue::StoreError;

/// An answer that says what went wrong.
pub(super) struct Refusal(StatusCode, String);

impl Refusal {
    pub fn new(status: StatusCode, what: impl Into<String>) -> Refusal {
        Refusal(status, what.into())
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.0, Json(json!({ "error": self.1 }))).into_response()
    }
}

impl From<StoreError> for Refusal {
    fn from(error: StoreError) -> Refusal {
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
        Refusal(status, error.to_string())
    }
}
