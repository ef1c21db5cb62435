//! UDP side of the replay.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::time::{MissedTickBehavior, interval};
use xplane_bridge::datarefs::CAPTURE_PORT;
use xplane_bridge::packet::{FromSimulator, ToSimulator};

use super::{Playback, Player};
use crate::server::subscriptions::Subscriptions;
use crate::server::{MockError, UdpSockets};

/// Frame duration, as in the stand-in: values are sent in frames.
const FRAME: Duration = Duration::from_nanos(1_000_000_000 / 60);
/// Maximum warnings about missing entries: clients choose their text.
const MAX_WARNINGS: usize = 100;

/// Serves forever.
pub(super) async fn run(sockets: UdpSockets, player: Arc<Player>) -> Result<(), MockError> {
    let mut server = Server {
        player,
        subscriptions: Subscriptions::default(),
        begin: Instant::now(),
        warned: BTreeSet::new(),
    };
    let mut frames = interval(FRAME);
    frames.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut buffer = vec![0; 65_536];
    loop {
        tokio::select! {
            biased;
            _ = frames.tick() => {
                for (datagram, to) in server.frame() {
                    if let Err(error) = sockets.answering.send_to(&datagram, to).await {
                        tracing::debug!(%to, %error, "datagram not sent");
                    }
                }
            }
            received = sockets.listening.recv_from(&mut buffer) => match received {
                Ok((length, from)) => server.take(&buffer[..length], from),
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => {}
                Err(source) => return Err(MockError::Socket { what: "the UDP server", source }),
            },
        }
    }
}

struct Server {
    player: Arc<Player>,
    subscriptions: Subscriptions,
    begin: Instant,
    /// Missing parts of the tape that were reported.
    warned: BTreeSet<String>,
}

impl Server {
    fn take(&mut self, datagram: &[u8], from: SocketAddr) {
        let now_s = self.begin.elapsed().as_secs_f64();
        self.subscriptions.heard(from, now_s);
        let player = self.player.clone();
        let mut playback = player.playback();
        match ToSimulator::decode(datagram) {
            Ok(ToSimulator::SubscribeDataref(request)) => {
                if request.is_end() || playback.histories.has(&request.path) {
                    self.subscriptions.subscribe(from, request, now_s);
                } else {
                    self.warn(format!(
                        "{} was never read on the tape: no answer",
                        request.path
                    ));
                }
            }
            Ok(ToSimulator::WriteDataref(write)) => {
                playback.context.write(&write.path, write.value);
                if !playback.histories.write(&write.path, write.value) {
                    self.warn(format!(
                        "the tape has no write of {} to {}: it stays as it is",
                        write.value, write.path
                    ));
                }
            }
            Ok(ToSimulator::Command(command)) => {
                if !playback.histories.command(&command.path) {
                    tracing::debug!(
                        path = command.path,
                        "the tape has no such command from here on"
                    );
                }
            }
            Ok(ToSimulator::SubscribePosition(request)) => {
                self.subscriptions
                    .subscribe_position(from, request.frequency_hz, now_s);
            }
            Ok(ToSimulator::PlaceAtStart(_)) => {
                if !playback.positions.place(datagram) {
                    self.warn(
                        "the aircraft was never placed there on the tape: it stays where it is"
                            .into(),
                    );
                }
            }
            Ok(_) => self.warn("only datarefs, commands and places are played from a tape".into()),
            Err(error) => tracing::warn!(%from, %error, "datagram ignored"),
        }
    }

    fn frame(&mut self) -> Vec<(Vec<u8>, SocketAddr)> {
        let now_s = self.begin.elapsed().as_secs_f64();
        let mut playback = self.player.playback();
        let our_port = f32::from(self.player.our_link_port);
        let Playback {
            histories,
            shown_weather,
            positions,
            context,
            ..
        } = &mut *playback;
        let histories = RefCell::new(histories);
        let values = self.subscriptions.due_values(now_s, |reader, path| {
            let recorded = histories.borrow_mut().read(reader, path);
            let value = shown_weather
                .value(context, path)
                .or(recorded)
                .unwrap_or_default();
            if path == CAPTURE_PORT && value > 0.0 {
                our_port
            } else {
                value
            }
        });
        let mut datagrams = Vec::new();
        for (to, values) in values {
            match FromSimulator::DatarefValues(values).encode() {
                Ok(datagram) => datagrams.push((datagram, to)),
                Err(error) => tracing::error!(%error, "values not sent"),
            }
        }
        for to in self.subscriptions.due_positions(now_s) {
            if let Some(datagram) = positions.next() {
                datagrams.push((datagram.to_owned(), to));
            }
        }
        drop(playback);
        self.subscriptions.begin_frame();
        datagrams
    }

    /// Warns once of each thing, as long as there are not too many.
    fn warn(&mut self, what: String) {
        if self.warned.len() < MAX_WARNINGS && !self.warned.contains(&what) {
            tracing::warn!("{what}");
            self.warned.insert(what);
            if self.warned.len() == MAX_WARNINGS {
                tracing::warn!("more that the tape lacks is not named");
            }
        }
    }
}
