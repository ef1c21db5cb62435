//! Any bytes as a recorded flight (CSV): no panic, and an accepted flight can be resampled to the ticks of a scenario.

#![no_main]

use std::sync::LazyLock;

use dataset::geometry::runway::Runway;
use dataset::numbers::frame_rate::FrameRate;
use dtd_fuzz::as_file;
use generator::airports::bundled;
use generator::recording::{Allowed, Recording};
use libfuzzer_sys::fuzz_target;

static CHANGI: LazyLock<Runway> = LazyLock::new(|| bundled("WSSS", "02L").unwrap());

fuzz_target!(|bytes: &[u8]| {
    as_file(bytes, "flight.csv", |path| {
        // From wherever it begins, whatever it is.
        let allow = [
            Allowed::Overflight,
            Allowed::Offset,
            Allowed::Outside,
            Allowed::GoAround,
        ];
        let Ok(recording) = Recording::read(path, &CHANGI, f64::MAX, &allow) else {
            return;
        };
        let flight = recording.trajectory;
        let _ = flight.touchdown();
        if let Ok(window) = flight.approach(&CHANGI, f64::MAX) {
            let rate = FrameRate::new(1, 2).unwrap();
            let states = flight.resample(window, rate);
            assert_eq!(states.len(), window.ticks(rate) as usize);
            assert!(
                states
                    .iter()
                    .all(|state| state.pose.altitude_msl_m.is_finite())
            );
        }
    });
});
