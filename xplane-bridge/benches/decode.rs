//! Speed of decoding a simulator's values: `cargo bench -p xplane-bridge`.
//!
//! A million values, in datagrams of 183 as X-Plane packs them, through the view that the client uses and through the packet that
//! owns its values. One core, the fastest of 50 rounds each. The project's own target is 20 ms.

use std::hint::black_box;
use std::time::{Duration, Instant};

use xplane_bridge::packet::{
    DatarefValue, DatarefValues, DatarefValuesView, FromSimulator, MAX_VALUES_PER_REPLY,
};

const VALUES: usize = 1_000_000;
const ROUNDS: usize = 50;

fn datagrams() -> Vec<Vec<u8>> {
    let values: Vec<DatarefValue> = (0..VALUES)
        .map(|i| DatarefValue {
            index: i as i32,
            value: i as f32 * 0.5,
        })
        .collect();
    values
        .chunks(MAX_VALUES_PER_REPLY)
        .map(|values| {
            let values = values.to_vec();
            FromSimulator::DatarefValues(DatarefValues { values })
                .encode()
                .expect("at most 183 values")
        })
        .collect()
}

/// Something that needs every index and every value.
fn fold(sum: (i64, f64), value: DatarefValue) -> (i64, f64) {
    (
        sum.0 + i64::from(value.index),
        sum.1 + f64::from(value.value),
    )
}

fn main() {
    let datagrams = datagrams();
    let [view, packet] = [&view as &dyn Fn(&[Vec<u8>]) -> (i64, f64), &packet]
        .map(|decoded| fastest(|| decoded(black_box(&datagrams))));
    println!("a million values: view {view:.2?}, packet {packet:.2?}");
    println!("ratio {:.2}", packet.as_secs_f64() / view.as_secs_f64());
}

fn fastest(work: impl Fn() -> (i64, f64)) -> Duration {
    let timed = |_| {
        let began = Instant::now();
        black_box(work());
        began.elapsed()
    };
    (0..ROUNDS).map(timed).min().unwrap_or_default()
}

fn view(datagrams: &[Vec<u8>]) -> (i64, f64) {
    let values = datagrams
        .iter()
        .flat_map(|datagram| DatarefValuesView::new(datagram).expect("values").iter());
    values.fold((0, 0.0), fold)
}

fn packet(datagrams: &[Vec<u8>]) -> (i64, f64) {
    let values = datagrams
        .iter()
        .flat_map(|datagram| match FromSimulator::decode(datagram) {
            Ok(FromSimulator::DatarefValues(packet)) => packet.values,
            other => panic!("{other:?}"),
        });
    values.fold((0, 0.0), fold)
}
