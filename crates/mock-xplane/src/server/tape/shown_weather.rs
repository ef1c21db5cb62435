//! The recorded weather at the aircraft, looked up by the written datarefs.
//!
//! Clients never write these datarefs, and X-Plane changes them after a command without any write, so a history of values between writes
//! cannot place them: a replay that sends its commands a little earlier, or leaves a scenario out, would read the weather of the wrong
//! scenario. Under the same written datarefs the last reading counts: the one that the recorded client ended with.

use std::collections::{BTreeMap, HashMap};

use xplane_bridge::datarefs::{
    CLOUD_COVER_AT_AIRCRAFT, RAIN_AT_AIRCRAFT, VISIBILITY_EFFECTIVE_M, WIND_DIRECTION_AT_AIRCRAFT,
    WIND_SPEED_AT_AIRCRAFT,
};

use super::conversation::Context;

const SHOWN: [&str; 5] = [
    VISIBILITY_EFFECTIVE_M,
    WIND_SPEED_AT_AIRCRAFT,
    WIND_DIRECTION_AT_AIRCRAFT,
    RAIN_AT_AIRCRAFT,
    CLOUD_COVER_AT_AIRCRAFT,
];

/// All readings of the weather at the aircraft.
#[derive(Debug, Default)]
pub(super) struct ShownWeather {
    by_context: HashMap<Context, BTreeMap<String, f32>>,
}

impl ShownWeather {
    /// A client read a value on the tape, after these writes. Other datarefs are ignored.
    pub(super) fn add_value(&mut self, written: &Context, path: &str, value: f32) {
        if !is_shown(path) {
            return;
        }
        match self.by_context.get_mut(written) {
            Some(values) => {
                values.insert(path.to_owned(), value);
            }
            None => {
                let values = BTreeMap::from([(path.to_owned(), value)]);
                self.by_context.insert(written.clone(), values);
            }
        }
    }

    /// The value after these writes, if the tape has it.
    pub(super) fn value(&self, written: &Context, path: &str) -> Option<f32> {
        if !is_shown(path) {
            return None;
        }
        self.by_context.get(written)?.get(path).copied()
    }
}

fn is_shown(path: &str) -> bool {
    let name = path.split('[').next().unwrap_or(path);
    SHOWN.contains(&name)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COVER: &str = "sim/weather/aircraft/cloud_coverage_percent[0]";

    fn after(cover: f32) -> Context {
        let mut written = Context::default();
        written.write("sim/weather/region/cloud_coverage_percent[0]", cover);
        written
    }

    #[test]
    fn the_last_reading_under_the_same_writes_counts_in_any_order_and_again() {
        let mut shown = ShownWeather::default();
        for (written, value) in [(0.9, 0.0), (0.9, 0.88), (0.0, 0.88), (0.0, 0.02)] {
            shown.add_value(&after(written), COVER, value);
        }
        for _ in 0..2 {
            assert_eq!(shown.value(&after(0.0), COVER), Some(0.02));
            assert_eq!(shown.value(&after(0.9), COVER), Some(0.88));
        }
        assert_eq!(shown.value(&after(0.5), COVER), None);
    }

    #[test]
    fn only_the_weather_at_the_aircraft_is_kept() {
        let mut shown = ShownWeather::default();
        shown.add_value(&after(0.9), "sim/time/paused", 1.0);
        assert_eq!(shown.value(&after(0.9), "sim/time/paused"), None);
    }
}
