//! Records planned scenarios: flies, records, seals and commits them, with one simulator or several.
//!
//! A scenario is recorded in `<id>.partial/` and renamed when it is complete, so a run can be stopped or killed at any moment and
//! the next one resumes: finished scenarios are skipped, unfinished ones are discarded and recorded again. Runs may work on one
//! corpus at the same time: each scenario is claimed by the run that records it, and a run with nothing left to do waits for the
//! scenarios of others, takes over those of runs that die, and so ends only when all its scenarios are finished or set aside.
//!
//! ```text
//! generate: plan, complete scenarios, simulators  ->  run: workers  ->  queue: claims  ->  record: one scenario
//!                                                      uploads: one scenario to the object store  <-
//! ```

mod error;
mod event;
mod freeze;
mod options;
mod outcome;
mod record;
mod remote;
mod run;
mod session;
mod space;
pub mod stand_in;

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::claim::Claim;
use dataset::corpus::set_aside::SetAside;
use dataset::plan::{Common, Picture, Plan, PlannedScenario};
use dataset::work::memory;
use futures_util::future::LocalBoxFuture;
use futures_util::future::join_all;
use indicatif::DecimalBytes;
use store::SPLIT_AGAIN;
use xplane_bridge::block_bytes;
use xplane_bridge::pixels::{PixelChoice, PixelKind};

pub use error::{GenerateError, ScenarioError};
pub use event::{Event, OnEvent};
pub(crate) use freeze::FolderState;
pub use options::{Cancel, GenerateOptions};
pub use outcome::{FailedScenario, MarkedScenario, Outcome, Stopped};
pub use remote::Remote;
pub use run::patience::Patience;
pub use session::restart::Restart;
pub use session::simulators::Simulators;
pub use session::{BadSimulator, SimulatorTarget};
pub use space::free_bytes;

use crate::plan::{counted, expand, room_bytes};
use crate::sweep::Sweep;
use event::Reporter;
use record::Work;
use record::image_source::ImageSource;
use run::Run;
use run::attempt::unless_cancelled;
use session::Session;

/// Records a sweep's scenarios in a corpus; see the module.
///
/// # Errors
/// Before anything is written: the corpus was started from a different sweep, a scenario of `only` is not in the plan, or there is no
/// simulator. Later: the corpus cannot be read. Scenarios that fail are not errors but part of the outcome, and so is a run that
/// ends early.
pub fn generate<'a>(
    sweep: &'a Sweep,
    corpus_root: &'a Path,
    options: &'a GenerateOptions,
    cancel: &'a Cancel,
    on_event: &'a mut OnEvent<'a>,
) -> LocalBoxFuture<'a, Result<Outcome, GenerateError>> {
    Box::pin(async move {
        let plan = expand(sweep);
        let wanted = wanted(&plan, options)?;
        if options.restart.is_some() {
            session::restart::check(&options.simulators)?;
        }
        let (split_there, in_store) = match &options.remote {
            Some(remote) => (
                remote.look(&plan, corpus_root).await?,
                remote.committed(&wanted).await?,
            ),
            None => (None, BTreeMap::new()),
        };
        if let Some(remote) = &options.remote {
            remote::stage::check(corpus_root, remote.store.name())?;
        }
        let frozen = freeze::frozen_plan(corpus_root, &plan)?;
        let mut outcome = Outcome::default();
        let (mut to_make, mut staged) = (Vec::new(), Vec::new());
        for scenario in wanted {
            let is_whole = || match Corpus::open(corpus_root) {
                Ok(corpus) => freeze::is_whole(&corpus, scenario),
                Err(_) => Ok(false),
            };
            if in_store.contains_key(&scenario.id) {
                outcome.skipped.push(scenario.id.clone());
                continue;
            }
            let is_whole = match is_whole() {
                // The others are recorded.
                Err(error @ GenerateError::ForeignFolder { .. }) => {
                    outcome.failed.push(FailedScenario {
                        id: scenario.id.clone(),
                        reason: error.to_string(),
                    });
                    continue;
                }
                whole => whole?,
            };
            if !is_whole {
                to_make.push(scenario);
            } else if options.remote.is_some() {
                staged.push(scenario);
            } else {
                outcome.skipped.push(scenario.id.clone());
            }
        }
        let reporter = Reporter::new(on_event);
        reporter.tell(Event::Planned {
            to_make: to_make.len(),
            skipped: outcome.skipped.len(),
            ticks: to_make.iter().map(|s| u64::from(s.ticks)).sum(),
        });
        if !staged.is_empty() {
            let staged = counted(staged.len(), "scenario");
            reporter.say(&format!("{staged} made before, and sent now"));
        }
        let lost = freeze::lost_files(corpus_root, &plan)?;
        let is_same_plan = frozen.as_ref() == Some(&plan) && lost.is_empty();
        if options.remote.is_none() && to_make.is_empty() && is_same_plan {
            Claim::tidy(&Corpus::open(corpus_root)?);
            return Ok(outcome);
        }
        let on_disk = at_once_on_disk(&to_make, options);
        warn_of_little_space(corpus_root, &plan.common, &on_disk, &reporter);
        if !to_make.is_empty() {
            memory::check(
                "recording a scenario",
                recording_bytes(
                    plan.common.picture,
                    plan.common.cameras.len() as u64,
                    may_use_screen(options.pixels, options.simulators.targets()),
                ),
            )
            .map_err(dataset::Error::from)?;
        }
        // A missing simulator is detected before anything is written.
        let needed = !to_make.is_empty();
        let sessions = open_sessions(options, sweep.picture, needed, cancel, &reporter).await?;
        let corpus = Corpus::create(corpus_root)?;
        if let Some(remote) = &options.remote {
            remote::stage::mark(&corpus, remote.store.name())?;
        }
        // The split is written before the plan: a plan without one has lost it.
        if frozen.is_some() && split_there.is_none() && lost.contains(&Corpus::SPLITS) {
            reporter.warn(SPLIT_AGAIN);
        }
        freeze::freeze(&corpus, sweep, &plan, split_there.as_deref()).await?;
        if let Some(remote) = &options.remote {
            remote.publish(&corpus).await?;
            remote.clear_what_is_sent(&corpus, &in_store).await;
            remote.bring_failures(&corpus, &to_make, &in_store).await?;
        }
        for scenario in &to_make {
            if let Some(before) = SetAside::read(&corpus, &scenario.id) {
                reporter.warn(&format!(
                    "{} failed in an earlier run and is tried again: {}",
                    scenario.id,
                    before.reasons.last().map_or("", String::as_str)
                ));
            }
        }
        let work = Work {
            sweep,
            plan: &plan,
            corpus: &corpus,
        };
        Run::new(work, reporter, options, &to_make, outcome)
            .work_through(sessions, &staged, cancel)
            .await
    })
}

/// Memory for one simulator's images that wait to be drawn, sent and encoded.
fn recording_bytes(picture: Picture, views: u64, may_use_screen: bool) -> u64 {
    /// Images held by simulator and link, all views together, and by one encoder, which looks ahead.
    const UNDER_WAY: (u64, u64) = (8, 12);
    let rgb_bytes = u64::from(picture.width_px) * u64::from(picture.height_px) * 3;
    let encoders = UNDER_WAY.1 * views;
    let size_px = (picture.width_px, picture.height_px);
    let simulator = if may_use_screen {
        // With those that wait for the encoders of all views.
        block_bytes(size_px)
    } else {
        UNDER_WAY.0 * rgb_bytes
    };
    simulator + encoders * rgb_bytes
}

/// True if images may be taken from a screen, in blocks: not from stand-ins and tapes of this run, unless that is asked for.
fn may_use_screen(pixels: PixelChoice, simulators: &[SimulatorTarget]) -> bool {
    match pixels {
        PixelChoice::Only(kind) => kind == PixelKind::Screen,
        PixelChoice::Auto => simulators.iter().any(SimulatorTarget::runs_already),
    }
}

fn wanted<'a>(
    plan: &'a Plan,
    options: &GenerateOptions,
) -> Result<Vec<&'a PlannedScenario>, GenerateError> {
    let only = &options.only;
    if let Some(id) = only
        .iter()
        .find(|id| !plan.scenarios.iter().any(|s| s.id == **id))
    {
        let scenarios = &plan.scenarios;
        let example = scenarios.first().map_or("", |scenario| &scenario.id);
        return Err(GenerateError::BadInput(format!(
            "there is no scenario {id} among the {} of the plan; identifiers look like {example}, `dtd plan` lists them",
            scenarios.len()
        )));
    }
    let mine = options.shard.part_of(&plan.scenarios);
    Ok(mine
        .filter(|s| only.is_empty() || only.contains(&s.id))
        .collect())
}

/// The largest scenarios that may be on disk at the same time: all, or those waiting on a stage for upload.
fn at_once_on_disk<'a>(
    to_make: &[&'a PlannedScenario],
    options: &GenerateOptions,
) -> Vec<&'a PlannedScenario> {
    let mut largest = to_make.to_vec();
    if options
        .remote
        .as_ref()
        .is_some_and(|remote| !remote.keep_staged)
    {
        largest.sort_by_key(|scenario| Reverse(scenario.ticks));
        // One being uploaded, those that wait, and per simulator one being recorded and one about to wait.
        largest.truncate(1 + remote::uploads::WAITING + 2 * options.simulators.targets().len());
    }
    largest
}

fn warn_of_little_space(
    corpus_root: &Path,
    common: &Common,
    to_make: &[&PlannedScenario],
    reporter: &Reporter<'_>,
) {
    let needed = room_bytes(common, to_make.iter().copied());
    if let Some(free) = space::free_bytes(corpus_root).filter(|free| *free < needed) {
        reporter.warn(&format!(
            "{} are free, and about {} will be needed",
            DecimalBytes(free),
            DecimalBytes(needed)
        ));
    }
}

/// Connects to or starts all simulators. Missing ones are retried later, as long as one works, is starting or can be restarted.
async fn open_sessions(
    options: &GenerateOptions,
    picture: Picture,
    needed: bool,
    cancel: &Cancel,
    reporter: &Reporter<'_>,
) -> Result<Vec<(Session, Option<ScenarioError>)>, GenerateError> {
    if !needed {
        return Ok(Vec::new());
    }
    let targets = options.simulators.with_local_udp(&options.local_udp);
    let pictures = &ImageSource::new(options.pixels, options.screen.clone(), picture);
    let opening = targets
        .enumerate()
        .map(|(number, (target, local_udp))| async move {
            let program = &options.stand_in_program;
            let mut session = Session::new(target, number, program, pictures, local_udp);
            let trouble = unless_cancelled(cancel, session.open()).await.err();
            (session, trouble)
        });
    let mut sessions = join_all(opening).await;
    if cancel.is_cancelled() {
        return Err(GenerateError::Cancelled);
    }
    let starting = sessions
        .iter_mut()
        .map(|(session, trouble)| async move {
            if let Some(error) = trouble
                && options.restart.is_none()
                && session.may_be_starting(error)
            {
                let name = session.name();
                let wait_s = options.patience.simulator.as_secs();
                reporter.warn(&format!(
                    "simulator {name} cannot be used yet: {error}. Waiting for it, for {wait_s} s at most, since it may still be starting"
                ));
                let back = session.come_back(options.patience.simulator);
                *trouble = unless_cancelled(cancel, back).await.err();
            }
        });
    join_all(starting).await;
    let can_restart = |session: &Session| options.restart.is_some() && session.runs_already();
    let is_hopeless = |(session, trouble): &(Session, Option<ScenarioError>)| {
        trouble
            .as_ref()
            .is_some_and(|error| error.is_bad_setup() || !can_restart(session))
    };
    if sessions.iter().all(is_hopeless) {
        return Err(match sessions.swap_remove(0).1 {
            Some(ScenarioError::Cancelled) | None => GenerateError::Cancelled,
            Some(error) => GenerateError::Simulator(Box::new(error)),
        });
    }
    Ok(sessions)
}

#[cfg(test)]
mod tests {
    use dataset::numbers::frame_rate::FrameRate;

    use super::*;

    #[test]
    fn memory_for_a_screen_holds_a_block_and_the_waiting_pictures_of_other_views() {
        let picture = Picture {
            width_px: 1920,
            height_px: 1280,
            frame_rate: FrameRate::new(30, 1).unwrap(),
        };
        let running = [SimulatorTarget::Address(([127, 0, 0, 1], 49_000).into())];
        assert!(may_use_screen(PixelChoice::Auto, &running));
        assert!(may_use_screen(PixelChoice::Only(PixelKind::Screen), &[]));
        assert!(!may_use_screen(
            PixelChoice::Auto,
            &[SimulatorTarget::StandIn]
        ));
        // 93 images in blocks, and 12 in each encoder.
        let rgb_bytes = 1920 * 1280 * 3;
        assert_eq!(recording_bytes(picture, 2, true), (93 + 24) * rgb_bytes);
        assert_eq!(recording_bytes(picture, 2, false), (8 + 24) * rgb_bytes);
    }
}
