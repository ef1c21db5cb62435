//! Input of the networks of a training: encoded samples.

use crate::estimators::paper_lstm::EstimatorSamples;
use crate::networks::encoded::Encoded;
use crate::networks::normalisation::Normalisation;
use crate::samples::Sample;

/// The encoded sides.
pub(crate) struct EncodedFlights {
    /// The training side.
    pub(crate) training: Encoded,
    /// The validation side.
    pub(crate) validation: Encoded,
}

impl EncodedFlights {
    /// Encodes both sides.
    pub(crate) fn new(
        training: &[&Sample],
        validation: &[Sample],
        normalisation: &Normalisation,
    ) -> Self {
        Self {
            training: Encoded::new(training.iter().copied(), normalisation),
            validation: Encoded::new(validation, normalisation),
        }
    }

    /// The samples of the LSTM.
    pub(crate) fn of_estimator(&self) -> EstimatorSamples<'_> {
        EstimatorSamples {
            training: &self.training,
            validation: &self.validation,
        }
    }
}
