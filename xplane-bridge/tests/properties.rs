//! Properties of every packet: encoding and decoding are inverse, and no bytes make a decoder panic.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use xplane_bridge::packet::{
    Beacon, Command, DatarefValue, DatarefValues, FromSimulator, LoadAircraft, PacketError,
    PlaceAtStart, Position, SubscribeDataref, SubscribePosition, ToSimulator, WriteDataref,
};

/// Cases of each property; a failing one is named by its seed.
const CASES: u64 = 512;

/// Random packet contents.
struct RandomPackets(ChaCha12Rng);

impl RandomPackets {
    fn of(seed: u64) -> Self {
        Self(ChaCha12Rng::seed_from_u64(seed))
    }

    fn i32(&mut self) -> i32 {
        self.0.random()
    }

    fn u32(&mut self) -> u32 {
        self.0.random()
    }

    /// Any number: a NaN is not equal to itself.
    fn f32(&mut self) -> f32 {
        let number = f32::from_bits(self.u32());
        if number.is_nan() { -0.0 } else { number }
    }

    /// Any number.
    fn f64(&mut self) -> f64 {
        let number = f64::from_bits(self.0.random());
        if number.is_nan() { -0.0 } else { number }
    }

    fn bytes(&mut self, fewer_than: usize) -> Vec<u8> {
        let count = self.0.random_range(0..fewer_than);
        (0..count).map(|_| self.0.random()).collect()
    }

    /// A text that fits a field: no NUL, no closing space, at most `most` bytes.
    fn text(&mut self, most: usize) -> String {
        let count = self.0.random_range(0..=120);
        let mut text: String = (0..count)
            .map(|_| {
                let is_ascii = self.0.random_bool(0.5);
                let last = if is_ascii { '~' } else { char::MAX };
                self.0.random_range(' '..=last)
            })
            .filter(|character| !character.is_control())
            .collect();
        while text.len() > most || text.ends_with(' ') {
            text.pop();
        }
        text
    }

    fn name(&mut self, most: usize) -> String {
        let name = self.text(most);
        if name.is_empty() { "x".into() } else { name }
    }

    fn any_to_simulator(&mut self) -> ToSimulator {
        match self.0.random_range(0..6) {
            0 => ToSimulator::SubscribeDataref(SubscribeDataref {
                frequency_hz: self.i32(),
                index: self.i32(),
                path: self.text(399),
            }),
            1 => ToSimulator::WriteDataref(WriteDataref {
                path: self.text(499),
                value: self.f32(),
            }),
            2 => ToSimulator::Command(Command {
                path: self.name(300),
            }),
            3 => ToSimulator::SubscribePosition(SubscribePosition {
                frequency_hz: self.u32(),
            }),
            4 => ToSimulator::PlaceAtStart(PlaceAtStart {
                start_type: self.i32(),
                plane: self.i32(),
                airport: self.text(7),
                runway: self.i32(),
                runway_end: self.i32(),
                latitude_deg: self.f64(),
                longitude_deg: self.f64(),
                elevation_msl_m: self.f64(),
                heading_true_deg: self.f64(),
                speed_mps: self.f64(),
            }),
            _ => ToSimulator::LoadAircraft(LoadAircraft {
                plane: self.i32(),
                path: self.text(149),
                livery: self.i32(),
            }),
        }
    }

    fn any_from_simulator(&mut self) -> FromSimulator {
        match self.0.random_range(0..3) {
            0 => {
                let count = self.0.random_range(0..=183);
                let mut value = || DatarefValue {
                    index: self.i32(),
                    value: self.f32(),
                };
                let values = (0..count).map(|_| value()).collect();
                FromSimulator::DatarefValues(DatarefValues { values })
            }
            1 => FromSimulator::Position(Position {
                longitude_deg: self.f64(),
                latitude_deg: self.f64(),
                elevation_msl_m: self.f64(),
                height_agl_m: self.f32(),
                pitch_deg: self.f32(),
                heading_true_deg: self.f32(),
                roll_deg: self.f32(),
                velocity_east_mps: self.f32(),
                velocity_up_mps: self.f32(),
                velocity_south_mps: self.f32(),
                roll_rate_rad_s: self.f32(),
                pitch_rate_rad_s: self.f32(),
                yaw_rate_rad_s: self.f32(),
            }),
            _ => FromSimulator::Beacon(Beacon {
                major: self.0.random(),
                minor: self.0.random(),
                host: self.i32(),
                version: self.i32(),
                role: self.u32(),
                port: self.0.random(),
                name: self.0.random_bool(0.5).then(|| self.name(40)),
                raknet_port: self.0.random_bool(0.5).then(|| self.0.random()),
            }),
        }
    }

    /// Bytes that get past the tag: one of the known ones, sometimes, and anything behind it.
    fn datagram(&mut self) -> Vec<u8> {
        let tag = if self.0.random_bool(0.5) {
            TAGS[self.0.random_range(0..TAGS.len())].to_vec()
        } else {
            self.bytes(5)
        };
        [tag, self.bytes(1_500)].concat()
    }
}

const TAGS: [&[u8; 4]; 8] = [
    b"RREF", b"DREF", b"CMND", b"RPOS", b"PREL", b"ACFN", b"DATA", b"BECN",
];

#[test]
fn what_goes_to_the_simulator_arrives_as_it_was_meant() {
    for seed in 0..CASES {
        let packet = RandomPackets::of(seed).any_to_simulator();
        let datagram = packet.encode().unwrap();
        assert_eq!(ToSimulator::decode(&datagram), Ok(packet), "seed {seed}");
    }
}

#[test]
fn what_comes_from_the_simulator_arrives_as_it_was_meant() {
    for seed in 0..CASES {
        let packet = RandomPackets::of(seed).any_from_simulator();
        let datagram = packet.encode().unwrap();
        assert_eq!(FromSimulator::decode(&datagram), Ok(packet), "seed {seed}");
    }
}

#[test]
fn any_bytes_are_a_packet_or_an_error_and_a_packet_said_again_is_the_same_bytes() {
    for seed in 0..CASES {
        let bytes = RandomPackets::of(seed).datagram();
        // Compared as bytes: a NaN is not equal to itself.
        if let Ok(again) = ToSimulator::decode(&bytes).and_then(|packet| packet.encode()) {
            let twice = ToSimulator::decode(&again).and_then(|packet| packet.encode());
            assert_eq!(twice, Ok(again), "seed {seed}");
        }
        if let Ok(again) = FromSimulator::decode(&bytes).and_then(|packet| packet.encode()) {
            let twice = FromSimulator::decode(&again).and_then(|packet| packet.encode());
            assert_eq!(twice, Ok(again), "seed {seed}");
        }
    }
}

#[test]
fn a_packet_that_is_cut_says_how_much_it_lacks() {
    for seed in 0..CASES {
        let mut drawn = RandomPackets::of(seed);
        let whole = drawn.any_to_simulator().encode().unwrap();
        let cut = drawn.0.random_range(0..=whole.len());
        if let Err(PacketError::TooShort { needed, found, .. }) = ToSimulator::decode(&whole[..cut])
        {
            assert_eq!(found, cut, "seed {seed}");
            assert!(
                found < needed && needed <= whole.len(),
                "seed {seed}: {needed} needed of {}",
                whole.len()
            );
        }
    }
}
