//! Monoscopic baseline as a formula: an aircraft of known size looks smaller the farther away it is.
//!
//! `range = k S / w` with focal length k, span S and box width w. The camera is not at the touchdown target, so the distance to
//! touchdown is that range minus a constant. Both `k S` and the constant are fitted per view on the training side: a detector's box
//! is not exactly as wide as the span.
//!
//! The noise is in the width, and false boxes make it wrong by any factor. So the fit compares widths, as ratios: the setback minimises
//! the scatter of `width * range` about its median, in mean absolute logarithm, and that median is `k S`. A few outliers hardly move a
//! median; under least squares of the predicted distance, with the width as a divisor, a single tiny box outweighs a thousand.

use dataset::numbers::spread::median;
use onnx_graph::proto::DOUBLE;
use serde::{Deserialize, Serialize};

use crate::estimators::MAX_SETBACK_M;
use crate::estimators::minimum::Search;
use crate::networks::estimator_graph::{BOXES, EstimatorGraph};
use crate::samples::{Observation, Sample};

/// Fitted formula: `dtd = focal_times_span / width - setback`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Pinhole {
    /// k S, pixel metres.
    pub focal_times_span_px_m: f64,
    /// Distance of the camera behind the touchdown target, metres.
    pub setback_m: f64,
}

impl Pinhole {
    /// Fits a view; `None` without boxes at two or more distances.
    pub(crate) fn fit(view: usize, training: &[&Sample]) -> Option<Self> {
        let seen: Vec<Seen> = training
            .iter()
            .filter_map(|sample| {
                let seen = sample.best(view).filter(|b| b.width_px > 0.0)?;
                Some(Seen {
                    width_px: seen.width_px,
                    dtd_m: sample.dtd_m,
                })
            })
            .collect();
        let nearest_m = seen.iter().map(|s| s.dtd_m).reduce(f64::min)?;
        let farthest_m = seen.iter().map(|s| s.dtd_m).reduce(f64::max)?;
        if nearest_m >= farthest_m {
            return None;
        }
        // The camera is behind the nearest position, and not farther behind the target than an approach is long.
        let search = Search {
            from: -nearest_m,
            to: farthest_m.max(MAX_SETBACK_M),
            parts: 40,
            rounds: 10,
        };
        let setback_m = search.lowest(|setback_m| scatter(&seen, setback_m));
        Some(Self {
            focal_times_span_px_m: log_median(&seen, setback_m).exp(),
            setback_m,
        })
    }

    /// Distance to touchdown from the box width, metres.
    pub(crate) fn dtd_m(&self, width_px: f64) -> f64 {
        self.focal_times_span_px_m / width_px - self.setback_m
    }
}

/// Training box.
struct Seen {
    width_px: f64,
    dtd_m: f64,
}

impl Seen {
    /// Logarithm of width times range, which equals the logarithm of k S if the setback is right.
    fn log_width_times_range(&self, setback_m: f64) -> f64 {
        (self.width_px * (self.dtd_m + setback_m)).ln()
    }
}

fn log_median(seen: &[Seen], setback_m: f64) -> f64 {
    let mut logs: Vec<f64> = seen
        .iter()
        .map(|s| s.log_width_times_range(setback_m))
        .collect();
    median(&mut logs)
}

/// Mean absolute deviation of the logarithms from their median.
fn scatter(seen: &[Seen], setback_m: f64) -> f64 {
    let median = log_median(seen, setback_m);
    let apart = |s: &Seen| (s.log_width_times_range(setback_m) - median).abs();
    seen.iter().map(apart).sum::<f64>() / seen.len() as f64
}

/// Mean over the views that saw the sample and were fitted, metres.
pub(crate) fn predict(pinholes: &[Option<Pinhole>], observed: &Observation) -> Option<f64> {
    let distances: Vec<f64> = pinholes
        .iter()
        .enumerate()
        .filter_map(|(view, pinhole)| {
            let seen = observed.best(view).filter(|b| b.width_px > 0.0)?;
            Some(pinhole.as_ref()?.dtd_m(seen.width_px))
        })
        .collect();
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64)
}

/// Adds the mean over the views to an ONNX graph, metres.
pub(crate) fn to_onnx(pinholes: &[Option<Pinhole>], graph: &mut EstimatorGraph) -> String {
    /// Column of the box width.
    const WIDTH: usize = 2;
    let (nothing, none) = (graph.graph.double(0.0), graph.graph.double(f64::NAN));
    // Both sums start at 0, so that they exist even without pinholes; a count of 0 means no answer.
    let (mut distances, mut counts) = (vec![nothing.clone()], vec![nothing.clone()]);
    for (view, pinhole) in pinholes.iter().enumerate() {
        let Some(pinhole) = pinhole else { continue };
        let seen_box = graph.of_view(BOXES, view);
        let width = graph.some_of(&seen_box, [WIDTH].into_iter());
        let seen = graph.seen_by(view);
        let wide = graph.graph.plain("Greater", &[&width, &nothing]);
        let counts_here = graph.graph.plain("And", &[&seen, &wide]);
        let focal_times_span = graph.graph.double(pinhole.focal_times_span_px_m);
        let setback = graph.graph.double(pinhole.setback_m);
        let range = graph.graph.plain("Div", &[&focal_times_span, &width]);
        let distance = graph.graph.plain("Sub", &[&range, &setback]);
        let here = [counts_here.as_str(), &distance, &nothing];
        distances.push(graph.graph.plain("Where", &here));
        counts.push(graph.graph.cast(&counts_here, DOUBLE));
    }
    let [mean, count] = graph.mean_and_count(&distances, &counts);
    let any = graph.graph.plain("Greater", &[&count, &nothing]);
    graph.graph.plain("Where", &[&any, &mean, &none])
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::tables::pixel_box::PixelBox;

    fn sample(dtd_m: f64) -> Sample {
        let width_px = 390_000.0 / (dtd_m + 1_500.0);
        let seen = PixelBox {
            cx_px: 0.0,
            cy_px: 0.0,
            width_px,
            height_px: 1.0,
        };
        Sample::of_boxes(dtd_m, vec![Some(seen), None])
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
    fn a_few_narrow_and_wide_boxes_of_something_else_leave_the_formula_as_it_is() {
        let mut samples: Vec<_> = (1..=60).map(|i| sample(300.0 * f64::from(i))).collect();
        for (far_off, width_px) in [(3, 3.0), (20, 4.0), (40, 900.0), (55, 3.0)] {
            samples[far_off].observed.best_mut(0).unwrap().width_px = width_px;
        }
        let fitted = Pinhole::fit(0, &samples.iter().collect::<Vec<_>>()).unwrap();
        assert!(
            (fitted.focal_times_span_px_m / 390_000.0 - 1.0).abs() < 1e-6
                && (fitted.setback_m / 1_500.0 - 1.0).abs() < 1e-6,
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
