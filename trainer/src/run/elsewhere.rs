//! Use of a run at a different runway: the run's cameras move with the runway. All other numbers are pixels and distances, which do not
//! depend on the place.

use crate::run::trained::TrainedRun;
use crate::samples::Samples;
use crate::samples::rig::are_same;
use crate::samples::rig::moved_rig::Move;

impl TrainedRun {
    /// Moves the cameras to the runway of `samples`. Its backgrounds, which show the other airport, are compared with none.
    #[must_use]
    pub(crate) fn at_runway_of(mut self, samples: &Samples) -> Self {
        // Cameras that stand where they stood have not moved with the runway.
        let comparable = self.summary.comparable(&samples.rig);
        if comparable.is_some_and(|[here, there]| are_same(here, there)) {
            return self;
        }
        let to = samples.scenarios.first().map(|scenario| &scenario.runway);
        let Some(motion) = to.and_then(|to| Move::between(&self.summary.runway, to)) else {
            return self;
        };
        let summary = &mut self.summary;
        summary.cameras = motion.entries(&summary.cameras);
        summary.planned_cameras = summary
            .planned_cameras
            .as_ref()
            .map(|all| motion.entries(all));
        if let Some(fitted) = &mut self.baselines.self_calibrated {
            fitted.move_with(&motion);
        }
        self.backgrounds = self.backgrounds.elsewhere();
        self.baselines.flight_filter = self.baselines.flight_filter.elsewhere();
        self.is_elsewhere = true;
        self
    }
}
