//! The monoscopic baseline as a formula: an aircraft of known size looks smaller the farther away it is.
//!
//! `range = k S / w` with focal length k, span S and box width w. The camera does not stand at the touchdown target, so the
//! distance to touchdown is that range less a constant. Both `k S` and the constant are fitted per view on the training side: a
//! detector's box is not exactly as wide as the span.
//!
//! The fit minimises the mean absolute relative error, the figure that the estimator is judged by, and not its square: the formula divides
//! by the width, so one box of another thing, a few pixels wide, says ten times the true distance, and as a square outweighs thousands.

use serde::{Deserialize, Serialize};

use crate::samples::Sample;

/// The fitted formula of one view: `dtd = focal_times_span / width - setback`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pinhole {
    /// k S, pixel metres.
    pub focal_times_span_px_m: f64,
    /// How far the camera stands behind the touchdown target, metres.
    pub setback_m: f64,
}

impl Pinhole {
    /// Fits one view; `None` if it saw fewer than two samples.
    pub fn fit(view: usize, training: &[&Sample]) -> Option<Self> {
        let rows: Vec<Row> = training
            .iter()
            .filter_map(|sample| {
                let seen = sample.boxes[view].filter(|b| b.width_px > 0.0)?;
                Some(Row {
                    per_a: 1.0 / (seen.width_px * sample.dtd_m),
                    per_b: -1.0 / sample.dtd_m,
                })
            })
            .collect();
        // Least absolute errors by least squares with each row weighted by the inverse of its last error.
        let mut fitted = least_squares(&rows, |_| 1.0)?;
        for _ in 0..REWEIGHTINGS {
            fitted = least_squares(&rows, |row| {
                row.relative_error(&fitted).abs().max(NEGLIGIBLE).recip()
            })?;
        }
        Some(fitted)
    }

    /// Distance to touchdown from a box's width, metres.
    pub fn dtd_m(&self, width_px: f64) -> f64 {
        self.focal_times_span_px_m / width_px - self.setback_m
    }
}

/// How often the rows are weighted anew. Convergence is linear; after so many the constants stand to a part in ten thousand.
const REWEIGHTINGS: usize = 100;
/// Relative errors below this weigh as if they were this large, or an exact row would weigh infinitely.
const NEGLIGIBLE: f64 = 1e-6;

/// What one box says: `a * per_a + b * per_b` is the predicted distance as a part of the true one, `a` and `b` the formula's constants.
struct Row {
    per_a: f64,
    per_b: f64,
}

impl Row {
    fn relative_error(&self, fitted: &Pinhole) -> f64 {
        self.per_a * fitted.focal_times_span_px_m + self.per_b * fitted.setback_m - 1.0
    }
}

/// Minimises the weighted sum of squared relative errors; `None` if the rows do not tell the constants apart.
fn least_squares(rows: &[Row], weight: impl Fn(&Row) -> f64) -> Option<Pinhole> {
    let (mut aa, mut ab, mut bb, mut a1, mut b1) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for row in rows {
        let weight = weight(row);
        aa += weight * row.per_a * row.per_a;
        ab += weight * row.per_a * row.per_b;
        bb += weight * row.per_b * row.per_b;
        a1 += weight * row.per_a;
        b1 += weight * row.per_b;
    }
    let determinant = aa * bb - ab * ab;
    (determinant > f64::EPSILON * aa * bb).then(|| Pinhole {
        focal_times_span_px_m: (a1 * bb - b1 * ab) / determinant,
        setback_m: (aa * b1 - ab * a1) / determinant,
    })
}

/// Mean over the views that saw the sample and were fitted, metres.
pub fn predict(pinholes: &[Option<Pinhole>], sample: &Sample) -> Option<f64> {
    let distances: Vec<f64> = pinholes
        .iter()
        .zip(&sample.boxes)
        .filter_map(|(pinhole, seen)| {
            Some(
                pinhole
                    .as_ref()?
                    .dtd_m(seen.filter(|b| b.width_px > 0.0)?.width_px),
            )
        })
        .collect();
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::geodesy::Geodetic;
    use dataset::pixel_box::PixelBox;

    fn sample(dtd_m: f64) -> Sample {
        let width_px = 390_000.0 / (dtd_m + 1_500.0);
        Sample {
            scenario: 0,
            tick: 0,
            time_ns: 0,
            dtd_m,
            along_track_m: dtd_m,
            cross_track_m: 0.0,
            position: Geodetic {
                latitude_deg: 0.0,
                longitude_deg: 0.0,
                altitude_msl_m: 0.0,
            },
            boxes: vec![
                Some(PixelBox {
                    cx_px: 0.0,
                    cy_px: 0.0,
                    width_px,
                    height_px: 1.0,
                }),
                None,
            ],
        }
    }

    #[test]
    fn span_and_setback_of_exact_boxes_are_found() {
        let samples: Vec<_> = [1_000.0, 4_000.0, 18_000.0].map(sample).into();
        let fitted = Pinhole::fit(0, &samples.iter().collect::<Vec<_>>()).unwrap();
        assert!(
            (fitted.focal_times_span_px_m - 390_000.0).abs() < 1e-3,
            "{fitted:?}"
        );
        assert!((fitted.setback_m - 1_500.0).abs() < 1e-3, "{fitted:?}");
        let found = predict(&[Some(fitted), None], &sample(7_000.0)).unwrap();
        assert!((found - 7_000.0).abs() < 1e-3, "{found}");
    }

    #[test]
    fn a_few_narrow_boxes_of_something_else_leave_the_formula_as_it_is() {
        let mut samples: Vec<_> = (1..=60).map(|i| sample(300.0 * f64::from(i))).collect();
        for far_off in [3, 20, 40, 55] {
            samples[far_off].boxes[0].as_mut().unwrap().width_px = 3.0;
        }
        let fitted = Pinhole::fit(0, &samples.iter().collect::<Vec<_>>()).unwrap();
        assert!(
            (fitted.focal_times_span_px_m / 390_000.0 - 1.0).abs() < 1e-3
                && (fitted.setback_m / 1_500.0 - 1.0).abs() < 1e-3,
            "{fitted:?}"
        );
    }

    #[test]
    fn a_view_that_saw_too_little_has_no_formula_and_predicts_nothing() {
        let samples = [sample(1_000.0)];
        assert_eq!(Pinhole::fit(1, &samples.iter().collect::<Vec<_>>()), None);
        assert_eq!(Pinhole::fit(0, &samples.iter().collect::<Vec<_>>()), None);
        assert_eq!(predict(&[None, None], &sample(1_000.0)), None);
    }
}
