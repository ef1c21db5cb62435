//! Any bytes as a datagram of either direction: no panic, and a decoded packet encodes to the same bytes.

#![no_main]

use libfuzzer_sys::fuzz_target;
use xplane_bridge::packet::{FromSimulator, ToSimulator};

fuzz_target!(|datagram: &[u8]| {
    // Compared as bytes: a NaN is not equal to itself. An encoder may fail, e.g. on a text that fills its field.
    let to = |bytes: &[u8]| ToSimulator::decode(bytes).and_then(|packet| packet.encode());
    if let Ok(again) = to(datagram) {
        assert_eq!(to(&again), Ok(again.clone()));
    }
    let from = |bytes: &[u8]| FromSimulator::decode(bytes).and_then(|packet| packet.encode());
    if let Ok(again) = from(datagram) {
        assert_eq!(from(&again), Ok(again.clone()));
    }
});
