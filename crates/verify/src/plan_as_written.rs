//! `plan.json` as it is written, by this version of dtd or a different one, whole or damaged: each value is read for itself, so that one
//! that cannot be read hides no other.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use dataset::conditions::Conditions;
use dataset::corpus::scenario::Flight;
use dataset::geometry::imaging::Imaging;
use dataset::geometry::runway::Runway;
use dataset::plan::{Aim, Jitter, Picture, PlannedCamera, plan_hash};

/// Planned properties of every scenario.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct PlanAsWritten {
    pub(super) plan_hash: Written<String>,
    pub(super) sweep_blake3: Written<String>,
    pub(super) common: CommonAsWritten,
    scenarios: Vec<ScenarioAsWritten>,
}

/// Properties shared by all scenarios.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct CommonAsWritten {
    pub(super) aircraft: Written<String>,
    pub(super) runway: Written<Runway>,
    pub(super) rig: Written<String>,
    pub(super) cameras: Written<Vec<PlannedCamera>>,
    pub(super) picture: Written<Picture>,
}

/// A planned scenario.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct ScenarioAsWritten {
    id: Written<String>,
    pub(super) config_hash: Written<String>,
    pub(super) seed: Written<u64>,
    pub(super) trajectory: Written<String>,
    pub(super) parameters: ParametersAsWritten,
}

/// A scenario's own parameters.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct ParametersAsWritten {
    pub(super) conditions: Written<Conditions>,
    pub(super) flight: Written<Flight>,
    pub(super) aim: Written<Option<Aim>>,
    pub(super) jitter: Written<Option<BTreeMap<String, Jitter>>>,
    pub(super) imaging: Written<Option<BTreeMap<String, Imaging>>>,
}

impl PlanAsWritten {
    /// The hash of the scenarios as they are listed.
    pub(super) fn hash_again(&self) -> String {
        fn text(written: &Written<String>) -> &str {
            written.value().map_or("", |text| text)
        }
        let scenarios = self.scenarios.iter();
        plan_hash(scenarios.map(|scenario| (text(&scenario.id), text(&scenario.config_hash))))
    }

    /// The scenarios by their identifiers.
    pub(super) fn scenarios(&self) -> BTreeMap<&str, &ScenarioAsWritten> {
        let scenarios = self.scenarios.iter();
        scenarios
            .filter_map(|scenario| Some((scenario.id.value()?.as_str(), scenario)))
            .collect()
    }
}

/// A planned value, or the invalid value in its place; null if it is missing.
pub(super) enum Written<T> {
    Value(T),
    Odd { found: Value, fault: String },
}

impl<T> Written<T> {
    /// The value, if it can be read.
    pub(super) fn value(&self) -> Option<&T> {
        self.read("").ok()
    }

    /// The value; the error says that `what` cannot be read, and why.
    pub(super) fn read(&self, what: &'static str) -> Result<&T, Unreadable<'_>> {
        match self {
            Self::Value(value) => Ok(value),
            Self::Odd { fault, .. } => Err(Unreadable { what, fault }),
        }
    }
}

/// A value that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{what} cannot be read: {fault}")]
pub(super) struct Unreadable<'a> {
    what: &'static str,
    fault: &'a str,
}

impl<T: DeserializeOwned> From<Value> for Written<T> {
    fn from(found: Value) -> Self {
        match T::deserialize(&found) {
            Ok(value) => Self::Value(value),
            Err(error) => Self::Odd {
                found,
                fault: error.to_string(),
            },
        }
    }
}

impl<T: DeserializeOwned> Default for Written<T> {
    fn default() -> Self {
        Value::Null.into()
    }
}

impl<'de, T: DeserializeOwned> Deserialize<'de> for Written<T> {
    fn deserialize<D: Deserializer<'de>>(input: D) -> Result<Self, D::Error> {
        Value::deserialize(input).map(Self::from)
    }
}

impl<T: Serialize + PartialEq> Written<T> {
    /// Text on how a recorded value differs from the planned one.
    pub(super) fn other_than(&self, what: &str, recorded: &T) -> Option<String> {
        if self.value() == Some(recorded) {
            return None;
        }
        let found = Written::Value(recorded);
        Some(format!(
            "{what} was planned as {self} (plan.json), but recorded as {found}"
        ))
    }
}

impl<T: Serialize> fmt::Display for Written<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Value(value) => match serde_json::to_value(value) {
                Ok(value) => write!(f, "{value}"),
                Err(error) => write!(f, "{error}"),
            },
            Self::Odd { found, .. } => write!(f, "{found}"),
        }
    }
}
