//! Leaving a condition out of training: performance in weather, at a time of day, with a type of aircraft, or with a graphics setting that
//! was never seen.

use airframe::AircraftType;
use dataset::corpus::splits::Side;

use crate::samples::{Samples, ScenarioSummary};

/// The condition for the test side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeftOut<'a> {
    Weather(&'a str),
    /// Time of day as named in the sweep.
    Time(&'a str),
    /// Aircraft type, by name.
    Type(&'a str),
    /// Graphics setting of the simulator, and its value.
    Graphics(&'a str, &'a str),
}

impl<'a> LeftOut<'a> {
    pub(crate) const EXPECTED: &'static str = "weather=NAME, time=HH:MM, type=NAME or graphics=SETTING=VALUE, as in scenario.json, or type=ICAO designator";

    /// Reads `weather=stormy`, `time=18:00`, `type=A359` or `graphics=renopt_MSAA=0`.
    pub(crate) fn parse(setting: &'a str) -> Option<Self> {
        match setting.split_once('=')? {
            (_, "") => None,
            ("weather", name) => Some(Self::Weather(name)),
            ("time", name) => Some(Self::Time(name)),
            ("type", name) => Some(Self::Type(
                AircraftType::named(name).map_or(name, |of| of.name.as_str()),
            )),
            ("graphics", setting) => {
                let (name, value) = setting.split_once('=')?;
                Some(Self::Graphics(name, value))
            }
            _ => None,
        }
    }

    fn has(self, scenario: &ScenarioSummary) -> bool {
        match self {
            Self::Weather(name) => scenario.weather == name,
            Self::Time(name) => scenario.time_of_day == name,
            Self::Type(name) => scenario.aircraft == name,
            Self::Graphics(name, value) => {
                let found = scenario.graphics.settings.get(name);
                found.is_some_and(|found| found == value)
            }
        }
    }

    /// Repeats the split: scenarios with this condition become the test side, scenarios with the same flights in other conditions are
    /// dropped, and the rest of the test side becomes validation. Returns whether the condition occurs.
    pub(crate) fn split(self, samples: &mut Samples) -> bool {
        let tested: Vec<String> = (samples.scenarios.iter())
            .filter(|scenario| self.has(scenario))
            .map(|scenario| scenario.flight.clone())
            .collect();
        samples
            .retain_scenarios(|scenario| self.has(scenario) || !tested.contains(&scenario.flight));
        for scenario in &mut samples.scenarios {
            scenario.side = match (self.has(scenario), scenario.side) {
                (true, _) => Side::Test,
                (false, Side::Test) => Side::Validation,
                (false, side) => side,
            };
        }
        !tested.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testkit::synthetic::SyntheticCorpus;

    #[test]
    fn a_setting_names_a_weather_a_time_a_type_or_graphics() {
        assert_eq!(
            LeftOut::parse("weather=stormy"),
            Some(LeftOut::Weather("stormy"))
        );
        assert_eq!(LeftOut::parse("time=18:00"), Some(LeftOut::Time("18:00")));
        for name in ["A350-900", "A359"] {
            let setting = format!("type={name}");
            assert_eq!(LeftOut::parse(&setting), Some(LeftOut::Type("A350-900")));
        }
        assert_eq!(
            LeftOut::parse("graphics=renopt_MSAA=0"),
            Some(LeftOut::Graphics("renopt_MSAA", "0"))
        );
        for wrong in ["stormy", "weather=", "wind=10", "graphics=zink", ""] {
            assert_eq!(LeftOut::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn scenarios_that_were_drawn_with_the_left_out_graphics_are_the_test_side() {
        let mut samples = Samples::synthetic(&SyntheticCorpus::tiny(), 0.0);
        for (at, scenario) in samples.scenarios.iter_mut().enumerate() {
            let value = if at == 1 { "4" } else { "0" };
            let settings = &mut scenario.graphics.settings;
            settings.insert("renopt_MSAA".into(), value.into());
        }
        assert!(LeftOut::Graphics("renopt_MSAA", "4").split(&mut samples));
        let tested: Vec<&str> = (samples.scenarios_of(Side::Test))
            .map(|scenario| scenario.id.as_str())
            .collect();
        assert_eq!(tested, ["0001"]);
        assert!(!LeftOut::Graphics("renopt_FSR", "4").split(&mut samples));
    }

    #[test]
    fn the_left_out_weather_is_the_test_side_and_its_flights_are_nowhere_else() {
        let mut samples = Samples::synthetic(&SyntheticCorpus::tiny(), 0.0);
        for scenario in &mut samples.scenarios {
            scenario.weather = "clear".into();
        }
        // Two training scenarios in the storm; a third flies the same flight as one of them under a clear sky.
        samples.scenarios[1].weather = "stormy".into();
        samples.scenarios[2].weather = "stormy".into();
        samples.scenarios[3].flight = samples.scenarios[2].flight.clone();
        assert!(LeftOut::Weather("stormy").split(&mut samples));
        let sides: Vec<_> = samples
            .scenarios
            .iter()
            .map(|scenario| (scenario.id.as_str(), scenario.side))
            .collect();
        let expected = [
            ("0000", Side::Train),
            ("0001", Side::Test),
            ("0002", Side::Test),
            ("0004", Side::Validation),
            ("0005", Side::Validation),
            ("0006", Side::Validation),
        ];
        assert_eq!(sides, expected);
        for sample in &samples.samples {
            assert!(sample.scenario < sides.len());
        }
        let of_last = samples.samples.last().unwrap();
        assert_eq!(samples.scenarios[of_last.scenario].id, "0006");
        assert!(!LeftOut::Time("03:00").split(&mut samples));
    }
}
