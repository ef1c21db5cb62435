//! Estimates a training's memory before anything is allocated: a settings file may request networks and batches that do not fit
//! into any machine, and the operating system kills such a process without naming the setting.

use std::fmt::Debug;

use crate::config::{Optimisation, TrainConfig};
use crate::error::{Error, Result};
use crate::networks::normalisation::BOX_FEATURES;
use crate::samples::Sample;
use crate::samples::flight_parts::MOST_PARTS;
use crate::samples::view_shift::ViewShift;

/// A number of a network, bytes.
const NUMBER: u64 = 4;
/// A trainable number also has its gradient, two moments of Adam and the copies of one step.
const TRAINED_NUMBER: u64 = 8 * NUMBER;
/// Numbers that the backward pass keeps per unit of a linear layer and sample, with their gradients.
const KEPT_PER_UNIT: u64 = 8;
/// The same per unit of an LSTM layer: four gates, two states.
const KEPT_PER_LSTM_UNIT: u64 = 48;
/// Numbers of a registration that the networks on the residual see, at most with the inverse range.
const REGISTRATION: u64 = 5;
/// Samples predicted at once without a backward pass.
const CHUNK: u64 = 2_048;

/// The numbers of samples.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SampleCounts {
    /// For training, without mixtures.
    pub(crate) training: usize,
    /// On the validation side, or to be evaluated.
    pub(crate) judged: usize,
}

/// One consumer of memory, and the setting that determines how much.
struct Part {
    setting: String,
    bytes: u64,
}

/// A stage of the training: its networks and its batches. Stages follow each other.
struct TrainingStage {
    networks: Part,
    numbers: u64,
    batch: Part,
}

/// Rejects a training that needs more memory than available.
pub(crate) fn check(config: &TrainConfig, views: usize, samples: SampleCounts) -> Result<()> {
    check_against(
        config,
        views,
        samples,
        dataset::work::memory::available().bytes,
    )
}

fn check_against(
    config: &TrainConfig,
    views: usize,
    samples: SampleCounts,
    available_bytes: u64,
) -> Result<()> {
    let stages = stages(config, views as u64, samples);
    let data = data(config, views as u64, samples);
    // Networks of earlier stages stay, without the overhead of training.
    let stay = stages.iter().fold(data.bytes, |sum, stage| {
        sum.saturating_add(stage.numbers.saturating_mul(NUMBER))
    });
    let at_work = |stage: &TrainingStage| stage.networks.bytes.saturating_add(stage.batch.bytes);
    let largest = stages.iter().map(at_work).max().unwrap_or(0);
    let needed_bytes = stay.saturating_add(largest);
    if needed_bytes <= available_bytes {
        return Ok(());
    }
    let parts = stages.into_iter().flat_map(|s| [s.networks, s.batch]);
    let most = parts.chain([data]).max_by_key(|part| part.bytes);
    Err(Error::Memory {
        most: most.map_or_else(String::new, |part| part.setting),
        needed_bytes,
        available_bytes,
    })
}

fn data(config: &TrainConfig, views: u64, samples: SampleCounts) -> Part {
    let training = samples.training as u64;
    let filled = config.augmentation.fill_up_to_samples as u64;
    // Single-view and joint samples, or the recorded ones for both.
    let learned = match filled > training {
        true => 2 * filled,
        false => training,
    };
    let boxes = views * size_of::<Option<dataset::tables::pixel_box::PixelBox>>() as u64;
    let shifts = views * size_of::<Option<ViewShift>>() as u64;
    let encoded = views * (BOX_FEATURES as u64 * NUMBER + 1) + NUMBER;
    let bytes_each = size_of::<Sample>() as u64 + boxes + shifts + encoded;
    let judged = (samples.judged as u64).saturating_mul(bytes_each);
    let setting = match filled > training {
        true => format!("augmentation.fill_up_to_samples {filled}"),
        false => format!("the corpus, with {training} samples on the training side,"),
    };
    Part {
        setting,
        bytes: learned.saturating_mul(bytes_each).saturating_add(judged),
    }
}

fn stages(config: &TrainConfig, views: u64, samples: SampleCounts) -> [TrainingStage; 4] {
    let boxes = BOX_FEATURES as u64;
    let judged = samples.judged as u64;
    let c = &config.calibration;
    let features = c.features as u64;
    let calibration_units = [sum(&c.hidden), features, sum(&c.head_hidden)]
        .into_iter()
        .fold(0, u64::saturating_add);
    let linear_path = match c.linear_path {
        true => boxes.saturating_mul(features),
        false => 0,
    };
    let per_view = dense(boxes, &c.hidden, features).saturating_add(linear_path);
    let calibration = stage(
        "calibration",
        (&c.hidden, c.features, &c.head_hidden),
        views
            .saturating_mul(per_view)
            .saturating_add(dense(features, &c.head_hidden, 1)),
        &c.optimisation,
        views
            .saturating_mul(calibration_units)
            .saturating_mul(KEPT_PER_UNIT),
        judged.saturating_mul(calibration_units),
    );
    let e = &config.estimator;
    let inputs = [features]
        .into_iter()
        .chain(e.lstm.iter().map(|&w| w as u64));
    let gates = inputs.zip(&e.lstm).fold(0_u64, |total, (from, &width)| {
        let width = width as u64;
        let gate = from.saturating_add(width).saturating_add(1);
        total.saturating_add(gate.saturating_mul(width).saturating_mul(4))
    });
    let last = e.lstm.last().map_or(features, |&width| width as u64);
    let normal = e.head_hidden.last().map_or(last, |&width| width as u64) + 1;
    let in_lstm = sum(&e.lstm).saturating_mul(KEPT_PER_LSTM_UNIT);
    let in_head = sum(&e.head_hidden).saturating_mul(KEPT_PER_UNIT);
    let kept = views
        .saturating_mul(in_lstm.saturating_add(features.saturating_mul(KEPT_PER_UNIT)))
        .saturating_add(in_head);
    let estimator = stage(
        "estimator",
        (&e.lstm, &e.head_hidden),
        gates.saturating_add(dense(last, &e.head_hidden, 1)),
        &e.optimisation,
        kept,
        CHUNK
            .saturating_mul(kept)
            .saturating_add(normal.saturating_mul(normal).saturating_mul(2)),
    );
    let m = &config.mono;
    let mono = stage(
        "mono",
        &m.hidden,
        views
            .saturating_mul(2)
            .saturating_mul(dense(boxes, &m.hidden, 1)),
        &m.optimisation,
        sum(&m.hidden).saturating_mul(KEPT_PER_UNIT),
        judged.saturating_mul(sum(&m.hidden)),
    );
    let r = &config.residual;
    // One network for the formula, and one for each part of the flights.
    let networks = 1 + MOST_PARTS as u64;
    let inputs = views.saturating_mul(REGISTRATION);
    let residual = stage(
        "residual",
        &r.hidden,
        networks.saturating_mul(dense(inputs, &r.hidden, 1)),
        &r.optimisation,
        networks
            .saturating_mul(sum(&r.hidden))
            .saturating_mul(KEPT_PER_UNIT),
        judged.saturating_mul(sum(&r.hidden)),
    );
    [calibration, estimator, mono, residual]
}

/// `kept`: numbers per sample of a batch; `judging`: numbers for evaluating all samples.
fn stage(
    name: &str,
    layers: impl Debug,
    numbers: u64,
    optimisation: &Optimisation,
    kept: u64,
    judging: u64,
) -> TrainingStage {
    let batch_size = optimisation.batch_size as u64;
    TrainingStage {
        networks: Part {
            setting: format!("the widths of {name}, {layers:?},"),
            bytes: numbers.saturating_mul(TRAINED_NUMBER),
        },
        numbers,
        batch: Part {
            setting: format!("{name}.optimisation.batch_size {batch_size}"),
            bytes: batch_size
                .saturating_mul(kept)
                .max(judging)
                .saturating_mul(NUMBER),
        },
    }
}

fn sum(widths: &[usize]) -> u64 {
    widths.iter().map(|&width| width as u64).sum()
}

/// Numbers of a stack of linear layers.
fn dense(inputs: u64, hidden: &[usize], outputs: u64) -> u64 {
    let mut from = inputs;
    let widths = hidden.iter().map(|&width| width as u64);
    widths.chain([outputs]).fold(0, |total: u64, to| {
        let layer = from.saturating_add(1).saturating_mul(to);
        from = to;
        total.saturating_add(layer)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GIB: u64 = 1 << 30;
    const COUNTS: SampleCounts = SampleCounts {
        training: 10_000,
        judged: 2_000,
    };

    fn refusal(change: impl Fn(&mut TrainConfig), views: usize) -> String {
        let mut config = TrainConfig::default();
        change(&mut config);
        config.check().unwrap();
        check_against(&config, views, COUNTS, 4 * GIB)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn the_usual_trainings_fit_into_half_a_gibibyte() {
        for config in [TrainConfig::default(), TrainConfig::demo()] {
            check_against(&config, 2, COUNTS, GIB / 2).unwrap();
        }
    }

    #[test]
    fn what_no_machine_holds_is_refused_with_the_setting_that_asks_for_it() {
        let message = refusal(|c| c.estimator.lstm = vec![16_384; 64], 2);
        assert!(message.contains("widths of estimator"), "{message}");
        let message = refusal(|c| c.estimator.optimisation.batch_size = 1_000_000, 2);
        assert!(
            message.contains("estimator.optimisation.batch_size 1000000"),
            "{message}"
        );
        assert!(message.contains("4096 MiB are there"), "{message}");
        let message = refusal(|c| c.augmentation.fill_up_to_samples = 10_000_000, 64);
        assert!(
            message.contains("augmentation.fill_up_to_samples 10000000"),
            "{message}"
        );
    }

    #[test]
    fn numbers_that_overflow_are_too_large_and_no_panic() {
        let config = TrainConfig::default();
        let counts = SampleCounts {
            training: usize::MAX / 4,
            judged: usize::MAX,
        };
        assert!(check_against(&config, 2, counts, u64::MAX - 1).is_err());
    }
}
