//! Properties of every packet: what was encoded decodes to the same, and no bytes make a decoder panic.

use proptest::prelude::*;
use xplane_bridge::packet::{
    Beacon, Command, DatarefValue, DatarefValues, DatarefValuesView, FromSimulator, LoadAircraft,
    PacketError, PlaceAtStart, Position, SubscribeDataref, SubscribePosition, ToSimulator,
    WriteDataref,
};

/// A text that fits a field: no NUL, no closing space, at most `most` bytes.
fn text(most: usize) -> impl Strategy<Value = String> {
    "\\PC{0,120}".prop_map(move |text| {
        let mut text = text.replace('\0', "");
        while text.len() > most || text.ends_with(' ') {
            text.pop();
        }
        text
    })
}

fn name(most: usize) -> impl Strategy<Value = String> {
    text(most).prop_filter("a name has characters", |name| !name.is_empty())
}

prop_compose! {
    fn place_at_start()(
        (start_type, plane, runway, runway_end) in any::<(i32, i32, i32, i32)>(), airport in text(7),
        (latitude_deg, longitude_deg, elevation_msl_m) in any::<(f64, f64, f64)>(), heading_true_deg: f64, speed_mps: f64,
    ) -> PlaceAtStart {
        PlaceAtStart {
            start_type, plane, airport, runway, runway_end, latitude_deg, longitude_deg, elevation_msl_m,
            heading_true_deg, speed_mps,
        }
    }
}

prop_compose! {
    fn position()(at: [f64; 3], values: [f32; 10]) -> Position {
        let [longitude_deg, latitude_deg, elevation_msl_m] = at;
        let [height_agl_m, pitch_deg, heading_true_deg, roll_deg, velocity_east_mps, velocity_up_mps,
            velocity_south_mps, roll_rate_rad_s, pitch_rate_rad_s, yaw_rate_rad_s] = values;
        Position {
            longitude_deg, latitude_deg, elevation_msl_m, height_agl_m, pitch_deg, heading_true_deg, roll_deg,
            velocity_east_mps, velocity_up_mps, velocity_south_mps, roll_rate_rad_s, pitch_rate_rad_s, yaw_rate_rad_s,
        }
    }
}

prop_compose! {
    fn beacon()(
        (major, minor) in any::<(u8, u8)>(), (host, version) in any::<(i32, i32)>(), role: u32, port: u16,
        name in proptest::option::of(name(40)), raknet_port: Option<u16>,
    ) -> Beacon {
        Beacon { major, minor, host, version, role, port, name, raknet_port }
    }
}

fn to_simulator() -> impl Strategy<Value = ToSimulator> {
    prop_oneof![
        (any::<i32>(), any::<i32>(), text(399)).prop_map(|(frequency_hz, index, path)| {
            ToSimulator::SubscribeDataref(SubscribeDataref {
                frequency_hz,
                index,
                path,
            })
        }),
        (text(499), any::<f32>())
            .prop_map(|(path, value)| ToSimulator::WriteDataref(WriteDataref { path, value })),
        name(300).prop_map(|path| ToSimulator::Command(Command { path })),
        any::<u32>().prop_map(
            |frequency_hz| ToSimulator::SubscribePosition(SubscribePosition { frequency_hz })
        ),
        place_at_start().prop_map(ToSimulator::PlaceAtStart),
        (any::<i32>(), text(149), any::<i32>()).prop_map(|(plane, path, livery)| {
            ToSimulator::LoadAircraft(LoadAircraft {
                plane,
                path,
                livery,
            })
        }),
    ]
}

fn from_simulator() -> impl Strategy<Value = FromSimulator> {
    let value = any::<(i32, f32)>().prop_map(|(index, value)| DatarefValue { index, value });
    prop_oneof![
        proptest::collection::vec(value, 0..=183)
            .prop_map(|values| FromSimulator::DatarefValues(DatarefValues { values })),
        position().prop_map(FromSimulator::Position),
        beacon().prop_map(FromSimulator::Beacon),
    ]
}

/// Bytes that get past the tag: one of the known ones, sometimes, and anything behind it.
fn datagram() -> impl Strategy<Value = Vec<u8>> {
    let tag = prop_oneof![
        proptest::sample::select(&TAGS[..]).prop_map(|tag| tag.to_vec()),
        proptest::collection::vec(any::<u8>(), 0..5),
    ];
    (tag, proptest::collection::vec(any::<u8>(), 0..1_500))
        .prop_map(|(tag, body)| [tag, body].concat())
}

const TAGS: [&[u8; 4]; 8] = [
    b"RREF", b"DREF", b"CMND", b"RPOS", b"PREL", b"ACFN", b"DATA", b"BECN",
];

proptest! {
    #[test]
    fn what_goes_to_the_simulator_arrives_as_it_was_meant(packet in to_simulator()) {
        let datagram = packet.encode().unwrap();
        prop_assert_eq!(ToSimulator::decode(&datagram), Ok(packet));
    }

    #[test]
    fn what_comes_from_the_simulator_arrives_as_it_was_meant(packet in from_simulator()) {
        let datagram = packet.encode().unwrap();
        prop_assert_eq!(FromSimulator::decode(&datagram), Ok(packet));
    }

    #[test]
    fn any_bytes_are_a_packet_or_an_error_and_a_packet_said_again_is_the_same_bytes(bytes in datagram()) {
        let _ = DatarefValuesView::new(&bytes).map(|view| view.iter().count());
        // Compared as bytes: a NaN is not equal to itself.
        if let Ok(again) = ToSimulator::decode(&bytes).and_then(|packet| packet.encode()) {
            let twice = ToSimulator::decode(&again).and_then(|packet| packet.encode());
            prop_assert_eq!(twice, Ok(again));
        }
        if let Ok(again) = FromSimulator::decode(&bytes).and_then(|packet| packet.encode()) {
            let twice = FromSimulator::decode(&again).and_then(|packet| packet.encode());
            prop_assert_eq!(twice, Ok(again));
        }
    }

    #[test]
    fn a_packet_that_is_cut_says_how_much_it_lacks(packet in to_simulator(), cut in 0_usize..1_000) {
        let whole = packet.encode().unwrap();
        let cut = cut.min(whole.len());
        if let Err(PacketError::TooShort { needed, found, .. }) = ToSimulator::decode(&whole[..cut]) {
            prop_assert_eq!(found, cut);
            prop_assert!(found < needed && needed <= whole.len(), "{} needed of {}", needed, whole.len());
        }
    }
}
