//! `aircraft` of `[approach]`: a type, or types of which each scenario draws one.

use std::collections::BTreeSet;

use airframe::AircraftType;
use schemars::{JsonSchema, Schema};
use serde::Deserialize;

use super::check::fault::{Checked, fault};
use crate::seed::shuffle_key;

const KEY: &str = "approach.aircraft";

/// Types by name or ICAO designator.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected an aircraft type, or { one_of = [types] }"
)]
pub(super) enum AircraftTable {
    /// One type for the whole corpus.
    One(TypeName),
    /// Types of which each scenario draws one.
    OneOf(OneOf),
}

/// Types of which each scenario draws one.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct OneOf {
    /// Aircraft types; each is as likely.
    #[schemars(length(min = 1))]
    one_of: Vec<TypeName>,
}

/// Name or ICAO designator of a type.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(transparent)]
#[schemars(inline, transform = known_type)]
pub(super) struct TypeName(String);

fn known_type(schema: &mut Schema) {
    let names: Vec<&str> = AircraftType::all()
        .iter()
        .flat_map(AircraftType::names)
        .collect();
    schema.insert("enum".into(), serde_json::json!(names));
}

fn of_name(name: &str, key: impl Into<String>) -> Checked<&'static AircraftType> {
    AircraftType::named(name).or_else(|unknown| fault(key, unknown.to_string()))
}

impl TypeName {
    /// This type alone.
    pub(super) fn only(&self, key: String) -> Checked<AircraftTypes> {
        Ok(AircraftTypes(vec![of_name(&self.0, key)?]))
    }
}

impl AircraftTable {
    /// The types, all different.
    pub(super) fn checked(&self) -> Checked<AircraftTypes> {
        let names = match self {
            Self::One(name) => std::slice::from_ref(name),
            Self::OneOf(table) => &table.one_of,
        };
        let mut types = Vec::new();
        for TypeName(name) in names {
            types.push(of_name(name, KEY)?);
        }
        let different: BTreeSet<&str> = types.iter().map(|of| of.name.as_str()).collect();
        if different.len() < types.len() || types.is_empty() {
            return fault(
                KEY,
                format!(
                    "one_of has {} types, expected at least one, and each once",
                    types.len()
                ),
            );
        }
        Ok(AircraftTypes(types))
    }
}

/// The types of a corpus; never empty, all different.
#[derive(Debug, Clone)]
pub struct AircraftTypes(Vec<&'static AircraftType>);

impl AircraftTypes {
    /// The type, if all scenarios have the same.
    pub fn only(&self) -> Option<&'static AircraftType> {
        match self.0.as_slice() {
            [only] => Some(only),
            _ => None,
        }
    }

    /// All of them.
    pub fn all(&self) -> &[&'static AircraftType] {
        &self.0
    }

    /// The type that a scenario draws. One that is added to the list is drawn by some scenarios and changes no other.
    pub(crate) fn drawn(&self, scenario_seed: u64) -> &'static AircraftType {
        self.drawn_as("aircraft", scenario_seed)
    }

    /// A type that a scenario draws for a purpose.
    pub(crate) fn drawn_as(&self, purpose: &str, scenario_seed: u64) -> &'static AircraftType {
        let order = |of: &&&AircraftType| shuffle_key(scenario_seed, purpose, &of.name);
        self.0
            .iter()
            .max_by_key(order)
            .copied()
            .unwrap_or(self.0[0])
    }
}
