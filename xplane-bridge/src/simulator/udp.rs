//! The client's UDP side: reading datarefs by short-lived subscriptions, writing them, sending commands.
//!
//! Datagrams may be lost both ways, so requests are repeated until values arrive, and values that arrive for a subscription that should
//! have ended end it again (`udp_socket`). Every reading uses fresh indices, so that late values are not mistaken for new ones.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, timeout_at};

use crate::datarefs::{CAPTURE_PORT, RUNNING_TIME_S, VERSION};
use crate::error::{BridgeError, Silence};
use crate::packet::{
    Command, DatarefValue, Position, SubscribeDataref, SubscribePosition, ToSimulator, WriteDataref,
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
    asked(address, VERSION, within, local).await.is_some()
}

/// Port of the capture link that the simulator at an address announces; `None` if none is announced in time.
pub async fn announced_link_port(
    address: SocketAddr,
    within: Duration,
    local: &LocalUdp,
) -> Option<u16> {
    let (port, _) = asked(address, CAPTURE_PORT, within, local).await?;
    (1.0..=f32::from(u16::MAX))
        .contains(&port)
        .then_some(port as u16)
}

/// Time at which the simulator at an address began to run, by its own clock; `None` if it does not answer in time.
pub(crate) async fn running_since(
    address: SocketAddr,
    within: Duration,
    local: &LocalUdp,
) -> Option<Instant> {
    let (running_s, at) = asked(address, RUNNING_TIME_S, within, local).await?;
    at.checked_sub(Duration::try_from_secs_f32(running_s).ok()?)
}

/// A value of the simulator at an address, and when it came. No subscription remains.
async fn asked(
    address: SocketAddr,
    name: &str,
    within: Duration,
    local: &LocalUdp,
) -> Option<(f32, Instant)> {
    let udp = SimulatorSocket::open(address, local).await.ok()?;
    let read = udp.read_one(name, within, |_| true).await;
    let at = Instant::now();
    udp.close().await;
    Some((read.ok()??, at))
}

impl SimulatorSocket {
    /// Reads a dataref until it is as wanted; returns the last value.
    pub(super) async fn read_one(
        self: &Arc<Self>,
        name: &str,
        within: Duration,
        wanted: impl Fn(f32) -> bool,
    ) -> Result<Option<f32>, BridgeError> {
        let enough = |values: &[Option<f32>]| values[0].is_some_and(&wanted);
        let deadline = Instant::now() + within;
        Ok(self.read_until(&[name], deadline, enough).await?[0])
    }

    /// Reads datarefs once.
    pub(super) async fn read_all(
        self: &Arc<Self>,
        names: &[&str],
        within: Duration,
    ) -> Result<Vec<Option<f32>>, BridgeError> {
        let all = |values: &[Option<f32>]| values.iter().all(Option::is_some);
        self.read_until(names, Instant::now() + within, all).await
    }

    /// Reads datarefs until all have arrived and `enough` is satisfied, or `deadline` passes; `None` for those that never arrived.
    ///
    /// # Errors
    /// [`BridgeError::NobodyAnswers`] before the deadline if the simulator has never answered and no program listens there.
    pub(super) async fn read_until(
        self: &Arc<Self>,
        names: &[&str],
        deadline: Instant,
        enough: impl Fn(&[Option<f32>]) -> bool,
    ) -> Result<Vec<Option<f32>>, BridgeError> {
        let mut reading = Reading {
            claim: self.claim(names.len()),
            values: vec![None; names.len()],
        };
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
            if self.is_refused().await {
                refusals += 1;
                if refusals == MAX_REFUSALS {
                    return Err(BridgeError::NobodyAnswers {
                        address: self.simulator(),
                        waited: began.elapsed(),
                        silence: Silence::Refused,
                    });
                }
            }
        }
        for (at, name) in names.iter().enumerate() {
            self.subscribe(0, reading.index(at), name).await?;
        }
        reading.claim.was_ended();
        Ok(reading.values)
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

    /// Position of the aircraft with full precision: listens until that satisfies `enough` or `deadline` passes, and returns the
    /// last position.
    pub(super) async fn position_until(
        &self,
        deadline: Instant,
        enough: impl Fn(&Position) -> bool,
    ) -> Result<Option<Position>, BridgeError> {
        let mut last = None;
        let mut positions = self.positions();
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
}

async fn next(positions: &mut mpsc::Receiver<Position>, until: Instant) -> Option<Position> {
    timeout_at(until, positions.recv()).await.ok().flatten()
}

/// Subscriptions that live for one value.
struct Reading {
    claim: Claim,
    values: Vec<Option<f32>>,
}

impl Reading {
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
}
