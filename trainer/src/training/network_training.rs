//! Training of all networks, one after the other.

use burn::module::Module;
use burn::tensor::Device;

use crate::config::{Plateau, StageEnd, TrainConfig};
use crate::error::Result;
use crate::estimators::mono_network::{MonoInputs, MonoNetworks};
use crate::estimators::paper_lstm::calibration_training::train_calibration;
use crate::estimators::paper_lstm::train_estimator;
use crate::estimators::paper_lstm::white_features::with_white_features;
use crate::networks::encoded::EncodedSides;
use crate::networks::stage::StageSummary;
use crate::networks::training_loop::{Companions, Setup};
use crate::run::estimator::Estimator;
use crate::run::trained::{Convergence, Networks};
use crate::training::stream::Stream;

/// Result of training the networks.
pub(crate) struct TrainedNetworks {
    /// Networks, on the CPU.
    pub(crate) networks: Networks,
    /// Convergence logs.
    pub(crate) convergence: Convergence,
    /// Stages, in order.
    pub(crate) stages: Vec<StageSummary>,
    /// Validation error of `paper_lstm`, percent.
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
    let setup = |stream: Stream, ends: StageEnd, first_cycle: usize| Setup {
        loss: config.target(),
        device: device.clone().autodiff(),
        random: stream.generator(config.seed),
        plateau: (ends == StageEnd::Plateau).then_some(Plateau {
            first_cycle,
            threshold_pct: config.calibration.plateau_threshold_pct,
        }),
    };
    let settings = &config.calibration;
    let (calibration, calibration_log) = train_calibration(
        start.map(|networks| &networks.calibration),
        &sides.training,
        &sides.validation,
        settings,
        setup(Stream::Calibration, settings.ends, settings.first_cycle),
        companions,
    )?;
    let samples = sides.training.len();
    let settings = &settings.optimisation;
    let mut stages = vec![calibration.summary("calibration networks", None, settings, samples)];
    let calibration_kept_step = calibration.kept.step;
    let calibration = calibration.kept.network.valid();
    let calibration = match start {
        // The initial LSTM was trained on these features.
        Some(_) => calibration,
        None => with_white_features(calibration, &sides.training, device),
    };
    let settings = &config.estimator;
    let (estimator, estimator_log) = train_estimator(
        start.map(|networks| &networks.estimator),
        &calibration,
        sides,
        settings,
        config.calibration.features,
        setup(Stream::Estimator, settings.ends, settings.first_cycle),
        companions,
    )?;
    let settings = &settings.optimisation;
    stages.push(estimator.summary(Estimator::PaperLstm.name(), None, settings, samples));
    let mut mono = |start, inputs, estimator: Estimator, stream| -> Result<MonoNetworks> {
        let settings = &config.mono;
        let setup = setup(stream, settings.ends, settings.first_cycle);
        let (networks, learned) =
            MonoNetworks::train_from(start, inputs, sides, settings, setup, companions)?;
        for (view, (name, learned)) in views.iter().zip(learned).enumerate() {
            if let Some(learned) = learned {
                let samples = sides.training.seen_by(view).len();
                let settings = &settings.optimisation;
                stages.push(learned.summary(estimator.name(), Some(name), settings, samples));
            }
        }
        Ok(networks)
    };
    let mono_size = mono(
        start.map(|networks| &networks.mono_size),
        MonoInputs::Size,
        Estimator::MonoNetwork,
        Stream::MonoSize,
    )?;
    let mono_box = mono(
        start.map(|networks| &networks.mono_box),
        MonoInputs::Box,
        Estimator::MonoNetworkBox,
        Stream::MonoBox,
    )?;
    let mono_position = mono(
        start.map(|networks| &networks.mono_position),
        MonoInputs::Position,
        Estimator::MonoNetworkPosition,
        Stream::MonoPosition,
    )?;
    let networks = Networks {
        calibration,
        estimator: estimator.kept.network.valid(),
        mono_size: mono_size.valid(),
        mono_box: mono_box.valid(),
        mono_position: mono_position.valid(),
    };
    Ok(TrainedNetworks {
        networks: networks.to_device(&Device::flex()),
        convergence: Convergence {
            views: views.to_vec(),
            calibration: calibration_log,
            calibration_kept_step,
            estimator: estimator_log,
            estimator_kept_step: estimator.kept.step,
        },
        stages,
        validation_mape_pct: estimator.kept.error_pct,
    })
}
