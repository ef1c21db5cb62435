//! A trained run that takes observations one by one, without a corpus: for cameras that have no end.
//!
//! ```text
//! boxes that count, shift    SeenTick -> Observation -> late views of recordings -> normalisation (boxes unlike the training's drop out)
//!                                |
//!                                v
//!                            PairedViews, Follower  -> the boxes of each aircraft
//!                                |
//!                                v                     of each aircraft:
//!                            InSight                -> phase, filter -> Answer
//! ```
//!
//! `dtd predict --online` feeds it corpus ticks with the boxes that counted at that moment. Nothing uses a later tick, and memory
//! does not grow with their number: objects are forgotten a minute after they were last seen.

mod answer;
mod in_sight;
mod phase;
mod seen_tick;

use std::slice::from_ref;

use dataset::geometry::camera::Camera;
use sight::background::Background;

pub use crate::background::Shown;
use crate::background::Sights;
use crate::error::{Error, Result};
use crate::estimators::geometry::self_calibration::SelfCalibrated;
use crate::run::estimator::{Estimator, Task};
use crate::run::folder::RunFolder;
use crate::run::sealed::SealedRun;
use crate::run::trained::TrainedRun;
use crate::samples::camera_health::late_images::PastLags;

pub use crate::estimators::inverse_range::contradiction::{Cause, Evidence, Withheld};
pub use crate::samples::{Candidate, Look};
pub use answer::{Answer, Stated};
pub(crate) use in_sight::{InSight, JudgedAircraft};
pub use phase::Phase;
pub use seen_tick::{SeenTick, SeenView};

/// Time for which an aircraft is in sight without a distance before that is reported, s: a view that sees an aircraft alone counts after
/// ten seconds.
pub const MIN_WITHHELD_S: f64 = 12.0;

/// A trained run with the aircraft in sight.
pub struct OnlineRun {
    run: TrainedRun,
    blake3: String,
    cameras: Vec<Camera>,
    estimator: Estimator,
    lags: PastLags,
    in_sight: InSight,
    sights: Sights,
    unlike: Vec<usize>,
    ticks: u32,
    last_ns: i64,
}

impl OnlineRun {
    /// Opens a run. `estimator` names the estimator; `None`: the run's choice, with the filter in place of estimators for single ticks or
    /// whole flights.
    ///
    /// # Errors
    /// The run cannot be read, or the estimator needs data that only a corpus has.
    pub fn open(folder: &RunFolder, estimator: Option<&str>) -> Result<Self> {
        let sealed = SealedRun::read(folder)?;
        let run = TrainedRun::of(&sealed)?;
        let refused = |fault: String| Error::run(folder.root(), fault);
        let estimator = match estimator {
            Some(name) => online(name).ok_or_else(|| {
                let known: Vec<_> = all_online().map(Estimator::name).collect();
                refused(format!(
                    "has no estimator {name:?} that answers image by image without a corpus; those that do are {}",
                    known.join(", ")
                ))
            })?,
            None => match online(&run.summary.choice.estimator) {
                None | Some(Estimator::InverseRange) => Estimator::InverseRangeFiltered,
                Some(chosen) => chosen,
            },
        };
        let is_of_fits = matches!(
            estimator,
            Estimator::InverseRange | Estimator::InverseRangeFiltered
        );
        if is_of_fits && run.baselines.inverse_range.is_empty() {
            return Err(refused(format!(
                "has no fit for {}: no view saw enough on the training side, so it would never answer; choose another one, such as \
                 mono_network_box, with --estimator, or train on more",
                estimator.name()
            )));
        }
        let cameras = cameras_of(&run).ok_or_else(|| {
            let views: Vec<_> = run.summary.cameras.keys().map(String::as_str).collect();
            refused(format!(
                "has cameras of the views {}, expected {}; train again",
                views.join(", "),
                run.normalisation.views.join(", ")
            ))
        })?;
        Ok(Self {
            blake3: sealed.blake3(),
            cameras,
            estimator,
            lags: PastLags::default(),
            in_sight: InSight::default(),
            sights: run.backgrounds.unseen(),
            unlike: Vec::new(),
            ticks: 0,
            last_ns: i64::MIN,
            run,
        })
    }

    /// View names, in the order used everywhere.
    pub fn views(&self) -> &[String] {
        &self.run.normalisation.views
    }

    /// A view's camera during training.
    ///
    /// # Panics
    /// There is no view with this index.
    pub fn camera(&self, view: usize) -> Camera {
        self.cameras[view]
    }

    /// Name of the rig.
    pub fn rig(&self) -> &str {
        &self.run.summary.rig
    }

    /// Name of the estimator.
    pub fn estimator(&self) -> &'static str {
        self.estimator.name()
    }

    /// File name of the detector used in training, if recorded, and the detections' name.
    pub fn model(&self) -> (Option<&str>, &str) {
        let summary = &self.run.summary;
        (summary.model.as_deref(), &summary.model_hash)
    }

    /// BLAKE3 hash of the training's files.
    pub fn blake3(&self) -> &str {
        &self.blake3
    }

    /// Compares the surroundings that a camera sees with the training's, for this tick and later ones. Returns what it shows.
    ///
    /// # Panics
    /// There is no view with this index.
    pub fn show(&mut self, view: usize, background: &Background) -> Shown {
        (self.run.backgrounds).show(&mut self.sights, view, background)
    }

    /// Takes the next tick; a time before the last one counts as the last one. Returns one answer for each aircraft that is or was recently
    /// in sight, the followed one first.
    ///
    /// # Panics
    /// The tick has a different number of views than the run.
    pub fn take(&mut self, tick: &SeenTick) -> Vec<Answer> {
        self.last_ns = tick.time_ns.max(self.last_ns);
        let observed = tick.observed((self.ticks, self.last_ns), &self.cameras);
        self.ticks = self.ticks.wrapping_add(1);
        let observed = self.run.backgrounds.corrected(&observed, &self.sights);
        let observed = if tick.is_recorded {
            let pairs = self.run.baselines.inverse_range.pairs();
            self.lags.corrected(&pairs, observed)
        } else {
            observed
        };
        let usual = self.run.normalisation.without_outliers(&observed, false);
        let views = observed.seen().map(|(view, _)| view);
        self.unlike = views.filter(|view| usual.best(*view).is_none()).collect();
        let judged = self.in_sight.take(&self.run, false, &observed);
        let fitted = self.run.baselines.self_calibrated.as_ref();
        let locator = fitted.map(SelfCalibrated::locator);
        let answers = judged.iter().map(|of| {
            let locator = locator.as_ref();
            Answer {
                position: locator.and_then(|of_all| of_all.place(&of.observed)),
                ..self.answer(of)
            }
        });
        answers.collect()
    }

    /// Views whose boxes were all unlike the training's at the last tick, by place or size.
    pub fn unlike(&self) -> &[usize] {
        &self.unlike
    }

    fn answer(&self, judged: &JudgedAircraft) -> Answer {
        if self.estimator == Estimator::InverseRangeFiltered {
            return Answer::with_estimate(judged);
        }
        let task = Task::new(&self.run, &[], from_ref(&judged.observed));
        let distance_m = self.estimator.answers(&task).distances_m.pop().flatten();
        Answer::with_distance(judged, distance_m)
    }
}

/// Training cameras in the order of the views; `None` if one is missing.
fn cameras_of(run: &TrainedRun) -> Option<Vec<Camera>> {
    let cameras = &run.summary.cameras;
    let views = run.normalisation.views.iter();
    views
        .map(|view| Some(cameras.get(view)?.camera()))
        .collect()
}

fn all_online() -> impl Iterator<Item = Estimator> {
    Estimator::ALL.into_iter().filter(|of| of.is_online())
}

fn online(name: &str) -> Option<Estimator> {
    all_online().find(|estimator| estimator.name() == name)
}
