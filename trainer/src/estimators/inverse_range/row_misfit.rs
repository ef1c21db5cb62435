//! How far rows of registered views are from where they should be.
//!
//! Where a view sees an aircraft, by where another sees it, is a line (epipolar geometry). Along it, mostly in columns, the place tells the
//! distance; across it, mostly in rows, it tells nothing. What rows are off by is error alone, and clouds behind the aircraft, light and
//! air displace both: where rows scatter more, distances do.

use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::deviation_from_zero;
use serde::{Deserialize, Serialize};

use super::robust_fit::precision_of;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{Observation, Sample};

/// Constant, and change with column and row in the reference view and with the columns between the views.
const UNKNOWNS: usize = 4;
/// Unit of places, pixels.
const UNIT_PX: f64 = 1_000.0;
/// Shifts below which nothing is learned, ...
const MIN_SHIFTS: usize = 30;
/// ... and at most; more do not change it.
const MAX_SHIFTS: usize = 20_000;
/// Keeps slopes small that flights on one line do not determine, beside a mean of squares of about one.
const RIDGE: f64 = 1e-6;
/// Residuals of so many standard deviations have half the weight, in so many rounds.
const CAUCHY: f64 = 2.5;
const ROUNDS: usize = 20;

/// The row of the aircraft in a view, by its place in another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct RowRelation {
    /// Indices of the reference view and of the other.
    pub(super) views: [usize; 2],
    pub(super) coefficients_px: [f64; UNKNOWNS],
}

/// Factors of the coefficients, and the row that is found.
type Row = ([f64; UNKNOWNS], f64);

fn row_in([reference, view]: [usize; 2], observed: &Observation) -> Option<Row> {
    let shift = observed.shifts[view].filter(|shift| shift.reference == reference)?;
    let (place, _) = centre_and_size(observed.boxes[reference].as_ref()?);
    let terms = [
        1.0,
        place.x / UNIT_PX,
        place.y / UNIT_PX,
        shift.shift_px.x / UNIT_PX,
    ];
    Some((terms, shift.shift_px.y))
}

/// Standard deviation of that row, with the errors that it shares with other ticks, pixels.
fn row_sd_px([reference, view]: [usize; 2], observed: &Observation) -> Option<f64> {
    let own_px = observed.shifts[view]?.sd_px.y;
    let common = observed.common_errors.iter();
    let common = common.filter(|error| [reference, view].contains(&error.view));
    Some(common.fold(own_px, |sd_px, error| sd_px.hypot(error.sd_px.y)))
}

impl RowRelation {
    /// The relations of all views that were registered with each other often enough.
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
        let rows: Vec<&Row> = rows.iter().step_by(step).collect();
        let mut weights = vec![1.0; rows.len()];
        let mut relation = None;
        for _ in 0..ROUNDS {
            let mut equations = NormalEquations::new(UNKNOWNS);
            for ((terms, row_px), weight) in rows.iter().zip(&weights) {
                equations.add(terms, *row_px, *weight);
            }
            equations.add_to_diagonal(RIDGE * rows.len() as f64);
            let fitted = Self {
                views,
                coefficients_px: equations.solve_for()?,
            };
            let sd_px = deviation_from_zero(rows.iter().map(|row| fitted.off_px(row)));
            let half_px = CAUCHY * sd_px.max(f64::MIN_POSITIVE);
            for (row, weight) in rows.iter().zip(&mut weights) {
                *weight = (1.0 + (fitted.off_px(row) / half_px).powi(2)).recip();
            }
            relation = Some(fitted);
        }
        relation
    }

    fn off_px(&self, (terms, row_px): &Row) -> f64 {
        let expected = terms.iter().zip(&self.coefficients_px);
        row_px - expected.map(|(term, by)| term * by).sum::<f64>()
    }
}

/// Root mean square over the pairs of views that are registered at a tick, pixels, as it were with shifts of the best precision: what is
/// stated as less certain is expected to be off by more. `None` without any.
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
    use dataset::tables::pixel_box::PixelBox;
    use dataset::tables::registrations::Shift;
    use glam::DVec2;

    use super::*;
    use crate::samples::CommonError;
    use crate::samples::view_shift::ViewShift;

    const SD_PX: f64 = 0.04;

    /// An aircraft whose row in the second view is off by this.
    fn sample(tick: u32, off_px: f64) -> Sample {
        let time = f64::from(tick);
        let box_at = |cx_px: f64, cy_px: f64| PixelBox {
            cx_px,
            cy_px,
            width_px: 40.0,
            height_px: 20.0,
        };
        let (x, y, apart) = (
            900.0 + 3.0 * (0.3 * time).sin(),
            500.0 + time,
            100.0 + 2.0 * time,
        );
        let down = 4.0 + 0.01 * x - 0.02 * y + 0.03 * apart + off_px;
        let boxes = [box_at(x, y), box_at(x + apart, y + down)];
        let shift = Shift {
            x_px: x,
            y_px: y,
            dx_px: apart,
            dy_px: down,
            sd_x_px: 0.03,
            sd_y_px: SD_PX,
            scale: 1.0,
            gain: 1.0,
            correlation: 0.9,
        };
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
        // What is stated as uncertain is expected to be off.
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
