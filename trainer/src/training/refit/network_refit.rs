//! Training of a single calibration network; the shared head, the other networks and the estimator are frozen.
//!
//! The loss is the view's loss of stage one plus the error of the estimator's answer: an estimator that compares views needs features that
//! keep their meaning to subpixel precision, which the head alone does not require. The networks with the lowest error on the judged
//! approaches are kept, even if they are the initial ones.

use burn::module::Module;
use burn::optim::GradientsParams;
use dataset::work::watch::Watch;

use crate::config::{Optimisation, TrainConfig};
use crate::error::Result;
use crate::estimators::paper_lstm::calibration_training::{CalibrationNetworks, batch_loss};
use crate::estimators::paper_lstm::{PaperLstm, features_of, predict};
use crate::networks::checkpoint::Checkpoints;
use crate::networks::encoded::{Encoded, draw, mape_pct};
use crate::networks::training_loop::{Companions, Setup, Task, learn};
use crate::networks::view_dropout::ViewSelection;

/// Steps: about a minute of the default networks on two cores.
const STEPS: usize = 200;
const JUDGED_EVERY: usize = 20;
/// Learning rate relative to a training from random weights: the network is nearly right.
const LEARNING_RATE_RATIO: f64 = 0.1;

pub(super) struct RefitSamples<'a> {
    pub(super) training: &'a Encoded,
    pub(super) judged: &'a Encoded,
}

/// Trains the network of `view`.
pub(super) fn refit_network(
    view: usize,
    networks: &CalibrationNetworks,
    estimator: &PaperLstm,
    samples: &RefitSamples,
    config: &TrainConfig,
    setup: Setup,
    watch: &dyn Watch,
) -> Result<CalibrationNetworks> {
    let seen = samples.training.seen_by(view);
    if seen.is_empty() || samples.judged.seen_by(view).is_empty() {
        return Ok(networks.clone());
    }
    let settings = Optimisation {
        steps: STEPS,
        batch_size: config.calibration.optimisation.batch_size,
        learning_rate: LEARNING_RATE_RATIO * config.calibration.optimisation.learning_rate,
    };
    let mut task = NetworkRefit {
        optimised: (0..samples.training.views())
            .map(|other| other == view)
            .collect(),
        seen,
        batch_size: settings.batch_size,
        estimator: estimator.clone().train().no_grad(),
        plain_estimator: estimator,
        samples,
        setup,
    };
    let mut companions = Companions {
        checkpoints: &mut Checkpoints::none(),
        watch,
    };
    let start = networks.clone().train();
    let learned = learn(&mut task, start, &settings, &mut companions)?;
    Ok(learned.kept.network.valid())
}

struct NetworkRefit<'a> {
    /// True for the refitted view.
    optimised: Vec<bool>,
    /// Samples that the view saw.
    seen: Vec<usize>,
    batch_size: usize,
    estimator: PaperLstm,
    plain_estimator: &'a PaperLstm,
    samples: &'a RefitSamples<'a>,
    setup: Setup,
}

impl Task for NetworkRefit<'_> {
    type Network = CalibrationNetworks;
    const NAME: &'static str = "calibration network";
    const STAGE: &'static str = "calibration network";

    fn judged_every(&self) -> usize {
        JUDGED_EVERY
    }

    fn keeps_best(&self) -> bool {
        true
    }

    fn setup(&mut self) -> &mut Setup {
        &mut self.setup
    }

    fn gradients(&mut self, networks: &CalibrationNetworks, _step: usize) -> GradientsParams {
        let batch = draw(&self.seen, self.batch_size, &mut self.setup.random);
        let Setup { loss, device, .. } = &self.setup;
        let samples = self.samples.training;
        let rows = 0..batch.len();
        let trained = networks.training_only(&self.optimised, false);
        let (alone, _) = batch_loss(
            &trained,
            samples,
            &batch,
            rows,
            &self.optimised,
            *loss,
            device,
        );
        let views = features_of(&trained, samples, &batch, ViewSelection::All, device);
        let answer = self.estimator.forward(&views);
        let together = samples.squared_error(answer, &batch, batch.len() as f32, *loss, device);
        GradientsParams::from_grads((alone + together).backward(), networks)
    }

    fn errors_pct(&self, networks: &CalibrationNetworks) -> Vec<Option<f64>> {
        let (judged, loss) = (self.samples.judged, self.setup.loss);
        let predicted = predict(
            &networks.valid(),
            self.plain_estimator,
            judged,
            loss,
            &self.setup.plain_device(),
        );
        let pairs = predicted.into_iter().enumerate();
        vec![mape_pct(
            pairs.map(|(sample, p)| (p, judged.distance(sample))),
        )]
    }

    fn record(&mut self, _done: usize, errors_pct: Vec<Option<f64>>) -> String {
        let errors = errors_pct.into_iter().flatten();
        errors.map(|error| format!("MAPE {error:.3} %")).collect()
    }
}
