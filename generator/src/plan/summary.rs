//! The plan in machine-readable form.

use serde::Serialize;

use super::{Plan, PlannedScenario};

/// What `dtd plan --json` prints about a plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanSummary<'a> {
    /// Hash of the plan.
    pub plan_hash: &'a str,
    /// Name of the corpus.
    pub corpus: &'a str,
    /// One line per scenario.
    pub scenarios: Vec<ScenarioSummary<'a>>,
}

/// A scenario in machine-readable form.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScenarioSummary<'a> {
    /// Identifier.
    pub id: &'a str,
    /// Local time, `HH:MM`.
    pub time_of_day: &'a str,
    /// Name of the weather.
    pub weather: &'a str,
    /// Seed.
    pub seed: u64,
    /// `live` or a file name.
    pub flight: &'a str,
    /// Name of the flight profile; absent for recordings.
    pub profile: Option<&'a str>,
    /// Start, nautical miles before the touchdown target.
    pub start_dtd_nm: f64,
    /// Visibility, metres.
    pub visibility_m: f64,
    /// Expected number of ticks.
    pub ticks: u32,
    /// Hash of all parameters.
    pub config_hash: &'a str,
}

impl Plan {
    /// What `dtd plan --json` prints.
    pub fn summary(&self) -> PlanSummary<'_> {
        PlanSummary {
            plan_hash: &self.plan_hash,
            corpus: &self.corpus,
            scenarios: self
                .scenarios
                .iter()
                .map(PlannedScenario::summary)
                .collect(),
        }
    }
}

impl PlannedScenario {
    fn summary(&self) -> ScenarioSummary<'_> {
        let parameters = &self.parameters;
        ScenarioSummary {
            id: &self.id,
            time_of_day: &self.time_of_day,
            weather: &self.weather,
            seed: self.seed,
            flight: &self.flight,
            profile: parameters
                .live
                .as_ref()
                .map(|live| live.profile_name.as_str()),
            start_dtd_nm: parameters.start_dtd_m / dataset::units::METERS_PER_NAUTICAL_MILE,
            visibility_m: parameters.conditions.weather.visibility_m,
            ticks: self.ticks,
            config_hash: &self.config_hash,
        }
    }
}
