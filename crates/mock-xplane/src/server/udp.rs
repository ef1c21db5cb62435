//! X-Plane's UDP protocol on a socket: receives packets, and sends due values in every frame.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::time::{MissedTickBehavior, interval};
use xplane_bridge::packet::{FromSimulator, ToSimulator};

use super::faults::disorder::{Disorder, Way};
use super::faults::outages::Outages;
use super::subscriptions::Subscriptions;
use super::{MockError, ServerOptions, Shared, UdpSockets};

/// Duration of the stand-in's frames: 60 per second.
const FRAME: Duration = Duration::from_nanos(1_000_000_000 / 60);
/// Maximum simulated time from one frame to the next, seconds: X-Plane slows down rather than jump.
const MAX_FRAME_S: f64 = 0.25;

/// A datagram, with its source or destination.
type Mail = (Vec<u8>, SocketAddr);

/// Serves until the simulator is told to end.
pub(super) async fn run(
    sockets: UdpSockets,
    world: Shared,
    options: ServerOptions,
    outages: Arc<Outages>,
) -> Result<(), MockError> {
    let mut server = Server {
        sockets,
        world,
        subscriptions: Subscriptions::default(),
        incoming: Disorder::new(&options.faults, Way::In),
        outgoing: Disorder::new(&options.faults, Way::Out),
        begin: Instant::now(),
        last_frame_s: 0.0,
        incoming_is_on: options.incoming,
        clock_rate: options.clock_rate,
    };
    let mut frames = interval(FRAME);
    frames.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut buffer = vec![0; 65_536];
    loop {
        tokio::select! {
            // Frames first: a flood of packets must not stop the simulator.
            biased;
            _ = frames.tick() => {
                outages.count_frame();
                outages.over().await;
                if server.world.lock().quits {
                    return Ok(());
                }
                if let Some(freeze_s) = server.frame().await {
                    outages.freeze_for(Duration::from_secs_f64(freeze_s));
                }
            }
            received = server.sockets.listening.recv_from(&mut buffer) => match received {
                Ok((length, from)) => {
                    outages.over().await;
                    for (datagram, from) in server.incoming.pass((buffer[..length].to_vec(), from)) {
                        server.take(&datagram, from);
                    }
                }
                // Some systems report here that an earlier datagram met a closed port.
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => {}
                Err(source) => return Err(MockError::Socket { what: "the UDP server", source }),
            },
        }
    }
}

struct Server {
    sockets: UdpSockets,
    world: Shared,
    subscriptions: Subscriptions,
    incoming: Disorder<Mail>,
    outgoing: Disorder<Mail>,
    begin: Instant,
    last_frame_s: f64,
    incoming_is_on: bool,
    clock_rate: f64,
}

impl Server {
    fn now_s(&self) -> f64 {
        self.begin.elapsed().as_secs_f64()
    }

    fn take(&mut self, datagram: &[u8], from: SocketAddr) {
        if !self.incoming_is_on {
            tracing::debug!(%from, "datagram ignored: incoming connections are switched off");
            return;
        }
        match ToSimulator::decode(datagram) {
            Ok(packet) => self.obey(packet, from),
            Err(error) => tracing::warn!(%from, %error, "datagram ignored"),
        }
    }

    fn obey(&mut self, packet: ToSimulator, from: SocketAddr) {
        let now_s = self.now_s();
        self.subscriptions.heard(from, now_s);
        match packet {
            ToSimulator::SubscribeDataref(request) => {
                if !request.is_end() {
                    self.world.lock().looked_up(&request.path);
                }
                if !self.subscriptions.subscribe(from, request, now_s) {
                    tracing::debug!(%from, "request lost: too many");
                }
            }
            ToSimulator::WriteDataref(write) => {
                let mut world = self.world.lock();
                world.looked_up(&write.path);
                if let Err(reason) = world.write(&write.path, write.value) {
                    tracing::warn!(%from, path = write.path, value = write.value, %reason, "write ignored");
                }
            }
            ToSimulator::Command(command) => {
                let known = self.world.lock().command(&command.path);
                tracing::debug!(%from, path = command.path, known, "command");
            }
            ToSimulator::SubscribePosition(request) => {
                let frequency_hz = request.frequency_hz;
                if !self
                    .subscriptions
                    .subscribe_position(from, frequency_hz, now_s)
                {
                    tracing::debug!(%from, "request lost: too many");
                }
            }
            ToSimulator::PlaceAtStart(start) if start.plane == 0 => {
                if !self.world.lock().start(&start) {
                    tracing::warn!(%from, ?start, "start ignored: expected type 6");
                }
            }
            ToSimulator::LoadAircraft(load) if load.plane == 0 => {
                self.world.lock().load_aircraft(&load.path);
            }
            ToSimulator::PlaceAtStart(_) | ToSimulator::LoadAircraft(_) => {
                tracing::warn!(%from, "ignored: the only aircraft is the user's");
            }
        }
    }

    /// A frame; returns for how long the simulator freezes after it, seconds.
    async fn frame(&mut self) -> Option<f64> {
        let now_s = self.now_s();
        if let Some((datagram, from)) = self.incoming.pass_time() {
            self.take(&datagram, from);
        }
        let (values, position, freeze_s) = {
            let mut world = self.world.lock();
            let elapsed_s = (now_s - self.last_frame_s).min(MAX_FRAME_S);
            world.advance(elapsed_s * self.clock_rate);
            let values = self
                .subscriptions
                .due_values(now_s, |_, path| world.read(path));
            (values, world.position(), world.take_freeze_s())
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
        if let Some((datagram, client)) = self.outgoing.pass_time() {
            self.put_on_the_wire(&datagram, client).await;
        }
        freeze_s.map(|freeze_s| freeze_s / self.clock_rate)
    }

    async fn send(&mut self, client: SocketAddr, packet: &FromSimulator) {
        match packet.encode() {
            Ok(datagram) => {
                for (datagram, client) in self.outgoing.pass((datagram, client)) {
                    self.put_on_the_wire(&datagram, client).await;
                }
            }
            Err(error) => tracing::error!(%client, %error, "packet not sent"),
        }
    }

    async fn put_on_the_wire(&self, datagram: &[u8], client: SocketAddr) {
        if let Err(error) = self.sockets.answering.send_to(datagram, client).await {
            tracing::debug!(%client, %error, "packet not sent");
        }
    }
}
