//! Files that this run made, sent to clients piece by piece.

use std::fs::File;
use std::io::{self, Read as _, Take};
use std::path::{Path, PathBuf};

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use futures_util::{Stream, stream};
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};

use super::problem::RequestError;
use super::worker::Worker;
use vps::storage::regular;

/// Bytes that are read at once: other work for files waits no longer than for these.
const PIECE_BYTES: u64 = 256 << 10;

/// A file as an answer. Its path comes from this run, never from a client.
pub(super) async fn send(files: &Worker, path: PathBuf) -> Result<Response, RequestError> {
    let name = name_of(&path);
    let opened = files
        .run(move || regular::open(&path).and_then(|file| Ok((file.metadata()?.len(), file))))
        .await;
    let unreadable =
        |why: String| RequestError::conflict(format!("{name} cannot be read: {why}"), "");
    let (n_bytes, file) = match opened {
        Some(opened) => opened.map_err(|error| unreadable(error.to_string()))?,
        None => return Err(unreadable("it could not be opened".to_owned())),
    };
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_LENGTH, n_bytes.to_string()),
        (
            header::CONTENT_DISPOSITION,
            format!(
                "attachment; filename*=UTF-8''{}",
                utf8_percent_encode(&name, NON_ALPHANUMERIC)
            ),
        ),
    ];
    Ok((headers, Body::from_stream(pieces(files.clone(), file.take(n_bytes)))).into_response())
}

/// A file piece by piece, each read on the thread for files once the client has taken the one
/// before.
fn pieces(
    files: Worker,
    file: Take<File>,
) -> impl Stream<Item = io::Result<Bytes>> + Send + 'static {
    stream::try_unfold((files, file), async |(files, mut file)| {
        let read = move || {
            let mut piece = Vec::new();
            (&mut file).take(PIECE_BYTES).read_to_end(&mut piece).map(|_| (file, piece))
        };
        let (file, piece) = files.run(read).await.ok_or(io::ErrorKind::Other)??;
        Ok((!piece.is_empty()).then(|| (Bytes::from(piece), (files, file))))
    })
}

pub(super) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Bytes of a file that is there.
pub(super) fn length(path: &Path) -> Option<u64> {
    std::fs::metadata(path).ok().map(|found| found.len())
}
