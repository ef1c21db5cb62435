//! A refusal as a page, for a person who opened the address in a browser: what was wrong, and how to get to the corpus.

use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use report_page::page::{render, value};
use serde::Serialize;

use crate::server::refusal::Refusal;

const TEMPLATE: &str = include_str!("../../page/refusal.html");

#[derive(Serialize)]
struct Values<'a> {
    message: &'a str,
    /// True if the host or the origin was wrong: a tunnel helps.
    is_forbidden: bool,
    port: u16,
}

/// The page. `port` is the server's.
pub(crate) fn answer(refusal: &Refusal, port: u16) -> Response {
    let values = Values {
        message: &refusal.message,
        is_forbidden: refusal.status == StatusCode::FORBIDDEN,
        port,
    };
    match render(TEMPLATE, value(values)) {
        Ok(page) => {
            let kind = [(CONTENT_TYPE, "text/html; charset=utf-8")];
            (refusal.status, kind, page).into_response()
        }
        Err(error) => Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, error).into_response(),
    }
}
