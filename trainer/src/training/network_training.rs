//! The networks of a run, trained one after the other.

use burn::module::Module;
use burn::tensor::Device;

use crate::config::TrainConfig;
use crate::error::Result;
use crate::estimators::mono::network::{MonoInputs, MonoNetworks};
use crate::estimators::paper_lstm::calibration_training::train_calibration;
use crate::estimators::paper_lstm::train_estimator;
use crate::networks::encoded::EncodedSides;
use crate::networks::training_loop::{Companions, Setup};
use crate::run::trained::{Convergence, Networks};
use crate::training::stream::Stream;

/// Result of training the networks.
pub(crate) struct TrainedNetworks {
    /// On the processor.
    pub(crate) networks: Networks,
    /// Convergence logs.
    pub(crate) convergence: Convergence,
    /// Error of `paper_lstm` on the validation side, percent.
    pub(crate) validation_mape_pct: f64,
}

/// Trains all networks, from `start` if there is one.
pub(crate) fn train_networks(
    start: Option<&Networks>,
    sides: &EncodedSides,
    views: &[String],
    config: &TrainConfig,
    device: &Device,
    companions: &mut Companions,
) -> Result<TrainedNetworks> {
    let start = start.map(|networks| networks.clone().to_device(device));
    let start = start.as_ref();
    let setup = |stream: Stream| Setup {
        loss: config.loss,
        device: device.clone().autodiff(),
        random: stream.generator(config.seed),
    };
    let (calibration, calibration_log) = train_calibration(
        start.map(|networks| &networks.calibration),
        &sides.training,
        &sides.validation,
        &config.calibration,
        setup(Stream::Calibration),
        companions,
    )?;
    let calibration_kept_step = calibration.step;
    let calibration = calibration.network.valid();
    let (estimator, estimator_log) = train_estimator(
        start.map(|networks| &networks.estimator),
        &calibration,
        sides,
        &config.estimator,
        config.calibration.features,
        setup(Stream::Estimator),
        companions,
    )?;
    let mut mono = |start, inputs, stream| {
        let (settings, setup) = (&config.mono, setup(stream));
        MonoNetworks::train_from(start, inputs, &sides.training, settings, setup, companions)
    };
    let mono_size = mono(
        start.map(|networks| &networks.mono_size),
        MonoInputs::Size,
        Stream::MonoSize,
    )?;
    let mono_box = mono(
        start.map(|networks| &networks.mono_box),
        MonoInputs::Box,
        Stream::MonoBox,
    )?;
    let networks = Networks {
        calibration,
        estimator: estimator.network.valid(),
        mono_size: mono_size.valid(),
        mono_box: mono_box.valid(),
    };
    Ok(TrainedNetworks {
        networks: networks.to_device(&Device::flex()),
        convergence: Convergence {
            views: views.to_vec(),
            calibration: calibration_log,
            calibration_kept_step,
            estimator: estimator_log,
            estimator_kept_step: estimator.step,
        },
        validation_mape_pct: estimator.error_pct,
    })
}
