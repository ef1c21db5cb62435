//! Ranges of all settings. Values outside are rejected before anything is computed from them.

use std::fmt::{Debug, Display};
use std::ops::RangeInclusive;

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

use super::{Optimisation, TrainConfig};
use crate::error::{Error, Result};
use crate::samples::FARTHEST_M;
use crate::samples::sides::leave_out::LeftOut;

/// Layer widths and depths: up to four times the paper's. With layers at these limits, a training on two views takes 2 GiB, plus 3.5 MB per
/// sample in a batch.
const WIDTHS: RangeInclusive<usize> = 1..=1_024;
const MAX_LAYERS: usize = 8;
const STEPS: RangeInclusive<usize> = 1..=100_000_000;
const BATCH_SIZES: RangeInclusive<usize> = 1..=8_192;
/// Maximum length of the convergence logs.
const MAX_ENTRIES: usize = 100_000;
/// Maximum of weights, thresholds, rates and standard deviations.
const MAX_NUMBER: f64 = 1e6;
const NUMBERS: RangeInclusive<f64> = 0.0..=MAX_NUMBER;
/// Maximum share of scenarios for test and for validation: a tenth is left for training.
const MAX_SHARE: f64 = 0.45;
/// Target units within the range of single-precision networks.
const UNITS_NM: RangeInclusive<f64> = 0.01..=10_000.0;

impl TrainConfig {
    /// Checks all settings.
    pub fn check(&self) -> Result<()> {
        let distances_nm = 0.0..=FARTHEST_M / METERS_PER_NAUTICAL_MILE;
        number("min_dtd_nm", self.min_dtd_nm, distances_nm.clone())?;
        if let Some(max) = self.max_dtd_nm {
            number("max_dtd_nm", max, distances_nm)?;
            if max <= self.min_dtd_nm {
                return Err(Error::setting(
                    "max_dtd_nm",
                    max,
                    format!("a number above min_dtd_nm, which is {}", self.min_dtd_nm),
                ));
            }
        }
        let stability_arcsec = self.camera_stability_arcsec;
        number("camera_stability_arcsec", stability_arcsec, 0.0..=3_600.0)?;
        if let Some(setting) = &self.leave_out
            && LeftOut::parse(setting).is_none()
        {
            return Err(Error::setting(
                "leave_out",
                format_args!("{setting:?}"),
                LeftOut::EXPECTED,
            ));
        }
        number("target_unit_nm", self.target_unit_nm, UNITS_NM)?;
        if let Some(split) = &self.scenario_split {
            for (setting, share) in [
                ("scenario_split.test_share", split.test_share),
                ("scenario_split.validation_share", split.validation_share),
            ] {
                number(setting, share, 0.0..=MAX_SHARE)?;
            }
            if let Some(left_out) = &self.leave_out {
                return Err(Error::setting(
                    "scenario_split",
                    format_args!("set beside leave_out = {left_out:?}"),
                    "one of the two",
                ));
            }
        }
        let c = &self.calibration;
        layers("calibration.hidden", &c.hidden, 0)?;
        whole("calibration.features", c.features, WIDTHS)?;
        layers("calibration.head_hidden", &c.head_hidden, 0)?;
        let (plateau_pct, gap_pct) = (c.plateau_threshold_pct, c.gap_threshold_pct);
        number("calibration.plateau_threshold_pct", plateau_pct, NUMBERS)?;
        number("calibration.gap_threshold_pct", gap_pct, NUMBERS)?;
        optimisation("calibration", &c.optimisation, c.first_cycle)?;
        log_every("calibration.log_every", c.log_every, &c.optimisation)?;
        let e = &self.estimator;
        layers("estimator.lstm", &e.lstm, 1)?;
        layers("estimator.head_hidden", &e.head_hidden, 0)?;
        number("estimator.alone_weight", e.alone_weight, NUMBERS)?;
        number("estimator.together_first", e.together_first, 0.0..=1.0)?;
        optimisation("estimator", &e.optimisation, e.first_cycle)?;
        log_every("estimator.log_every", e.log_every, &e.optimisation)?;
        let s = &self.self_calibration;
        // Less is numerically indistinguishable from certainty.
        let least = MAX_NUMBER.recip();
        let position = least..=MAX_NUMBER;
        number("self_calibration.position_sd_m", s.position_sd_m, position)?;
        number("self_calibration.turn_sd_deg", s.turn_sd_deg, least..=90.0)?;
        let focal = least..=1_000.0;
        number("self_calibration.focal_sd_pct", s.focal_sd_pct, focal)?;
        let m = &self.mono;
        layers("mono.hidden", &m.hidden, 0)?;
        optimisation("mono", &m.optimisation, m.first_cycle)
    }
}

fn number(setting: &str, found: f64, allowed: RangeInclusive<f64>) -> Result<()> {
    within(setting, found, allowed, "a number")
}

fn whole(setting: &str, found: usize, allowed: RangeInclusive<usize>) -> Result<()> {
    within(setting, found, allowed, "a whole number")
}

fn within<T: PartialOrd + Debug + Display>(
    setting: &str,
    found: T,
    allowed: RangeInclusive<T>,
    kind: &str,
) -> Result<()> {
    // NaN is never in range.
    if allowed.contains(&found) {
        return Ok(());
    }
    let expected = format!("{kind} from {} to {}", allowed.start(), allowed.end());
    Err(Error::setting(setting, format_args!("{found:?}"), expected))
}

fn layers(setting: &str, widths: &[usize], least: usize) -> Result<()> {
    if !(least..=MAX_LAYERS).contains(&widths.len()) {
        return Err(Error::setting(
            setting,
            format_args!("{} layers", widths.len()),
            format!("{least} to {MAX_LAYERS}"),
        ));
    }
    widths
        .iter()
        .try_for_each(|&width| whole(setting, width, WIDTHS))
}

fn optimisation(stage: &str, found: &Optimisation, first_cycle: usize) -> Result<()> {
    whole(&format!("{stage}.first_cycle"), first_cycle, STEPS)?;
    let setting = |key: &str| format!("{stage}.optimisation.{key}");
    whole(&setting("steps"), found.steps, STEPS)?;
    whole(&setting("batch_size"), found.batch_size, BATCH_SIZES)?;
    if found.learning_rate > 0.0 && found.learning_rate <= MAX_NUMBER {
        return Ok(());
    }
    Err(Error::setting(
        &setting("learning_rate"),
        found.learning_rate,
        format!("a number above 0, at most {MAX_NUMBER}"),
    ))
}

fn log_every(setting: &str, found: usize, training: &Optimisation) -> Result<()> {
    let least = training.steps.div_ceil(MAX_ENTRIES);
    if found >= least {
        return Ok(());
    }
    Err(Error::setting(
        setting,
        format_args!("{found:?}"),
        format!(
            "at least {least}: {} steps make {MAX_ENTRIES} entries of the log at most",
            training.steps
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error for the demo's settings with these lines changed.
    fn refusal(toml: &str) -> String {
        let config: TrainConfig = serde_json::from_str(toml).unwrap();
        config.check().unwrap_err().to_string()
    }

    #[test]
    fn numbers_beyond_all_measure_are_refused_with_name_value_and_range() {
        for (settings, words) in [
            (
                r#"{"estimator": {"lstm": [1000000000]}}"#,
                ["estimator.lstm", "1000000000", "1 to 1024"],
            ),
            (
                r#"{"calibration": {"features": 1000000000}}"#,
                ["calibration.features", "1000000000", "1 to 1024"],
            ),
            (
                r#"{"mono": {"optimisation": {"steps": 1, "batch_size": 1000000000, "learning_rate": 0.1}}}"#,
                ["mono.optimisation.batch_size", "1000000000", "1 to 8192"],
            ),
            (
                r#"{"self_calibration": {"position_sd_m": 0}}"#,
                ["self_calibration.position_sd_m", "is 0", "100000"],
            ),
            (
                r#"{"min_dtd_nm": 1e9}"#,
                ["min_dtd_nm", "1000000000", "0 to 10800"],
            ),
            (
                r#"{"estimator": {"log_every": 0}}"#,
                ["estimator.log_every", "is 0", "at least 3"],
            ),
            (
                r#"{"estimator": {"lstm": []}}"#,
                ["estimator.lstm", "0 layers", "1 to 8"],
            ),
        ] {
            let message = refusal(settings);
            for word in words {
                assert!(message.contains(word), "no {word:?} in {message}");
            }
        }
        let many = vec![1; 9];
        let message = refusal(&serde_json::json!({"mono": {"hidden": many}}).to_string());
        assert!(message.contains("mono.hidden is 9 layers"), "{message}");
    }

    #[test]
    fn a_number_that_is_none_is_in_no_range() {
        let mut config = TrainConfig::default();
        config.calibration.optimisation.learning_rate = f64::NAN;
        assert!(config.check().is_err());
        config = TrainConfig {
            max_dtd_nm: Some(f64::INFINITY),
            ..TrainConfig::default()
        };
        assert!(config.check().is_err());
    }
}
