//! `dtd plan`: a sweep's scenarios, their cost, and differences from a corpus.

mod pacing;
mod show;
mod warnings;

use std::path::Path;

use dataset::corpus::Corpus;
use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::sun::Sun;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::{Plan, PlannedScenario};
use generator::plan::{Estimate, Outlook, Pacing, expand};
use generator::progress::against::{Against, Standing};
use generator::sweep::Sweep;
use serde_json::{Value, json};
use store::{CorpusLocation, CorpusStore, Logged, StoreUrl};

use super::Outcome;
use super::async_runtime::async_runtime;
use super::object_store::{STORE_TIMEOUT, failure_of};
use super::output::print_json;
use crate::args::recording::PlanArgs;
use crate::failure::{Ending, Failure};

pub(crate) use warnings::warn;

/// The README's name for a corpus: compared with by default.
const DEFAULT_CORPUS: &str = "corpus";

/// Runs the verb.
pub(crate) fn run(args: &PlanArgs) -> Outcome {
    let (sweep, plan) = read_plan(&args.sweep)?;
    let outlook = Outlook::new(&sweep, &plan);
    warn(&sweep, &plan, &outlook);
    let compared = match &args.against {
        Some(CorpusLocation::Store(url)) => Some(compare_with_store(&plan, url)?),
        Some(CorpusLocation::Folder(root)) => {
            let corpus = Corpus::open(root).map_err(Failure::bad_input)?;
            Some(compare(&sweep, &plan, &corpus)?)
        }
        None => match default_corpus(&plan) {
            Some(corpus) => Some(Compared {
                is_default: true,
                ..compare(&sweep, &plan, &corpus)?
            }),
            None => None,
        },
    };
    let pacing = pacing::pacing(args)?;
    let report = Report::new(&sweep, &plan, &pacing, outlook, compared.as_ref());
    report.warn();
    if args.json {
        print_json(&report.document())?;
    } else {
        report.show();
    }
    Ok(Ending::Done)
}

/// Reads a sweep and expands it.
pub(crate) fn read_plan(path: &Path) -> Result<(Sweep, Plan), Failure> {
    let sweep = Sweep::read(path).map_err(Failure::bad_input)?;
    let plan = expand(&sweep);
    Ok((sweep, plan))
}

/// Held-out data stays held out: a new [split] does not move existing scenarios.
fn warn_of_another_split(sweep: &Sweep, corpus: &Corpus) {
    let split = |text: &str| toml::from_str::<toml::Table>(text).ok()?.remove("split");
    let there = outside_file::read_text(&corpus.sweep_path(), FileKind::SWEEP);
    if there.is_ok_and(|there| split(&there) != split(&sweep.text)) {
        eprint_warning!(
            "[split] is not the one that {} was started with: its scenarios keep their sides, only new ones follow the new [split]",
            corpus.root().display()
        );
    }
}

/// The corpus of the default name, if it was made from a sweep of this name.
fn default_corpus(plan: &Plan) -> Option<Corpus> {
    let corpus = Corpus::open(Path::new(DEFAULT_CORPUS)).ok()?;
    let its_plan = Plan::read(&corpus.plan_path());
    let same_name = its_plan.is_ok_and(|its| its.corpus == plan.corpus);
    same_name.then_some(corpus)
}

fn compare(sweep: &Sweep, plan: &Plan, corpus: &Corpus) -> Result<Compared, Failure> {
    warn_of_another_split(sweep, corpus);
    Ok(Compared {
        corpus: corpus.root().display().to_string(),
        is_default: false,
        against: Against::compare(plan, corpus).map_err(Failure::bad_input)?,
    })
}

fn compare_with_store(plan: &Plan, url: &StoreUrl) -> Result<Compared, Failure> {
    let store = CorpusStore::open(url, false, STORE_TIMEOUT).map_err(failure_of)?;
    let against = async_runtime()?.block_on(async {
        store.watched(&Logged).check().await?;
        Against::compare_with_store(plan, &store).await
    });
    Ok(Compared {
        corpus: store.name().to_owned(),
        is_default: false,
        against: against.map_err(failure_of)?,
    })
}

struct Compared {
    /// Folder or URL.
    corpus: String,
    /// True if the corpus was not named and has the default name.
    is_default: bool,
    against: Against,
}

/// Everything that is reported about a plan.
struct Report<'a> {
    plan: &'a Plan,
    utc_offset_h: f64,
    outlook: Outlook,
    compared: Option<&'a Compared>,
    /// Cost of the whole plan.
    estimate: Estimate,
    /// The remaining part of that.
    left: Option<Estimate>,
}

impl<'a> Report<'a> {
    fn new(
        sweep: &Sweep,
        plan: &'a Plan,
        pacing: &Pacing,
        outlook: Outlook,
        compared: Option<&'a Compared>,
    ) -> Self {
        let size = compared.and_then(|compared| compared.against.size);
        let estimate = Estimate::new(&plan.common, &plan.scenarios, pacing, size);
        let left = compared.map(|compared| {
            let pairs = plan.scenarios.iter().zip(&compared.against.standings);
            let unmade = pairs.filter(|(_, standing)| **standing != Standing::Whole);
            Estimate::new(
                &plan.common,
                unmade.map(|(scenario, _)| scenario),
                pacing,
                size,
            )
        });
        Self {
            plan,
            utc_offset_h: sweep.utc_offset_h,
            outlook,
            compared,
            estimate,
            left,
        }
    }

    fn warn(&self) {
        for (name, level_m) in &self.outlook.low_levels_m {
            eprint_warning!(
                "the profile {name:?} flies level {level_m:.0} m above the runway, and approaches usually at 400 m or more: are its altitudes \
                 from another airport?"
            );
        }
    }

    /// The sun as the runway has it in a scenario.
    fn sun(&self, scenario: &PlannedScenario) -> Sun {
        Sun::true_at(
            self.plan.common.runway.threshold,
            &scenario.parameters.conditions.clock,
        )
    }

    /// Output of `--json`.
    fn document(&self) -> Value {
        let scenarios = self.plan.scenarios.iter().enumerate();
        let scenarios: Vec<Value> = scenarios
            .map(|(index, scenario)| {
                let mut row = row(scenario, self.sun(scenario));
                if let Some(compared) = self.compared {
                    row["standing"] = json!(compared.against.standings[index]);
                }
                row
            })
            .collect();
        json!({
            "plan_hash": self.plan.plan_hash,
            "corpus": self.plan.corpus,
            "runway": self.plan.common.runway,
            "estimate": self.estimate,
            "utc_offset_h": self.utc_offset_h,
            "outlook": self.outlook,
            "against": self.compared.map(|compared| self.difference(compared)),
            "scenarios": scenarios,
        })
    }

    fn difference(&self, compared: &Compared) -> Value {
        let against = &compared.against;
        let ids = |standing: Standing| -> Vec<&str> {
            let scenarios = against.standing(self.plan, standing);
            scenarios.map(|scenario| scenario.id.as_str()).collect()
        };
        json!({
            "corpus": compared.corpus,
            "whole": ids(Standing::Whole),
            "to_make": ids(Standing::ToMake),
            "new": ids(Standing::New),
            "damaged": against.damaged,
            "weather": against.weather,
            "changed": against.difference.changed,
            "removed": against.difference.removed,
            "left": self.left,
            "pace": against.pace,
        })
    }
}

/// A scenario in the output of `--json`. The sun's elevation is without refraction, its azimuth clockwise from north.
fn row(scenario: &PlannedScenario, sun: Sun) -> Value {
    let parameters = &scenario.parameters;
    let profile = parameters.live.as_ref().map(|live| &live.profile_name);
    json!({
        "id": scenario.id,
        "time_of_day": scenario.time_of_day,
        "weather": scenario.weather,
        "seed": scenario.seed,
        "flight": scenario.flight,
        "profile": profile,
        "start_dtd_nm": parameters.start_dtd_m / METERS_PER_NAUTICAL_MILE,
        "visibility_m": parameters.conditions.weather.visibility_m,
        "sun_elevation_deg": sun.elevation_deg,
        "sun_azimuth_deg": sun.azimuth_deg,
        "ticks": scenario.ticks,
        "config_hash": scenario.config_hash,
    })
}
