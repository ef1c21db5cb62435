//! RTP packets in their order, and the reports of their sender's clock (RFC 3550).

use std::ops::Range;

/// Packets that came so many after their place are late or come twice; further back, the sender has started again.
const MAX_LATE: u16 = 100;
/// Packets that wait for an earlier one: a key frame may have some hundreds.
const MAX_HELD: usize = 1_000;
/// Seconds between the beginnings of NTP's and Unix time.
const NTP_S: f64 = 2_208_988_800.0;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Packet {
    bytes: Vec<u8>,
    payload: Range<usize>,
}

impl Packet {
    /// Reads a packet; `None` for anything else.
    pub(crate) fn of(bytes: Vec<u8>) -> Option<Self> {
        let first = *bytes.first().filter(|first| **first >> 6 == 2)?;
        let mut from = 12 + 4 * usize::from(first & 0xf);
        if first & 0x10 != 0 {
            let words = bytes.get(from + 2..from + 4)?;
            from += 4 + 4 * usize::from(u16::from_be_bytes([words[0], words[1]]));
        }
        let padding = if first & 0x20 == 0 { 0 } else { *bytes.last()? };
        let to = bytes.len().checked_sub(usize::from(padding))?;
        (from <= to).then_some(Self {
            bytes,
            payload: from..to,
        })
    }

    #[cfg(test)]
    pub(super) fn made(sequence: u16, timestamp: u32, is_last: bool, payload: &[u8]) -> Self {
        let mut bytes = vec![0x80, 96 | u8::from(is_last) << 7];
        bytes.extend(sequence.to_be_bytes());
        bytes.extend(timestamp.to_be_bytes());
        bytes.extend([0, 0, 0, 7]);
        bytes.extend(payload);
        Self::of(bytes).unwrap()
    }

    pub(crate) fn payload(&self) -> &[u8] {
        &self.bytes[self.payload.clone()]
    }

    pub(crate) fn payload_type(&self) -> u8 {
        self.bytes[1] & 0x7f
    }

    /// The marker bit: the last packet of an image.
    pub(crate) fn is_last(&self) -> bool {
        self.bytes[1] & 0x80 != 0
    }

    fn sequence(&self) -> u16 {
        u16::from_be_bytes([self.bytes[2], self.bytes[3]])
    }

    pub(crate) fn timestamp(&self) -> u32 {
        u32_at(&self.bytes, 4)
    }

    fn sender(&self) -> u32 {
        u32_at(&self.bytes, 8)
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4]
        .iter()
        .fold(0, |sum, byte| sum << 8 | u32::from(*byte))
}

/// Brings packets into the order in which they were sent.
#[derive(Debug)]
pub(crate) struct Order {
    /// Time to wait for a packet that is missing, s.
    most_wait_s: f64,
    sender: Option<u32>,
    next: u16,
    /// Packets after a gap, with their arrivals.
    held: Vec<(Packet, f64)>,
    has_begun_anew: bool,
}

impl Order {
    pub(crate) fn new(most_wait_s: f64) -> Self {
        Self {
            most_wait_s,
            sender: None,
            next: 0,
            held: Vec::new(),
            has_begun_anew: false,
        }
    }

    pub(crate) fn put(&mut self, packet: Packet, now_s: f64) {
        let sequence = packet.sequence();
        let late = self.next.wrapping_sub(sequence);
        let is_behind = (1..0x8000).contains(&late);
        let is_other = self.sender != Some(packet.sender());
        if is_other || is_behind && late > MAX_LATE {
            self.has_begun_anew = self.sender.replace(packet.sender()).is_some();
            self.held.clear();
            self.next = sequence;
        } else if is_behind
            || self
                .held
                .iter()
                .any(|(held, _)| held.sequence() == sequence)
        {
            return;
        }
        self.held.push((packet, now_s));
    }

    /// The next packet, and if packets before it are lost.
    pub(crate) fn next(&mut self, now_s: f64) -> Option<(Packet, bool)> {
        let gaps = self
            .held
            .iter()
            .map(|(held, _)| held.sequence().wrapping_sub(self.next));
        let (gap, index) = gaps.zip(0..).min()?;
        let oldest_s = self
            .held
            .iter()
            .map(|(_, came_s)| *came_s)
            .fold(now_s, f64::min);
        let must_wait = now_s - oldest_s < self.most_wait_s && self.held.len() < MAX_HELD;
        if gap > 0 && must_wait {
            return None;
        }
        let (packet, _) = self.held.swap_remove(index);
        self.next = packet.sequence().wrapping_add(1);
        let has_loss = std::mem::take(&mut self.has_begun_anew) || gap > 0;
        Some((packet, has_loss))
    }
}

/// A sender's report: UTC of its clock in seconds, and the timestamp at that time.
pub(crate) fn sender_report(mut bytes: &[u8]) -> Option<(f64, u32)> {
    while bytes.len() >= 4 {
        let words = usize::from(u16::from_be_bytes([bytes[2], bytes[3]]));
        let (packet, rest) = bytes.split_at_checked(4 + 4 * words)?;
        if packet[1] == 200 && packet.len() >= 20 {
            let [seconds, parts] = [8, 12].map(|at| f64::from(u32_at(packet, at)));
            let utc_s = seconds - NTP_S + parts / 2_f64.powi(32);
            return Some((utc_s, u32_at(packet, 16)));
        }
        bytes = rest;
    }
    None
}

/// Timestamps that do not begin again after 2^32 units.
#[derive(Debug, Default)]
pub(crate) struct Timeline(Option<i64>);

impl Timeline {
    /// The place of a timestamp, which is the nearest to those before.
    pub(crate) fn place(&mut self, timestamp: u32) -> i64 {
        let last = *self.0.get_or_insert(i64::from(timestamp));
        last + i64::from(timestamp.wrapping_sub(last as u32) as i32)
    }

    pub(crate) fn advance(&mut self, timestamp: u32) -> i64 {
        let here = self.place(timestamp);
        self.0 = Some(here);
        here
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(sequence: u16, timestamp: u32, is_last: bool, payload: &[u8]) -> Packet {
        Packet::made(sequence, timestamp, is_last, payload)
    }

    /// Puts these packets at 1 ms intervals; returns sequence numbers with losses before them.
    fn ordered(sequences: &[u16], most_wait_s: f64) -> Vec<(u16, bool)> {
        let mut order = Order::new(most_wait_s);
        let mut all = Vec::new();
        for (at, sequence) in sequences.iter().enumerate() {
            let now_s = at as f64 * 1e-3;
            order.put(packet(*sequence, 5, false, &[]), now_s);
            while let Some((packet, has_loss)) = order.next(now_s) {
                all.push((packet.sequence(), has_loss));
            }
        }
        all
    }

    #[test]
    fn packets_that_overtake_others_are_put_back_and_lost_ones_are_told() {
        let sound = |sequences: &[u16]| sequences.iter().map(|of| (*of, false)).collect::<Vec<_>>();
        let swapped = ordered(&[65_534, 0, 65_535, 0, 2, 1, 3], 0.06);
        assert_eq!(swapped, sound(&[65_534, 65_535, 0, 1, 2, 3]));
        let lost = ordered(&[1, 2, 4, 5, 6, 7, 8, 3], 0.003);
        assert_eq!(
            lost,
            [
                (1, false),
                (2, false),
                (4, true),
                (5, false),
                (6, false),
                (7, false),
                (8, false)
            ]
        );
        let at_once = ordered(&[1, 3, 2, 4], 0.0);
        assert_eq!(at_once, [(1, false), (3, true), (4, false)]);
        let anew = ordered(&[5_000, 5_001, 7, 8], 0.06);
        assert_eq!(
            anew,
            [(5_000, false), (5_001, false), (7, true), (8, false)]
        );
    }

    #[test]
    fn a_packet_is_what_stands_between_its_extensions_and_its_padding() {
        let bytes = [
            &[0xb1, 0xe0, 0, 9, 0, 0, 0, 5, 0, 0, 0, 7][..],
            &[1; 4],
            &[0, 0, 0, 1],
            &[2; 4],
            b"ab",
            &[0, 2],
        ];
        let packet = Packet::of(bytes.concat()).unwrap();
        assert_eq!((packet.payload(), packet.payload_type()), (&b"ab"[..], 96));
        assert!(packet.is_last() && packet.timestamp() == 5);
        for bytes in [
            vec![],
            vec![0x80; 11],
            vec![0; 40],
            vec![0xb1; 20],
            vec![0xa0; 40],
        ] {
            assert_eq!(Packet::of(bytes.clone()), None, "{bytes:?}");
        }
    }

    #[test]
    fn a_report_has_the_senders_clock_and_timestamps_go_on_after_their_end() {
        let report = [
            &[0x80, 200, 0, 6, 0, 0, 0, 7][..],
            &2_208_988_801_u32.to_be_bytes(),
            &[0x80, 0, 0, 0],
            &[0, 0, 0, 9],
            &[0; 8],
        ];
        let report = report.concat();
        assert_eq!(sender_report(&report), Some((1.5, 9)));
        assert_eq!(
            sender_report(&[&[0x80, 201, 0, 0], &report[..]].concat()),
            Some((1.5, 9))
        );
        assert_eq!(sender_report(&report[..20]), None);
        let mut times = Timeline::default();
        assert_eq!(times.advance(u32::MAX - 1), i64::from(u32::MAX) - 1);
        assert_eq!(times.advance(3), i64::from(u32::MAX) + 4);
        assert_eq!(times.place(u32::MAX), i64::from(u32::MAX));
    }
}
