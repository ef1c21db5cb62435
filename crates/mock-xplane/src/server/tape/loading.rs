//! Reads a tape for replay. Messages of the link stay in the file; only their locations are kept.

use std::collections::{HashMap, VecDeque};
use std::path::Path;

use serde_json::Value;
use xplane_bridge::datarefs::VERSION;
use xplane_bridge::link::LINK_VERSION;
use xplane_bridge::packet::{DatarefValue, FromSimulator, SubscribeDataref, ToSimulator};
use xplane_tape::{Direction, Entry, LinkMessage, MessagePosition, TapeError, TapeReader, Traffic};

use super::Playback;
use super::conversation::Context;

/// The version to report if no client asked for it on the tape: 12.4.0.
const USUAL_VERSION: i32 = 124_009;

/// A tape prepared for replay.
pub(super) struct Loaded {
    pub(super) reader: TapeReader,
    pub(super) playback: Playback,
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
        let (sequence, topic) = (entry.place.sequence(), entry.channel.topic());
        loading.take(entry).map_err(|found| {
            let tape = path.display();
            TapeError::BadInput(format!(
                "tape {tape}: message {sequence} on {topic}: {found}"
            ))
        })?;
    }
    if !reader.is_whole() {
        tracing::warn!(path = %path.display(), "the tape has no end: its recorder was killed");
    }
    let playback = Playback {
        context: Context::default(),
        ..loading.playback
    };
    let version = playback
        .histories
        .first_value(VERSION)
        .map_or(USUAL_VERSION, |version| version as i32);
    tracing::info!(
        path = %path.display(),
        datarefs = playback.histories.count(),
        requests = playback.conversation.count(),
        positions = playback.positions.count(),
        "tape loaded"
    );
    Ok(Loaded {
        link_version: reader.link_version().unwrap_or(LINK_VERSION),
        reader,
        playback,
        version,
    })
}

#[derive(Default)]
struct Loading {
    playback: Playback,
    /// Per client, the dataref of each index.
    subscribed: HashMap<u32, HashMap<i32, String>>,
    /// Unanswered requests by connection.
    open: HashMap<u32, VecDeque<(Value, Context, MessagePosition)>>,
}

impl Loading {
    /// Takes one entry; the error says what is wrong with it.
    fn take(&mut self, entry: Entry) -> Result<(), String> {
        let number = entry.channel.number;
        match (entry.channel.traffic, entry.channel.direction) {
            (Traffic::Udp, Direction::ToSimulator) => self.said(number, &entry.data),
            (Traffic::Udp, Direction::FromSimulator) => self.heard(number, entry.data),
            (Traffic::Link, Direction::ToSimulator) => return self.asked(number, entry),
            (Traffic::Link, Direction::FromSimulator) => self.answered(number, entry.place),
        }
        Ok(())
    }

    fn said(&mut self, client: u32, datagram: &[u8]) {
        match ToSimulator::decode(datagram) {
            Ok(ToSimulator::SubscribeDataref(request)) => self.subscribe(client, request),
            Ok(ToSimulator::WriteDataref(write)) => {
                self.playback.histories.add_write(&write.path, write.value);
                self.playback.context.write(&write.path, write.value);
            }
            Ok(ToSimulator::Command(command)) => self.playback.histories.add_command(&command.path),
            Ok(ToSimulator::PlaceAtStart(_)) => {
                self.playback.positions.add_placing(datagram);
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
        if let Ok(FromSimulator::DatarefValues(received)) = FromSimulator::decode(&datagram) {
            let numbers = self.subscribed.entry(client).or_default();
            let playback = &mut self.playback;
            for DatarefValue { index, value } in received.values {
                if let Some(path) = numbers.get(&index) {
                    playback.histories.add_value(client, path, value);
                    playback
                        .shown_weather
                        .add_value(&playback.context, path, value);
                }
            }
        } else if datagram.starts_with(b"RPOS") {
            self.playback.positions.add(datagram);
        }
    }

    fn asked(&mut self, connection: u32, entry: Entry) -> Result<(), String> {
        let message = LinkMessage::parse(entry.data).map_err(|bad| bad.to_string())?;
        let request: Value = serde_json::from_slice(message.header())
            .map_err(|error| format!("its header is not JSON: {error}"))?;
        if is_hello(&request) {
            self.playback.context.clear();
        }
        let open = self.open.entry(connection).or_default();
        open.push_back((request, self.playback.context.clone(), entry.place));
        Ok(())
    }

    /// Answers come in the order of the requests.
    fn answered(&mut self, connection: u32, place: MessagePosition) {
        let open = self.open.entry(connection).or_default();
        if let Some((request, context, at)) = open.pop_front() {
            self.playback
                .conversation
                .add(&request, &context, at, place);
        }
    }
}

/// True if a request opens a conversation; earlier writes belong to an earlier one.
pub(super) fn is_hello(request: &Value) -> bool {
    request
        .get("message")
        .is_some_and(|message| message == "hello")
}
