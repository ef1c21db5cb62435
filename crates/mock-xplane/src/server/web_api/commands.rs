//! Commands over HTTP: listing them, and activating one for a while.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Json;
use axum::extract::{Path, Query, State};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::time::Instant;

use super::WebApiService;
use super::datarefs::{Filters, filtered};
use super::refusal::Refusal;

/// Maximum time to hold down a command, seconds.
const LONGEST_S: f64 = 10.0;

/// Commands that are held down, and until when.
#[derive(Debug, Default)]
pub(super) struct ActiveCommands(Mutex<HashMap<u64, Option<Instant>>>);

impl ActiveCommands {
    /// Holds a command down: for a time, or until it is released.
    pub(super) fn hold(&self, id: u64, time: Option<Duration>) {
        let until = time.map(|time| Instant::now() + time);
        self.lock().insert(id, until);
    }

    pub(super) fn release(&self, id: u64) {
        self.lock().remove(&id);
    }

    pub(super) fn is_held(&self, id: u64) -> bool {
        self.lock()
            .get(&id)
            .is_some_and(|until| until.is_none_or(|until| Instant::now() < until))
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<u64, Option<Instant>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl WebApiService {
    pub(super) fn command(&self, id: u64) -> Result<&'static str, Refusal> {
        self.ids.command(id).ok_or_else(|| {
            Refusal::not_found(
                "invalid_command_id",
                format!("no command has the number {id} in this session"),
            )
        })
    }

    /// Runs a command once and shows it as held down for `duration_s`.
    pub(super) fn activate(&self, id: u64, duration_s: f64) -> Result<(), Refusal> {
        let path = self.command(id)?;
        if !(0.0..=LONGEST_S).contains(&duration_s) {
            return Err(Refusal::bad_request(
                "invalid_duration",
                format!("duration is {duration_s}, expected 0 to {LONGEST_S} seconds"),
            ));
        }
        self.world.lock().command(path);
        self.active
            .hold(id, Some(Duration::from_secs_f64(duration_s)));
        Ok(())
    }
}

pub(super) async fn list(
    State(service): State<Arc<WebApiService>>,
    Query(filters): Filters,
) -> Result<Json<Value>, Refusal> {
    let records = service
        .ids
        .commands()
        .map(|(id, name)| json!({ "id": id, "name": name, "description": description(name) }));
    Ok(Json(json!({ "data": filtered(records, &filters)? })))
}

pub(super) async fn count(State(service): State<Arc<WebApiService>>) -> Json<Value> {
    Json(json!({ "data": service.ids.commands().count() }))
}

/// Body of an activation.
#[derive(Debug, Deserialize)]
pub(super) struct Activation {
    duration: f64,
}

pub(super) async fn activate(
    State(service): State<Arc<WebApiService>>,
    Path(id): Path<u64>,
    Json(Activation { duration }): Json<Activation>,
) -> Result<Json<Value>, Refusal> {
    service.activate(id, duration)?;
    Ok(Json(Value::Null))
}

/// The last part of a command's name, as words.
fn description(name: &str) -> String {
    let last = name.rsplit('/').next().unwrap_or(name);
    last.replace('_', " ")
}
