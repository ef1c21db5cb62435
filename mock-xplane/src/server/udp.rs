//! X-Plane's UDP protocol on a socket: takes packets, and sends in every frame what is due.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use tokio::net::UdpSocket;
use tokio::time::{MissedTickBehavior, interval};
use xplane_bridge::packet::{FromSimulator, ToSimulator};

use super::subscriptions::Subscriptions;
use super::{MockError, Shared};

/// Length of a frame of the stand-in: 60 a second.
const FRAME: Duration = Duration::from_nanos(1_000_000_000 / 60);
/// Subscriptions kept at most, so that clients that never unsubscribe cannot fill the memory.
const MAX_SUBSCRIPTIONS: usize = 100_000;

/// Serves for ever.
pub(super) async fn run(socket: UdpSocket, world: Shared) -> Result<(), MockError> {
    let mut server = Server {
        socket,
        world,
        subscriptions: Subscriptions::default(),
        begin: Instant::now(),
        last_frame_s: 0.0,
    };
    let mut frames = interval(FRAME);
    frames.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut buffer = vec![0; 65_536];
    loop {
        tokio::select! {
            // Frames first: a flood of packets must not stop the simulator.
            biased;
            _ = frames.tick() => server.frame().await,
            received = server.socket.recv_from(&mut buffer) => match received {
                Ok((length, from)) => server.take(&buffer[..length], from),
                // Some systems report here that an earlier datagram met a closed port.
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => {}
                Err(source) => return Err(MockError::Socket { what: "the UDP server", source }),
            },
        }
    }
}

struct Server {
    socket: UdpSocket,
    world: Shared,
    subscriptions: Subscriptions,
    begin: Instant,
    last_frame_s: f64,
}

impl Server {
    fn now_s(&self) -> f64 {
        self.begin.elapsed().as_secs_f64()
    }

    fn take(&mut self, datagram: &[u8], from: SocketAddr) {
        match ToSimulator::decode(datagram) {
            Ok(packet) => self.obey(packet, from),
            Err(error) => tracing::warn!(%from, %error, "datagram ignored"),
        }
    }

    fn obey(&mut self, packet: ToSimulator, from: SocketAddr) {
        let now_s = self.now_s();
        match packet {
            ToSimulator::SubscribeDataref(request) => {
                let full = !request.is_end() && self.subscriptions.count() >= MAX_SUBSCRIPTIONS;
                if full || !self.subscriptions.subscribe(from, request, now_s) {
                    tracing::debug!(%from, full, "request lost: too many");
                }
            }
            ToSimulator::WriteDataref(write) => {
                if let Err(reason) = self.world.lock().write(&write.path, write.value) {
                    tracing::warn!(%from, path = write.path, value = write.value, %reason, "write ignored");
                }
            }
            ToSimulator::Command(command) => {
                let known = self.world.lock().command(&command.path);
                tracing::debug!(%from, path = command.path, known, "command");
            }
            ToSimulator::SubscribePosition(request) => {
                self.subscriptions
                    .subscribe_position(from, request.frequency_hz, now_s);
            }
            ToSimulator::PlaceAircraft(place) if place.plane == 0 => {
                self.world.lock().place(&place);
            }
            ToSimulator::PlaceAtStart(start) if start.plane == 0 => {
                if !self.world.lock().start(&start) {
                    tracing::warn!(%from, start_type = start.start_type, "start ignored: only type 6 is known");
                }
            }
            ToSimulator::PlaceAircraft(_) | ToSimulator::PlaceAtStart(_) => {
                tracing::warn!(%from, "ignored: there is no aircraft but the user's");
            }
        }
    }

    async fn frame(&mut self) {
        let now_s = self.now_s();
        let (values, position) = {
            let mut world = self.world.lock();
            world.advance(now_s - self.last_frame_s);
            let values = self
                .subscriptions
                .due_values(now_s, |path| world.read(path));
            (values, world.position())
        };
        self.last_frame_s = now_s;
        self.subscriptions.begin_frame();
        for (client, packet) in values {
            self.send(client, &FromSimulator::DatarefValues(packet))
                .await;
        }
        for client in self.subscriptions.due_positions(now_s) {
            self.send(client, &FromSimulator::Position(position)).await;
        }
    }

    async fn send(&self, client: SocketAddr, packet: &FromSimulator) {
        let sent = match packet.encode() {
            Ok(datagram) => self.socket.send_to(&datagram, client).await.map(drop),
            Err(error) => Err(std::io::Error::other(error)),
        };
        if let Err(error) = sent {
            tracing::debug!(%client, %error, "packet not sent");
        }
    }
}
