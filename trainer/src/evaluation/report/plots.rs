//! The plots of the report as SVG.

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use report_page::chart::{Axis, INK, MAX_POINTS, Panel, Stroke, colour, is_hollow, svg};

use crate::estimators::paper_lstm::calibration_training::CalibrationLogEntry;
use crate::evaluation::metrics::{BoxFigures, DistanceBin, Outcome, quantile};
use crate::run::estimator::Estimator;
use crate::run::trained::Convergence;
use crate::samples::Sample;

/// Maximum error on an axis, %.
const MAX_ERROR_PCT: f64 = 1_000.0;
const DISTANCE: &str = "distance to touchdown, NM";

/// Error at the end of an axis: the margin times the quantile of a share.
fn reach_pct(mut errors_pct: Vec<f64>, share: f64, least: f64, margin: f64) -> f64 {
    errors_pct.sort_by(f64::total_cmp);
    let typical = quantile(&errors_pct, share).unwrap_or(1.0);
    typical.clamp(least, MAX_ERROR_PCT) * margin
}

/// Axis of the distances of all bins.
fn distances(shown: &[(usize, &[DistanceBin])]) -> Axis {
    let bins = || shown.iter().flat_map(|(_, bins)| bins.iter());
    let first = bins().map(|bin| bin.from_nm).reduce(f64::min);
    let last = bins().map(|bin| bin.to_nm).reduce(f64::max);
    Axis::linear(DISTANCE, first.unwrap_or(0.0), last.unwrap_or(1.0))
}

/// Mean errors over distance, on a logarithmic axis. `shown`: the numbers of estimators, each with its bins.
pub(in crate::evaluation) fn best_by_distance(shown: &[(usize, &[DistanceBin])]) -> String {
    let bins = shown.iter().flat_map(|(_, bins)| bins.iter());
    let errors = bins.filter_map(|bin| bin.figures.mape_pct);
    let errors = Axis::logarithmic("mean error, % (logarithmic)", errors);
    let mut panel = Panel::new(380, distances(shown), errors);
    for (which, bins) in shown.iter().rev() {
        let points = || {
            let middle_nm = |bin: &DistanceBin| f64::midpoint(bin.from_nm, bin.to_nm);
            let bins = bins.iter();
            bins.filter_map(move |bin| Some((middle_nm(bin), bin.figures.mape_pct?)))
        };
        panel.line(points(), Stroke::new(colour(*which), 2));
        panel.dots(points(), 4, colour(*which), is_hollow(*which));
    }
    svg("mean error by distance of the best estimators", &[panel])
}

/// Box plot of the signed percentage error by distance bin and estimator. `shown`: the numbers of estimators, each with its bins.
pub(in crate::evaluation) fn errors_by_distance(shown: &[(usize, &[DistanceBin])]) -> String {
    let bins = || shown.iter().flat_map(|(_, bins)| bins.iter());
    let width_nm = bins().next().map_or(1.0, |bin| bin.to_nm - bin.from_nm);
    let ends = bins()
        .filter_map(|bin| bin.signed)
        .flat_map(|of| of.whiskers_pct);
    // Whiskers of the worst estimators must not flatten all boxes: they are cut off at the image's edge.
    let reach = reach_pct(ends.map(f64::abs).collect(), 0.7, 0.02, 1.15);
    let distances = distances(shown);
    let zero = [distances.start(), distances.end()].map(|nm| (nm, 0.0));
    let errors = Axis::errors("percentage error, % (+ = too far)", reach);
    let mut panel = Panel::new(430, distances, errors);
    panel.line(zero, Stroke::new(INK, 1).faint(0.6));
    let slot_nm = width_nm * 0.84 / shown.len().max(1) as f64;
    for (slot, (which, bins)) in shown.iter().enumerate() {
        let colour = colour(*which);
        let stroke = Stroke::new(colour, 2);
        let filled = if is_hollow(*which) { 0.0 } else { 0.35 };
        for (from_nm, numbers) in bins
            .iter()
            .filter_map(|bin| Some((bin.from_nm, bin.signed?)))
        {
            let left = from_nm + width_nm * 0.08 + slot_nm * (slot as f64 + 0.1);
            let right = left + slot_nm * 0.8;
            let middle = f64::midpoint(left, right);
            let BoxFigures {
                quartiles_pct,
                whiskers_pct,
                ..
            } = numbers;
            let cut = |y: f64| y.clamp(-reach, reach);
            let [low, median, high] = quartiles_pct.map(cut);
            let [bottom, top] = whiskers_pct.map(cut);
            panel.rectangle([(left, low), (right, high)], colour, filled);
            panel.line([(middle, bottom), (middle, low)], stroke);
            panel.line([(middle, high), (middle, top)], stroke);
            panel.line([(left, median), (right, median)], stroke);
        }
    }
    svg("the spread of errors by distance", &[panel])
}

/// A line of the convergence plot.
struct ConvergenceLine {
    name: String,
    colour: &'static str,
    validation: Vec<(f64, f64)>,
    training: Vec<(f64, f64)>,
}

/// The calibration network of each view, then stage two, which has the colour of `paper_lstm` in all plots.
fn convergence_lines(log: &Convergence) -> Vec<ConvergenceLine> {
    let of_view = |of: fn(&CalibrationLogEntry) -> &Vec<Option<f64>>, view: usize| {
        let entries = log.calibration.iter();
        let points =
            entries.filter_map(|entry| Some((entry.step as f64, (*of(entry).get(view)?)?)));
        points.collect()
    };
    let views = log.views.iter().enumerate();
    let views = views.map(|(view, name)| ConvergenceLine {
        name: format!("calibration network {name}"),
        colour: colour(1 + (view * 3) % 5),
        validation: of_view(|entry| &entry.validation_mape_pct, view),
        training: of_view(|entry| &entry.training_mape_pct, view),
    });
    let offset = log.calibration.last().map_or(0, |entry| entry.step) as f64;
    let estimator = || log.estimator.iter().map(|e| (offset + e.step as f64, e));
    let validation = estimator().map(|(step, e)| (step, e.validation_mape_pct));
    let training = estimator().filter_map(|(step, e)| Some((step, e.training_mape_pct?)));
    let stage_two = ConvergenceLine {
        name: "distance estimator (stage two)".into(),
        colour: colour(0),
        validation: validation.collect(),
        training: training.collect(),
    };
    views.chain([stage_two]).collect()
}

/// Errors over the steps of both stages, on the validation side and in the batches.
pub(in crate::evaluation) fn convergence(log: &Convergence) -> String {
    let lines = convergence_lines(log);
    let points = || {
        lines
            .iter()
            .flat_map(|line| line.validation.iter().copied())
    };
    let last = points().map(|point| point.0).fold(1.0, f64::max);
    // The first entries, of hardly trained networks, may leave the plot.
    let errors = points()
        .map(|point| point.1)
        .filter(|error| error.is_finite());
    let high = reach_pct(errors.collect(), 0.95, 0.01, 1.2);
    let steps = Axis::linear("training step (mini-batches)", 0.0, last);
    let mut panel = Panel::new(360, steps, Axis::linear("MAPE, %", 0.0, high));
    // A bar along the top marks phases in which only some views continue training, in their colours.
    let phases = log.calibration.chunk_by(|a, b| a.optimised == b.optimised);
    let phases: Vec<_> = phases.collect();
    let ends = phases.iter().skip(1).map(|next| next[0].step);
    let last_step = log.calibration.last().map_or(0, |entry| entry.step);
    let ended = phases.iter().zip(ends.chain([last_step]));
    for (phase, end) in ended.take(MAX_POINTS) {
        let optimised = &phase[0].optimised;
        if optimised.iter().all(|&optimised| optimised) {
            continue;
        }
        for (line, _) in lines
            .iter()
            .zip(optimised)
            .filter(|(_, optimised)| **optimised)
        {
            let corners = [(phase[0].step as f64, high * 0.94), (end as f64, high)];
            panel.rectangle(corners, line.colour, 1.0);
        }
    }
    for line in &lines {
        let stroke = Stroke::new(line.colour, 2);
        let of_batches = Stroke::new(line.colour, 1).faint(0.3);
        panel.line(line.training.iter().copied(), of_batches);
        panel.line(line.validation.iter().copied(), stroke);
        panel.name_line(&line.name, stroke);
    }
    svg("errors during training", &[panel])
}

/// A scenario over time: distances above, errors below. `of` returns its ticks with an estimator's outcomes.
pub(super) fn flight<'a>(of: impl Fn(usize) -> Vec<(&'a Sample, Outcome<'a>)>) -> String {
    // The monoscopic formulas are far off the scale of the two-view methods; two of those are shown.
    let two_view: Vec<_> = (Estimator::ALL.into_iter().enumerate())
        .filter(|(_, shown)| matches!(shown, Estimator::PaperLstm | Estimator::InverseRange))
        .map(|(which, shown)| (colour(which), shown, of(which)))
        .collect();
    let ticks = || two_view.iter().take(1).flat_map(|(.., ticks)| ticks);
    let time_s = |sample: &Sample| sample.time_ns as f64 / 1e9;
    let nm = |metres: f64| metres / METERS_PER_NAUTICAL_MILE;
    let times = || ticks().map(|(sample, _)| time_s(sample));
    let (first, last) = (times().reduce(f64::min), times().reduce(f64::max));
    let times_s = |title| Axis::linear(title, first.unwrap_or(0.0), last.unwrap_or(1.0));
    let truth = || ticks().map(|(sample, _)| (time_s(sample), nm(sample.dtd_m)));
    let farthest = truth().map(|point| point.1).fold(0.0, f64::max);
    let errors = two_view.iter().flat_map(|(.., ticks)| {
        let errors = ticks.iter().map(|(_, outcome)| outcome.signed_error_pct());
        errors.flatten().map(f64::abs)
    });
    let reach = reach_pct(errors.collect(), 0.98, 0.05, 1.2);

    let distances = Axis::linear(DISTANCE, 0.0, farthest * 1.05);
    let mut above = Panel::new(300, times_s(""), distances);
    above.line(truth(), Stroke::new(INK, 1));
    above.name_line("true", Stroke::new(INK, 2));
    let below = times_s("time since the start of the scenario, s");
    let zero = [below.start(), below.end()].map(|time| (time, 0.0));
    let mut below = Panel::new(260, below, Axis::errors("percentage error, %", reach));
    below.line(zero, Stroke::new(INK, 1).faint(0.6));
    for (colour, shown, ticks) in &two_view {
        let answers = ticks.iter();
        let answers = answers
            .filter_map(|(sample, outcome)| Some((time_s(sample), nm(outcome.predicted_m?))));
        above.dots(answers, 2, colour, false);
        above.name_dots(shown.name(), colour);
    }
    for (colour, _, ticks) in two_view.iter().rev() {
        let errors = ticks.iter();
        let errors = errors
            .filter_map(|(sample, outcome)| Some((time_s(sample), outcome.signed_error_pct()?)));
        below.dots(errors, 2, colour, false);
    }
    svg("distances and errors of a held-out flight", &[above, below])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::paper_lstm::EstimatorLogEntry;
    use crate::evaluation::metrics::EstimatorMetrics;
    use crate::evaluation::rules::EvaluationRules;

    /// A plot with extreme values must still open: finite numbers, and not too many.
    fn assert_sound(svg: &str) {
        assert!(svg.ends_with("</svg>\n"), "{}", &svg[svg.len() - 40..]);
        assert!(svg.len() < 2_000_000, "{} bytes", svg.len());
        for none in ["NaN", "inf"] {
            assert!(!svg.contains(none), "{none} in {svg}");
        }
    }

    fn outcome(dtd_m: f64, predicted_m: Option<f64>) -> Outcome<'static> {
        Outcome::of_answer(dtd_m, predicted_m)
    }

    fn sample(time_ns: i64, dtd_m: f64) -> Sample {
        let mut sample = Sample::of_boxes(dtd_m, vec![None]);
        sample.observed.time_ns = time_ns;
        sample
    }

    #[test]
    fn absurd_answers_distances_and_times_make_plots_that_end() {
        let ticks = [
            (0, 2_000.0),
            (i64::MAX, 2.0e7),
            (i64::MIN, 1e-9),
            (1, 18_520.0),
        ];
        let answers = [
            1e308,
            -1e308,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
            0.0,
            1e-308,
        ];
        for ticks in [&ticks[..], &ticks[..1], &[]] {
            let samples: Vec<_> = ticks.iter().map(|t| sample(t.0, t.1)).collect();
            for answer in answers {
                let outcomes: Vec<_> = ticks.iter().map(|t| outcome(t.1, Some(answer))).collect();
                let rules = EvaluationRules::current();
                let common = vec![true; outcomes.len()];
                let removed = std::collections::BTreeMap::new();
                let metrics = EstimatorMetrics::of(&outcomes, &common, removed, &rules);
                let bins = &metrics.by_distance_nm[..];
                let shown: Vec<_> = (0..Estimator::ALL.len())
                    .map(|which| (which, bins))
                    .collect();
                assert_sound(&errors_by_distance(&shown));
                assert_sound(&best_by_distance(&[(0, bins), (7, bins)]));
                let of = |_| samples.iter().zip(outcomes.iter().copied()).collect();
                assert_sound(&flight(of));
            }
        }
    }

    #[test]
    fn a_long_flight_and_a_long_training_are_thinned_out() {
        let samples: Vec<_> = (0..100_000)
            .map(|tick| sample(tick * 1_000_000, 20_000.0 - tick as f64 / 10.0))
            .collect();
        let of = |_| {
            let answer = |sample: &Sample| outcome(sample.dtd_m, Some(sample.dtd_m * 1.01));
            samples
                .iter()
                .map(|sample| (sample, answer(sample)))
                .collect()
        };
        assert_sound(&flight(of));
        let log = Convergence {
            views: vec!["left".into(), "right".into()],
            calibration: (0..100_000)
                .map(|step| CalibrationLogEntry {
                    step,
                    training_loss: None,
                    training_mape_pct: vec![Some(1e308), None],
                    validation_mape_pct: vec![Some(if step == 7 { 1e308 } else { 2.0 })],
                    optimised: vec![step % 2 == 0, true],
                })
                .collect(),
            estimator: (0..100_000)
                .map(|step| EstimatorLogEntry {
                    step,
                    training_loss: Some(1.0),
                    training_mape_pct: Some(1.0),
                    validation_mape_pct: 0.0,
                })
                .collect(),
            calibration_kept_step: 99_999,
            estimator_kept_step: 99_999,
        };
        assert_sound(&convergence(&log));
    }
}
