//! Commands over HTTP: listing them, and activating one for a while.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, Query, State};
use serde::Deserialize;
use serde_json::{Value, json};

use super::WebApiService;
use super::datarefs::{Filters, filtered};
use super::refusal::Refusal;

/// Maximum time to hold down a command, seconds.
const MAX_DURATION_S: f64 = 10.0;

impl WebApiService {
    pub(super) fn command(&self, id: u64) -> Result<&'static str, Refusal> {
        self.ids.command(id).ok_or_else(|| {
            Refusal::not_found(
                "invalid_command_id",
                format!("no command has the number {id} in this session"),
            )
        })
    }
}

pub(super) async fn list(
    State(service): State<Arc<WebApiService>>,
    Query(filters): Filters,
) -> Json<Value> {
    let records = service
        .ids
        .commands()
        .map(|(id, name)| json!({ "id": id, "name": name, "description": description(name) }));
    Json(json!({ "data": filtered(records, &filters) }))
}

#[derive(Debug, Deserialize)]
pub(super) struct Activation {
    duration: f64,
}

pub(super) async fn activate(
    State(service): State<Arc<WebApiService>>,
    Path(id): Path<u64>,
    Json(Activation { duration }): Json<Activation>,
) -> Result<Json<Value>, Refusal> {
    let path = service.command(id)?;
    if !(0.0..=MAX_DURATION_S).contains(&duration) {
        return Err(Refusal::bad_request(
            "invalid_duration",
            format!("duration is {duration}, expected 0 to {MAX_DURATION_S} seconds"),
        ));
    }
    service.world.lock().command(path);
    Ok(Json(Value::Null))
}

/// The last part of a command's name, as words.
fn description(name: &str) -> String {
    let last = name.rsplit('/').next().unwrap_or(name);
    last.replace('_', " ")
}
