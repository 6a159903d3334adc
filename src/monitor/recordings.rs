//! The recordings of this run over HTTP: a list, each file, and its report. A client names a
//! recording by its number, never a file.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::app_state::AppState;
use super::download::{length, name_of, send};
use super::problem::RequestError;
use super::recorder::{MadeRecording, RecordingControl};

/// A report has its styles and pictures inside, and loads nothing.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; \
    frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

pub(super) async fn list(State(state): State<Arc<AppState>>) -> Json<Value> {
    let made = state.hub.recorder.as_ref().map(|recorder| recorder.made()).unwrap_or_default();
    // A disk may take its time to say how long a file is.
    let shown = move || made.iter().map(shown).collect::<Vec<_>>();
    Json(state.files.run(shown).await.unwrap_or_default().into())
}

fn shown(made: &MadeRecording) -> Value {
    let MadeRecording { number, is_under_way, status } = made;
    let mut shown = status.json();
    let bytes = length(&status.file).filter(|_| !is_under_way);
    shown["number"] = (*number).into();
    shown["name"] = name_of(&status.file).into();
    shown["is_under_way"] = (*is_under_way).into();
    shown["bytes"] = bytes.into();
    shown["download"] = json!(format!("/api/v1/recordings/{number}"));
    shown["report"] = json!(format!("/api/v1/recordings/{number}/report"));
    shown
}

pub(super) async fn file(
    State(state): State<Arc<AppState>>,
    Path(number): Path<u32>,
) -> Result<Response, RequestError> {
    let (_, made) = ended(&state, number)?;
    send(&state.files, made.status.file).await
}

pub(super) async fn report(
    State(state): State<Arc<AppState>>,
    Path(number): Path<u32>,
) -> Result<Response, RequestError> {
    let (recorder, made) = ended(&state, number)?;
    let path = made.status.file.clone();
    match state.files.run(move || recorder.report(&path)).await {
        Some(Ok(page)) => {
            let headers = [
                (header::CONTENT_TYPE, "text/html; charset=utf-8"),
                (header::CONTENT_SECURITY_POLICY, REPORT_POLICY),
            ];
            Ok((headers, page).into_response())
        }
        Some(Err(error)) => Err(unreadable(&made, &error.to_string())),
        None => Err(unreadable(&made, "the report could not be made")),
    }
}

/// A recording of this run that can be read.
fn ended(
    state: &AppState,
    number: u32,
) -> Result<(Arc<dyn RecordingControl>, MadeRecording), RequestError> {
    let unknown = || {
        RequestError::new(
            StatusCode::NOT_FOUND,
            format!("this run has no recording {number}"),
            "GET /api/v1/recordings lists them",
        )
    };
    let recorder = state.hub.recorder.clone().ok_or_else(unknown)?;
    let made =
        recorder.made().into_iter().find(|made| made.number == number).ok_or_else(unknown)?;
    if made.is_under_way {
        return Err(RequestError::conflict(
            format!("{} is under way", name_of(&made.status.file)),
            "end the recording first",
        ));
    }
    Ok((recorder, made))
}

fn unreadable(made: &MadeRecording, why: &str) -> RequestError {
    RequestError::conflict(format!("{} cannot be read: {why}", name_of(&made.status.file)), "")
}
