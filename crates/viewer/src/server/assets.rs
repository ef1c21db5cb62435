//! The page's own files, part of the program.

use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Router, http::HeaderValue};

const HTML: &str = "text/html; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const ICON: &str = "image/svg+xml";

macro_rules! page {
    ($name:literal) => {
        include_str!(concat!("../../page/", $name))
    };
}

/// Address, kind and content of each file.
const FILES: [(&str, &str, &str); 21] = [
    ("/", HTML, page!("index.html")),
    ("/icon.svg", ICON, page!("icon.svg")),
    ("/family.css", STYLE, report_page::page::STYLE),
    ("/view.css", STYLE, page!("view.css")),
    ("/app.js", SCRIPT, page!("app.js")),
    ("/chart.js", SCRIPT, page!("chart.js")),
    ("/colours.js", SCRIPT, page!("colours.js")),
    ("/dom.js", SCRIPT, page!("dom.js")),
    ("/flight.js", SCRIPT, page!("flight.js")),
    ("/flight-charts.js", SCRIPT, page!("flight-charts.js")),
    ("/flown.js", SCRIPT, page!("flown.js")),
    ("/link.js", SCRIPT, page!("link.js")),
    ("/path-colours.js", SCRIPT, page!("path-colours.js")),
    ("/picture.js", SCRIPT, page!("picture.js")),
    ("/playback.js", SCRIPT, page!("playback.js")),
    ("/readout.js", SCRIPT, page!("readout.js")),
    ("/runs.js", SCRIPT, page!("runs.js")),
    ("/scenario.js", SCRIPT, page!("scenario.js")),
    ("/scenarios.js", SCRIPT, page!("scenarios.js")),
    ("/thumbnails.js", SCRIPT, page!("thumbnails.js")),
    ("/units.js", SCRIPT, page!("units.js")),
];

/// Routes to all assets.
pub(crate) fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let route = |router: Router<S>, (path, kind, content): (&'static str, _, _)| {
        router.route(path, get(async move || answer(kind, content)))
    };
    FILES.into_iter().fold(Router::new(), route)
}

fn answer(kind: &'static str, content: &'static str) -> Response {
    ([(CONTENT_TYPE, HeaderValue::from_static(kind))], content).into_response()
}
