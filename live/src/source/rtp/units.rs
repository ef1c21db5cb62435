//! Coded images from the payloads of packets: H.264 (RFC 6184), H.265 (RFC 7798), JPEG (RFC 2435).
//!
//! The marker bit ends an image; without it, the next timestamp does.

use super::jpeg;
use super::packets::Packet;
use super::sdp::Coding;

pub(crate) const START_CODE: [u8; 4] = [0, 0, 0, 1];
/// Bytes of the largest image: a sender that ends none must not fill the memory.
const MAX_BYTES: usize = 16 << 20;

/// A coded image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Unit {
    pub(crate) timestamp: u32,
    pub(crate) data: Vec<u8>,
    /// Parts of it, or an image before it, are lost.
    pub(crate) is_damaged: bool,
}

/// The current image.
#[derive(Debug)]
pub(crate) struct Units {
    coding: Coding,
    timestamp: u32,
    data: Vec<u8>,
    is_damaged: bool,
    /// It has coded pixels, and not only parameters.
    has_pixels: bool,
    is_in_fragment: bool,
}

impl Units {
    /// `parameters`: parameter sets of the description, for the first image.
    pub(crate) fn new(coding: Coding, parameters: Vec<u8>) -> Self {
        Self {
            coding,
            timestamp: 0,
            data: parameters,
            is_damaged: false,
            has_pixels: false,
            is_in_fragment: false,
        }
    }

    /// Takes the next packet, and returns the images that are complete: one that ends before it, and one that ends with it.
    pub(crate) fn take(&mut self, packet: &Packet, has_loss: bool) -> [Option<Unit>; 2] {
        self.is_damaged |= has_loss;
        let is_next = packet.timestamp() != self.timestamp;
        let before = (is_next && self.has_pixels).then(|| self.end());
        self.is_damaged |= has_loss;
        self.timestamp = packet.timestamp();
        let payload = packet.payload();
        let is_sound = self.data.len() + payload.len() <= MAX_BYTES
            && match self.coding {
                Coding::H264 | Coding::H265 => self.add_units(payload).is_some(),
                Coding::Jpeg => {
                    self.has_pixels = true;
                    jpeg::add(&mut self.data, payload).is_some()
                }
            };
        self.is_damaged |= !is_sound;
        [
            before,
            (packet.is_last() && self.has_pixels).then(|| self.end()),
        ]
    }

    fn end(&mut self) -> Unit {
        (self.has_pixels, self.is_in_fragment) = (false, false);
        Unit {
            timestamp: self.timestamp,
            data: std::mem::take(&mut self.data),
            is_damaged: std::mem::take(&mut self.is_damaged),
        }
    }

    /// Adds a payload's units; `None` if it is not intact.
    fn add_units(&mut self, payload: &[u8]) -> Option<()> {
        let is_h264 = self.coding == Coding::H264;
        let (bytes, aggregation, fragment) = if is_h264 { (1, 24, 28) } else { (2, 48, 49) };
        let header = payload.get(..bytes)?;
        let kind = self.kind(header[0]);
        if kind == aggregation {
            let mut rest = &payload[bytes..];
            while let Some((length, after)) = rest.split_first_chunk::<2>() {
                let (unit, others) = after.split_at_checked(u16::from_be_bytes(*length).into())?;
                self.begin(unit)?;
                rest = others;
            }
        } else if kind == fragment {
            let (part, rest) = payload[bytes..].split_first()?;
            if part & 0x80 != 0 {
                let begin = if is_h264 {
                    vec![header[0] & 0xe0 | part & 0x1f]
                } else {
                    vec![header[0] & 0x81 | (part & 0x3f) << 1, header[1]]
                };
                self.begin(&begin)?;
                self.is_in_fragment = true;
            }
            if !self.is_in_fragment {
                return None;
            }
            self.data.extend(rest);
            self.is_in_fragment = part & 0x40 == 0;
        } else if kind < aggregation {
            self.begin(payload)?;
        }
        Some(())
    }

    fn begin(&mut self, unit: &[u8]) -> Option<()> {
        let kind = self.kind(*unit.first()?);
        self.has_pixels |= match self.coding {
            Coding::H264 => (1..=5).contains(&kind),
            _ => kind < 32,
        };
        self.data.extend(START_CODE);
        self.data.extend(unit);
        Some(())
    }

    fn kind(&self, header: u8) -> u8 {
        match self.coding {
            Coding::H264 => header & 0x1f,
            _ => header >> 1 & 0x3f,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Packets of timestamps, marker bits, losses and payloads; returns the images.
    fn images(coding: Coding, packets: &[(u32, bool, bool, &[u8])]) -> Vec<Unit> {
        let mut units = Units::new(coding, START_CODE.into());
        let taken = packets
            .iter()
            .flat_map(|(timestamp, is_last, has_loss, payload)| {
                units.take(&Packet::made(0, *timestamp, *is_last, payload), *has_loss)
            });
        taken.flatten().collect()
    }

    fn unit(timestamp: u32, data: &[&[u8]], is_damaged: bool) -> Unit {
        Unit {
            timestamp,
            data: data.concat(),
            is_damaged,
        }
    }

    const S: &[u8] = &START_CODE;

    #[test]
    fn an_image_ends_with_the_marker_bit_and_two_may_have_one_timestamp() {
        let found = images(
            Coding::H264,
            &[
                (1, true, false, &[0x67, 1]),
                (2, false, false, &[24, 0, 2, 0x68, 2, 0, 1, 6]),
                (2, false, false, &[0x7c, 0x85, 3]),
                (2, true, false, &[0x7c, 0x45, 4]),
                (2, true, false, &[0x41, 5]),
            ],
        );
        let first = [S, S, &[0x67, 1], S, &[0x68, 2], S, &[6], S, &[0x65, 3, 4]];
        assert_eq!(
            found,
            [unit(2, &first, false), unit(2, &[S, &[0x41, 5]], false)]
        );
    }

    #[test]
    fn without_marker_bits_the_next_timestamp_ends_an_image() {
        let slice = |number: u8| [2, 1, number];
        let [a, b, c] = [1, 2, 3].map(slice);
        let found = images(
            Coding::H265,
            &[
                (1, false, false, &a),
                (1, false, false, &b),
                (2, false, false, &c),
            ],
        );
        assert_eq!(found, [unit(1, &[S, S, &a, S, &b], false)]);
    }

    #[test]
    fn a_loss_damages_the_image_that_it_ends_and_the_next() {
        let [begin, end, slice] = [&[98, 1, 0x81, 7][..], &[98, 1, 0x41, 8], &[2, 1, 9]];
        let found = images(
            Coding::H265,
            &[
                (1, false, false, begin),
                (2, true, true, slice),
                (3, true, false, slice),
                (4, false, false, begin),
                (4, true, true, end),
                (5, true, false, end),
            ],
        );
        let damaged: Vec<_> = found
            .iter()
            .map(|unit| (unit.timestamp, unit.is_damaged))
            .collect();
        // The last one has lost its beginning unseen, and has no pixels.
        assert_eq!(damaged, [(1, true), (2, true), (3, false), (4, true)]);
    }

    #[test]
    fn a_sender_that_ends_no_image_fills_no_memory() {
        let mut units = Units::new(Coding::H264, Vec::new());
        let mut part = vec![0x7c, 5];
        part.resize(60_000, 7);
        let part = Packet::made(0, 1, false, &part);
        let _ = units.take(&Packet::made(0, 1, false, &[0x7c, 0x85, 7]), false);
        for _ in 0..400 {
            assert_eq!(units.take(&part, false), [None, None]);
        }
        assert!(units.data.len() <= MAX_BYTES);
        let [cut, _] = units.take(&Packet::made(0, 2, false, &[0x41, 7]), false);
        assert!(cut.unwrap().is_damaged);
    }
}
