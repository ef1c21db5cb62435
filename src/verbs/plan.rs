//! `dtd plan`: a sweep's scenarios, their cost, and differences from a corpus.

mod pacing;
mod show;
mod warnings;

use std::collections::BTreeMap;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::effective_weather::ReportedWeather;
use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::runway::Runway;
use dataset::geometry::sun::Sun;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::{Change, Plan, PlannedScenario};
use generator::against::{Against, Standing};
use generator::plan::{Estimate, Outlook, Pacing, expand};
use generator::sweep::Sweep;
use serde::Serialize;
use store::{CorpusLocation, CorpusStore, Logged, StoreUrl};

use super::Outcome;
use super::async_runtime::async_runtime;
use super::object_store::{STORE_TIMEOUT, failure_of};
use super::output::print_json;
use crate::args::PlanArgs;
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
    let pacing = pacing::pacing(args, &sweep)?;
    let report = Report::new(args, &sweep, &plan, &pacing, outlook, compared.as_ref());
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
        args: &PlanArgs,
        sweep: &Sweep,
        plan: &'a Plan,
        pacing: &Pacing,
        outlook: Outlook,
        compared: Option<&'a Compared>,
    ) -> Self {
        let pacing = (pacing, args.restart_every.map(u32::from));
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

    fn document(&self) -> Document<'_> {
        let standing = |index: usize| Some(self.compared?.against.standings[index]);
        let scenarios = self.plan.scenarios.iter().enumerate();
        Document {
            plan_hash: &self.plan.plan_hash,
            corpus: &self.plan.corpus,
            scenarios: scenarios
                .map(|(index, scenario)| Row::new(scenario, self.sun(scenario), standing(index)))
                .collect(),
            runway: &self.plan.common.runway,
            estimate: &self.estimate,
            utc_offset_h: self.utc_offset_h,
            outlook: &self.outlook,
            against: self.compared.map(|compared| AgainstDocument {
                corpus: &compared.corpus,
                whole: self.ids(compared, Standing::Whole),
                to_make: self.ids(compared, Standing::ToMake),
                new: self.ids(compared, Standing::New),
                damaged: &compared.against.damaged,
                weather: &compared.against.weather,
                changed: &compared.against.difference.changed,
                removed: &compared.against.difference.removed,
                left: self.left.as_ref(),
            }),
        }
    }

    fn ids(&self, compared: &'a Compared, standing: Standing) -> Vec<&'a str> {
        let id = |scenario: &'a PlannedScenario| scenario.id.as_str();
        let standing = compared.against.standing(self.plan, standing);
        standing.map(id).collect()
    }
}

/// Output of `--json`.
#[derive(Serialize)]
struct Document<'a> {
    plan_hash: &'a str,
    corpus: &'a str,
    runway: &'a Runway,
    estimate: &'a Estimate,
    /// Local time minus UTC, hours.
    utc_offset_h: f64,
    outlook: &'a Outlook,
    against: Option<AgainstDocument<'a>>,
    scenarios: Vec<Row<'a>>,
}

#[derive(Serialize)]
struct Row<'a> {
    id: &'a str,
    time_of_day: &'a str,
    weather: &'a str,
    seed: u64,
    /// `live`, `computed` or a file name.
    flight: &'a str,
    /// Name of the flight profile; absent for recordings.
    profile: Option<&'a str>,
    start_dtd_nm: f64,
    visibility_m: f64,
    /// Elevation of the sun's centre, without refraction.
    sun_elevation_deg: f64,
    /// Clockwise from north.
    sun_azimuth_deg: f64,
    ticks: u32,
    config_hash: &'a str,
    /// State in the corpus, if compared with one.
    #[serde(skip_serializing_if = "Option::is_none")]
    standing: Option<Standing>,
}

impl<'a> Row<'a> {
    fn new(scenario: &'a PlannedScenario, sun: Sun, standing: Option<Standing>) -> Self {
        let parameters = &scenario.parameters;
        let live = parameters.live.as_ref();
        Self {
            id: &scenario.id,
            time_of_day: &scenario.time_of_day,
            weather: &scenario.weather,
            seed: scenario.seed,
            flight: &scenario.flight,
            profile: live.map(|live| live.profile_name.as_str()),
            start_dtd_nm: parameters.start_dtd_m / METERS_PER_NAUTICAL_MILE,
            visibility_m: parameters.conditions.weather.visibility_m,
            sun_elevation_deg: sun.elevation_deg,
            sun_azimuth_deg: sun.azimuth_deg,
            ticks: scenario.ticks,
            config_hash: &scenario.config_hash,
            standing,
        }
    }
}

#[derive(Serialize)]
struct AgainstDocument<'a> {
    corpus: &'a str,
    whole: Vec<&'a str>,
    to_make: Vec<&'a str>,
    new: Vec<&'a str>,
    /// Faults, by identifier.
    damaged: &'a BTreeMap<String, String>,
    /// Weather reported by simulators at the aircraft, by name of the planned weather.
    weather: &'a BTreeMap<String, ReportedWeather>,
    changed: &'a [Change],
    removed: &'a [String],
    left: Option<&'a Estimate>,
}
