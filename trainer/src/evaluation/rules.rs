//! Evaluation rules: the constants in `evaluation-rules.toml`, which every `metrics.json` repeats.

use std::path::Path;

use dataset::corpus::Corpus;
use dataset::files::toml_file::TomlFile;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::samples::{DistanceRange, Sample};

const FILE: &str = "evaluation-rules.toml";
const TEXT: &str = include_str!("../../evaluation-rules.toml");

/// The rules; `evaluation-rules.toml` explains each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluationRules {
    /// Incremented whenever a value changes.
    pub version: u32,
    /// Minimum distance to touchdown, nautical miles.
    pub min_dtd_nm: f64,
    /// Maximum distance to touchdown, nautical miles.
    pub max_dtd_nm: f64,
    /// Share of contrast below which fog hides the aircraft.
    pub hidden_below_transmission: f64,
    /// Width of the distance bins, nautical miles.
    pub distance_bin_nm: f64,
    /// Rules for removing views.
    pub removed_views: RemovedViewsRules,
    /// Rules for confidence intervals.
    pub bootstrap: BootstrapRules,
}

/// Rules for removing views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RemovedViewsRules {
    /// Seed for random numbers.
    pub seed: u64,
    /// Probability that a tick loses a view.
    pub random_share: f64,
    /// Lengths of bursts, seconds.
    pub burst_s: Vec<f64>,
    /// Period with one burst, seconds.
    pub burst_every_s: f64,
}

/// Rules for confidence intervals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BootstrapRules {
    /// Seed for random numbers.
    pub seed: u64,
    /// Number of resamples.
    pub resamples: usize,
    /// Interval coverage.
    pub share: f64,
}

impl EvaluationRules {
    /// The rules in this version.
    pub fn current() -> Self {
        let file = TomlFile::new(Path::new(FILE), TEXT);
        file.parse().expect("a test parses this very text")
    }

    pub(crate) fn range(&self) -> DistanceRange {
        DistanceRange {
            min_nm: self.min_dtd_nm,
            max_nm: Some(self.max_dtd_nm),
        }
    }

    /// True if the aircraft is present, so that the tick counts.
    pub(crate) fn is_there(&self, sample: &Sample) -> bool {
        self.range().contains(sample.dtd_m) && sample.transmission.is_some()
    }

    /// Error for a corpus without a tick that counts.
    pub(crate) fn nothing_to_judge(&self, corpus: &Corpus) -> Error {
        let fault = format!(
            "has no samples on the test side from {} to {} NM",
            self.min_dtd_nm, self.max_dtd_nm
        );
        Error::corpus(corpus.root(), fault)
    }

    /// True if fog hides the aircraft from every camera that looks at it.
    pub(crate) fn is_hidden(&self, sample: &Sample) -> bool {
        let remains = |share| share < self.hidden_below_transmission;
        sample.transmission.is_some_and(remains)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

    #[test]
    fn the_rules_are_those_that_the_documentation_names_and_each_is_sensible() {
        let rules = EvaluationRules::current();
        assert_eq!(
            (rules.version, rules.min_dtd_nm, rules.max_dtd_nm),
            (1, 1.0, 10.0)
        );
        let removed = &rules.removed_views;
        assert_eq!(removed.random_share, 0.15);
        assert_eq!(removed.burst_s, [5.0, 20.0, 60.0]);
        assert!(
            removed
                .burst_s
                .iter()
                .all(|&burst_s| burst_s < removed.burst_every_s)
        );
        assert!((0.5..1.0).contains(&rules.bootstrap.share));
        assert!(rules.bootstrap.resamples >= 100 && rules.distance_bin_nm > 0.0);
    }

    #[test]
    fn fog_hides_an_aircraft_here_where_it_does_so_for_the_detector() {
        let hidden_below = EvaluationRules::current().hidden_below_transmission;
        assert_eq!(hidden_below, dataset::conditions::sight::MIN_TRANSMISSION);
    }

    #[test]
    fn an_aircraft_is_there_from_one_to_ten_miles_in_a_picture_and_fog_hides_it_below_two_percent()
    {
        let rules = EvaluationRules::current();
        let at = |dtd_nm: f64, transmission| Sample {
            transmission,
            ..Sample::of_boxes(dtd_nm * METERS_PER_NAUTICAL_MILE, vec![None])
        };
        for (dtd_nm, transmission, is_there, is_hidden) in [
            (1.0, Some(1.0), true, false),
            (10.0, Some(0.021), true, false),
            (5.0, Some(0.019), true, true),
            (0.99, Some(1.0), false, false),
            (10.01, Some(1.0), false, false),
            (5.0, None, false, false),
        ] {
            let sample = at(dtd_nm, transmission);
            let found = (rules.is_there(&sample), rules.is_hidden(&sample));
            assert_eq!(
                found,
                (is_there, is_hidden),
                "{dtd_nm} NM, {transmission:?}"
            );
        }
    }
}
