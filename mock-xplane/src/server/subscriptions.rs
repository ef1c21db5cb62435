//! Subscriptions of datarefs by clients and rates. Pure: takes the time and the values, returns what to send.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use xplane_bridge::packet::{DatarefValue, DatarefValues, MAX_VALUES_PER_REPLY, SubscribeDataref};

/// Requests accepted in one frame; X-Plane loses the others silently.
pub(super) const REQUESTS_PER_FRAME: usize = 140;

/// All subscriptions of all clients.
#[derive(Debug, Default)]
pub(super) struct Subscriptions {
    datarefs: BTreeMap<SocketAddr, BTreeMap<i32, (String, Rhythm)>>,
    positions: BTreeMap<SocketAddr, Rhythm>,
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
    /// Accepts a request, unless too many came in this frame; returns whether it was accepted.
    pub(super) fn subscribe(
        &mut self,
        from: SocketAddr,
        request: SubscribeDataref,
        now_s: f64,
    ) -> bool {
        self.requests += 1;
        if self.requests > REQUESTS_PER_FRAME {
            return false;
        }
        let client = self.datarefs.entry(from).or_default();
        if request.is_end() {
            client.remove(&request.index);
            if client.is_empty() {
                self.datarefs.remove(&from);
            }
        } else {
            let rhythm = Rhythm::new(f64::from(request.frequency_hz), now_s);
            client.insert(request.index, (request.path, rhythm));
        }
        true
    }

    /// Starts or ends the stream of positions to a client. Some clients end it from another socket than they started it from; then
    /// it ends for all sockets of that computer.
    pub(super) fn subscribe_position(&mut self, from: SocketAddr, frequency_hz: u32, now_s: f64) {
        if frequency_hz > 0 {
            self.positions
                .insert(from, Rhythm::new(f64::from(frequency_hz), now_s));
        } else if self.positions.remove(&from).is_none() {
            self.positions.retain(|client, _| client.ip() != from.ip());
        }
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

    /// The clients to whom a position is due.
    pub(super) fn due_positions(&mut self, now_s: f64) -> Vec<SocketAddr> {
        let due = self.positions.iter_mut();
        due.filter_map(|(client, rhythm)| rhythm.is_due(now_s).then_some(*client))
            .collect()
    }

    /// Number of subscribed datarefs of all clients together.
    pub(super) fn count(&self) -> usize {
        self.datarefs.values().map(BTreeMap::len).sum()
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
}
