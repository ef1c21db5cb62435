//! Reads a tape for replay. Messages of the link stay in the file; only their locations are kept.

use std::collections::{HashMap, VecDeque};
use std::path::Path;

use serde_json::Value;
use xplane_bridge::datarefs::VERSION;
use xplane_bridge::link::LINK_VERSION;
use xplane_bridge::packet::{DatarefValuesView, SubscribeDataref, ToSimulator};
use xplane_tape::{Channel, Direction, Entry, LinkMessage, MessagePosition, TapeError, TapeReader};

use super::conversation::{Context, Conversation};
use super::history::Histories;
use super::positions::Positions;
use super::shown_weather::ShownWeather;

/// The version to report if no client asked for it on the tape: 12.4.0.
const USUAL_VERSION: i32 = 124_009;

/// A tape prepared for replay.
pub(super) struct Loaded {
    pub(super) reader: TapeReader,
    pub(super) histories: Histories,
    pub(super) shown_weather: ShownWeather,
    pub(super) positions: Positions,
    pub(super) conversation: Conversation,
    /// Version of the recorded simulator, 124009 for 12.4.0.
    pub(super) version: i32,
    /// Version of the recorded capture link.
    pub(super) link_version: u32,
}

/// Reads a tape to its end, even if it was cut off.
pub(super) fn load(path: &Path) -> Result<Loaded, TapeError> {
    let mut reader = TapeReader::open(path)?;
    let mut loading = Loading::default();
    while let Some(entry) = reader.next_entry()? {
        let what = entry.channel.topic();
        loading
            .take(entry)
            .map_err(|(sequence, found)| TapeError::BadMessage {
                path: path.to_owned(),
                sequence,
                topic: what,
                found,
            })?;
    }
    if !reader.is_whole() {
        tracing::warn!(path = %path.display(), "the tape has no end: its recorder was killed");
    }
    let histories = loading.histories;
    let version = histories
        .first_value(VERSION)
        .map_or(USUAL_VERSION, |version| version as i32);
    tracing::info!(
        path = %path.display(),
        datarefs = histories.count(),
        requests = loading.conversation.count(),
        positions = loading.positions.count(),
        "tape loaded"
    );
    Ok(Loaded {
        link_version: reader.link_version().unwrap_or(LINK_VERSION),
        reader,
        histories,
        shown_weather: loading.shown_weather,
        positions: loading.positions,
        conversation: loading.conversation,
        version,
    })
}

#[derive(Default)]
struct Loading {
    histories: Histories,
    shown_weather: ShownWeather,
    positions: Positions,
    conversation: Conversation,
    context: Context,
    /// Per client, the dataref of each index.
    subscribed: HashMap<u32, HashMap<i32, String>>,
    /// Unanswered requests by connection.
    open: HashMap<u32, VecDeque<(Value, Context, MessagePosition)>>,
}

/// Number and fault of a message.
type Bad = (u32, String);

impl Loading {
    fn take(&mut self, entry: Entry) -> Result<(), Bad> {
        match entry.channel {
            Channel::Udp {
                client,
                direction: Direction::ToSimulator,
            } => self.said(client, &entry.data),
            Channel::Udp {
                client,
                direction: Direction::FromSimulator,
            } => self.heard(client, entry.data),
            Channel::Link {
                connection,
                direction: Direction::ToSimulator,
            } => return self.asked(connection, entry),
            Channel::Link {
                connection,
                direction: Direction::FromSimulator,
            } => self.answered(connection, entry.place),
        }
        Ok(())
    }

    /// A client's datagram. Datagrams that we do not send have no answer that a replay could give.
    fn said(&mut self, client: u32, datagram: &[u8]) {
        match ToSimulator::decode(datagram) {
            Ok(ToSimulator::SubscribeDataref(request)) => self.subscribe(client, request),
            Ok(ToSimulator::WriteDataref(write)) => {
                self.histories.add_write(&write.path, write.value);
                self.context.write(&write.path, write.value);
            }
            Ok(ToSimulator::Command(command)) => self.histories.add_command(&command.path),
            Ok(ToSimulator::PlaceAtStart(_)) => {
                self.positions.add_placing(datagram);
            }
            _ => {}
        }
    }

    /// Values that arrive after a subscription has ended are outdated, and left out.
    fn subscribe(&mut self, client: u32, request: SubscribeDataref) {
        let numbers = self.subscribed.entry(client).or_default();
        if request.is_end() {
            numbers.remove(&request.index);
        } else {
            numbers.insert(request.index, request.path);
        }
    }

    fn heard(&mut self, client: u32, datagram: Vec<u8>) {
        if let Ok(values) = DatarefValuesView::new(&datagram) {
            let numbers = self.subscribed.entry(client).or_default();
            for value in values.iter() {
                if let Some(path) = numbers.get(&value.index) {
                    self.histories.add_value(client, path, value.value);
                    self.shown_weather
                        .add_value(&self.context, path, value.value);
                }
            }
        } else if datagram.starts_with(b"RPOS") {
            self.positions.add(datagram);
        }
    }

    fn asked(&mut self, connection: u32, entry: Entry) -> Result<(), Bad> {
        let sequence = entry.place.sequence();
        let message = LinkMessage::parse(entry.data).map_err(|bad| (sequence, bad.to_string()))?;
        let request: Value = serde_json::from_slice(message.header())
            .map_err(|error| (sequence, format!("its header is not JSON: {error}")))?;
        if is_hello(&request) {
            self.context.clear();
        }
        let open = self.open.entry(connection).or_default();
        open.push_back((request, self.context.clone(), entry.place));
        Ok(())
    }

    /// Answers come in the order of the requests.
    fn answered(&mut self, connection: u32, place: MessagePosition) {
        let open = self.open.entry(connection).or_default();
        if let Some((request, context, at)) = open.pop_front() {
            self.conversation.add(&request, &context, at, place);
        }
    }
}

/// True if a request opens a conversation; earlier writes belong to an earlier one.
pub(super) fn is_hello(request: &Value) -> bool {
    request
        .get("message")
        .is_some_and(|message| message == "hello")
}
