//! The client's UDP side: reading datarefs by short-lived subscriptions, writing them, sending commands.
//!
//! Datagrams may be lost both ways, so requests are repeated until values arrive, and values that arrive for a subscription that should
//! have ended end it again (`udp_socket`). Every reading uses fresh indices, so that late values are not mistaken for new ones.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, timeout_at};

use crate::datarefs::{RUNNING_TIME_S, VERSION};
use crate::error::BridgeError;
use crate::packet::{
    Command, DatarefValue, LoadAircraft, PlaceAtStart, Position, SubscribeDataref,
    SubscribePosition, ToSimulator, WriteDataref,
};
use crate::udp::socket::{Claim, LocalUdp, SimulatorSocket};
use crate::udp::subscription::{BATCH, BATCH_PAUSE};

/// Delay before a request that brought no value is sent again.
const REPEAT_AFTER: Duration = Duration::from_millis(250);
/// A subscription lives for one value; a high rate brings it soon.
const FREQUENCY_HZ: i32 = 50;
/// Refusals after which no program listens at the address: a single one may belong to a simulator that is just starting.
const MAX_REFUSALS: u32 = 2;
/// Writes sent at once: they must fit the receiver's buffer together.
const WRITES_AT_ONCE: usize = 32;

/// True if a simulator answers at an address within a time. No subscription remains.
pub async fn somebody_answers(address: SocketAddr, within: Duration, local: &LocalUdp) -> bool {
    let Ok(mut udp) = UdpClient::open(address, local).await else {
        return false;
    };
    let came = |values: &[Option<f32>]| values[0].is_some();
    let read = udp
        .read_until(&[VERSION], Instant::now() + within, came)
        .await;
    udp.close().await;
    read.is_ok_and(|values| came(&values))
}

/// Time at which the simulator at an address began to run, by its own clock; `None` if it does not answer in time.
pub(crate) async fn running_since(
    address: SocketAddr,
    within: Duration,
    local: &LocalUdp,
) -> Option<Instant> {
    let mut udp = UdpClient::open(address, local).await.ok()?;
    let came = |values: &[Option<f32>]| values[0].is_some();
    let read = udp
        .read_until(&[RUNNING_TIME_S], Instant::now() + within, came)
        .await;
    let now = Instant::now();
    udp.close().await;
    let running = Duration::try_from_secs_f32(read.ok()?[0]?).ok()?;
    now.checked_sub(running)
}

/// Reading, writing and commanding on the client's socket.
#[derive(Debug)]
pub(super) struct UdpClient {
    socket: Arc<SimulatorSocket>,
}

impl UdpClient {
    /// Opens a socket for the simulator.
    pub(super) async fn open(address: SocketAddr, local: &LocalUdp) -> Result<Self, BridgeError> {
        Ok(Self {
            socket: SimulatorSocket::open(address, local).await?,
        })
    }

    /// The socket, for other readers.
    pub(super) fn socket(&self) -> &Arc<SimulatorSocket> {
        &self.socket
    }

    /// Reads datarefs until all have arrived and `enough` is satisfied, or `deadline` passes; `None` for those that never arrived.
    ///
    /// # Errors
    /// [`BridgeError::NobodyAnswers`] before the deadline if the simulator has never answered and no program listens there.
    pub(super) async fn read_until(
        &mut self,
        names: &[&str],
        deadline: Instant,
        enough: impl Fn(&[Option<f32>]) -> bool,
    ) -> Result<Vec<Option<f32>>, BridgeError> {
        let mut reading = Reading::new(&self.socket, names.len());
        let (began, mut refusals) = (Instant::now(), 0);
        while !enough(&reading.values) && Instant::now() < deadline {
            let missing: Vec<usize> = (0..names.len())
                .filter(|&at| reading.values[at].is_none())
                .collect();
            for batch in missing.chunks(BATCH) {
                for &at in batch {
                    let index = reading.index(at);
                    self.subscribe(FREQUENCY_HZ, index, names[at]).await?;
                }
                if missing.len() > BATCH {
                    let until = deadline.min(Instant::now() + BATCH_PAUSE);
                    reading.listen(until, |_| false).await;
                }
            }
            let until = deadline.min(Instant::now() + REPEAT_AFTER);
            reading.listen(until, &enough).await;
            if self.socket.is_refused().await {
                refusals += 1;
                if refusals == MAX_REFUSALS {
                    return Err(BridgeError::NobodyAnswers {
                        address: self.socket.simulator(),
                        waited: began.elapsed(),
                        refused: true,
                    });
                }
            }
        }
        for (at, name) in names.iter().enumerate() {
            self.subscribe(0, reading.index(at), name).await?;
        }
        Ok(reading.into_values())
    }

    /// Sets datarefs. The values must be read back to confirm.
    pub(super) async fn write<'a>(
        &self,
        writes: impl IntoIterator<Item = (&'a str, f32)>,
    ) -> Result<(), BridgeError> {
        for (at, (path, value)) in writes.into_iter().enumerate() {
            if at % WRITES_AT_ONCE == WRITES_AT_ONCE - 1 {
                sleep(Duration::from_millis(5)).await;
            }
            let path = path.to_owned();
            self.send(&ToSimulator::WriteDataref(WriteDataref { path, value }))
                .await?;
        }
        Ok(())
    }

    /// Runs a command once.
    pub(super) async fn command(&self, path: &str) -> Result<(), BridgeError> {
        self.send(&ToSimulator::Command(Command {
            path: path.to_owned(),
        }))
        .await
    }

    /// Starts a flight in the air.
    pub(super) async fn place_at_start(&self, start: PlaceAtStart) -> Result<(), BridgeError> {
        self.send(&ToSimulator::PlaceAtStart(start)).await
    }

    /// Loads an aircraft.
    pub(super) async fn load_aircraft(&self, load: LoadAircraft) -> Result<(), BridgeError> {
        self.send(&ToSimulator::LoadAircraft(load)).await
    }

    /// Position of the aircraft with full precision: listens until that satisfies `enough` or `deadline` passes, and returns the
    /// last position.
    pub(super) async fn position_until(
        &mut self,
        deadline: Instant,
        enough: impl Fn(&Position) -> bool,
    ) -> Result<Option<Position>, BridgeError> {
        let mut last = None;
        let mut positions = self.socket.positions();
        while Instant::now() < deadline && !last.as_ref().is_some_and(&enough) {
            self.subscribe_position(FREQUENCY_HZ as u32).await?;
            let until = deadline.min(Instant::now() + REPEAT_AFTER);
            while !last.as_ref().is_some_and(&enough) {
                let Some(position) = next(&mut positions, until).await else {
                    break;
                };
                last = Some(position);
            }
        }
        self.subscribe_position(0).await?;
        Ok(last)
    }

    async fn subscribe_position(&self, frequency_hz: u32) -> Result<(), BridgeError> {
        self.send(&ToSimulator::SubscribePosition(SubscribePosition {
            frequency_hz,
        }))
        .await
    }

    /// Listens for a moment for values that still arrive, and ends their subscriptions. None remains.
    pub(super) async fn close(&mut self) {
        self.socket.close().await;
    }

    async fn subscribe(
        &self,
        frequency_hz: i32,
        index: i32,
        path: &str,
    ) -> Result<(), BridgeError> {
        let path = path.to_owned();
        self.send(&ToSimulator::SubscribeDataref(SubscribeDataref {
            frequency_hz,
            index,
            path,
        }))
        .await
    }

    async fn send(&self, packet: &ToSimulator) -> Result<(), BridgeError> {
        self.socket.send(packet).await
    }
}

async fn next(positions: &mut mpsc::Receiver<Position>, until: Instant) -> Option<Position> {
    timeout_at(until, positions.recv()).await.ok().flatten()
}

/// Subscriptions that live for one value. Those that were not ended in order, since the reading was abandoned, end with this: a client
/// that fails half-way must not leave the simulator sending forever.
struct Reading {
    socket: Arc<SimulatorSocket>,
    claim: Claim,
    values: Vec<Option<f32>>,
    is_over: bool,
}

impl Reading {
    fn new(socket: &Arc<SimulatorSocket>, count: usize) -> Self {
        Self {
            socket: socket.clone(),
            claim: socket.claim(count),
            values: vec![None; count],
            is_over: false,
        }
    }

    fn index(&self, at: usize) -> i32 {
        self.claim.first() + at as i32
    }

    /// Receives values until `until`, or until `enough`.
    async fn listen(&mut self, until: Instant, enough: impl Fn(&[Option<f32>]) -> bool) {
        while !enough(&self.values) {
            let Ok(values) = timeout_at(until, self.claim.values()).await else {
                return;
            };
            for DatarefValue { index, value } in values {
                let at = (index - self.claim.first()) as usize;
                self.values[at] = Some(value);
            }
        }
    }

    /// Values received, after all subscriptions were ended.
    fn into_values(mut self) -> Vec<Option<f32>> {
        self.is_over = true;
        std::mem::take(&mut self.values)
    }
}

impl Drop for Reading {
    fn drop(&mut self) {
        if !self.is_over {
            for at in 0..self.values.len() {
                self.socket.end_now(self.index(at));
            }
        }
    }
}
