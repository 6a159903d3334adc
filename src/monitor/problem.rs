//! What is answered when something cannot be done: a status, a sentence, and what would do.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use crate::daemon::sculpting::OrderError;
use crate::daemon::session::{ControlError, SessionError};
use clay::engine::EngineError;

/// One refusal, the same over HTTP and WebSocket.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct RequestError {
    pub(super) status: StatusCode,
    pub(super) said: ErrorBody,
}

/// Its words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct ErrorBody {
    pub(super) error: String,
    /// Empty where there is nothing to say.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub(super) hint: String,
}

impl RequestError {
    pub(super) fn new(
        status: StatusCode,
        error: impl Into<String>,
        hint: impl Into<String>,
    ) -> Self {
        Self { status, said: ErrorBody { error: error.into(), hint: hint.into() } }
    }

    /// The request makes no sense.
    pub(super) fn bad(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, error, hint)
    }

    /// Not as things stand.
    pub(super) fn conflict(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, error, hint)
    }

    /// Not so many.
    pub(super) fn too_many(error: impl Into<String>) -> Self {
        Self::new(StatusCode::TOO_MANY_REQUESTS, error, "wait for answers, and ask less often")
    }

    /// Not now, or not here.
    pub(super) fn unavailable(error: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, error, hint)
    }
}

impl From<SessionError> for RequestError {
    fn from(error: SessionError) -> Self {
        let (status, hint) = match &error {
            SessionError::UnknownScene { .. }
            | SessionError::Control(
                ControlError::UnknownParameter { .. } | ControlError::UnknownObject { .. },
            ) => (StatusCode::NOT_FOUND, ""),
            SessionError::Control(ControlError::Range { .. } | ControlError::Pose { .. }) => {
                (StatusCode::BAD_REQUEST, "")
            }
            SessionError::Control(ControlError::Full) => {
                (StatusCode::TOO_MANY_REQUESTS, "send at most one per tick")
            }
            SessionError::Baking => (StatusCode::SERVICE_UNAVAILABLE, "wait for the event `scene`"),
            _ => (StatusCode::CONFLICT, ""),
        };
        Self::new(status, error.to_string(), hint)
    }
}

impl From<&OrderError> for RequestError {
    fn from(refused: &OrderError) -> Self {
        let status = match refused {
            OrderError::Engine(EngineError::Length { .. }) => StatusCode::BAD_REQUEST,
            OrderError::Busy => StatusCode::TOO_MANY_REQUESTS,
            OrderError::Engine(_) | OrderError::Over => StatusCode::CONFLICT,
        };
        Self::new(status, refused.to_string(), refused.hint())
    }
}

impl IntoResponse for RequestError {
    fn into_response(self) -> Response {
        (self.status, Json(self.said)).into_response()
    }
}
