//! Subscriptions of datarefs by clients and rates. Pure: takes the time and the values, returns what to send.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};

use xplane_bridge::packet::{DatarefValue, DatarefValues, MAX_VALUES_PER_REPLY, SubscribeDataref};

/// Requests accepted in one frame; X-Plane loses the others silently.
pub(super) const REQUESTS_PER_FRAME: usize = 140;
/// Maximum subscriptions of datarefs and positions, so that clients that never unsubscribe cannot fill the memory.
const MAX_SUBSCRIPTIONS: usize = 100_000;
/// Maximum clients that positions are sent to: each costs a datagram in every frame.
const MAX_POSITION_CLIENTS: usize = 256;
/// Positions are no longer sent to a computer that has been silent for this long, seconds. X-Plane goes on forever.
const SILENCE_S: f64 = 600.0;

/// All subscriptions of all clients.
#[derive(Debug, Default)]
pub(super) struct Subscriptions {
    datarefs: BTreeMap<SocketAddr, BTreeMap<i32, (String, Rhythm)>>,
    positions: BTreeMap<SocketAddr, Rhythm>,
    /// Time of the last packet from each computer that receives positions.
    heard_s: BTreeMap<IpAddr, f64>,
    requests: usize,
}

/// Due times. Times are seconds of any monotonic clock.
#[derive(Debug, Clone, Copy)]
struct Rhythm {
    period_s: f64,
    next_s: f64,
}

impl Rhythm {
    fn new(frequency_hz: f64, now_s: f64) -> Self {
        Self {
            period_s: 1.0 / frequency_hz,
            next_s: now_s,
        }
    }

    fn is_due(&mut self, now_s: f64) -> bool {
        let due = now_s >= self.next_s;
        if due {
            // In step with the first time, but never several at once after a pause.
            self.next_s = (self.next_s + self.period_s).max(now_s);
        }
        due
    }
}

impl Subscriptions {
    /// Notes that a client sent something, whatever it is.
    pub(super) fn heard(&mut self, from: SocketAddr, now_s: f64) {
        if let Some(heard_s) = self.heard_s.get_mut(&from.ip()) {
            *heard_s = now_s;
        }
    }

    /// Accepts a request, unless too many came in this frame or there are too many subscriptions; returns whether it was accepted.
    pub(super) fn subscribe(
        &mut self,
        from: SocketAddr,
        request: SubscribeDataref,
        now_s: f64,
    ) -> bool {
        if !self.is_within_frame() {
            return false;
        }
        if request.is_end() {
            if let Some(client) = self.datarefs.get_mut(&from) {
                client.remove(&request.index);
                if client.is_empty() {
                    self.datarefs.remove(&from);
                }
            }
            return true;
        }
        if self.count() >= MAX_SUBSCRIPTIONS {
            return false;
        }
        let rhythm = Rhythm::new(f64::from(request.frequency_hz), now_s);
        let client = self.datarefs.entry(from).or_default();
        client.insert(request.index, (request.path, rhythm));
        true
    }

    /// Starts or ends the stream of positions to a client, with the same limits and a maximum number of clients; returns whether it was
    /// accepted. Some clients end it from a different socket than they started it from; then it ends for all sockets on that computer.
    pub(super) fn subscribe_position(
        &mut self,
        from: SocketAddr,
        frequency_hz: u32,
        now_s: f64,
    ) -> bool {
        if !self.is_within_frame() {
            return false;
        }
        if frequency_hz > 0 {
            let is_new = !self.positions.contains_key(&from);
            let is_full =
                self.count() >= MAX_SUBSCRIPTIONS || self.positions.len() >= MAX_POSITION_CLIENTS;
            if is_new && is_full {
                return false;
            }
            let rhythm = Rhythm::new(f64::from(frequency_hz), now_s);
            self.positions.insert(from, rhythm);
            self.heard_s.insert(from.ip(), now_s);
        } else if self.positions.remove(&from).is_none() {
            self.positions.retain(|client, _| client.ip() != from.ip());
        }
        true
    }

    fn is_within_frame(&mut self) -> bool {
        self.requests += 1;
        self.requests <= REQUESTS_PER_FRAME
    }

    /// Starts a new frame, which resets the request limit.
    pub(super) fn begin_frame(&mut self) {
        self.requests = 0;
    }

    /// The values that are due, in packets of at most 183.
    pub(super) fn due_values(
        &mut self,
        now_s: f64,
        read: impl Fn(SocketAddr, &str) -> f32,
    ) -> Vec<(SocketAddr, DatarefValues)> {
        let mut packets = Vec::new();
        for (client, subscriptions) in &mut self.datarefs {
            let due = subscriptions
                .iter_mut()
                .filter_map(|(&index, (path, rhythm))| {
                    rhythm.is_due(now_s).then(|| DatarefValue {
                        index,
                        value: read(*client, path),
                    })
                });
            let due: Vec<DatarefValue> = due.collect();
            for values in due.chunks(MAX_VALUES_PER_REPLY) {
                let values = values.to_vec();
                packets.push((*client, DatarefValues { values }));
            }
        }
        packets
    }

    /// The clients to whom a position is due. Ends the streams to computers that are silent.
    pub(super) fn due_positions(&mut self, now_s: f64) -> Vec<SocketAddr> {
        self.heard_s
            .retain(|_, heard_s| now_s - *heard_s < SILENCE_S);
        self.positions
            .retain(|client, _| self.heard_s.contains_key(&client.ip()));
        let due = self.positions.iter_mut();
        due.filter_map(|(client, rhythm)| rhythm.is_due(now_s).then_some(*client))
            .collect()
    }

    /// Number of subscriptions of all clients together.
    fn count(&self) -> usize {
        let datarefs = self.datarefs.values().map(BTreeMap::len);
        datarefs.sum::<usize>() + self.positions.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(port: u16) -> SocketAddr {
        ([127, 0, 0, 1], port).into()
    }

    fn request(frequency_hz: i32, index: i32, path: &str) -> SubscribeDataref {
        SubscribeDataref {
            frequency_hz,
            index,
            path: path.into(),
        }
    }

    fn sent(subscriptions: &mut Subscriptions, now_s: f64) -> usize {
        let packets = subscriptions.due_values(now_s, |_, _| 1.0);
        packets.iter().map(|(_, packet)| packet.values.len()).sum()
    }

    #[test]
    fn a_value_comes_at_the_asked_rate_until_the_subscription_ends() {
        let mut subscriptions = Subscriptions::default();
        subscriptions.subscribe(client(1), request(10, 5, "a"), 0.0);
        let frames = (0..120).map(|frame| sent(&mut subscriptions, f64::from(frame) / 60.0));
        assert_eq!(frames.sum::<usize>(), 20);
        // By index, with an empty path.
        subscriptions.subscribe(client(1), request(10, 5, ""), 2.0);
        assert_eq!(sent(&mut subscriptions, 3.0), 0);
        assert_eq!(subscriptions.count(), 0);
    }

    #[test]
    fn the_same_index_of_two_clients_are_two_subscriptions() {
        let mut subscriptions = Subscriptions::default();
        subscriptions.subscribe(client(1), request(1, 5, "a"), 0.0);
        subscriptions.subscribe(client(2), request(1, 5, "b"), 0.0);
        subscriptions.subscribe(client(1), request(1, 5, "c"), 0.0);
        let packets = subscriptions.due_values(0.0, |_, path| f32::from(path.as_bytes()[0]));
        let values: Vec<_> = packets
            .iter()
            .map(|(to, packet)| (to.port(), packet.values[0].value))
            .collect();
        assert_eq!(values, [(1, f32::from(b'c')), (2, f32::from(b'b'))]);
    }

    #[test]
    fn more_than_140_requests_in_a_frame_are_lost_and_183_values_fill_a_packet() {
        let mut subscriptions = Subscriptions::default();
        let mut taken = 0;
        for index in 0..200 {
            taken += usize::from(subscriptions.subscribe(client(1), request(1, index, "a"), 0.0));
        }
        assert_eq!(taken, 140);
        subscriptions.begin_frame();
        for index in 140..200 {
            assert!(subscriptions.subscribe(client(1), request(1, index, "a"), 0.0));
        }
        let sizes: Vec<_> = subscriptions
            .due_values(0.0, |_, _| 0.0)
            .iter()
            .map(|(_, packet)| packet.values.len())
            .collect();
        assert_eq!(sizes, [183, 17]);
    }

    #[test]
    fn the_stream_of_positions_may_be_stopped_from_another_socket() {
        let mut subscriptions = Subscriptions::default();
        subscriptions.subscribe_position(client(1), 30, 0.0);
        assert_eq!(subscriptions.due_positions(0.0), [client(1)]);
        assert!(subscriptions.due_positions(0.01).is_empty());
        subscriptions.subscribe_position(client(2), 0, 0.02);
        assert!(subscriptions.due_positions(1.0).is_empty());
    }

    #[test]
    fn positions_count_like_datarefs_and_go_to_256_clients() {
        let mut subscriptions = Subscriptions::default();
        for port in 0..256 {
            subscriptions.begin_frame();
            assert!(subscriptions.subscribe_position(client(port), 60, 0.0));
        }
        subscriptions.begin_frame();
        assert!(!subscriptions.subscribe_position(client(256), 60, 0.0));
        assert!(subscriptions.subscribe_position(client(255), 30, 0.0));
        for index in 0..(MAX_SUBSCRIPTIONS - 256) as i32 {
            subscriptions.begin_frame();
            assert!(subscriptions.subscribe(client(0), request(1, index, "a"), 0.0));
        }
        assert_eq!(subscriptions.count(), MAX_SUBSCRIPTIONS);
        assert!(!subscriptions.subscribe(client(0), request(1, -1, "a"), 0.0));
        // An end makes room.
        subscriptions.begin_frame();
        assert!(subscriptions.subscribe_position(client(1), 0, 0.0));
        assert!(subscriptions.subscribe(client(0), request(1, -1, "a"), 0.0));
        assert!(!subscriptions.subscribe_position(client(1), 60, 0.0));
        let mut flood = Subscriptions::default();
        let taken = (0..200).filter(|_| flood.subscribe_position(client(1), 60, 0.0));
        assert_eq!(taken.count(), REQUESTS_PER_FRAME);
    }

    #[test]
    fn positions_end_when_their_computer_is_silent_and_anything_that_it_sends_keeps_them() {
        let mut subscriptions = Subscriptions::default();
        subscriptions.subscribe_position(client(1), 1, 0.0);
        assert_eq!(subscriptions.due_positions(SILENCE_S - 0.1), [client(1)]);
        subscriptions.heard(client(9), SILENCE_S - 0.1);
        assert_eq!(subscriptions.due_positions(SILENCE_S + 1.0), [client(1)]);
        assert!(subscriptions.due_positions(2.0 * SILENCE_S).is_empty());
        assert_eq!(subscriptions.count(), 0);
    }
}
