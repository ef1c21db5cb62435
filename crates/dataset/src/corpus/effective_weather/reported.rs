//! The effective weather of several scenarios with the same planned weather, for people: ranges, and the scenarios that are marked.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use super::{EffectiveQuantity, EffectiveWeather};
use crate::conditions::Weather;
use crate::corpus::scenario::ScenarioRecord;

/// The least and the largest reported value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// The least.
    pub least: f64,
    /// The largest.
    pub most: f64,
}

/// Weather that was reported under one weather of the sweep.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ReportedWeather {
    /// Number of scenarios.
    pub scenarios: usize,
    /// Number of scenarios without any report: recorded by a simulator that reports none.
    pub unreported: usize,
    /// The ranges of the reported quantities; those that no scenario has are missing.
    pub ranges: BTreeMap<EffectiveQuantity, Range>,
    /// The marked scenarios, with their differences from the plan.
    pub marked: BTreeMap<String, Vec<String>>,
}

impl ReportedWeather {
    /// Adds a scenario.
    pub fn add(&mut self, id: &str, shown: Option<&EffectiveWeather>, planned: &Weather) {
        self.scenarios += 1;
        let Some(shown) = shown else {
            self.unreported += 1;
            return;
        };
        for quantity in EffectiveQuantity::ALL {
            if let Some(value) = shown.value(quantity) {
                let range = self.ranges.entry(quantity).or_insert(Range {
                    least: value,
                    most: value,
                });
                range.least = range.least.min(value);
                range.most = range.most.max(value);
            }
        }
        if shown.is_marked() {
            let differences = shown.marks(planned);
            let said = differences.iter().map(ToString::to_string).collect();
            self.marked.insert(id.to_owned(), said);
        }
    }

    /// True if at least one scenario has a report.
    pub fn is_reported(&self) -> bool {
        self.scenarios > self.unreported
    }

    /// Sorts records by the name of their planned weather.
    pub fn by_name<'a>(
        records: impl IntoIterator<Item = &'a ScenarioRecord>,
    ) -> BTreeMap<String, Self> {
        let mut by_name: BTreeMap<String, Self> = BTreeMap::new();
        for record in records {
            let Some(weather) = record.weather() else {
                continue;
            };
            let name = record.weather_name().to_owned();
            let of_name: &mut Self = by_name.entry(name).or_default();
            of_name.add(&record.id, record.effective_weather.as_ref(), weather);
        }
        by_name
    }
}

/// A line of text: `visibility 79500 m to 80100 m, rain 0.00, 1 of 12 scenarios marked`.
impl fmt::Display for ReportedWeather {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ranges = self.ranges.iter().map(|(quantity, range)| {
            let [least, most] = [range.least, range.most].map(|end| quantity.with_unit(end));
            if least == most {
                format!("{quantity} {least}")
            } else {
                format!("{quantity} {least} to {most}")
            }
        });
        let mut parts: Vec<String> = ranges.collect();
        if self.unreported > 0 {
            parts.push(format!(
                "{} of {} without a report",
                self.unreported, self.scenarios
            ));
        }
        if !self.marked.is_empty() {
            parts.push(format!(
                "{} of {} marked",
                self.marked.len(),
                self.scenarios
            ));
        }
        f.write_str(&parts.join(", "))
    }
}
