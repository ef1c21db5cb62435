//! Deviation of registered rows from the epipolar line.
//!
//! The position in a second view lies on a line (epipolar geometry). Along it, mostly in columns, the position gives the distance; across
//! it, mostly in rows, it contains only error. Clouds behind the aircraft, light and air displace both: where rows scatter more, distances
//! do.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::robust_fit::precision_of;
use crate::samples::robust_line::{FINE_UNIT_PX, UNIT_PX, dot, robust_line};
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{Observation, Sample};

/// Constant, and change with column and row in the reference view and with the shift in columns.
const UNKNOWNS: usize = 4;
/// Minimum number of shifts.
const MIN_SHIFTS: usize = 30;
/// Maximum number of shifts; more do not change the fit.
const MAX_SHIFTS: usize = 20_000;

/// Row in a view as a function of the position in the reference view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct RowRelation {
    /// Indices of the reference view and of the second view.
    pub(super) views: [usize; 2],
    pub(super) coefficients_px: [f64; UNKNOWNS],
}

/// Terms and measured row.
type Row = ([f64; UNKNOWNS], f64);

fn row_in([reference, view]: [usize; 2], observed: &Observation) -> Option<Row> {
    let shift = observed.shifts[view].filter(|shift| shift.reference == reference)?;
    let (place, _) = centre_and_size(observed.boxes[reference].as_ref()?);
    Some(row_of(place, shift.shift_px))
}

fn row_of(place: DVec2, shift_px: DVec2) -> Row {
    let terms = [
        1.0,
        place.x / UNIT_PX,
        place.y / UNIT_PX,
        shift_px.x / UNIT_PX,
    ];
    (terms, shift_px.y)
}

/// Standard deviation of that row, including common errors, pixels.
fn row_sd_px([reference, view]: [usize; 2], observed: &Observation) -> Option<f64> {
    let own_px = observed.shifts[view]?.sd_px.y;
    let common = observed.common_errors.iter();
    let common = common.filter(|error| [reference, view].contains(&error.view));
    Some(common.fold(own_px, |sd_px, error| sd_px.hypot(error.sd_px.y)))
}

impl RowRelation {
    /// Relations for all views that were registered with each other often enough.
    pub(super) fn all(views: usize, training: &[&Sample]) -> Vec<Self> {
        let pairs = (0..views).flat_map(|a| (0..views).map(move |b| [a, b]));
        pairs.filter_map(|pair| Self::of(pair, training)).collect()
    }

    fn of(views: [usize; 2], training: &[&Sample]) -> Option<Self> {
        let rows: Vec<Row> = (training.iter())
            .filter_map(|sample| row_in(views, sample))
            .collect();
        if rows.len() < MIN_SHIFTS {
            return None;
        }
        let step = rows.len().div_ceil(MAX_SHIFTS);
        // In finer units the ridge of the fit moves no row.
        let finer = UNIT_PX / FINE_UNIT_PX;
        let points = rows.iter().step_by(step);
        let points = points.map(|(terms, row_px)| (terms.map(|term| finer * term), *row_px, 1.0));
        let (coefficients, _) = robust_line(&points.collect::<Vec<_>>())?;
        Some(Self {
            views,
            coefficients_px: coefficients.map(|coefficient| finer * coefficient),
        })
    }

    pub(super) fn off_by_px(&self, [first, second]: [DVec2; 2]) -> f64 {
        self.off_px(&row_of(first, second - first))
    }

    fn off_px(&self, (terms, row_px): &Row) -> f64 {
        row_px - dot(terms, &self.coefficients_px)
    }
}

/// Root mean square over the registered pairs at a tick, pixels, normalised to shifts with the best precision: less certain rows may be off
/// by more. `None` without any.
pub(super) fn row_misfit_px(relations: &[RowRelation], observed: &Observation) -> Option<f64> {
    let off = relations.iter().filter_map(|relation| {
        let row = row_in(relation.views, observed)?;
        let sd_px = row_sd_px(relation.views, observed)?;
        Some((relation.off_px(&row) * precision_of(sd_px)).powi(2))
    });
    let (sum, count) = off.fold((0.0, 0.0), |(sum, count), square| {
        (sum + square, count + 1.0)
    });
    (count > 0.0).then(|| (sum / count).sqrt())
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
        sample.observed.shifts[1] = ViewShift::between((0, &boxes[0]), &boxes[1], &shift);
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
            let found_px = row_misfit_px(&relations, &sample(77, off_px)).unwrap();
            assert!(
                (found_px - precision_of(SD_PX) * off_px.abs()).abs() < 0.02,
                "{off_px}: {found_px}"
            );
        }
        // Uncertain rows may be off.
        let mut turned = sample(77, 0.5).observed;
        turned.common_errors.push(CommonError {
            view: 0,
            sd_px: DVec2::new(0.0, 0.3),
        });
        let found_px = row_misfit_px(&relations, &turned).unwrap();
        let expected_px = precision_of(SD_PX.hypot(0.3)) * 0.5;
        assert!((found_px - expected_px).abs() < 0.02, "{found_px}");
        let mut alone = sample(77, 0.0).observed;
        alone.shifts[1] = None;
        assert_eq!(row_misfit_px(&relations, &alone), None);
    }

    #[test]
    fn few_shifts_teach_nothing() {
        let samples: Vec<Sample> = (0..20).map(|tick| sample(tick, 0.0)).collect();
        assert_eq!(RowRelation::all(2, &samples.iter().collect::<Vec<_>>()), []);
    }
}
