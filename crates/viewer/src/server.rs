//! The server: which address gives what.

mod assets;
mod byte_range;
mod doorkeeper;
pub(crate) mod refusal;
mod refusal_page;
mod video_file;

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;

use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Router, middleware};
use dataset::corpus::Corpus;
use doorway::serve_http;
use serde::{Deserialize, Serialize};
use tokio::net::TcpListener;
use tokio::task::spawn_blocking;

use crate::error::ViewError;
use crate::library::Library;
use crate::pictures::planes::{MAX_EVERY, Part};
use crate::pictures::{Form, Picture};
use crate::pictures::{planes, thumbnail};
use crate::run::{Run, Summary};
use crate::{overview, path, scenario_tables};
use doorkeeper::guard;
use refusal::Refusal;

/// Size of an image that is sent as planes, and of a full-resolution part if there is one.
const PICTURE_SIZE: HeaderName = HeaderName::from_static("picture-size");

/// Options of the server.
#[derive(Debug)]
pub struct ViewOptions {
    /// The corpus.
    pub corpus: Corpus,
    /// Folders of runs, or tables of `dtd predict`.
    pub runs: Vec<PathBuf>,
    /// Port on the loopback device; 0 takes any free one.
    pub port: u16,
}

/// Serves the page until the future is dropped; `ready` is called with the address.
///
/// # Errors
/// A run is given twice, or the port is not free.
pub async fn serve(options: ViewOptions, ready: impl FnOnce(SocketAddr)) -> Result<(), ViewError> {
    let ViewOptions { corpus, runs, port } = options;
    let runs = named(&runs)?;
    let cannot_listen = |source| ViewError::Listen { port, source };
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .await
        .map_err(cannot_listen)?;
    let address = listener.local_addr().map_err(cannot_listen)?;
    let library = Arc::new(Library::new(corpus, runs));
    read_ahead(library.clone());
    ready(address);
    match serve_http("the viewer", &listener, router(library, address), true).await {}
}

/// The runs by the names of their folders, numbered where several have the same.
fn named(paths: &[PathBuf]) -> Result<Vec<Run>, ViewError> {
    let real = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    let real: Vec<PathBuf> = paths.iter().map(real).collect();
    let name = |path: &PathBuf| {
        let name = path.file_name().unwrap_or(path.as_os_str());
        name.to_string_lossy().into_owned()
    };
    let names: Vec<String> = real.iter().map(name).collect();
    if let Some(again) = (1..real.len()).find(|&index| real[..index].contains(&real[index])) {
        let run = names[again].clone();
        return Err(ViewError::SameRun { run });
    }
    let run = |(index, path): (usize, &PathBuf)| {
        let name = &names[index];
        let name = match names.iter().filter(|other| *other == name).count() {
            1 => name.clone(),
            _ => format!("{name} ({})", index + 1),
        };
        Run::at(path.clone(), name)
    };
    Ok(paths.iter().enumerate().map(run).collect())
}

/// Reads the runs before the page asks for them.
fn read_ahead(library: Arc<Library>) {
    spawn_blocking(move || {
        for run in &library.runs {
            run.answers();
        }
    });
}

fn router(library: Arc<Library>, address: SocketAddr) -> Router {
    assets::routes()
        .route("/api/corpus", get(corpus))
        .route("/api/runs", get(runs))
        .route("/api/path", get(flown_path))
        .route("/api/scenario", get(scenario))
        .route("/frame", get(frame))
        .route("/thumbnail", get(scenario_thumbnail))
        .route("/video", get(video))
        .fallback(async || Refusal::not_found("there is nothing at this address"))
        .with_state(library)
        .layer(middleware::from_fn_with_state(address.port(), guard))
}

type Answer = Result<Response, Refusal>;
type Asked<T> = Result<Query<T>, QueryRejection>;

/// Scenario query.
#[derive(Debug, Deserialize)]
struct OfScenario {
    scenario: String,
}

/// View query.
#[derive(Debug, Deserialize)]
struct OfView {
    scenario: String,
    view: String,
}

/// Image query.
#[derive(Debug, Deserialize)]
struct OfPicture {
    scenario: String,
    view: String,
    tick: u32,
    #[serde(rename = "as")]
    form: Option<Form>,
    /// Reduction factor for planes.
    every: Option<u32>,
    /// Part sent in full resolution beside reduced planes: left, top, width and height.
    part: Option<String>,
}

async fn corpus(State(library): State<Arc<Library>>) -> Answer {
    blocking(move || json(&overview::read(&library))).await
}

async fn runs(State(library): State<Arc<Library>>) -> Answer {
    let summaries = move || {
        let flown = |id: &str| Some(library.look_into(id).ok()?.files.frames().ok()?.rows);
        let runs = library.runs.iter().map(|run| run.summary(flown));
        let runs: Vec<Summary<'_>> = runs.collect();
        json(&runs)
    };
    blocking(summaries).await
}

async fn flown_path(State(library): State<Arc<Library>>, asked: Asked<OfScenario>) -> Answer {
    let OfScenario { scenario } = understood(asked)?;
    blocking(move || json(&path::read(&*library.look_into(&scenario)?)?)).await
}

async fn scenario(State(library): State<Arc<Library>>, asked: Asked<OfScenario>) -> Answer {
    let OfScenario { scenario } = understood(asked)?;
    blocking(move || {
        let opened = library.open(&scenario)?;
        json(&scenario_tables::read(&library, &opened)?)
    })
    .await
}

async fn scenario_thumbnail(
    State(library): State<Arc<Library>>,
    asked: Asked<OfScenario>,
) -> Answer {
    let OfScenario { scenario } = understood(asked)?;
    let jpeg = thumbnail::read(library, scenario).await?;
    Ok(([(CONTENT_TYPE, "image/jpeg")], jpeg).into_response())
}

async fn frame(State(library): State<Arc<Library>>, asked: Asked<OfPicture>) -> Answer {
    let OfPicture {
        scenario,
        view,
        tick,
        form,
        every,
        part,
    } = understood(asked)?;
    blocking(move || {
        let form = form.unwrap_or(Form::Bitmap);
        let Picture { bytes, size_px } = library.open(&scenario)?.picture(&view, tick, form)?;
        match size_px {
            None => Ok(([(CONTENT_TYPE, "image/bmp")], bytes).into_response()),
            Some(size) => shown_planes(&bytes, size, every.unwrap_or(1), part.as_deref()),
        }
    })
    .await
}

/// Planes for the screen: the whole image, reduced, and optionally a part in full resolution.
fn shown_planes(picture: &[u8], size: [u32; 2], every: u32, part: Option<&str>) -> Answer {
    let wrong = |message: String| Refusal::new(StatusCode::BAD_REQUEST, message);
    if !(1..=MAX_EVERY).contains(&every) {
        let message = format!("every is {every}, expected 1 to {MAX_EVERY}");
        return Err(wrong(message));
    }
    let mut body = Vec::new();
    let [width, height] = planes::reduce(picture, size, every, &mut body);
    let mut sizes = format!("{width}x{height}");
    if let Some(text) = part {
        let [width, height] = size;
        let part = Part::parse(text, size).ok_or_else(|| {
            wrong(format!(
                "part is {text:?}, expected left,top,width,height in {width}x{height} pixels, even numbers"
            ))
        })?;
        planes::cut(picture, size, part, &mut body);
        sizes += &format!(" {}x{}", part.width, part.height);
    }
    let kind = (CONTENT_TYPE, "application/octet-stream".to_owned());
    Ok(([kind, (PICTURE_SIZE, sizes)], body).into_response())
}

async fn video(
    State(library): State<Arc<Library>>,
    headers: HeaderMap,
    asked: Asked<OfView>,
) -> Answer {
    let OfView { scenario, view } = understood(asked)?;
    blocking(move || {
        let opened = library.open(&scenario)?;
        video_file::answer(opened.video(&view)?, &headers)
    })
    .await
}

fn understood<T>(asked: Asked<T>) -> Result<T, Refusal> {
    match asked {
        Ok(Query(asked)) => Ok(asked),
        Err(rejection) => Err(Refusal::new(StatusCode::BAD_REQUEST, rejection)),
    }
}

/// Reads files on a thread that may wait for them.
async fn blocking(read: impl FnOnce() -> Answer + Send + 'static) -> Answer {
    let read = spawn_blocking(read).await;
    read.unwrap_or_else(|error| Err(Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, error)))
}

fn json(value: &impl Serialize) -> Answer {
    let text = serde_json::to_vec(value)
        .map_err(|error| Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, error))?;
    Ok(([(CONTENT_TYPE, "application/json")], text).into_response())
}
