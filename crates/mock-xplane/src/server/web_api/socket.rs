//! The WebSocket: requests in, results and updates out, ten updates a second with changed values.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::response::Response;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use tokio::time::{Instant, MissedTickBehavior, interval};

use super::refusal::Refusal;
use super::{WebApiService, value};

/// X-Plane sends about ten updates a second.
const PERIOD: Duration = Duration::from_millis(100);
/// A client that was silent for this long is pinged, and has the same time to respond.
const SILENCE: Duration = Duration::from_secs(10);

pub(super) async fn open(
    State(service): State<Arc<WebApiService>>,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Refusal> {
    let room = service.sockets.room().ok_or_else(Refusal::no_room)?;
    let upgrade = upgrade.max_message_size(MOST_MESSAGE_BYTES);
    Ok(upgrade.on_upgrade(|socket| async move {
        let _room = room;
        let mut session = service.session.clone();
        let talk = Client::new(service).talk(socket);
        tokio::select! {
            () = talk => {}
            // Never changes, only ends.
            _ = session.changed() => {}
        }
    }))
}

/// Longest message of a client.
const MOST_MESSAGE_BYTES: usize = 1 << 20;

/// A request.
#[derive(Debug, Deserialize)]
struct Ask {
    req_id: Option<i64>,
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    params: Params,
}

#[derive(Debug, Default, Deserialize)]
struct Params {
    #[serde(default)]
    datarefs: Subjects,
    #[serde(default)]
    commands: Subjects,
}

/// Some, or `"all"` of those that are subscribed.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Subjects {
    Some(Vec<Subject>),
    Named(String),
}

impl Default for Subjects {
    fn default() -> Self {
        Self::Some(Vec::new())
    }
}

#[derive(Debug, Deserialize)]
struct Subject {
    id: u64,
    index: Option<Indices>,
    value: Option<Value>,
    is_active: Option<bool>,
    duration: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Indices {
    One(usize),
    Several(Vec<usize>),
}

impl Indices {
    fn list(&self) -> Vec<usize> {
        match self {
            Self::One(index) => vec![*index],
            Self::Several(list) => list.clone(),
        }
    }
}

/// A client's subscriptions, and the values it was sent last.
struct Client {
    service: Arc<WebApiService>,
    /// Elements of a dataref, or none for all of it.
    datarefs: BTreeMap<u64, (BTreeSet<usize>, Option<Value>)>,
    commands: BTreeMap<u64, Option<bool>>,
}

impl Client {
    fn new(service: Arc<WebApiService>) -> Self {
        Self {
            service,
            datarefs: BTreeMap::new(),
            commands: BTreeMap::new(),
        }
    }

    /// Runs until the client leaves.
    async fn talk(mut self, mut socket: WebSocket) {
        let mut ticks = interval(PERIOD);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut heard = Instant::now();
        let mut was_asked = false;
        loop {
            let messages = tokio::select! {
                received = socket.recv() => {
                    (heard, was_asked) = (Instant::now(), false);
                    match received {
                        Some(Ok(Message::Text(text))) => {
                            self.service.outages.over().await;
                            vec![self.answer(&text)]
                        }
                        Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                        Some(Ok(_)) => continue,
                    }
                }
                _ = ticks.tick() => {
                    if heard.elapsed() > 2 * SILENCE {
                        return;
                    }
                    if heard.elapsed() > SILENCE && !was_asked {
                        was_asked = true;
                        if socket.send(Message::Ping(Bytes::new())).await.is_err() {
                            return;
                        }
                    }
                    self.service.outages.over().await;
                    self.updates()
                }
            };
            for message in messages {
                let text = message.to_string().into();
                if socket.send(Message::Text(text)).await.is_err() {
                    return;
                }
            }
        }
    }

    fn answer(&mut self, text: &str) -> Value {
        let ask: Ask = match serde_json::from_str(text) {
            Ok(ask) => ask,
            Err(error) => {
                let req_id = serde_json::from_str::<Value>(text)
                    .ok()
                    .and_then(|ask| ask.get("req_id").cloned());
                return result(
                    req_id,
                    Err(Refusal::bad_request("invalid_json", error.to_string())),
                );
            }
        };
        let outcome = self.obey(&ask);
        result(ask.req_id.map(Value::from), outcome)
    }

    fn obey(&mut self, ask: &Ask) -> Result<(), Refusal> {
        let (datarefs, commands) = (&ask.params.datarefs, &ask.params.commands);
        match ask.kind.as_str() {
            "dataref_subscribe_values" => self.subscribe_datarefs(some(datarefs)?),
            "dataref_unsubscribe_values" => self.unsubscribe_datarefs(datarefs),
            "dataref_set_values" => self.set_values(some(datarefs)?),
            "command_subscribe_is_active" => {
                for subject in some(commands)? {
                    self.service.command(subject.id)?;
                    self.commands.insert(subject.id, None);
                }
                Ok(())
            }
            "command_unsubscribe_is_active" => {
                match commands {
                    Subjects::Named(_) => self.commands.clear(),
                    Subjects::Some(list) => {
                        for subject in list {
                            self.commands.remove(&subject.id);
                        }
                    }
                }
                Ok(())
            }
            "command_set_is_active" => self.hold_commands(some(commands)?),
            other => Err(Refusal::bad_request(
                "unknown_type",
                format!("there is no request of type {other:?}"),
            )),
        }
    }

    fn subscribe_datarefs(&mut self, list: &[Subject]) -> Result<(), Refusal> {
        for subject in list {
            let name = self.service.dataref(subject.id)?;
            let length = self
                .service
                .world
                .lock()
                .datarefs()
                .find(name)
                .map_or(0, |(_, values)| values.len());
            let wanted = subject.index.iter().flat_map(Indices::list);
            if let Some(index) = wanted.clone().find(|index| *index >= length) {
                return Err(Refusal::bad_request(
                    "invalid_index",
                    format!("{name} has {length} elements, and no index {index}"),
                ));
            }
            let (indices, told) = self.datarefs.entry(subject.id).or_default();
            // Further elements are added to those already subscribed.
            indices.extend(wanted);
            *told = None;
        }
        Ok(())
    }

    fn unsubscribe_datarefs(&mut self, subjects: &Subjects) -> Result<(), Refusal> {
        let Subjects::Some(list) = subjects else {
            self.datarefs.clear();
            return Ok(());
        };
        for subject in list {
            let Some((indices, _)) = self.datarefs.get_mut(&subject.id) else {
                continue;
            };
            for index in subject.index.iter().flat_map(Indices::list) {
                indices.remove(&index);
            }
            if subject.index.is_none() || indices.is_empty() {
                self.datarefs.remove(&subject.id);
            }
        }
        Ok(())
    }

    fn set_values(&self, list: &[Subject]) -> Result<(), Refusal> {
        for subject in list {
            let name = self.service.dataref(subject.id)?;
            let index = match &subject.index {
                None => None,
                Some(Indices::One(index)) => Some(*index),
                Some(Indices::Several(_)) => {
                    return Err(Refusal::bad_request(
                        "invalid_index",
                        "a value is set at one index or at none",
                    ));
                }
            };
            let data = subject.value.as_ref().unwrap_or(&Value::Null);
            value::write(&mut self.service.world.lock(), name, index, data)?;
        }
        Ok(())
    }

    fn hold_commands(&self, list: &[Subject]) -> Result<(), Refusal> {
        for Subject {
            id,
            is_active,
            duration,
            ..
        } in list
        {
            match (is_active, duration) {
                (Some(true), Some(duration_s)) => self.service.activate(*id, *duration_s)?,
                (Some(true), None) => {
                    self.service.activate(*id, 0.0)?;
                    self.service.active.hold(*id, None);
                }
                (Some(false), _) => {
                    self.service.command(*id)?;
                    self.service.active.release(*id);
                }
                (None, _) => {
                    return Err(Refusal::bad_request(
                        "missing_parameter",
                        "is_active is missing",
                    ));
                }
            }
        }
        Ok(())
    }

    /// Messages with everything that has changed since the last ones.
    fn updates(&mut self) -> Vec<Value> {
        let mut messages = Vec::new();
        let mut values = Map::new();
        let world = self.service.world.lock();
        for (id, (indices, told)) in &mut self.datarefs {
            let found = self.service.ids.dataref(*id);
            let Some((dataref, current)) = found.and_then(|name| world.datarefs().find(name))
            else {
                continue;
            };
            let current = if indices.is_empty() {
                value::whole(dataref, current)
            } else {
                value::elements(dataref, current, indices.iter().copied()).into()
            };
            if told.as_ref() != Some(&current) {
                values.insert(id.to_string(), current.clone());
                *told = Some(current);
            }
        }
        drop(world);
        if !values.is_empty() {
            messages.push(json!({ "type": "dataref_update_values", "data": values }));
        }
        let mut states = Map::new();
        for (id, told) in &mut self.commands {
            let held = self.service.active.is_held(*id);
            if *told != Some(held) {
                states.insert(id.to_string(), json!(held));
                *told = Some(held);
            }
        }
        if !states.is_empty() {
            messages.push(json!({ "type": "command_update_is_active", "data": states }));
        }
        messages
    }
}

fn some(subjects: &Subjects) -> Result<&[Subject], Refusal> {
    match subjects {
        Subjects::Some(list) if !list.is_empty() => Ok(list),
        Subjects::Some(_) => Err(Refusal::bad_request(
            "missing_parameter",
            "nothing is named",
        )),
        Subjects::Named(word) => Err(Refusal::bad_request(
            "invalid_parameter",
            format!("{word:?} can only be unsubscribed from"),
        )),
    }
}

fn result(req_id: Option<Value>, outcome: Result<(), Refusal>) -> Value {
    let mut answer = json!({ "type": "result", "success": outcome.is_ok() });
    if let Some(req_id) = req_id {
        answer["req_id"] = req_id;
    }
    if let Err(refusal) = outcome {
        answer["error_code"] = json!(refusal.code);
        answer["error_message"] = json!(refusal.message);
    }
    answer
}
