//! How fast a simulator's values are decoded: `cargo bench -p xplane-bridge`.
//!
//! A million values, in datagrams of 183 as X-Plane packs them, through the view that the client uses and through the packet that
//! owns its values. One core. The project's own target is 20 ms.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use xplane_bridge::packet::{
    DatarefValue, DatarefValues, DatarefValuesView, FromSimulator, MAX_VALUES_PER_REPLY,
};

const VALUES: usize = 1_000_000;

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

fn decode(criterion: &mut Criterion) {
    let datagrams = datagrams();
    let mut group = criterion.benchmark_group("a million values");
    group.throughput(Throughput::Elements(VALUES as u64));
    group.bench_function("view", |bencher| {
        bencher.iter(|| {
            let values = black_box(&datagrams)
                .iter()
                .flat_map(|datagram| DatarefValuesView::new(datagram).expect("values").iter());
            values.fold((0, 0.0), fold)
        });
    });
    group.bench_function("packet", |bencher| {
        bencher.iter(|| {
            let values = black_box(&datagrams).iter().flat_map(|datagram| {
                match FromSimulator::decode(datagram) {
                    Ok(FromSimulator::DatarefValues(packet)) => packet.values,
                    other => panic!("{other:?}"),
                }
            });
            values.fold((0, 0.0), fold)
        });
    });
    group.finish();
}

criterion_group!(benches, decode);
criterion_main!(benches);
