//! A trial: a few ticks from one scenario per weather, recorded into a temporary corpus as in a run, to measure the recording time with the
//! stand-in on this machine.
//!
//! Each scenario is recorded with few ticks and with more: the difference is the cost of images, the rest the cost per scenario. The
//! aircraft is shown all along its way, but the images are as close in time as the sweep wants: those that are close share the clouds,
//! which are an image's most expensive part.

pub(crate) mod encoder_trial;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use dataset::corpus::Corpus;
use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::scenario::Flight;
use dataset::plan::{Plan, PlannedScenario};
use futures_util::future::LocalBoxFuture;

use super::error::GenerateError;
use super::error::ScenarioError;
use super::event::Reporter;
use super::options::{Cancel, GenerateOptions};
use super::record::image_source::ImageSource;
use super::record::steps::Steps;
use super::record::{Work, record};
use super::run::attempt::{Attempt, unless_cancelled};
use super::session::Session;
use crate::plan::{WeatherCost, expand};
use crate::sweep::Sweep;

/// Numbers of ticks in a scenario's two recordings.
const TICKS: [u32; 2] = [3, 18];

/// Records a trial with the first simulator of `options`; returns the cost of each weather.
///
/// # Errors
/// The simulator does not start, or a scenario cannot be recorded.
pub fn trial<'a>(
    sweep: &'a Sweep,
    options: &'a GenerateOptions,
    cancel: &'a Cancel,
) -> LocalBoxFuture<'a, Result<BTreeMap<String, WeatherCost>, GenerateError>> {
    Box::pin(async move {
        let plan = expand(sweep);
        let folder = tempfile::tempdir().map_err(dataset::Error::io(
            "create",
            Path::new("a temporary folder"),
        ))?;
        let corpus = Corpus::create(folder.path())?;
        let target = &options.simulators.targets()[0];
        let pictures = ImageSource::new(options.pixels, options.screen.clone(), sweep.picture);
        let mut session = Session::new(
            target,
            0,
            &options.stand_in_program,
            &pictures,
            options.local_udp.clone(),
        );
        let mut ignore = |_: super::event::Event<'_>| {};
        let trial = Trial {
            work: Work {
                sweep,
                plan: &plan,
                corpus: &corpus,
                encoder: options.encoder.unwrap_or_default(),
            },
            reporter: Reporter::new(&mut ignore),
            answer_limit: options.patience.answer,
            cancel,
        };
        let costs = trial.costs(&mut session).await;
        session.close().await;
        costs.map_err(|error| match error {
            ScenarioError::Bridge(_) | ScenarioError::StandIn(_) => {
                GenerateError::Simulator(Box::new(error))
            }
            ScenarioError::Corpus(error) => error.into(),
            ScenarioError::Cancelled => GenerateError::Cancelled,
            error => GenerateError::Trial(Box::new(error)),
        })
    })
}

struct Trial<'a> {
    work: Work<'a>,
    reporter: Reporter<'a>,
    answer_limit: Duration,
    cancel: &'a Cancel,
}

impl Trial<'_> {
    async fn costs(
        &self,
        session: &mut Session,
    ) -> Result<BTreeMap<String, WeatherCost>, ScenarioError> {
        unless_cancelled(self.cancel, session.open()).await?;
        let mut costs = BTreeMap::new();
        for scenario in one_of_each_weather(self.work.plan) {
            let few = self.record(scenario, TICKS[0], session).await?;
            let again = self.record(scenario, TICKS[0], session).await?;
            let more = self.record(scenario, TICKS[1], session).await?;
            let views = self.work.plan.common.cameras.len() as f64;
            let pictures = |(ticks, _): (u32, Steps)| f64::from(ticks) * views;
            let recording_s = |(_, steps): (u32, Steps)| steps.recording.as_secs_f64();
            let more_pictures = (pictures(more) - pictures(again)).max(1.0);
            let picture_s = ((recording_s(more) - recording_s(again)) / more_pictures).max(0.0);
            costs.insert(
                scenario.weather.clone(),
                WeatherCost {
                    picture_s,
                    scenario_s: (recording_s(few) - pictures(few) * picture_s).max(0.0),
                    loading_s: again.1.loading.as_secs_f64(),
                    weather_s: again.1.weather.as_secs_f64(),
                    flying_s: again.1.flying.as_secs_f64(),
                },
            );
        }
        Ok(costs)
    }

    /// Records some ticks, and removes them.
    async fn record(
        &self,
        scenario: &PlannedScenario,
        most_ticks: u32,
        session: &mut Session,
    ) -> Result<(u32, Steps), ScenarioError> {
        let corpus = self.work.corpus;
        let Claimed::Mine(claim) = Claim::take(corpus, &scenario.id)? else {
            return Err(ScenarioError::Cancelled);
        };
        let attempt = Attempt {
            id: &scenario.id,
            cancel: self.cancel,
            reporter: &self.reporter,
            answer_limit: self.answer_limit,
            most_ticks: Some(most_ticks),
        };
        let recorded = record(&self.work, scenario, &claim, session, &attempt).await?;
        let folder = corpus.scenario(&scenario.id);
        std::fs::remove_dir_all(folder.root())
            .map_err(dataset::Error::io("remove", folder.root()))?;
        Ok((recorded.ticks, recorded.steps.unwrap_or_default()))
    }
}

/// The first scenario of every weather, one that is flown if there is one.
fn one_of_each_weather(plan: &Plan) -> Vec<&PlannedScenario> {
    let mut chosen: BTreeMap<&str, &PlannedScenario> = BTreeMap::new();
    let is_recorded =
        |scenario: &PlannedScenario| matches!(scenario.parameters.flight, Flight::Recorded { .. });
    for scenario in &plan.scenarios {
        let entry = chosen.entry(&scenario.weather).or_insert(scenario);
        if is_recorded(entry) && !is_recorded(scenario) {
            *entry = scenario;
        }
    }
    chosen.into_values().collect()
}
