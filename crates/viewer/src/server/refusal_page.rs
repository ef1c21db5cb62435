//! Refusals as a page, for people who opened the address in a browser.

use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use report_page::page::{page_titled, value};
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
    let heading = "dtd view does not show this";
    match page_titled("dtd view: not shown", heading, TEMPLATE, value(values)) {
        Ok(page) => {
            let kind = [(CONTENT_TYPE, "text/html; charset=utf-8")];
            (refusal.status, kind, page).into_response()
        }
        Err(error) => Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, error).into_response(),
    }
}
