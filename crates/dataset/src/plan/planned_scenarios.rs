//! The planned scenarios, for readers that need no other part of the plan: plans of any version list them.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Deserialize;

use crate::corpus::Corpus;
use crate::error::{Error, Result};
use crate::files::json_file::parse_json;
use crate::files::outside_file::{self, FileKind};
use crate::files::own_path::own_path;

/// The hashes of the planned parameters, by scenario.
#[derive(Debug, Clone, Default)]
pub struct PlannedScenarios {
    plan: PathBuf,
    /// Missing if the corpus has no plan.
    config_hashes: Option<BTreeMap<String, String>>,
}

#[derive(Deserialize)]
struct Plan {
    scenarios: Vec<Planned>,
}

#[derive(Deserialize)]
struct Planned {
    id: String,
    config_hash: String,
}

impl PlannedScenarios {
    /// Reads a corpus's plan, if it has one.
    ///
    /// # Errors
    /// It cannot be read, or is not a plan.
    pub fn read(corpus: &Corpus) -> Result<Self> {
        let plan = own_path(corpus.root(), Corpus::PLAN)?;
        let content = Error::if_there(outside_file::read(&plan, FileKind::PLAN.unlinked()))?;
        let parsed = content.map(|content| parse_json::<Plan>(&content, &plan, super::WHAT));
        let scenarios = parsed.transpose()?.map(|plan| plan.scenarios);
        let by_id = |planned: Planned| (planned.id, planned.config_hash);
        Ok(Self {
            plan,
            config_hashes: scenarios.map(|all| all.into_iter().map(by_id).collect()),
        })
    }

    /// True if a scenario is planned; without a plan, always true.
    pub fn has(&self, id: &str) -> bool {
        let planned = self.config_hashes.as_ref();
        planned.is_none_or(|planned| planned.contains_key(id))
    }

    /// Rejects a scenario that is not planned, or has other parameters. Without a plan, accepts every scenario.
    ///
    /// # Errors
    /// See above.
    pub fn check(&self, id: &str, config_hash: &str) -> Result<()> {
        let Some(planned) = &self.config_hashes else {
            return Ok(());
        };
        let fault = match planned.get(id) {
            Some(planned) if planned == config_hash => return Ok(()),
            Some(planned) => format!(
                "plans scenario {id} with the config_hash {planned}, but it was made with {config_hash}"
            ),
            None => format!("has no scenario {id}, which is in the corpus"),
        };
        Err(Error::corpus(
            &self.plan,
            format!(
                "{fault}: one of the two is of another corpus; move the scenario's folder away, or put its plan.json there"
            ),
        ))
    }
}
