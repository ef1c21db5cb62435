//! Selection of training and validation flights.

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::work::watch::Watch;

use crate::background::Backgrounds;
use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::evaluation::split_again;
use crate::networks::normalisation::Normalisation;
use crate::samples::camera_health::Corrections;
use crate::samples::paired_views::PairedViews;
use crate::samples::sides::marked_scenarios;
use crate::samples::sides::scenario_split::ScenarioSplit;
use crate::samples::training_cameras::{DroppedByView, TrainingCameras};
use crate::samples::{DistanceRange, Observation, Sample, Samples};

/// Samples of all corpora, with the ground-truth boxes of the training side.
pub(crate) struct Flights {
    pub(crate) samples: Samples,
    /// Split by scenario, if the settings ask for it.
    pub(crate) scenario_split: Option<ScenarioSplit>,
    /// What the cameras saw.
    pub(crate) backgrounds: Backgrounds,
    /// Training side, reduced to its ground-truth boxes.
    pub(crate) true_boxes: Vec<Sample>,
    /// Removed boxes of the training side, by view.
    pub(crate) dropped_boxes: DroppedByView,
    /// Relations between the views, learned from ground-truth boxes.
    pub(crate) paired_views: PairedViews,
}

impl Flights {
    /// Reads all corpora. Errors about all corpora name the first.
    ///
    /// # Errors
    /// A corpus does not suit the settings, or has no ground-truth box to learn from.
    pub(crate) fn read(
        corpora: &[Corpus],
        config: &TrainConfig,
        watch: &dyn Watch,
    ) -> Result<Self> {
        let mut samples = Samples::read_all(corpora, config.model_hash.as_deref())?;
        watch.check()?;
        if config.scenario_split.is_some() && corpora.len() > 1 {
            return Err(Error::setting(
                "scenario_split",
                format_args!("set for {} corpora", corpora.len()),
                "a single corpus: one scenario may be in several",
            ));
        }
        let scenario_split = (config.scenario_split.as_ref())
            .map(|config| ScenarioSplit::draw(&mut samples, config));
        if !config.accept_weather {
            let left_out = marked_scenarios::leave_out(&mut samples);
            if !left_out.is_empty() {
                watch.say(&marked_scenarios::left_out_line(&left_out));
            }
        }
        let corpus = &corpora[0];
        split_again(corpus, &mut samples, config.leave_out.as_deref())?;
        put_in_time_and_range(&mut samples, &[Side::Train, Side::Validation], config);
        let backgrounds = align(&mut samples, config.camera_stability_arcsec, watch)?;
        samples.move_common_to_shifts();
        let recorded = side_with_samples(corpus, &samples, Side::Train)?;
        let cameras = TrainingCameras::of(&samples, &recorded);
        let dropped_boxes = cameras.report(&samples, &recorded, watch);
        let corrections = samples.scenarios.iter().map(|of| of.corrections);
        if let Some(line) = Corrections::line(corrections) {
            watch.say(&line);
        }
        let true_boxes = cameras.true_boxes(&recorded);
        if true_boxes.is_empty() {
            let fault = format!(
                "has {} samples on the {} side, but no box of theirs is where a camera near that of calibration.json sees the aircraft of \
                 frames.parquet; label and detect again, or check the calibration with `dtd verify`",
                recorded.len(),
                Side::Train
            );
            return Err(Error::corpus(corpus.root(), fault));
        }
        let learned_from: Vec<&Sample> = true_boxes.iter().collect();
        let paired_views = PairedViews::fit(samples.views.len(), &learned_from);
        for line in paired_views.unrelated(&samples.views, &learned_from) {
            watch.say(&line);
        }
        Ok(Self {
            scenario_split,
            true_boxes,
            dropped_boxes,
            samples,
            backgrounds,
            paired_views,
        })
    }

    /// Samples for formulas, which a single false box can spoil.
    pub(crate) fn with_true_boxes(&self) -> Vec<&Sample> {
        self.true_boxes.iter().collect()
    }

    /// Samples for networks.
    pub(crate) fn training(&self, config: &TrainConfig) -> Vec<&Sample> {
        if config.only_true_boxes {
            self.with_true_boxes()
        } else {
            self.samples.of_side(Side::Train)
        }
    }

    /// Validation side as estimators see it; samples without a trusted box are omitted.
    ///
    /// # Errors
    /// None is left.
    pub(crate) fn validation(
        &self,
        corpus: &Corpus,
        normalisation: &Normalisation,
    ) -> Result<Vec<Sample>> {
        let recorded = side_with_samples(corpus, &self.samples, Side::Validation)?;
        let usual: Vec<Observation> = (recorded.iter())
            .map(|sample| normalisation.without_outliers(sample, false))
            .collect();
        let of_one = self.paired_views.of_one_aircraft(&usual);
        let usual: Vec<Sample> = (recorded.iter().zip(of_one))
            .map(|(sample, observed)| sample.with(observed))
            .filter(|sample| sample.detections() > 0)
            .collect();
        if usual.is_empty() {
            let fault = format!(
                "has {} samples on the {} side, but no box of theirs is near the places and sizes of the boxes on the training side; \
                 change the split, or detect again",
                recorded.len(),
                Side::Validation
            );
            return Err(Error::corpus(corpus.root(), fault));
        }
        Ok(usual)
    }
}

/// Corrects late images, and then drops the ticks outside the training's distances: they tell the motion at its limits.
pub(crate) fn put_in_time_and_range(samples: &mut Samples, sides: &[Side], config: &TrainConfig) {
    samples.put_in_time(sides, &[]);
    samples.retain_within(DistanceRange {
        min_nm: config.min_dtd_nm,
        max_nm: config.max_dtd_nm,
    });
}

/// Learns the camera directions, and corrects boxes and shifts on the training and validation sides.
fn align(samples: &mut Samples, stability_arcsec: f64, watch: &dyn Watch) -> Result<Backgrounds> {
    let backgrounds = Backgrounds::learn(samples, 0..samples.views.len(), stability_arcsec, watch)?;
    let alignment = backgrounds.align(samples, (&[Side::Train, Side::Validation], true), watch)?;
    alignment.report(watch);
    Ok(backgrounds)
}

fn side_with_samples<'a>(
    corpus: &Corpus,
    samples: &'a Samples,
    side: Side,
) -> Result<Vec<&'a Sample>> {
    let found = samples.of_side(side);
    if found.is_empty() {
        let scenarios = match samples.scenario_count(side) {
            1 => "1 scenario is there".to_owned(),
            count => format!("{count} scenarios are there"),
        };
        let fault = format!(
            "has no samples on the {side} side: {scenarios}, none with a detection before touchdown within the distance range; \
             generate, label and detect more, change the split, leave out less (leave_out), or accept marked scenarios \
             (accept_weather)"
        );
        return Err(Error::corpus(corpus.root(), fault));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use testkit::synthetic::SyntheticCorpus;

    use super::*;
    use crate::samples::tests::fixtures::registered_corpus;

    #[test]
    fn late_images_at_the_limits_of_the_distances_are_corrected_by_the_path_beyond() {
        let corpus = SyntheticCorpus {
            miss_ratio: 0.0,
            late_ticks: 1,
            ..registered_corpus(0.01)
        };
        let mut samples = Samples::synthetic(&corpus, 0.0);
        let config = TrainConfig {
            min_dtd_nm: 3.0,
            ..TrainConfig::default()
        };
        put_in_time_and_range(&mut samples, &[Side::Train], &config);
        for flight in samples.flights_of_side(Side::Train) {
            let nearest = flight.last().unwrap();
            assert!(nearest.dtd_m > 5_556.0 && nearest.best(1).is_some());
            let corrections = samples.scenarios[nearest.scenario].corrections;
            assert!(corrections.late > 30, "{corrections:?}");
        }
    }
}
