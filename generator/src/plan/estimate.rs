//! A plan's cost: hours of flight, hours of recording (`duration.rs`), bytes. Every figure states its source.
//!
//! There are two figures for bytes: the expected size ([`Estimate::bytes`]), and the free space to have before a run, which allows
//! for more detailed scenery than any that was measured ([`room_bytes`]).

use dataset::plan::{Common, PlannedScenario};
use dataset::video::VideoSettings;
use serde::Serialize;

use super::duration::{Durations, Pacing, counted, relative_size};

/// Seconds between two images, and bytes per image on disk, mean over the four weathers of `scenarios.toml`: the further apart images are,
/// the less a video gains from the one before. `docs/plan.md` has the measurement.
const BYTES_PER_PICTURE: [(f64, f64); 5] = [
    (1.0 / 30.0, 9_200.0),
    (0.2, 17_900.0),
    (0.5, 23_700.0),
    (1.0, 29_100.0),
    (2.0, 33_400.0),
];
/// Bits per pixel for scenery far more detailed than the stand-in's, whose worst weather takes 0.07 bits per pixel (docs/corpus.md).
const AMPLE_BITS_PER_PIXEL: f64 = 0.1;
/// Bits per pixel of such scenery in a lossless video.
const AMPLE_BITS_PER_LOSSLESS_PIXEL: f64 = 6.0;
/// Bytes of tables and records per tick.
const TABLE_BYTES_PER_TICK: f64 = 400.0;
/// A measured corpus may contain the easier scenarios.
const AMPLE_OVER_MEASURED: f64 = 1.5;
/// Measured in a corpus of the same images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredSize {
    /// Bytes of all folders examined.
    pub bytes: u64,
    /// Images in them, all views together.
    pub pictures: u64,
    /// Number of those scenarios.
    pub scenarios: usize,
}

/// Cost of scenarios.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// Number of scenarios.
    pub scenarios: usize,
    /// Ticks of all scenarios: exact for recordings, expected for live flights.
    pub ticks: u64,
    /// Images of all views.
    pub pictures: u64,
    /// Simulated flight, hours.
    pub flight_h: f64,
    /// Total recording time, hours.
    pub making_h: f64,
    /// Parts of the recording time.
    #[serde(flatten)]
    pub durations: Durations,
    /// Bytes on disk; absent if the size of such images is unknown.
    pub bytes: Option<u64>,
    /// Source of that figure, or how to get one.
    pub bytes_basis: String,
    /// Bytes that should be free before the scenarios are recorded: more than they are expected to take.
    pub room_bytes: u64,
}

impl Estimate {
    /// Cost of scenarios.
    pub fn new<'a>(
        common: &Common,
        scenarios: impl IntoIterator<Item = &'a PlannedScenario>,
        pacing: &Pacing,
        size: Option<MeasuredSize>,
    ) -> Self {
        let scenarios: Vec<&PlannedScenario> = scenarios.into_iter().collect();
        let count = scenarios.len();
        let ticks = ticks(scenarios.iter().copied());
        let pictures = ticks * common.cameras.len() as u64;
        let durations = Durations::new(common, &scenarios, pacing);
        let (bytes_per_picture, bytes_basis) = bytes(common, size);
        let flight_s = ticks as f64 * common.picture.frame_rate.period_s();
        Self {
            scenarios: count,
            ticks,
            pictures,
            flight_h: flight_s / 3_600.0,
            making_h: durations.total_h(),
            durations,
            bytes: bytes_per_picture.map(|per_picture| (per_picture * pictures as f64) as u64),
            bytes_basis,
            room_bytes: room(common, ticks, size),
        }
    }
}

/// Bytes that should be free before scenarios are recorded; as [`Estimate::room_bytes`] without measurements.
pub fn room_bytes<'a>(
    common: &Common,
    scenarios: impl IntoIterator<Item = &'a PlannedScenario>,
) -> u64 {
    room(common, ticks(scenarios), None)
}

fn room(common: &Common, ticks: u64, size: Option<MeasuredSize>) -> u64 {
    let pictures = common.cameras.len() as f64;
    let per_picture = match measured_bytes_per_picture(size) {
        Some(bytes) => bytes * AMPLE_OVER_MEASURED,
        None => {
            let picture = common.picture;
            let bits = match common.video.codec {
                codec if codec.is_lossless() => AMPLE_BITS_PER_LOSSLESS_PIXEL,
                _ => AMPLE_BITS_PER_PIXEL,
            };
            let detailed = f64::from(picture.width_px) * f64::from(picture.height_px) * bits / 8.0;
            match expected_bytes_per_picture(common) {
                Some(expected) => detailed.max(expected * AMPLE_OVER_MEASURED),
                None => detailed,
            }
        }
    };
    (ticks as f64 * (pictures * per_picture + TABLE_BYTES_PER_TICK)) as u64
}

fn ticks<'a>(scenarios: impl IntoIterator<Item = &'a PlannedScenario>) -> u64 {
    scenarios.into_iter().map(|s| u64::from(s.ticks)).sum()
}

fn measured_bytes_per_picture(size: Option<MeasuredSize>) -> Option<f64> {
    size.filter(|size| size.pictures > 0)
        .map(|size| size.bytes as f64 / size.pictures as f64)
}

/// Bytes per stand-in image, if it was measured with this `[video]`.
fn expected_bytes_per_picture(common: &Common) -> Option<f64> {
    let apart_s = common.picture.frame_rate.period_s();
    (common.video == VideoSettings::default())
        .then(|| bytes_of_picture_after(apart_s) * relative_size(common))
}

/// Bytes per image at this interval: between two measurements, linear in the logarithm of the time.
fn bytes_of_picture_after(apart_s: f64) -> f64 {
    let measured = BYTES_PER_PICTURE;
    let next = measured.partition_point(|(measured_s, _)| *measured_s < apart_s);
    let [before, after] =
        [next.saturating_sub(1), next.min(measured.len() - 1)].map(|index| measured[index]);
    match (after.0 / before.0).ln() {
        0.0 => after.1,
        all => {
            let share = (apart_s / before.0).ln() / all;
            before.1 + share * (after.1 - before.1)
        }
    }
}

fn bytes(common: &Common, size: Option<MeasuredSize>) -> (Option<f64>, String) {
    if let Some(per_picture) = measured_bytes_per_picture(size) {
        let scenarios = counted(size.map_or(0, |size| size.scenarios), "scenario");
        let basis = format!("{per_picture:.0} per image, as in {scenarios} of the corpus");
        return (Some(per_picture), basis);
    }
    if let Some(per_picture) = expected_bytes_per_picture(common) {
        let basis = format!(
            "{per_picture:.0} per image, measured with the bundled simulator at 1920x1280, five rates and the default [video]; --against CORPUS measures yours"
        );
        return (Some(per_picture), basis);
    }
    let basis = "nothing was measured with this [video]; make a scenario and ask again with --against CORPUS";
    (None, basis.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_takes_what_was_measured_at_its_rate_and_more_the_further_apart_pictures_are() {
        for (apart_s, bytes) in BYTES_PER_PICTURE {
            assert!((bytes_of_picture_after(apart_s) - bytes).abs() < 1.0);
        }
        let [often, between, rarely] = [0.001, 0.1, 100.0].map(bytes_of_picture_after);
        assert!(often == 9_200.0 && rarely == 33_400.0);
        assert!(
            9_200.0 < between && between < BYTES_PER_PICTURE[1].1,
            "{between}"
        );
    }
}
