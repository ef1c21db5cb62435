//! A video as the answer to a request, whole or in part.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::http::header::{ACCEPT_RANGES, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE, RANGE};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use dataset::files::outside_file::{self, FileKind};
use futures_util::stream;
use tokio::task::spawn_blocking;

use crate::server::byte_range::Asked;
use crate::server::refusal::Refusal;

/// Bytes that are read at once.
const CHUNK_BYTES: u64 = 1 << 18;

/// Answers with the requested range.
pub(crate) fn answer(path: &Path, headers: &HeaderMap) -> Result<Response, Refusal> {
    let file = outside_file::open(path, FileKind::VIDEO.unlinked())?;
    let about = file.metadata();
    let bytes = about.map_err(dataset::Error::io("read", path))?.len();
    let asked = match headers.get(RANGE).and_then(|range| range.to_str().ok()) {
        Some(range) => Asked::of(range, bytes),
        None => Asked::Whole,
    };
    let all = [
        (CONTENT_TYPE, "video/mp4".to_owned()),
        (ACCEPT_RANGES, "bytes".to_owned()),
    ];
    let (status, part) = match asked {
        Asked::Whole => (StatusCode::OK, 0..bytes),
        Asked::Part(part) => (StatusCode::PARTIAL_CONTENT, part),
        Asked::Outside => {
            let range = [(CONTENT_RANGE, format!("bytes */{bytes}"))];
            return Ok((StatusCode::RANGE_NOT_SATISFIABLE, all, range).into_response());
        }
    };
    let length = [(CONTENT_LENGTH, (part.end - part.start).to_string())];
    let range = (status == StatusCode::PARTIAL_CONTENT).then(|| {
        let last = part.end - 1;
        [(
            CONTENT_RANGE,
            format!("bytes {}-{last}/{bytes}", part.start),
        )]
    });
    let file = Arc::new(file);
    let body = stream::try_unfold(part.start, move |at| {
        let file = file.clone();
        async move {
            let end = part.end.min(at + CHUNK_BYTES);
            if at >= end {
                return Ok(None);
            }
            let read = spawn_blocking(move || read(&file, at, end)).await;
            let chunk = read.map_err(io::Error::other)??;
            Ok::<_, io::Error>(Some((chunk, end)))
        }
    });
    let body = Body::from_stream(body);
    Ok(match range {
        Some(range) => (status, all, length, range, body).into_response(),
        None => (status, all, length, body).into_response(),
    })
}

fn read(file: &File, from: u64, to: u64) -> io::Result<Bytes> {
    let mut chunk = vec![0; (to - from) as usize];
    file.read_exact_at(&mut chunk, from)?;
    Ok(chunk.into())
}
