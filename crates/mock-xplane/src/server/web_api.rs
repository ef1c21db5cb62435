//! X-Plane 12's Web API: datarefs, commands and flights over HTTP, without the WebSocket.
//!
//! Input: requests of clients on this computer. Output: JSON. `v1` has datarefs, `v2` adds commands, `v3` flights; the world behind
//! it is the same as for UDP and the capture link. Written from Laminar's "X-Plane Web API" and "Flight Initialization API".

mod callers;
mod commands;
mod datarefs;
mod flight;
mod flight_form;
mod ids;
mod refusal;
mod value;

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Request, State};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use doorway::serve_http;
use serde_json::json;
use tokio::net::TcpListener;
use tokio::time::timeout;

use self::ids::Ids;
use self::refusal::Refusal;
use super::faults::outages::Outages;
use super::{MockError, Shared};

/// Time limit for a request after its head, with its answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(10);

/// Shared by all requests.
struct WebApiService {
    world: Shared,
    outages: Arc<Outages>,
    incoming_is_on: bool,
    ids: Ids,
}

/// Accepts clients forever. `session` is a number that no earlier session had.
pub(super) async fn run(
    listener: Arc<TcpListener>,
    world: Shared,
    incoming_is_on: bool,
    session: u64,
    outages: Arc<Outages>,
) -> Result<(), MockError> {
    let ids = Ids::new(session, world.lock().datarefs());
    let service = Arc::new(WebApiService {
        world,
        outages,
        incoming_is_on,
        ids,
    });
    match serve_http("the Web API", &listener, router(service), false).await {}
}

fn router(service: Arc<WebApiService>) -> Router {
    let one = Router::new()
        .route("/datarefs", get(datarefs::list))
        .route("/datarefs/count", get(datarefs::count))
        .route(
            "/datarefs/{id}/value",
            get(datarefs::read).patch(datarefs::write),
        );
    let two = one
        .clone()
        .route("/commands", get(commands::list))
        .route("/command/{id}/activate", post(commands::activate));
    let three = two.clone().route("/flight", post(flight::start));
    Router::new()
        .route("/api/capabilities", get(capabilities))
        .nest("/api/v1", one)
        .nest("/api/v2", two)
        .nest("/api/v3", three)
        .fallback(async || Refusal::not_found("unknown_endpoint", "there is no such endpoint"))
        .layer(middleware::from_fn_with_state(service.clone(), doorkeeper))
        .with_state(service)
}

/// No answers during an outage, while incoming traffic is switched off, or to foreign web pages.
async fn doorkeeper(
    State(service): State<Arc<WebApiService>>,
    request: Request,
    next: Next,
) -> Response {
    service.outages.over().await;
    if !service.incoming_is_on {
        return Refusal::incoming_traffic_is_off().into_response();
    }
    if let Err(refusal) = callers::check(request.headers()) {
        return refusal.into_response();
    }
    timeout(ANSWER_WITHIN, next.run(request))
        .await
        .unwrap_or_else(|_late| Refusal::too_slow().into_response())
}

async fn capabilities(State(service): State<Arc<WebApiService>>) -> Response {
    let version = service.world.lock().version_text();
    Json(json!({
        "api": { "versions": ["v1", "v2", "v3"] },
        "x-plane": { "version": version },
    }))
    .into_response()
}
