//! The client's UDP side: reading datarefs by short-lived subscriptions, writing them, sending commands.
//!
//! Datagrams may be lost both ways, so requests are repeated until values arrive, and values that arrive for a subscription that
//! should have ended end it again. Every reading uses fresh indices, so that a late value of an earlier reading is not mistaken for
//! a new one.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::time::{Instant, sleep, timeout_at};

use crate::datarefs::VERSION;
use crate::error::BridgeError;
use crate::packet::{
    Command, DatarefValue, DatarefValuesView, FromSimulator, LoadAircraft, PlaceAtStart, Position,
    SubscribeDataref, SubscribePosition, ToSimulator, WriteDataref,
};
use crate::subscription::{BATCH, BATCH_PAUSE, end_of};
use crate::udp_socket::{is_refused, open};

/// Delay before a request that brought no value is sent again.
const REPEAT_AFTER: Duration = Duration::from_millis(250);
/// A subscription lives for one value; a high rate brings it soon.
const FREQUENCY_HZ: i32 = 50;
/// How long to listen on exit for values of subscriptions whose end was lost.
const LEAVE_PAUSE: Duration = Duration::from_millis(60);
/// Writes sent at once: they must fit the receiver's buffer together.
const WRITES_AT_ONCE: usize = 32;

/// Whether a simulator answers at an address within a time. Nothing stays subscribed.
pub async fn somebody_answers(address: SocketAddr, within: Duration) -> bool {
    let Ok(mut udp) = UdpClient::bind(address).await else {
        return false;
    };
    let came = |values: &[Option<f32>]| values[0].is_some();
    let read = udp
        .read_until(&[VERSION], Instant::now() + within, came)
        .await;
    udp.unsubscribe_all().await;
    read.is_ok_and(|values| came(&values))
}

/// A UDP socket connected to the simulator, and what is subscribed on it.
#[derive(Debug)]
pub(super) struct UdpClient {
    socket: UdpSocket,
    address: SocketAddr,
    next_index: i32,
    active: BTreeSet<i32>,
}

impl UdpClient {
    /// Opens a socket towards the simulator. Sends nothing yet.
    pub(super) async fn bind(address: SocketAddr) -> Result<Self, BridgeError> {
        let socket = open(address).await?;
        Ok(Self {
            socket,
            address,
            next_index: 1,
            active: BTreeSet::new(),
        })
    }

    /// Reads datarefs until all have arrived and `enough` is satisfied, or `deadline` passes; `None` for those that never arrived.
    pub(super) async fn read_until(
        &mut self,
        names: &[&str],
        deadline: Instant,
        enough: impl Fn(&[Option<f32>]) -> bool,
    ) -> Result<Vec<Option<f32>>, BridgeError> {
        let first = self.next_index;
        // Far from the end of i32 within any run, and never 0, which clients use for "all".
        self.next_index = first.checked_add(names.len() as i32).unwrap_or(1);
        let mut values = vec![None; names.len()];
        let indices: BTreeMap<i32, usize> =
            (0..names.len()).map(|at| (first + at as i32, at)).collect();
        self.active.extend(indices.keys());
        while !enough(&values) && Instant::now() < deadline {
            let missing: Vec<usize> = (0..names.len())
                .filter(|&at| values[at].is_none())
                .collect();
            for batch in missing.chunks(BATCH) {
                for &at in batch {
                    self.subscribe(FREQUENCY_HZ, first + at as i32, names[at])
                        .await?;
                }
                if missing.len() > BATCH {
                    let until = deadline.min(Instant::now() + BATCH_PAUSE);
                    self.listen(until, &indices, &mut values, |_| false).await?;
                }
            }
            let until = deadline.min(Instant::now() + REPEAT_AFTER);
            self.listen(until, &indices, &mut values, &enough).await?;
        }
        for (&index, &at) in &indices {
            self.subscribe(0, index, names[at]).await?;
            self.active.remove(&index);
        }
        Ok(values)
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

    /// Loads another aircraft.
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
        let mut buffer = [0; 2048];
        while Instant::now() < deadline && !last.as_ref().is_some_and(&enough) {
            self.subscribe_position(FREQUENCY_HZ as u32).await?;
            let until = deadline.min(Instant::now() + REPEAT_AFTER);
            while !last.as_ref().is_some_and(&enough) {
                let Some(length) = self.receive(until, &mut buffer).await? else {
                    break;
                };
                if let Ok(FromSimulator::Position(position)) =
                    FromSimulator::decode(&buffer[..length])
                {
                    last = Some(position);
                }
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

    /// The next datagram, `None` if none comes until a moment.
    async fn receive(
        &self,
        until: Instant,
        buffer: &mut [u8],
    ) -> Result<Option<usize>, BridgeError> {
        loop {
            match timeout_at(until, self.socket.recv(buffer)).await {
                Err(_) => return Ok(None),
                Ok(Ok(length)) => return Ok(Some(length)),
                Ok(Err(error)) if is_refused(&error) => sleep(Duration::from_millis(50)).await,
                Ok(Err(source)) => {
                    return Err(BridgeError::Udp {
                        address: self.address,
                        source,
                    });
                }
            }
        }
    }

    /// Ends all subscriptions, and listens for a moment whether something still arrives.
    pub(super) async fn unsubscribe_all(&mut self) {
        let _ = self.subscribe_position(0).await;
        for index in std::mem::take(&mut self.active) {
            let _ = self.socket.send(&end_datagram(index)).await;
        }
        let until = Instant::now() + LEAVE_PAUSE;
        let _ = self
            .listen(until, &BTreeMap::new(), &mut [], |_| false)
            .await;
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
        match self.socket.send(&packet.encode()?).await {
            Ok(_) => Ok(()),
            // "Connection refused" is the answer to an earlier datagram: nobody listens, perhaps not yet.
            Err(error) if is_refused(&error) => Ok(()),
            Err(source) => Err(BridgeError::Udp {
                address: self.address,
                source,
            }),
        }
    }

    /// Receives values until `until`, or until `enough`.
    async fn listen(
        &mut self,
        until: Instant,
        indices: &BTreeMap<i32, usize>,
        values: &mut [Option<f32>],
        enough: impl Fn(&[Option<f32>]) -> bool,
    ) -> Result<(), BridgeError> {
        let mut buffer = [0; 2048];
        while !enough(values) {
            let Some(length) = self.receive(until, &mut buffer).await? else {
                return Ok(());
            };
            match DatarefValuesView::new(&buffer[..length]) {
                Ok(reply) => {
                    for DatarefValue { index, value } in reply.iter() {
                        match indices.get(&index) {
                            Some(&at) => values[at] = Some(value),
                            None if !self.active.contains(&index) => {
                                let _ = self.socket.try_send(&end_datagram(index));
                            }
                            None => {}
                        }
                    }
                }
                Err(error) => tracing::debug!(address = %self.address, %error, "datagram ignored"),
            }
        }
        Ok(())
    }
}

impl Drop for UdpClient {
    /// A client that fails half-way must not leave the simulator sending forever.
    fn drop(&mut self) {
        for &index in &self.active {
            let _ = self.socket.try_send(&end_datagram(index));
        }
    }
}

/// The datagram that ends a subscription by its number alone.
fn end_datagram(index: i32) -> Vec<u8> {
    ToSimulator::SubscribeDataref(end_of(index))
        .encode()
        .unwrap_or_default()
}
