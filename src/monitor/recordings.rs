//! The recordings of this run over HTTP: a list, each file, and its report. A client names a recording by its number, never a file.

use std::fs::File;
use std::io::{self, Read as _, Take};
use std::sync::Arc;

use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::{Stream, stream};
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::{Value, json};

use super::app_state::AppState;
use super::problem::RequestError;
use super::recorder::{MadeRecording, RecordingControl};
use super::worker::Worker;
use vps::storage::regular;

/// Bytes that are read at once: other work for files waits no longer than for these.
const PIECE_BYTES: u64 = 256 << 10;

/// A report has its styles and pictures inside, and loads nothing.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

pub(super) async fn list(State(state): State<Arc<AppState>>) -> Json<Value> {
    let made = state.hub.recorder.as_ref().map(|recorder| recorder.made()).unwrap_or_default();
    // A disk may take its time to say how long a file is.
    let shown = move || made.iter().map(shown).collect::<Vec<_>>();
    Json(state.files.run(shown).await.unwrap_or_default().into())
}

fn shown(made: &MadeRecording) -> Value {
    let MadeRecording { number, is_under_way, status } = made;
    let mut shown = status.json();
    let bytes = std::fs::metadata(&status.file).ok().filter(|_| !is_under_way).map(|found| found.len());
    shown["number"] = (*number).into();
    shown["name"] = name(made).into();
    shown["is_under_way"] = (*is_under_way).into();
    shown["bytes"] = bytes.into();
    shown["download"] = json!(format!("/api/v1/recordings/{number}"));
    shown["report"] = json!(format!("/api/v1/recordings/{number}/report"));
    shown
}

fn name(made: &MadeRecording) -> String {
    made.status.file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

pub(super) async fn file(State(state): State<Arc<AppState>>, Path(number): Path<u32>) -> Result<Response, RequestError> {
    let (_, made) = ended(&state, number)?;
    let path = made.status.file.clone();
    let opened = state.files.run(move || regular::open(&path).and_then(|file| Ok((file.metadata()?.len(), file)))).await;
    let (n_bytes, file) = match opened {
        Some(Ok(opened)) => opened,
        Some(Err(error)) => return Err(unreadable(&made, &error.to_string())),
        None => return Err(unreadable(&made, "it could not be opened")),
    };
    let name = utf8_percent_encode(&name(&made), NON_ALPHANUMERIC).to_string();
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_LENGTH, n_bytes.to_string()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename*=UTF-8''{name}")),
    ];
    Ok((headers, Body::from_stream(pieces(state.files.clone(), file.take(n_bytes)))).into_response())
}

/// A file piece by piece, each read on the thread for files once the client has taken the one before.
fn pieces(files: Worker, file: Take<File>) -> impl Stream<Item = io::Result<Bytes>> + Send + 'static {
    stream::try_unfold((files, file), async |(files, mut file)| {
        let read = move || {
            let mut piece = Vec::new();
            (&mut file).take(PIECE_BYTES).read_to_end(&mut piece).map(|_| (file, piece))
        };
        let (file, piece) = files.run(read).await.ok_or(io::ErrorKind::Other)??;
        Ok((!piece.is_empty()).then(|| (Bytes::from(piece), (files, file))))
    })
}

pub(super) async fn report(State(state): State<Arc<AppState>>, Path(number): Path<u32>) -> Result<Response, RequestError> {
    let (recorder, made) = ended(&state, number)?;
    let path = made.status.file.clone();
    match state.files.run(move || recorder.report(&path)).await {
        Some(Ok(page)) => {
            let headers = [(header::CONTENT_TYPE, "text/html; charset=utf-8"), (header::CONTENT_SECURITY_POLICY, REPORT_POLICY)];
            Ok((headers, page).into_response())
        }
        Some(Err(error)) => Err(unreadable(&made, &error.to_string())),
        None => Err(unreadable(&made, "the report could not be made")),
    }
}

/// A recording of this run that can be read.
fn ended(state: &AppState, number: u32) -> Result<(Arc<dyn RecordingControl>, MadeRecording), RequestError> {
    let unknown = || RequestError::new(StatusCode::NOT_FOUND, format!("this run has no recording {number}"), "GET /api/v1/recordings lists them");
    let recorder = state.hub.recorder.clone().ok_or_else(unknown)?;
    let made = recorder.made().into_iter().find(|made| made.number == number).ok_or_else(unknown)?;
    if made.is_under_way {
        return Err(RequestError::conflict(format!("{} is under way", name(&made)), "end the recording first"));
    }
    Ok((recorder, made))
}

fn unreadable(made: &MadeRecording, why: &str) -> RequestError {
    RequestError::conflict(format!("{} cannot be read: {why}", name(made)), "")
}
