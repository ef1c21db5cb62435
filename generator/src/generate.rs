//! Makes the scenarios of a plan: flown, recorded, sealed, committed; one after the other.
//!
//! A scenario is made in `<id>.partial/` and renamed when it is whole, so a run can be stopped or killed at any moment and the next one
//! goes on: whole scenarios are skipped, unfinished ones are thrown away and made anew. A scenario that fails is tried once more with
//! a fresh connection, then reported, and the run goes on with the next.

mod cancel;
mod encoders;
mod error;
mod lockstep;
mod record;
mod session;
mod workplace;

use std::path::{Path, PathBuf};
use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::json_file::write_atomically;
use dataset::splits::Splits;
use serde::Serialize;

pub use cancel::Cancel;
pub use error::{GenerateError, ScenarioError};
pub use session::SimulatorTarget;

use crate::plan::{Plan, PlannedScenario, assign_sides, expand};
use crate::sweep::Sweep;
use session::Session;

/// How often a scenario is tried.
const ATTEMPTS: u32 = 2;

/// What to make, and with which simulator.
#[derive(Debug, Clone)]
pub struct GenerateOptions {
    /// The simulator.
    pub target: SimulatorTarget,
    /// The program that becomes the stand-in when called with `mock-xplane`: the `dtd` command itself.
    pub stand_in_program: PathBuf,
    /// Identifiers of the scenarios to make; empty for all.
    pub only: Vec<String>,
}

/// What happened to the scenarios of a run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Outcome {
    /// Made by this run.
    pub committed: Vec<String>,
    /// Whole already.
    pub skipped: Vec<String>,
    /// Given up, with the reason of the last attempt.
    pub failed: Vec<FailedScenario>,
    /// Whether the run was stopped before its end.
    #[serde(skip)]
    pub interrupted: bool,
}

/// A scenario that could not be made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FailedScenario {
    /// Its identifier.
    pub id: String,
    /// Why.
    pub reason: String,
}

/// What a run is doing, for whoever shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event<'a> {
    /// The run begins.
    Planned {
        /// Scenarios to make.
        to_make: usize,
        /// Scenarios that are whole already.
        skipped: usize,
        /// Expected ticks of all that are to be made.
        ticks: u64,
    },
    /// A scenario begins.
    Started {
        /// Its identifier.
        id: &'a str,
        /// Expected number of ticks.
        ticks: u32,
    },
    /// Its flight is there: from now on the number of ticks is certain.
    Flown {
        /// Number of ticks.
        ticks: u32,
    },
    /// All views of a tick are captured.
    Captured {
        /// Ticks so far.
        done: u32,
    },
    /// A scenario is whole.
    Committed {
        /// Its identifier.
        id: &'a str,
        /// Number of ticks.
        ticks: u32,
        /// How long it took, seconds.
        seconds: f64,
    },
    /// An attempt failed and is repeated.
    Retrying {
        /// Identifier of the scenario.
        id: &'a str,
        /// Why.
        reason: &'a str,
    },
    /// A scenario is given up.
    Failed {
        /// Its identifier.
        id: &'a str,
        /// Why.
        reason: &'a str,
    },
}

/// Takes the events of a run.
pub type OnEvent<'a> = dyn FnMut(Event<'_>) + Send + 'a;

/// Makes the scenarios of a sweep in a corpus; see the module.
///
/// # Errors
/// Before anything is written: the corpus was begun with another plan, a scenario of `only` is not in the plan, or the simulator is not
/// there. Later: the corpus cannot be written. Scenarios that fail are no errors but part of the outcome.
pub async fn generate(
    sweep: &Sweep,
    corpus_root: &Path,
    options: &GenerateOptions,
    cancel: &Cancel,
    on_event: &mut OnEvent<'_>,
) -> Result<Outcome, GenerateError> {
    let plan = expand(sweep);
    let wanted = wanted(&plan, &options.only)?;
    let frozen = frozen_plan(corpus_root)?;
    if let Some(difference) = frozen
        .as_ref()
        .and_then(|frozen| plan.conflict_with(frozen))
    {
        return Err(GenerateError::OtherPlan {
            corpus: corpus_root.to_owned(),
            difference,
        });
    }
    let mut outcome = Outcome::default();
    let mut to_make = Vec::new();
    for scenario in wanted {
        if is_whole(corpus_root, scenario)? {
            outcome.skipped.push(scenario.id.clone());
        } else {
            to_make.push(scenario);
        }
    }
    on_event(Event::Planned {
        to_make: to_make.len(),
        skipped: outcome.skipped.len(),
        ticks: to_make.iter().map(|s| u64::from(s.ticks)).sum(),
    });
    // A simulator that is not there is found out before anything is written.
    let mut session = match to_make.is_empty() {
        true => None,
        false => Some(Session::open(&options.target, &options.stand_in_program).await?),
    };
    let corpus = Corpus::create(corpus_root)?;
    write_plan(&corpus, sweep, &plan, frozen.as_ref())?;
    if let Some(session) = &mut session {
        for scenario in to_make {
            if cancel.is_cancelled() {
                break;
            }
            make(
                sweep,
                &plan,
                scenario,
                &corpus,
                session,
                cancel,
                on_event,
                &mut outcome,
            )
            .await;
        }
    }
    if let Some(session) = session {
        session.close().await;
    }
    outcome.interrupted = cancel.is_cancelled();
    Ok(outcome)
}

fn wanted<'a>(plan: &'a Plan, only: &[String]) -> Result<Vec<&'a PlannedScenario>, GenerateError> {
    if let Some(id) = only
        .iter()
        .find(|id| !plan.scenarios.iter().any(|s| s.id == **id))
    {
        let example = plan
            .scenarios
            .first()
            .map(|s| s.id.clone())
            .unwrap_or_default();
        return Err(GenerateError::UnknownScenario {
            id: id.clone(),
            scenarios: plan.scenarios.len(),
            example,
        });
    }
    Ok(plan
        .scenarios
        .iter()
        .filter(|s| only.is_empty() || only.contains(&s.id))
        .collect())
}

fn frozen_plan(corpus_root: &Path) -> Result<Option<Plan>, GenerateError> {
    match Corpus::open(corpus_root) {
        Ok(corpus) if corpus.plan_path().exists() => Ok(Some(Plan::read(&corpus.plan_path())?)),
        _ => Ok(None),
    }
}

/// Whether a scenario is there, sealed, and made from these very parameters.
fn is_whole(corpus_root: &Path, scenario: &PlannedScenario) -> Result<bool, GenerateError> {
    let Ok(corpus) = Corpus::open(corpus_root) else {
        return Ok(false);
    };
    let folder = corpus.scenario(&scenario.id);
    let seal = folder.seal()?;
    if !folder.root().exists() {
        return Ok(false);
    }
    match seal {
        Some(seal) if seal.config_hash == scenario.config_hash => Ok(true),
        Some(_) => Err(GenerateError::ForeignFolder {
            folder: folder.root().to_owned(),
            message: "it was made from other parameters",
        }),
        None => Err(GenerateError::ForeignFolder {
            folder: folder.root().to_owned(),
            message: "it has no seal (DONE.json)",
        }),
    }
}

/// Freezes the plan in the corpus, or adds to the one that is there.
fn write_plan(
    corpus: &Corpus,
    sweep: &Sweep,
    plan: &Plan,
    frozen: Option<&Plan>,
) -> Result<(), GenerateError> {
    let path = corpus.splits_path();
    let earlier = if path.exists() {
        Some(Splits::read(&path)?)
    } else {
        None
    };
    let splits = assign_sides(plan, &sweep.split, sweep.corpus.seed, earlier.as_ref())
        .map_err(|message| dataset::Error::corpus(&path, message))?;
    if earlier.as_ref() != Some(&splits) {
        splits.write(&path)?;
    }
    if frozen != Some(plan) {
        write_atomically(&corpus.sweep_path(), sweep.text.as_bytes())?;
        plan.write(&corpus.plan_path())?;
    }
    Ok(())
}

#[allow(
    clippy::too_many_arguments,
    reason = "the loop body of `generate`, apart for the sake of its retry"
)]
async fn make(
    sweep: &Sweep,
    plan: &Plan,
    scenario: &PlannedScenario,
    corpus: &Corpus,
    session: &mut Session,
    cancel: &Cancel,
    on_event: &mut OnEvent<'_>,
    outcome: &mut Outcome,
) {
    let began = Instant::now();
    let id = scenario.id.as_str();
    for attempt in 1..=ATTEMPTS {
        on_event(Event::Started {
            id,
            ticks: scenario.ticks,
        });
        let made = record::record(sweep, plan, scenario, corpus, session, cancel, on_event).await;
        match made {
            Ok(ticks) => {
                on_event(Event::Committed {
                    id,
                    ticks,
                    seconds: began.elapsed().as_secs_f64(),
                });
                outcome.committed.push(id.to_owned());
                return;
            }
            Err(ScenarioError::Cancelled) => return,
            Err(error) if attempt < ATTEMPTS => {
                tracing::warn!(id, %error, "attempt failed");
                on_event(Event::Retrying {
                    id,
                    reason: &error.to_string(),
                });
            }
            Err(error) => {
                tracing::error!(id, %error, "given up");
                let reason = error.to_string();
                on_event(Event::Failed {
                    id,
                    reason: &reason,
                });
                outcome.failed.push(FailedScenario {
                    id: id.to_owned(),
                    reason,
                });
            }
        }
    }
}
