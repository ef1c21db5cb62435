//! Deviation of registered rows from the epipolar line.
//!
//! The position in a second view lies on a line (epipolar geometry). Along it, mostly in columns, the position gives the distance; across
//! it, mostly in rows, it contains only error. Rows that are off for some time contradict each other
//! ([`super::flight_filter`]), and they show a view's lag.

use dataset::numbers::spread::deviation_from_zero;
use serde::{Deserialize, Serialize};

use crate::samples::camera_health::late_images::Pair;
use crate::samples::row_line::RowLine;
use crate::samples::view_shift::MIN_SD_PX;
use crate::samples::{Observation, Sample};

/// Minimum number of shifts.
const MIN_SHIFTS: usize = 30;
/// Minimum number of flights that show how accurate lags are.
const MIN_FLIGHTS: usize = 4;
/// Maximum number of shifts; more do not change the fit.
const MAX_SHIFTS: usize = 20_000;

/// Row in a view as a function of the position in the reference view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct RowRelation {
    /// Indices of the reference view and of the second view.
    pub(super) views: [usize; 2],
    pub(super) row: RowLine,
    /// Standard deviation of rows in training, pixels.
    sd_px: f64,
    /// Standard deviation of the lags of training flights by rows that were learned from others, s: they have none. Missing with few
    /// flights.
    lag_sd_s: Option<f64>,
}

impl RowRelation {
    /// Relations for all views that were registered with each other often enough.
    pub(super) fn all(views: usize, training: &[&Sample]) -> Vec<Self> {
        let pairs = (0..views).flat_map(|a| (0..views).map(move |b| [a, b]));
        pairs.filter_map(|pair| Self::of(pair, training)).collect()
    }

    /// Learns how accurate lags are, from flights that have none, each with relations that others taught.
    pub(super) fn learn_lags(&mut self, flights: &[(&[Self], &[&Sample])]) {
        let lags_s = flights.iter().filter_map(|(relations, flight)| {
            let relation = relations.iter().find(|of| of.views == self.views)?;
            let observed: Vec<&Observation> = flight.iter().map(|of| &of.observed).collect();
            relation.pair_of(0.0).lag_s(&observed)
        });
        let lags_s: Vec<f64> = lags_s.collect();
        let is_known = lags_s.len() >= MIN_FLIGHTS;
        self.lag_sd_s = is_known.then(|| deviation_from_zero(lags_s.into_iter()));
    }

    /// The rows of these views, for measuring lags; `None` if too few flights showed how accurate such lags are.
    pub(super) fn pair(&self) -> Option<Pair<'_>> {
        Some(self.pair_of(self.lag_sd_s?))
    }

    fn pair_of(&self, lag_sd_s: f64) -> Pair<'_> {
        Pair {
            views: self.views,
            off_px: Box::new(|places_px| self.row.off_px(places_px)),
            row_sd_px: self.sd_px,
            lag_sd_s,
        }
    }

    fn of(views: [usize; 2], training: &[&Sample]) -> Option<Self> {
        let places = training.iter();
        let places: Vec<_> = places
            .filter_map(|sample| Some(sample.registered_places(views)?.1))
            .collect();
        if places.len() < MIN_SHIFTS {
            return None;
        }
        let step = places.len().div_ceil(MAX_SHIFTS);
        let (row, sd_px) = RowLine::fit(places.into_iter().step_by(step).map(|of| (of, 1.0)))?;
        Some(Self {
            views,
            row,
            sd_px,
            lag_sd_s: None,
        })
    }
}

/// Misfits of the registered pairs at a tick in joint standard deviations, with the views in ascending order: positive if the row in the
/// second one is lower than expected.
pub(super) fn row_misfits(
    relations: &[RowRelation],
    observed: &Observation,
) -> Vec<([usize; 2], f64)> {
    let misfits = relations.iter().filter_map(|relation| {
        let [reference, view] = relation.views;
        let (shift, places_px) = observed.registered_places(relation.views)?;
        let off_px = relation.row.off_px(places_px);
        let sd_px = MIN_SD_PX.hypot(observed.row_sd_px(relation.views, shift.sd_px.y));
        Some(if reference < view {
            ([reference, view], off_px / sd_px)
        } else {
            ([view, reference], -off_px / sd_px)
        })
    });
    misfits.collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::samples::CommonError;
    use crate::samples::tests::fixtures::{box_at, shift_of};
    use crate::samples::view_shift::ViewShift;

    const SD_PX: f64 = 0.04;

    /// An aircraft with a row error in the second view.
    fn sample(tick: u32, off_px: f64) -> Sample {
        let time = f64::from(tick);
        let (x, y, apart) = (
            900.0 + 3.0 * (0.3 * time).sin(),
            500.0 + time,
            100.0 + 2.0 * time,
        );
        let down = 4.0 + 0.01 * x - 0.02 * y + 0.03 * apart + off_px;
        let boxes = [box_at(x, y), box_at(x + apart, y + down)];
        let shift = shift_of([x, y], [apart, down]);
        let mut sample = Sample::of_boxes(1.0, boxes.map(Some).to_vec());
        sample.observed.shifts[1] = Some(ViewShift::of(0, &shift));
        sample
    }

    #[test]
    fn rows_that_follow_from_places_have_no_misfit_and_others_are_off_by_as_much_as_they_are() {
        let samples: Vec<Sample> = (0..200)
            .map(|tick| sample(tick, if tick % 10 == 0 { 5.0 } else { 0.0 }))
            .collect();
        let relations = RowRelation::all(2, &samples.iter().collect::<Vec<_>>());
        let [relation] = relations.as_slice() else {
            panic!("{relations:?}")
        };
        assert_eq!(relation.views, [0, 1]);
        for off_px in [0.0, 0.5, -0.5] {
            let found = row_misfits(&relations, &sample(77, off_px));
            let [([0, 1], misfit)] = found[..] else {
                panic!("{found:?}")
            };
            let expected = off_px / MIN_SD_PX.hypot(SD_PX);
            assert!((misfit - expected).abs() < 0.3, "{off_px}: {misfit}");
        }
        // Uncertain rows may be off.
        let mut turned = sample(77, 0.5).observed;
        turned.common_errors.push(CommonError {
            view: 0,
            sd_px: DVec2::new(0.0, 0.3),
        });
        let found = row_misfits(&relations, &turned)[0].1;
        let expected = 0.5 / MIN_SD_PX.hypot(SD_PX).hypot(0.3);
        assert!((found - expected).abs() < 0.1, "{found}");
        let mut alone = sample(77, 0.0).observed;
        alone.shifts[1] = None;
        assert_eq!(row_misfits(&relations, &alone), []);
    }

    #[test]
    fn few_shifts_teach_nothing() {
        let samples: Vec<Sample> = (0..20).map(|tick| sample(tick, 0.0)).collect();
        assert_eq!(RowRelation::all(2, &samples.iter().collect::<Vec<_>>()), []);
    }
}
