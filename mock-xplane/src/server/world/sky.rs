//! The weather that is flown and drawn, which is not always the one that the datarefs say.
//!
//! X-Plane 11 shows what is written at once. X-Plane 12 does so only while `update_immediately` is set, and never for the
//! clouds: those want the command `regen_weather`, which puts their datarefs back, and then to be written again while the
//! weather settles. A client that forgets one of these steps flies through other clouds than it reads.

use std::collections::BTreeMap;

use dataset::conditions::Weather;
use xplane_bridge::datarefs::{self as names, Generation};

use crate::datarefs::Datarefs;

/// How long after `regen_weather` written clouds are taken over, seconds.
const SETTLING_S: f64 = 15.0;
const REGION: &str = "sim/weather/";

/// What the sky shows.
#[derive(Debug, Clone)]
pub(super) struct Sky {
    generation: Generation,
    shown: BTreeMap<String, Vec<f64>>,
    clouds_open_until_s: f64,
}

impl Sky {
    /// The sky as the datarefs say.
    pub(super) fn new(generation: Generation, datarefs: &Datarefs) -> Self {
        let mut sky = Self {
            generation,
            shown: BTreeMap::new(),
            clouds_open_until_s: f64::NEG_INFINITY,
        };
        sky.take_over(datarefs, |_| true);
        sky
    }

    /// A client wrote the dataref of this name (without index) at a running time.
    pub(super) fn written(&mut self, name: &str, datarefs: &Datarefs, now_s: f64) {
        if !name.starts_with(REGION) {
            return;
        }
        match self.generation {
            Generation::XPlane11 => self.take_over(datarefs, |other| other == name),
            Generation::XPlane12 if names::needs_repeating_after_regeneration(name) => {
                if now_s <= self.clouds_open_until_s {
                    self.take_over(datarefs, |other| other == name);
                }
            }
            Generation::XPlane12 => {
                if datarefs.get(names::UPDATE_IMMEDIATELY) != 0.0 {
                    self.take_over_all_but_clouds(datarefs);
                }
            }
        }
    }

    /// The command `regen_weather`.
    pub(super) fn regenerate(&mut self, datarefs: &mut Datarefs, now_s: f64) {
        if self.generation == Generation::XPlane11 {
            return;
        }
        self.take_over_all_but_clouds(datarefs);
        for (name, values) in &self.shown {
            if names::needs_repeating_after_regeneration(name) {
                datarefs.restore(name, values);
            }
        }
        self.clouds_open_until_s = now_s + SETTLING_S;
    }

    /// A new flight has the weather that was asked for, clouds and all.
    pub(super) fn take_over_everything(&mut self, datarefs: &Datarefs) {
        self.take_over(datarefs, |_| true);
    }

    /// The weather in SI.
    pub(super) fn weather(&self) -> Weather {
        names::weather_from_datarefs(self.generation, |path| {
            let (name, rest) = path.split_once('[').unwrap_or((path, "0]"));
            let index = rest.trim_end_matches(']').parse::<usize>().unwrap_or(0);
            let values = self.shown.get(name);
            values
                .and_then(|values| values.get(index))
                .map_or(0.0, |&value| value as f32)
        })
    }

    fn take_over_all_but_clouds(&mut self, datarefs: &Datarefs) {
        self.take_over(datarefs, |name| {
            !names::needs_repeating_after_regeneration(name)
        });
    }

    fn take_over(&mut self, datarefs: &Datarefs, which: impl Fn(&str) -> bool) {
        for (dataref, values) in datarefs.iter() {
            if dataref.name.starts_with(REGION) && which(dataref.name) {
                self.shown.insert(dataref.name.into(), values.to_vec());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn twelve() -> (Datarefs, Sky) {
        let datarefs = Datarefs::new(Generation::XPlane12);
        let sky = Sky::new(Generation::XPlane12, &datarefs);
        (datarefs, sky)
    }

    fn write(datarefs: &mut Datarefs, sky: &mut Sky, path: &str, value: f64, now_s: f64) {
        datarefs.write_exact(path, value).unwrap();
        sky.written(path.split('[').next().unwrap(), datarefs, now_s);
    }

    fn cover(sky: &Sky) -> f64 {
        sky.weather()
            .clouds
            .iter()
            .map(|cloud| cloud.cover_ratio)
            .sum()
    }

    #[test]
    fn twelve_shows_all_but_clouds_once_it_may_update() {
        let (mut datarefs, mut sky) = twelve();
        let before_m = sky.weather().visibility_m;
        write(&mut datarefs, &mut sky, names::VISIBILITY_SM, 5.0, 0.0);
        assert_eq!(sky.weather().visibility_m, before_m);
        let clouds = format!("{}[0]", names::CLOUD_COVER);
        write(&mut datarefs, &mut sky, &clouds, 0.75, 0.0);
        write(&mut datarefs, &mut sky, names::UPDATE_IMMEDIATELY, 1.0, 0.0);
        assert!((sky.weather().visibility_m - 8_046.72).abs() < 1e-3);
        assert_eq!(cover(&sky), 0.0);
        write(&mut datarefs, &mut sky, names::VISIBILITY_SM, 6.0, 0.0);
        assert!((sky.weather().visibility_m - 9_656.064).abs() < 1e-3);
    }

    #[test]
    fn clouds_of_twelve_want_the_command_and_then_to_be_told_again() {
        let (mut datarefs, mut sky) = twelve();
        let clouds = format!("{}[0]", names::CLOUD_COVER);
        write(&mut datarefs, &mut sky, &clouds, 0.75, 0.0);
        sky.regenerate(&mut datarefs, 1.0);
        // The command forgets what it did not take over.
        assert_eq!((cover(&sky), datarefs.get(&clouds)), (0.0, 0.0));
        write(&mut datarefs, &mut sky, &clouds, 0.75, 2.0);
        assert_eq!(cover(&sky), 0.75);
        // Long after the command nothing is taken over any more.
        write(&mut datarefs, &mut sky, &clouds, 0.25, 30.0);
        assert_eq!(cover(&sky), 0.75);
    }

    #[test]
    fn eleven_shows_everything_at_once() {
        let mut datarefs = Datarefs::new(Generation::XPlane11);
        let mut sky = Sky::new(Generation::XPlane11, &datarefs);
        for (path, value) in [
            ("sim/weather/visibility_reported_m", 5_000.0),
            ("sim/weather/cloud_type[0]", 3.0),
            ("sim/weather/cloud_base_msl_m[0]", 600.0),
            ("sim/weather/wind_speed_kt[0]", 10.0),
        ] {
            write(&mut datarefs, &mut sky, path, value, 0.0);
        }
        let weather = sky.weather();
        assert_eq!(weather.visibility_m, 5_000.0);
        assert_eq!(weather.clouds[0].base_msl_m, 600.0);
        assert!((weather.wind_speed_mps - 5.144).abs() < 1e-3);
    }
}
