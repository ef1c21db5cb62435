//! Input of the networks of a training: encoded samples, with mixtures of flights if the settings ask for them.

use crate::config::TrainConfig;
use crate::estimators::paper_lstm::EstimatorSamples;
use crate::estimators::paper_lstm::trajectory_mixing::{Corridor, mix};
use crate::networks::encoded::Encoded;
use crate::networks::normalisation::Normalisation;
use crate::samples::{Sample, Samples};
use crate::training::stream::Stream;

/// The encoded sides.
pub(crate) struct EncodedFlights {
    /// The training side, for batches of single views.
    pub(crate) training: Encoded,
    /// The same for batches of all views, where it differs.
    together: Option<Encoded>,
    /// The validation side.
    pub(crate) validation: Encoded,
    /// Mixtures among the training samples.
    pub(crate) mixed_samples: usize,
}

impl EncodedFlights {
    /// Encodes both sides.
    pub(crate) fn new(
        samples: &Samples,
        training: &[&Sample],
        validation: &[Sample],
        normalisation: &Normalisation,
        config: &TrainConfig,
    ) -> Self {
        let [mixed, mixed_together] = mixed_samples(samples, training, config);
        let with =
            |mixed: &[Sample]| Encoded::new(training.iter().copied().chain(mixed), normalisation);
        Self {
            training: with(&mixed),
            together: (!mixed_together.is_empty()).then(|| with(&mixed_together)),
            validation: Encoded::new(validation, normalisation),
            mixed_samples: mixed.len() + mixed_together.len(),
        }
    }

    /// The samples of the LSTM.
    pub(crate) fn of_estimator(&self) -> EstimatorSamples<'_> {
        EstimatorSamples {
            alone: &self.training,
            together: self.together.as_ref().unwrap_or(&self.training),
            validation: &self.validation,
        }
    }
}

/// Mixtures for single views, and for all views together.
fn mixed_samples(
    samples: &Samples,
    training: &[&Sample],
    config: &TrainConfig,
) -> [Vec<Sample>; 2] {
    let augmentation = &config.augmentation;
    let count = augmentation
        .fill_up_to_samples
        .saturating_sub(training.len());
    let random = &mut Stream::Mixing.generator(config.seed);
    [
        Corridor {
            extrapolation: augmentation.extrapolation,
            deviation_m: 0.0,
        },
        Corridor {
            extrapolation: augmentation.extrapolation_together,
            deviation_m: augmentation.deviation_together_m,
        },
    ]
    .map(|corridor| mix(training, &samples.scenarios, corridor, count, random))
}
