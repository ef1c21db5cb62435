//! `[grid]`, `[[exclude]]` and `[[include]]`: which times, weathers, profiles and repeats are combined.
//!
//! A combination is identified by its values, never by its position: adding a time, a weather or a repeat adds combinations and
//! leaves the others as they are.

pub(crate) mod split;
pub(crate) mod times;

use std::collections::{BTreeMap, BTreeSet};

use dataset::numbers::limits;
use schemars::JsonSchema;
use serde::Deserialize;

use super::check::fault::{Checked, NAME_PATTERN, defined, fault, list};
use super::check::limits::in_schema;
use crate::time_of_day::TimeOfDay;
use times::{LocalDay, TimeEntry};

/// Maximum number of scenarios: more is a typo, and a plan of gigabytes.
const MAX_SCENARIOS: u64 = 1_000_000;

/// `[grid]`: every time is combined with every weather (and every profile, if they are listed here), `repeats` times.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Grid {
    /// Local times: `"HH:MM"`, or `{ from = "06:00", to = "18:00", every_min = 60 }`, or by the sun: `"dawn"`, `"dusk"`, `"sunset-00:20"`,
    /// `{ sun_elevation_deg = -4, in = "evening" }`.
    #[schemars(length(min = 1))]
    times: Vec<TimeEntry>,
    /// Names of weathers that the file defines; by default all.
    #[schemars(length(min = 1), extend("uniqueItems" = true), inner(regex(pattern = NAME_PATTERN)))]
    weathers: Option<Vec<String>>,
    /// Names of flight profiles to combine with. By default, each scenario draws one of `start.profiles`.
    #[schemars(length(min = 1), extend("uniqueItems" = true), inner(regex(pattern = NAME_PATTERN)))]
    pub(super) profiles: Option<Vec<String>>,
    /// Number of flights per combination, each with a different seed.
    #[schemars(range(min = 1, max = MAX_SCENARIOS))]
    repeats: u32,
    /// Day of the year, 1 to 365; it sets the sun's path.
    #[schemars(transform = in_schema(limits::DAY_OF_YEAR))]
    pub(super) day_of_year: u32,
    /// Local time minus UTC, hours. By default as in the time zone of the airport on this day.
    #[schemars(transform = in_schema(limits::UTC_OFFSET_H))]
    pub(super) utc_offset_h: Option<f64>,
}

/// `[[exclude]]`: combinations of the grid to omit: those that match every given list.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Exclude", extend("minProperties" = 1))]
pub(super) struct Selection {
    /// Times to omit.
    pub(super) times: Vec<String>,
    /// Weathers to omit.
    pub(super) weathers: Vec<String>,
    /// Repeats to omit, counted from 1.
    pub(super) repeats: Vec<u32>,
}

/// `[[include]]`: combinations in addition to the grid. Lists that are not given are the grid's.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("minProperties" = 1))]
pub(super) struct Include {
    /// Times to add, which need not be in the grid.
    times: Vec<TimeEntry>,
    /// Weathers to add, which need not be in the grid.
    weathers: Vec<String>,
    /// Repeats to add, counted from 1.
    #[schemars(inner(range(min = 1, max = MAX_SCENARIOS)))]
    repeats: Vec<u32>,
}

/// Parameters that distinguish scenarios within a sweep.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Combination {
    /// Number of the repeat, from 1.
    pub repeat: u32,
    /// Local time.
    pub time: TimeOfDay,
    /// Name of the weather.
    pub weather: String,
    /// Name of the profile, if the grid lists profiles.
    pub profile: Option<String>,
}

impl Combination {
    /// Identifier of the scenario: local time, weather, profile if the grid lists them, repeat; e.g. `1700-foggy-r3`.
    pub fn id(&self) -> String {
        format!("{}-r{}", self.condition(), self.repeat)
    }

    /// The common part of all repeats, e.g. `1700-foggy`.
    pub fn condition(&self) -> String {
        format!("{}-{}", self.time.digits(), self.label())
    }

    fn label(&self) -> String {
        match &self.profile {
            None => self.weather.clone(),
            Some(profile) => format!("{}-{profile}", self.weather),
        }
    }
}

/// Names of weathers and profiles that a sweep may use.
pub(super) struct Names<'a> {
    pub(super) weathers: BTreeSet<&'a String>,
    pub(super) profiles: BTreeSet<&'a String>,
}

/// All combinations, in recording order. Repeats vary slowest: a run that is stopped early has covered all conditions.
pub(super) fn combinations(
    grid: &Grid,
    exclude: &[Selection],
    include: &[Include],
    names: &Names<'_>,
    day: &LocalDay,
) -> Checked<Vec<Combination>> {
    let axes = Axes::of_grid(grid, names, day)?;
    let mut all = axes.combine();
    for (index, rule) in exclude.iter().enumerate() {
        rule.apply(index, &mut all, day)?;
    }
    if all.is_empty() {
        return fault(
            "exclude",
            "every combination of the grid is excluded; expected at least one that is left",
        );
    }
    for (index, rule) in include.iter().enumerate() {
        rule.apply(index, &axes, names, day, &mut all)?;
    }
    check_count("include", all.len() as u64)?;
    check_labels(&all)?;
    Ok(all)
}

/// The lists whose product is formed.
#[derive(Clone)]
struct Axes {
    times: Vec<TimeOfDay>,
    weathers: Vec<String>,
    profiles: Vec<Option<String>>,
    repeats: Vec<u32>,
}

impl Axes {
    fn of_grid(grid: &Grid, names: &Names<'_>, day: &LocalDay) -> Checked<Self> {
        let times = times("grid.times", &grid.times, day)?;
        let weathers = match &grid.weathers {
            Some(listed) => {
                distinct("grid.weathers", listed, |key, name| {
                    defined(key, "weather", name, &names.weathers)
                })?;
                listed.clone()
            }
            None => names.weathers.iter().copied().cloned().collect(),
        };
        let profiles = match &grid.profiles {
            Some(listed) => {
                distinct("grid.profiles", listed, |key, name| {
                    defined(key, "profile", name, &names.profiles)
                })?;
                listed.iter().cloned().map(Some).collect()
            }
            None => vec![None],
        };
        if times.is_empty() || weathers.is_empty() || profiles.is_empty() || grid.repeats == 0 {
            return fault(
                "grid",
                "the grid is empty; expected at least one time, one weather and one repeat",
            );
        }
        let conditions = (times.len() * weathers.len() * profiles.len()) as u64;
        check_count("grid.repeats", conditions * u64::from(grid.repeats))?;
        Ok(Self {
            times,
            weathers,
            profiles,
            repeats: (1..=grid.repeats).collect(),
        })
    }

    fn combine(&self) -> Vec<Combination> {
        let mut all = Vec::with_capacity(
            self.repeats.len() * self.times.len() * self.weathers.len() * self.profiles.len(),
        );
        for &repeat in &self.repeats {
            for &time in &self.times {
                for weather in &self.weathers {
                    for profile in &self.profiles {
                        all.push(Combination {
                            repeat,
                            time,
                            weather: weather.clone(),
                            profile: profile.clone(),
                        });
                    }
                }
            }
        }
        all
    }
}

impl Selection {
    fn apply(&self, index: usize, all: &mut Vec<Combination>, day: &LocalDay) -> Checked<()> {
        let key = |field: &str| format!("exclude.{index}.{field}");
        let matches = self.matcher(all, day, key)?;
        let before = all.len();
        all.retain(|combination| !matches(combination));
        if all.len() == before {
            return fault(
                format!("exclude.{index}"),
                "excludes nothing: no combination that is left fits all its lists",
            );
        }
        Ok(())
    }

    /// The filter for combinations; rejects values that no combination of `all` has. An empty list matches all.
    pub(super) fn matcher<K: Fn(&str) -> String>(
        &self,
        all: &[Combination],
        day: &LocalDay,
        key: K,
    ) -> Checked<impl Fn(&Combination) -> bool + use<K>> {
        fn known<T: Ord + std::fmt::Display>(
            values: &[T],
            present: impl Iterator<Item = T>,
            key: String,
            what: &str,
        ) -> Checked<()> {
            let present: BTreeSet<T> = present.collect();
            match values.iter().position(|value| !present.contains(value)) {
                None => Ok(()),
                Some(index) => fault(
                    format!("{key}.{index}"),
                    format!(
                        "there is no {what} {} in the sweep; there are {}",
                        values[index],
                        list(&present)
                    ),
                ),
            }
        }
        let mut times = Vec::new();
        for (index, text) in self.times.iter().enumerate() {
            let key = format!("{}.{index}", key("times"));
            times.push(times::parse(&key, text, day)?);
        }
        let (weathers, repeats) = (self.weathers.clone(), self.repeats.clone());
        known(&times, all.iter().map(|c| c.time), key("times"), "time")?;
        let all_weathers = all.iter().map(|c| c.weather.clone());
        known(&weathers, all_weathers, key("weathers"), "weather")?;
        let all_repeats = all.iter().map(|c| c.repeat);
        known(&repeats, all_repeats, key("repeats"), "repeat")?;
        Ok(move |combination: &Combination| {
            (times.is_empty() || times.contains(&combination.time))
                && (weathers.is_empty() || weathers.contains(&combination.weather))
                && (repeats.is_empty() || repeats.contains(&combination.repeat))
        })
    }
}

impl Include {
    fn apply(
        &self,
        index: usize,
        grid: &Axes,
        names: &Names<'_>,
        day: &LocalDay,
        all: &mut Vec<Combination>,
    ) -> Checked<()> {
        let key = |field: &str| format!("include.{index}.{field}");
        let mut axes = grid.clone();
        if !self.times.is_empty() {
            axes.times = times(&key("times"), &self.times, day)?;
        }
        if !self.weathers.is_empty() {
            distinct(&key("weathers"), &self.weathers, |key, name| {
                defined(key, "weather", name, &names.weathers)
            })?;
            axes.weathers.clone_from(&self.weathers);
        }
        if !self.repeats.is_empty() {
            distinct(&key("repeats"), &self.repeats, |key, repeat| {
                if (1..=MAX_SCENARIOS).contains(&u64::from(*repeat)) {
                    Ok(())
                } else {
                    fault(key, format!("{repeat} is not a repeat; expected 1 or more"))
                }
            })?;
            axes.repeats.clone_from(&self.repeats);
        }
        let there: BTreeSet<&Combination> = all.iter().collect();
        let mut new = axes.combine();
        new.retain(|combination| !there.contains(combination));
        if new.is_empty() {
            return fault(
                format!("include.{index}"),
                "includes nothing: all its combinations are in the sweep already",
            );
        }
        all.append(&mut new);
        Ok(())
    }
}

fn times(key: &str, entries: &[TimeEntry], day: &LocalDay) -> Checked<Vec<TimeOfDay>> {
    let mut all = Vec::new();
    for (index, entry) in entries.iter().enumerate() {
        let key = format!("{key}.{index}");
        for time in entry.times(&key, day)? {
            if all.contains(&time) {
                return fault(key, format!("{time} is listed twice; use repeats"));
            }
            all.push(time);
        }
    }
    Ok(all)
}

fn distinct<T: Ord + std::fmt::Display>(
    key: &str,
    values: &[T],
    check: impl Fn(String, &T) -> Checked<()>,
) -> Checked<()> {
    let mut seen = BTreeSet::new();
    for (index, value) in values.iter().enumerate() {
        let key = format!("{key}.{index}");
        check(key.clone(), value)?;
        if !seen.insert(value) {
            return fault(key, format!("{value} is listed twice; use repeats"));
        }
    }
    Ok(())
}

fn check_count(key: &str, scenarios: u64) -> Checked<()> {
    if scenarios > MAX_SCENARIOS {
        return fault(
            key,
            format!("the sweep has {scenarios} scenarios; expected at most {MAX_SCENARIOS}"),
        );
    }
    Ok(())
}

/// Weather `a-b` without a profile and weather `a` with profile `b` would be recorded into one folder.
fn check_labels(all: &[Combination]) -> Checked<()> {
    let mut owners: BTreeMap<String, &str> = BTreeMap::new();
    for combination in all {
        let (label, weather) = (combination.label(), combination.weather.as_str());
        let other = *owners.entry(label.clone()).or_insert(weather);
        if other != weather {
            return fault(
                format!("weather.{weather}"),
                format!(
                    "weathers {other:?} and {weather:?} with their profiles would both be called {label:?}; expected different names"
                ),
            );
        }
    }
    Ok(())
}
