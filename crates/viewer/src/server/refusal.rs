//! Answers to requests that cannot be fulfilled: a status, and a sentence for the page to show.

use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use serde_json::json;

/// Reason why a request was refused.
#[derive(Debug, Clone)]
pub(crate) struct Refusal {
    pub(crate) status: StatusCode,
    pub(crate) message: String,
}

impl Refusal {
    pub(crate) fn new(status: StatusCode, message: impl ToString) -> Self {
        Self {
            status,
            message: message.to_string(),
        }
    }

    pub(crate) fn not_found(message: impl ToString) -> Self {
        Self::new(StatusCode::NOT_FOUND, message)
    }

    pub(crate) fn forbidden(message: impl ToString) -> Self {
        Self::new(StatusCode::FORBIDDEN, message)
    }
}

impl From<dataset::Error> for Refusal {
    /// Status: 404 if missing, 503 for a passing error, otherwise 422 (present but damaged).
    fn from(error: dataset::Error) -> Self {
        let status = if error.is_not_found() {
            StatusCode::NOT_FOUND
        } else if error.is_passing() {
            StatusCode::SERVICE_UNAVAILABLE
        } else {
            StatusCode::UNPROCESSABLE_ENTITY
        };
        Self::new(status, error)
    }
}

impl IntoResponse for Refusal {
    /// JSON for the scripts of the page. The refusal goes along, so that it can become a page for a person.
    fn into_response(self) -> Response {
        let json = Json(json!({ "error": self.message }));
        (self.status, Extension(self), json).into_response()
    }
}
