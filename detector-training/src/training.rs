//! Trains the network on samples.
//!
//! Input: samples, a duration, a seed. Output: a trained network. AdamW with a warm-up and a cosine to zero over the effort,
//! whether that is measured in minutes or in steps; two forked copies of the network work on two halves of every batch. A training
//! with a checkpoint resumes where it was killed.

pub mod checkpoint;
pub(crate) mod start;
pub(crate) mod training_config;

use std::path::Path;
use std::time::Instant;

use burn::grad_clipping::GradientClippingConfig;
use burn::module::Module;
use burn::optim::{AdamWConfig, GradientsAccumulator, GradientsParams};
use burn::tensor::Device;
use dataset::work::watch::Watch;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::grid::CELL_VALUES;
use super::loss::loss;
use super::network::Network;
use super::network::convolution::GatherTables;
use super::samples::{Batch, CROP_SIZES, HardPlace, HardPlaces, Samples};
use crate::error::{Error, Result};
use checkpoint::{Checkpoint, Position, Saved};
use start::start_from;
use training_config::{Effort, TrainingConfig};

/// Copies of the network that work in parallel.
const SHARDS: usize = 2;
/// Steps over which the learning rate rises.
const WARM_UP_STEPS: u64 = 200;
/// Steps between two checkpoints and between two progress reports.
const CHECKPOINT_STEPS: u64 = 100;
const NOTE_STEPS: u64 = 20;
/// Background with a logit above this (a score of 0.12) is hard.
const HARD_LOGIT: f32 = -2.0;
/// Progress is reported in this many parts of the effort.
const PROGRESS_PARTS: u64 = 1000;
/// AdamW's weight decay.
const WEIGHT_DECAY: f32 = 1e-3;

/// Training result.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The network, without gradients.
    pub network: Network,
    /// Position at the end.
    pub position: Position,
    /// Background places that were ever mistaken for aircraft.
    pub hard_places: usize,
}

/// Trains; if a folder is given, from and to the checkpoint in it, which has the last step if the training is stopped.
pub fn train(
    samples: &Samples,
    config: &TrainingConfig,
    checkpoint_folder: Option<&Path>,
    watch: &dyn Watch,
) -> Result<Trained> {
    config.check()?;
    let mut training = Training::new(config)?;
    let checkpoint = checkpoint_folder.map(|folder| Checkpoint::new(folder, config));
    if let Some(checkpoint) = &checkpoint {
        training.saved = checkpoint.load(training.saved)?;
        training.saved.hard.forget_beyond(samples.backgrounds.len());
    }
    watch.begin("detector", PROGRESS_PARTS);
    let spent_before_s = training.saved.position.seconds;
    let started = Instant::now();
    while training.done_share(config) < 1.0 {
        let loss = training.step(samples, config)?;
        training.saved.position.seconds = spent_before_s + started.elapsed().as_secs_f64();
        let step = training.saved.position.step;
        if step.is_multiple_of(NOTE_STEPS) {
            let share = training.done_share(config).min(1.0);
            let note = format!(
                "step {step}, loss {loss:.3}, {} hard places",
                training.saved.hard.len()
            );
            watch.advance((share * PROGRESS_PARTS as f64) as u64, &note);
        }
        let stopped = watch.check();
        if let Some(checkpoint) = &checkpoint
            && (stopped.is_err() || step.is_multiple_of(CHECKPOINT_STEPS))
        {
            checkpoint.save(&training.saved)?;
        }
        stopped?;
    }
    if let Some(checkpoint) = &checkpoint {
        checkpoint.save(&training.saved)?;
    }
    Ok(Trained {
        network: training.saved.network.valid(),
        position: training.saved.position,
        hard_places: training.saved.hard.len(),
    })
}

/// A training in progress.
struct Training {
    saved: Saved,
    device: Device,
    tables: Vec<GatherTables>,
    mean_loss: f64,
}

impl Training {
    fn new(config: &TrainingConfig) -> Result<Self> {
        let device = Device::flex().autodiff();
        let optimizer = AdamWConfig::new()
            .with_epsilon(1e-8)
            .with_weight_decay(WEIGHT_DECAY)
            .with_grad_clipping(Some(GradientClippingConfig::Norm(10.0)))
            .init();
        let network = match &config.start_from {
            Some(model) => start_from(model, &device)?,
            None => Network::new(&device, config.seed),
        };
        Ok(Self {
            saved: Saved {
                network,
                optimizer,
                position: Position::default(),
                hard: HardPlaces::default(),
            },
            tables: (0..SHARDS).map(|_| GatherTables::new(&device)).collect(),
            device,
            mean_loss: f64::NAN,
        })
    }

    fn done_share(&self, config: &TrainingConfig) -> f64 {
        match config.effort {
            Effort::Minutes(minutes) => self.saved.position.seconds / (60.0 * minutes),
            Effort::Steps(steps) => self.saved.position.step as f64 / steps.max(1) as f64,
        }
    }

    fn learning_rate(&self, config: &TrainingConfig) -> f64 {
        let warm = ((self.saved.position.step + 1) as f64 / WARM_UP_STEPS as f64).min(1.0);
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * self.done_share(config).min(1.0)).cos());
        config.learning_rate * warm * cosine.max(1e-3)
    }

    /// Takes a step; returns a running mean of the loss.
    fn step(&mut self, samples: &Samples, config: &TrainingConfig) -> Result<f64> {
        // Randomness depends only on the seed and the step, so that a resumed training draws the same numbers.
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        rng.set_stream(self.saved.position.step + 1);
        let size = samples.random_size(&mut rng);
        let seeds: [u64; SHARDS] = std::array::from_fn(|_| rng.next_u64());
        let count = CROP_SIZES[size].batch / SHARDS;

        let forks: Vec<Network> = (0..SHARDS)
            .map(|_| self.saved.network.clone().fork(&self.device))
            .collect();
        let (hard, device) = (&self.saved.hard, &self.device);
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
                step: self.saved.position.step,
            });
        }
        let mut gradients = GradientsAccumulator::new();
        for shard in shards {
            gradients.accumulate(&self.saved.network, shard.gradients);
            for place in shard.hard {
                self.saved.hard.remember(place, &mut rng);
            }
        }
        let learning_rate = self.learning_rate(config);
        self.saved.network =
            self.saved
                .optimizer
                .step(learning_rate, self.saved.network.clone(), gradients.grads());
        self.saved.position.step += 1;
        self.saved.position.crops += (SHARDS * count) as u64;
        self.mean_loss = if self.mean_loss.is_finite() {
            0.98 * self.mean_loss + 0.02 * loss
        } else {
            loss
        };
        Ok(self.mean_loss)
    }
}

/// A worker's result for its part of a batch.
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
    use crate::crop::augmentation::Augmentation;
    use crate::grid::peaks;
    use crate::grid::targets::CropTruth;
    use crate::network::patches::PatchBatch;
    use crate::samples::training_picture::TrainingPicture;
    use dataset::tables::pixel_box::PixelBox;
    use dataset::work::watch::Silent;
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

    /// Centres of boxes in a picture, best first.
    fn found_cx_px(
        network: &Network,
        tables: &mut GatherTables,
        picture: &TrainingPicture,
        threshold: f64,
    ) -> Vec<f64> {
        let pixels = picture.rgb.iter().map(|value| f32::from(*value) / 255.0);
        let mut batch = PatchBatch::new(1, picture.height_px, picture.width_px);
        batch.fill(0, &pixels.collect::<Vec<_>>());
        let map = network.forward(&batch, tables);
        let cells: Vec<f32> = map.rows.into_data().try_into_vec().unwrap();
        let found = peaks(&cells, map.width, map.height, threshold);
        found.iter().map(|found| found.pixel_box.cx_px).collect()
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
        let trained = train(&samples, &config, None, &Silent).unwrap();
        let mut tables = GatherTables::new(&Device::flex());
        let mut errors = Vec::new();
        for _ in 0..40 {
            let picture = shape(192, true, &mut rng);
            let truth = picture.aircraft.unwrap().pixel_box;
            let found = found_cx_px(&trained.network, &mut tables, &picture, 0.3);
            let best = found.first().map(|cx_px| cx_px - truth.cx_px);
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
        let found = found_cx_px(&trained.network, &mut tables, &empty, 0.5);
        assert!(found.is_empty(), "{found:?}");
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
                .saved
                .hard
                .remember(hard, &mut ChaCha8Rng::seed_from_u64(13));
            for _ in 0..steps {
                training.step(&samples, &config).unwrap();
            }
            training
        };
        Checkpoint::new(folder.path(), &config)
            .save(&begun(5).saved)
            .unwrap();
        let resumed = train(&samples, &config, Some(folder.path()), &Silent).unwrap();
        let straight = begun(8).saved;
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
