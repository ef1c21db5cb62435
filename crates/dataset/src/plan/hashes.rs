//! A plan's hashes: of each scenario's parameters, and of the list of scenarios.
//!
//! Only values that were read or drawn are hashed. Values derived by trigonometry are excluded, because their last digits differ between
//! machines. Numbers are written with the fewest digits that read back as the same number, members in the order of the structs.

use super::camera::meridians_converge;
use super::{Common, Parameters, Plan, PlannedCamera, PlannedScenario};

/// Marks hashes of cameras whose `inward_deg` is measured at the mast: away from the equator it used to be measured at the target.
const INWARD_AT_MAST: &[u8] = b"\ninward_deg at the mast";

/// Hashes the parameters of the plan's scenarios.
#[derive(Debug)]
pub struct ConfigHasher {
    common: Vec<u8>,
}

/// Reasons why a plan does not match its hashes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum HashMismatch {
    /// A scenario's parameters were changed.
    #[error("the parameters of scenario {id} are not those that its config_hash is of")]
    Scenario {
        /// Identifier of the scenario.
        id: String,
    },
    /// The list of scenarios was changed.
    #[error("its scenarios are not those that its plan_hash is of")]
    Plan,
}

impl ConfigHasher {
    /// For scenarios that have this in common.
    pub fn new(common: &Common) -> Self {
        let mut bytes = json(common);
        let is_turned = |camera: &PlannedCamera| camera.inward_deg.is_some();
        if meridians_converge(&common.runway) && common.cameras.iter().any(is_turned) {
            bytes.extend_from_slice(INWARD_AT_MAST);
        }
        Self { common: bytes }
    }

    /// Hash of the scenario's identifier, seed, parameters and common values.
    pub fn config_hash(&self, id: &str, seed: u64, parameters: &Parameters) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{id}\n{seed}\n").as_bytes());
        hasher.update(&self.common);
        hasher.update(b"\n");
        hasher.update(&json(parameters));
        hasher.finalize().to_string()
    }
}

impl Plan {
    /// Checks the plan against its hashes.
    ///
    /// # Errors
    /// A scenario's parameters, or the list of scenarios, do not match their hashes.
    pub fn check_hashes(&self) -> Result<(), HashMismatch> {
        let hasher = ConfigHasher::new(&self.common);
        for scenario in &self.scenarios {
            let PlannedScenario {
                id,
                seed,
                parameters,
                config_hash,
                ..
            } = scenario;
            if hasher.config_hash(id, *seed, parameters) != *config_hash {
                return Err(HashMismatch::Scenario { id: id.clone() });
            }
        }
        if plan_hash(self.scenarios.iter().map(PlannedScenario::id_and_hash)) == self.plan_hash {
            Ok(())
        } else {
            Err(HashMismatch::Plan)
        }
    }
}

impl PlannedScenario {
    pub(super) fn id_and_hash(&self) -> (&str, &str) {
        (&self.id, &self.config_hash)
    }
}

/// Hash of the listed scenarios, each given by its identifier and `config_hash`.
pub fn plan_hash<'a>(scenarios: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    let mut hasher = blake3::Hasher::new();
    for (id, config_hash) in scenarios {
        hasher.update(format!("{id} {config_hash}\n").as_bytes());
    }
    hasher.finalize().to_string()
}

fn json(value: &impl serde::Serialize) -> Vec<u8> {
    serde_json::to_vec(value).expect("plain structs without maps of odd keys are always JSON")
}
