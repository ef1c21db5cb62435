//! The weather that is flown and drawn, which may differ from the weather in the datarefs.
//!
//! X-Plane 11 shows written weather at once. X-Plane 12 does so only while `update_immediately` is set, and never for the clouds: they need
//! the command `regen_weather`, and must then be written again while the weather settles. A client that omits one of these steps flies
//! through clouds that differ from its readings. Further complications are quirks.

mod late_clouds;
mod real;
mod samples;

use std::collections::BTreeMap;

use dataset::conditions::Weather;
use dataset::numbers::units::MPS_PER_KNOT;
use xplane_bridge::datarefs::{self as names, Generation};

use self::late_clouds::LateClouds;
use crate::datarefs::Datarefs;
use crate::quirks::{Quirk, Quirks};

/// Time after `regen_weather` during which written clouds are accepted, seconds: clouds were seen to take about a minute.
const SETTLING_S: f64 = 60.0;
/// Duration of the freeze by `regen_weather`, seconds.
const REGENERATION_FREEZE_S: f64 = 3.0;
/// Duration of the temperature's drift after the start, or after real weather, seconds.
const SLIDING_S: f64 = 150.0;
/// Speed of that drift.
const SLIDING_C_PER_S: f64 = 0.7;
/// Maximum temperature.
const WARMEST_C: f64 = 45.0;
/// Height of settled clouds above the requested base, metres.
const BASE_OFF_M: f64 = 3.5;

/// [`names::WEATHER_PRESET`] without clouds.
const CLEAR: f64 = 0.0;

/// The effective weather.
#[derive(Debug, Clone)]
pub(super) struct Sky {
    generation: Generation,
    quirks: Quirks,
    shown: BTreeMap<String, Vec<f64>>,
    /// The weather's own time, which may stand still in a pause.
    now_s: f64,
    stands_still: bool,
    /// Actions of clients while it stood still.
    waiting: Vec<Deed>,
    clouds_open_until_s: f64,
    late_clouds: LateClouds,
    real: bool,
    slides_until_s: f64,
    /// Duration of a requested freeze, seconds.
    freeze_s: f64,
}

/// Actions of clients on the weather.
#[derive(Debug, Clone)]
enum Deed {
    Write(String),
    Regenerate,
}

impl Sky {
    /// The sky of the datarefs, or real weather.
    pub(super) fn new(generation: Generation, quirks: Quirks, datarefs: &mut Datarefs) -> Self {
        let mut sky = Self {
            generation,
            quirks,
            shown: BTreeMap::new(),
            now_s: 0.0,
            stands_still: false,
            waiting: Vec::new(),
            clouds_open_until_s: f64::NEG_INFINITY,
            late_clouds: LateClouds::default(),
            real: quirks.has(Quirk::RealWeatherAtStart),
            slides_until_s: SLIDING_S,
            freeze_s: 0.0,
        };
        if sky.real {
            real::switch_on(generation, datarefs);
            real::overwrite(generation, datarefs);
        }
        sky.take_over(datarefs, |_| true);
        sky.publish(datarefs);
        sky
    }

    /// A client wrote a dataref, `name` or `name[3]`, which had the value `before`.
    pub(super) fn written(&mut self, path: &str, before: f64, datarefs: &mut Datarefs) {
        let name = path.split('[').next().unwrap_or(path);
        if !name.starts_with(region(self.generation)) {
            return;
        }
        if name == real::switch(self.generation) {
            self.switch_real_weather(datarefs);
        }
        if name == names::WEATHER_PRESET && datarefs.get(name) == CLEAR {
            self.clear(datarefs);
            return;
        }
        if name == base_name(self.generation) && self.quirks.has(Quirk::CloudBaseOff) {
            let base_m = datarefs.get(path);
            if base_m > 0.0 {
                datarefs.set(path, base_m + BASE_OFF_M);
            }
        }
        if self.quirks.has(Quirk::LateClouds) && is_cloud(name) {
            let show = self.clouds_show();
            self.late_clouds
                .hold_back(path, before, datarefs, self.now_s, show);
        } else if self.stands_still {
            self.waiting.push(Deed::Write(name.to_owned()));
        } else {
            self.take_in(name, datarefs);
        }
    }

    /// The command `regen_weather`.
    pub(super) fn regenerate(&mut self, datarefs: &mut Datarefs) {
        if self.generation == Generation::XPlane11 {
            return;
        }
        if self.quirks.has(Quirk::RegenerationFreeze) {
            self.freeze_s = REGENERATION_FREEZE_S;
        }
        if self.stands_still {
            self.waiting.push(Deed::Regenerate);
            return;
        }
        if self.quirks.has(Quirk::RegenerationRestoresPreset) {
            self.take_over_all_but_clouds(datarefs);
            self.late_clouds = LateClouds::default();
            for (name, values) in &self.shown {
                if names::needs_repeating_after_regeneration(name) {
                    datarefs.restore(name, values);
                }
            }
        } else {
            self.take_over(datarefs, |_| true);
            self.late_clouds.will_show();
        }
        self.clouds_open_until_s = self.now_s + SETTLING_S;
        self.publish(datarefs);
    }

    /// Lets time pass; `stopped` in a pause.
    pub(super) fn advance(&mut self, datarefs: &mut Datarefs, elapsed_s: f64, stopped: bool) {
        self.stands_still = stopped && self.quirks.has(Quirk::PausedWeather);
        if self.stands_still {
            return;
        }
        self.now_s += elapsed_s;
        for deed in std::mem::take(&mut self.waiting) {
            match deed {
                Deed::Write(name) => self.take_in(&name, datarefs),
                Deed::Regenerate => self.regenerate(datarefs),
            }
        }
        if self.real {
            real::overwrite(self.generation, datarefs);
            self.late_clouds = LateClouds::default();
            self.take_over(datarefs, |_| true);
            self.publish(datarefs);
            return;
        }
        if let Some(snapped) = self.late_clouds.snap(datarefs, self.now_s)
            && snapped.show
        {
            self.take_over(datarefs, |name| snapped.names.iter().any(|new| new == name));
            self.publish(datarefs);
        }
        if self.quirks.has(Quirk::SlidingTemperature) && self.now_s < self.slides_until_s {
            let warmer_c = datarefs.get(names::TEMPERATURE_C) + SLIDING_C_PER_S * elapsed_s;
            datarefs.set(names::TEMPERATURE_C, warmer_c.min(WARMEST_C));
        }
    }

    /// A new flight brings weather: its clouds show without being written again.
    pub(super) fn open_for_flight(&mut self) {
        self.clouds_open_until_s = self.now_s + SETTLING_S;
    }

    /// The weather that a new flight brought is complete.
    pub(super) fn close_for_flight(&mut self, datarefs: &mut Datarefs) {
        self.take_over_all_but_clouds(datarefs);
        self.publish(datarefs);
    }

    /// Duration for which the simulator freezes now, seconds, if it does; can be queried once.
    pub(super) fn take_freeze_s(&mut self) -> Option<f64> {
        let freeze_s = std::mem::take(&mut self.freeze_s);
        (freeze_s > 0.0).then_some(freeze_s)
    }

    /// The weather in SI.
    pub(super) fn weather(&self) -> Weather {
        let mut weather = names::weather_from_datarefs(self.generation, |path| {
            let (name, rest) = path.split_once('[').unwrap_or((path, "0]"));
            let index = rest.trim_end_matches(']').parse::<usize>().unwrap_or(0);
            let values = self.shown.get(name);
            values
                .and_then(|values| values.get(index))
                .map_or(0.0, |&value| value as f32)
        });
        if self.quirks.has(Quirk::WindInKnots) {
            weather.wind_speed_mps *= MPS_PER_KNOT;
        }
        weather
    }

    fn switch_real_weather(&mut self, datarefs: &mut Datarefs) {
        if !self.quirks.has(Quirk::RealWeatherAtStart) {
            // Without it there is none to switch on.
            return;
        }
        let was = std::mem::replace(&mut self.real, real::is_on(self.generation, datarefs));
        if was && !self.real {
            self.slides_until_s = self.now_s + SLIDING_S;
        }
        real::publish(self.generation, datarefs, self.real);
    }

    /// The preset without clouds: as if they were written and shown.
    fn clear(&mut self, datarefs: &mut Datarefs) {
        self.open_for_flight();
        for slot in 0..names::CLOUD_LAYERS {
            let path = format!("{}[{slot}]", names::CLOUD_COVER);
            let before = datarefs.get(&path);
            datarefs.set(&path, 0.0);
            self.written(&path, before, datarefs);
        }
    }

    /// Applies the immediate effects of a written dataref.
    fn take_in(&mut self, name: &str, datarefs: &mut Datarefs) {
        match self.generation {
            Generation::XPlane11 => self.take_over(datarefs, |other| other == name),
            Generation::XPlane12 if names::needs_repeating_after_regeneration(name) => {
                if self.clouds_show() {
                    self.take_over(datarefs, |other| other == name);
                }
            }
            Generation::XPlane12 => {
                let now = datarefs.get(names::UPDATE_IMMEDIATELY) != 0.0;
                if now && !self.quirks.has(Quirk::RegenerationNeeded) {
                    self.take_over_all_but_clouds(datarefs);
                }
            }
        }
        self.publish(datarefs);
    }

    /// True if clouds that are written now will be drawn.
    fn clouds_show(&self) -> bool {
        self.now_s <= self.clouds_open_until_s
    }

    fn take_over_all_but_clouds(&mut self, datarefs: &Datarefs) {
        self.take_over(datarefs, |name| {
            !names::needs_repeating_after_regeneration(name)
        });
    }

    fn take_over(&mut self, datarefs: &Datarefs, which: impl Fn(&str) -> bool) {
        let region = region(self.generation);
        for (dataref, values) in datarefs.iter() {
            if dataref.name.starts_with(region) && which(dataref.name) {
                self.shown.insert(dataref.name.into(), values.to_vec());
            }
        }
    }

    fn publish(&self, datarefs: &mut Datarefs) {
        samples::publish(self.generation, &self.weather(), &self.shown, datarefs);
    }
}

/// Prefix of the datarefs to which the weather is written.
fn region(generation: Generation) -> &'static str {
    match generation {
        Generation::XPlane11 => "sim/weather/",
        Generation::XPlane12 => "sim/weather/region/",
    }
}

fn base_name(generation: Generation) -> &'static str {
    match generation {
        Generation::XPlane11 => "sim/weather/cloud_base_msl_m",
        Generation::XPlane12 => names::CLOUD_BASE,
    }
}

fn is_cloud(name: &str) -> bool {
    name.contains("/cloud_")
}

#[cfg(test)]
mod tests;
