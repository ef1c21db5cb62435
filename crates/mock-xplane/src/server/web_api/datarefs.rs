//! Datarefs over HTTP: listing, reading and setting them.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, Query, State};
use serde::Deserialize;
use serde_json::{Value, json};

use super::refusal::Refusal;
use super::{WebApiService, value};

/// List filters: `filter[name]` may occur several times.
pub(super) type Filters = Query<Vec<(String, String)>>;

/// The records that pass the filters.
pub(super) fn filtered(
    records: impl Iterator<Item = Value>,
    filters: &[(String, String)],
) -> Value {
    let names: Vec<&str> = names(filters).collect();
    records
        .filter(|record| names.is_empty() || names.iter().any(|&name| record["name"] == name))
        .collect()
}

fn names(filters: &[(String, String)]) -> impl Iterator<Item = &str> {
    let named = filters.iter().filter(|(key, _)| key == "filter[name]");
    named.map(|(_, name)| name.as_str())
}

impl WebApiService {
    /// The list of datarefs: empty until a flight is loaded.
    fn dataref_records(&self) -> Vec<Value> {
        let world = self.world.lock();
        if !world.flight_loaded {
            return Vec::new();
        }
        let records = self.ids.datarefs().filter_map(|(id, name)| {
            let (dataref, _) = world.datarefs().find(name)?;
            Some(json!({
                "id": id,
                "name": name,
                "value_type": value::type_word(dataref),
                "is_writable": dataref.writable,
            }))
        });
        records.collect()
    }

    pub(super) fn dataref(&self, id: u64) -> Result<&'static str, Refusal> {
        let mut world = self.world.lock();
        let known = self.ids.dataref(id).filter(|_| world.flight_loaded);
        if let Some(name) = known {
            world.looked_up(name);
        }
        known.ok_or_else(|| {
            Refusal::not_found(
                "invalid_dataref_id",
                format!("no dataref has the number {id} in this session"),
            )
        })
    }
}

pub(super) async fn list(
    State(service): State<Arc<WebApiService>>,
    Query(filters): Filters,
) -> Json<Value> {
    for name in names(&filters) {
        service.world.lock().looked_up(name);
    }
    let data = filtered(service.dataref_records().into_iter(), &filters);
    Json(json!({ "data": data }))
}

pub(super) async fn count(State(service): State<Arc<WebApiService>>) -> Json<Value> {
    Json(json!({ "data": service.dataref_records().len() }))
}

#[derive(Debug, Deserialize)]
pub(super) struct Element {
    index: Option<usize>,
}

pub(super) async fn read(
    State(service): State<Arc<WebApiService>>,
    Path(id): Path<u64>,
    Query(Element { index }): Query<Element>,
) -> Result<Json<Value>, Refusal> {
    let name = service.dataref(id)?;
    let world = service.world.lock();
    let missing = || Refusal::not_found("invalid_dataref_id", "no such dataref");
    let (dataref, values) = world.datarefs().find(name).ok_or_else(missing)?;
    let data = match index {
        None => value::whole(dataref, values),
        Some(index) => value::element(dataref, values, index).ok_or_else(|| {
            Refusal::bad_request("invalid_index", format!("{name} has no element {index}"))
        })?,
    };
    Ok(Json(json!({ "data": data })))
}

#[derive(Debug, Deserialize)]
pub(super) struct Write {
    data: Value,
}

pub(super) async fn write(
    State(service): State<Arc<WebApiService>>,
    Path(id): Path<u64>,
    Query(Element { index }): Query<Element>,
    Json(Write { data }): Json<Write>,
) -> Result<Json<Value>, Refusal> {
    let name = service.dataref(id)?;
    value::write(&mut service.world.lock(), name, index, &data)?;
    Ok(Json(Value::Null))
}
