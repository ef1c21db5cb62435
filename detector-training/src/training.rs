//! Trains the network on samples.
//!
//! Input: samples, a duration, a seed. Output: a trained network. AdamW with a warm-up and a cosine to zero over the effort,
//! whether that is measured in minutes or in steps; two forked copies of the network work on two halves of every batch. A training
//! with a checkpoint resumes where it was killed.

use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::grad_clipping::GradientClippingConfig;
use burn::module::Module;
use burn::optim::{AdamWConfig, GradientsAccumulator, GradientsParams, ModuleOptimizer};
use burn::tensor::Device;
use dataset::progress::Progress;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::augmentation::Augmentation;
use super::checkpoint::{Checkpoint, Position};
use super::convolution::GatherTables;
use super::grid::CELL_VALUES;
use super::loss::loss;
use super::network::Network;
use super::samples::{Batch, CROP_SIZES, HardPlace, HardPlaces, Samples};
use super::start::start_from;
use crate::error::{Error, Result, in_range};

/// Copies of the network that work in parallel.
const SHARDS: usize = 2;
/// Steps over which the learning rate rises.
const WARM_UP_STEPS: f64 = 200.0;
/// Steps between two checkpoints and between two progress reports.
const CHECKPOINT_STEPS: u64 = 100;
const NOTE_STEPS: u64 = 20;
/// Background with a logit above this (a score of 0.12) is hard.
const HARD_LOGIT: f32 = -2.0;
/// The longest training that can be asked for, minutes: a year.
pub const MOST_MINUTES: f64 = 525_600.0;
const MOST_RATE: f64 = 1.0;
/// What must be above 0 is at least this.
const LEAST: f64 = 1e-9;
/// Progress is reported in this many parts of the effort.
const PROGRESS_PARTS: f64 = 1000.0;

/// How long to train.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Effort {
    /// Minutes of wall-clock time.
    Minutes(f64),
    /// Steps: gives the same weights on every run.
    Steps(u64),
}

/// Settings of the training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainingConfig {
    /// How long.
    pub effort: Effort,
    /// Highest learning rate.
    pub learning_rate: f64,
    /// Weight decay of AdamW.
    pub weight_decay: f32,
    /// Seed of the first weights and of all crops.
    pub seed: u64,
    /// A detector of this project whose weights are the first; missing: random weights.
    pub start_from: Option<PathBuf>,
    /// How crops are varied.
    pub augmentation: Augmentation,
}

impl Default for TrainingConfig {
    fn default() -> Self {
        Self {
            effort: Effort::Minutes(30.0),
            learning_rate: 2e-3,
            weight_decay: 1e-3,
            seed: 1,
            start_from: None,
            augmentation: Augmentation::default(),
        }
    }
}

impl TrainingConfig {
    /// Checks that every setting is in its range.
    pub fn check(&self) -> Result<()> {
        if let Effort::Minutes(minutes) = self.effort {
            in_range("training.effort.minutes", minutes, LEAST..=MOST_MINUTES)?;
        }
        in_range(
            "training.learning_rate",
            self.learning_rate,
            LEAST..=MOST_RATE,
        )?;
        in_range(
            "training.weight_decay",
            f64::from(self.weight_decay),
            0.0..=1.0,
        )?;
        self.augmentation.check()
    }
}

/// The result of a training.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The network, without gradients.
    pub network: Network,
    /// Where it ended.
    pub position: Position,
    /// Background places that were ever mistaken for aircraft.
    pub hard_places: usize,
}

/// Trains; if a folder is given, from and to the checkpoint in it.
pub fn train(
    samples: &Samples,
    config: &TrainingConfig,
    checkpoint_folder: Option<&Path>,
    progress: &mut dyn Progress,
) -> Result<Trained> {
    config.check()?;
    let mut training = Training::new(config)?;
    let checkpoint = checkpoint_folder.map(|folder| Checkpoint::new(folder, config));
    if let Some(checkpoint) = &checkpoint {
        training = checkpoint.load(training)?;
        training.hard.forget_beyond(samples.backgrounds.len());
    }
    progress.begin("detector", PROGRESS_PARTS as u64);
    let spent_before_s = training.position.seconds;
    let started = Instant::now();
    while training.done_share(config) < 1.0 {
        let loss = training.step(samples, config)?;
        training.position.seconds = spent_before_s + started.elapsed().as_secs_f64();
        let step = training.position.step;
        if step.is_multiple_of(NOTE_STEPS) {
            let share = training.done_share(config).min(1.0);
            let note = format!(
                "step {step}, loss {loss:.3}, {} hard places",
                training.hard.len()
            );
            progress.advance((share * PROGRESS_PARTS) as u64, &note);
        }
        if let Some(checkpoint) = &checkpoint
            && step.is_multiple_of(CHECKPOINT_STEPS)
        {
            checkpoint.save(&training)?;
        }
    }
    if let Some(checkpoint) = &checkpoint {
        checkpoint.save(&training)?;
    }
    Ok(Trained {
        network: training.network.valid(),
        position: training.position,
        hard_places: training.hard.len(),
    })
}

/// A training in progress.
pub(super) struct Training {
    pub(super) network: Network,
    pub(super) optimizer: ModuleOptimizer,
    pub(super) position: Position,
    device: Device,
    tables: Vec<GatherTables>,
    pub(super) hard: HardPlaces,
    mean_loss: f64,
}

impl Training {
    fn new(config: &TrainingConfig) -> Result<Self> {
        let device = Device::flex().autodiff();
        let optimizer = AdamWConfig::new()
            .with_epsilon(1e-8)
            .with_weight_decay(config.weight_decay)
            .with_grad_clipping(Some(GradientClippingConfig::Norm(10.0)))
            .init();
        let network = match &config.start_from {
            Some(model) => start_from(model, &device)?,
            None => Network::new(&device, config.seed),
        };
        Ok(Self {
            network,
            optimizer,
            position: Position::default(),
            tables: (0..SHARDS).map(|_| GatherTables::new(&device)).collect(),
            device,
            hard: HardPlaces::default(),
            mean_loss: f64::NAN,
        })
    }

    fn done_share(&self, config: &TrainingConfig) -> f64 {
        match config.effort {
            Effort::Minutes(minutes) => self.position.seconds / (60.0 * minutes),
            Effort::Steps(steps) => self.position.step as f64 / steps.max(1) as f64,
        }
    }

    fn learning_rate(&self, config: &TrainingConfig) -> f64 {
        let warm = ((self.position.step + 1) as f64 / WARM_UP_STEPS).min(1.0);
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * self.done_share(config).min(1.0)).cos());
        config.learning_rate * warm * cosine.max(1e-3)
    }

    /// One step; returns a running mean of the loss.
    fn step(&mut self, samples: &Samples, config: &TrainingConfig) -> Result<f64> {
        // Randomness depends only on the seed and the step, so that a resumed training draws the same numbers.
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        rng.set_stream(self.position.step + 1);
        let size = samples.random_size(&mut rng);
        let seeds: [u64; SHARDS] = std::array::from_fn(|_| rng.next_u64());
        let count = CROP_SIZES[size].batch / SHARDS;

        let forks: Vec<Network> = (0..SHARDS)
            .map(|_| self.network.clone().fork(&self.device))
            .collect();
        let (hard, device) = (&self.hard, &self.device);
        let shards: Vec<Shard> = std::thread::scope(|scope| {
            let workers: Vec<_> = forks
                .into_iter()
                .zip(&mut self.tables)
                .zip(seeds)
                .map(|((network, tables), seed)| {
                    scope.spawn(move || {
                        let mut rng = ChaCha8Rng::seed_from_u64(seed);
                        let batch =
                            samples.batch(size, count, &config.augmentation, hard, &mut rng);
                        Shard::work(&network, &batch, tables, device)
                    })
                })
                .collect();
            workers
                .into_iter()
                .map(|worker| worker.join().expect("a worker does not panic"))
                .collect()
        });

        let loss: f64 = shards.iter().map(|shard| shard.loss).sum::<f64>() / SHARDS as f64;
        if !loss.is_finite() {
            return Err(Error::Diverged {
                step: self.position.step,
            });
        }
        let mut gradients = GradientsAccumulator::new();
        for shard in shards {
            gradients.accumulate(&self.network, shard.gradients);
            for place in shard.hard {
                self.hard.remember(place, &mut rng);
            }
        }
        let learning_rate = self.learning_rate(config);
        self.network = self
            .optimizer
            .step(learning_rate, self.network.clone(), gradients.grads());
        self.position.step += 1;
        self.position.crops += (SHARDS * count) as u64;
        self.mean_loss = if self.mean_loss.is_finite() {
            0.98 * self.mean_loss + 0.02 * loss
        } else {
            loss
        };
        Ok(self.mean_loss)
    }
}

/// One worker's result for its part of a batch.
struct Shard {
    gradients: GradientsParams,
    loss: f64,
    hard: Vec<HardPlace>,
}

impl Shard {
    fn work(network: &Network, batch: &Batch, tables: &mut GatherTables, device: &Device) -> Self {
        let output = network.forward(&batch.pictures, tables);
        let total = loss(
            &output,
            &batch.targets,
            batch.targets.positives.max(1),
            device,
        )
        .total();
        let numbers: Vec<f32> = output
            .rows
            .clone()
            .inner()
            .into_data()
            .try_into_vec()
            .expect("the output holds floats");
        let cells = output.height * output.width;
        let hard = batch.places.iter().enumerate().filter_map(|(crop, place)| {
            let worst = (crop * cells..(crop + 1) * cells)
                .filter(|&cell| {
                    batch.targets.heat[cell] == 0.0 && batch.targets.heat_weight[cell] > 0.0
                })
                .map(|cell| numbers[cell * CELL_VALUES])
                .fold(f32::NEG_INFINITY, f32::max);
            place.filter(|_| worst > HARD_LOGIT)
        });
        let hard = hard.collect();
        let value: f32 = total.clone().inner().into_scalar();
        let gradients = total.mul_scalar(1.0 / SHARDS as f32).backward();
        Self {
            gradients: GradientsParams::from_grads(gradients, network),
            loss: f64::from(value),
            hard,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::detect;
    use crate::picture::TrainingPicture;
    use crate::targets::CropTruth;
    use dataset::pixel_box::PixelBox;
    use dataset::progress::Silent;
    use rand::RngExt;

    /// A sky with a soft-edged dark fuselage and wings, and the box around them.
    fn shape(side: usize, with_aircraft: bool, rng: &mut ChaCha8Rng) -> TrainingPicture {
        let (cx, cy) = (
            rng.random_range(60.0..side as f64 - 60.0),
            rng.random_range(60.0..side as f64 - 60.0),
        );
        let width = rng.random_range(18.0..36.0);
        let height = width / 2.9;
        let contrast = rng.random_range(15.0..70.0);
        let base = rng.random_range(90.0..200.0);
        let mut rgb = Vec::with_capacity(side * side * 3);
        let cover = |distance: f64| (0.5 - distance).clamp(0.0, 1.0);
        for y in 0..side {
            for x in 0..side {
                let (dx, dy) = (x as f64 - cx, y as f64 - cy);
                let wings = cover(dx.abs() - width / 2.0) * cover(dy.abs() - 1.0);
                let fuselage = cover(dx.hypot(dy) - height / 2.0);
                let part = if with_aircraft {
                    wings.max(fuselage)
                } else {
                    0.0
                };
                let grey = base + 0.1 * y as f64 - contrast * part + rng.random_range(-1.0..1.0);
                rgb.extend([grey.clamp(0.0, 255.0) as u8; 3]);
            }
        }
        let pixel_box = PixelBox {
            cx_px: cx,
            cy_px: cy,
            width_px: width,
            height_px: height,
        };
        let aircraft = with_aircraft.then_some(CropTruth {
            pixel_box,
            visible: true,
        });
        TrainingPicture {
            rgb,
            width_px: side,
            height_px: side,
            aircraft,
            cover: None,
        }
    }

    fn samples(rng: &mut ChaCha8Rng) -> Samples {
        let mut samples = Samples::default();
        samples.aircraft[0] = (0..200).map(|_| shape(192, true, rng)).collect();
        samples.backgrounds = (0..4).map(|_| shape(256, false, rng)).collect();
        samples
    }

    #[test]
    fn the_network_learns_a_shape_in_seconds_and_finds_its_centre_to_a_fraction_of_a_pixel() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let samples = samples(&mut rng);
        let config = TrainingConfig {
            effort: Effort::Steps(200),
            learning_rate: 4e-3,
            augmentation: Augmentation::none(),
            ..Default::default()
        };
        let trained = train(&samples, &config, None, &mut Silent).unwrap();
        let mut tables = GatherTables::new(&Device::flex());
        let mut errors = Vec::new();
        for _ in 0..40 {
            let picture = shape(192, true, &mut rng);
            let truth = picture.aircraft.unwrap().pixel_box;
            let found = detect(&trained.network, &mut tables, &picture, 0.3);
            let best = found
                .first()
                .map(|found| found.pixel_box.cx_px - truth.cx_px);
            errors.push(best.map_or(99.0, f64::abs));
        }
        errors.sort_by(f64::total_cmp);
        assert!(errors[20] < 0.7, "median error {} px", errors[20]);
        assert!(
            errors[36] < 2.5,
            "nine of ten errors within {} px",
            errors[36]
        );
        let empty = shape(192, false, &mut rng);
        assert_eq!(detect(&trained.network, &mut tables, &empty, 0.5), vec![]);
    }

    #[test]
    fn a_killed_training_goes_on_to_the_weights_it_would_have_had() {
        let mut rng = ChaCha8Rng::seed_from_u64(12);
        let samples = samples(&mut rng);
        let folder = tempfile::tempdir().unwrap();
        let config = TrainingConfig {
            effort: Effort::Steps(8),
            ..Default::default()
        };
        let places = samples.batch(
            0,
            32,
            &config.augmentation,
            &HardPlaces::default(),
            &mut rng,
        );
        let hard = places.places.into_iter().flatten().next().unwrap();
        let begun = |steps: u64| {
            let mut training = Training::new(&config).unwrap();
            training
                .hard
                .remember(hard, &mut ChaCha8Rng::seed_from_u64(13));
            for _ in 0..steps {
                training.step(&samples, &config).unwrap();
            }
            training
        };
        Checkpoint::new(folder.path(), &config)
            .save(&begun(5))
            .unwrap();
        let resumed = train(&samples, &config, Some(folder.path()), &mut Silent).unwrap();
        let straight = begun(8);
        assert_eq!(
            (resumed.position.step, resumed.position.crops),
            (8, straight.position.crops)
        );
        let head = |network: &Network| -> Vec<f32> {
            network
                .head
                .weight
                .val()
                .into_data()
                .try_into_vec()
                .unwrap()
        };
        assert_eq!(head(&resumed.network), head(&straight.network));
    }
}
