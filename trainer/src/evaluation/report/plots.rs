//! The plots of the report as SVG.

use plotters::prelude::*;
use report_page::Result;
use report_page::chart::{
    COLOURS, FONT, GRID, INK, LogarithmicAxis, MAX_POINTS, axes, axis, shown_points, svg,
};

use crate::estimators::paper_lstm::calibration_training::CalibrationLogEntry;
use crate::evaluation::metrics::{BoxFigures, DistanceBin, Outcome, quantile};
use crate::run::estimator::Estimator;
use crate::run::trained::Convergence;
use crate::samples::Sample;

/// Maximum numbers along the axis of distances.
const MAX_LABELS: usize = 60;
/// Maximum end of an axis of percentage errors.
const FARTHEST_PCT: f64 = 1_000.0;

/// End of an axis of percentage errors, on either side: the margin times the quantile of a share.
fn reach_pct(mut errors_pct: Vec<f64>, share: f64, least: f64, margin: f64) -> f64 {
    errors_pct.sort_by(f64::total_cmp);
    let typical = quantile(&errors_pct, share).unwrap_or(1.0);
    typical.clamp(least, FARTHEST_PCT) * margin
}

/// True if boxes and points of an estimator are hollow: there are more estimators than colours that everybody can distinguish.
pub(super) fn is_hollow(which: usize) -> bool {
    which >= COLOURS.len()
}

/// Mean errors over distance, on a logarithmic axis. `shown`: the numbers of estimators, each with its bins.
pub(in crate::evaluation) fn best_by_distance(shown: &[(usize, &[DistanceBin])]) -> Result<String> {
    let points = |bins: &[DistanceBin]| -> Vec<(f64, f64)> {
        let middle_nm = |bin: &DistanceBin| f64::midpoint(bin.from_nm, bin.to_nm);
        let bins = bins.iter();
        bins.filter_map(|bin| Some((middle_nm(bin), bin.figures.mape_pct?)))
            .collect()
    };
    let bins = || shown.iter().flat_map(|(_, bins)| bins.iter());
    let first = bins().map(|bin| bin.from_nm).reduce(f64::min);
    let last = bins().map(|bin| bin.to_nm).reduce(f64::max);
    let distances = axis(first.unwrap_or(0.0), last.unwrap_or(1.0));
    let labels = bins().map(|bin| bin.to_nm.round() as usize).max();
    let errors = LogarithmicAxis::over(bins().filter_map(|bin| bin.figures.mape_pct));
    svg(
        "mean error by distance of the best estimators",
        380,
        |area| {
            let mut chart = ChartBuilder::on(area)
                .margin(8)
                .x_label_area_size(44)
                .y_label_area_size(66)
                .build_cartesian_2d(distances, errors)?;
            axes(&mut chart)
                .x_labels(labels.unwrap_or(1).clamp(2, MAX_LABELS))
                .y_labels(24)
                .y_label_formatter(&LogarithmicAxis::number)
                .x_desc("distance to touchdown, NM")
                .y_desc("mean error, % (logarithmic)")
                .draw()?;
            for (which, bins) in shown.iter().rev() {
                let colour = COLOURS[which % COLOURS.len()];
                let points = points(bins);
                chart.draw_series(LineSeries::new(
                    points.iter().copied(),
                    colour.stroke_width(2),
                ))?;
                let inside = if is_hollow(*which) { WHITE } else { colour };
                for style in [inside.filled(), colour.stroke_width(2)] {
                    let circles = points.iter().map(|&point| Circle::new(point, 4, style));
                    chart.draw_series(circles)?;
                }
            }
            Ok(())
        },
    )
}

/// Box plot of the signed percentage error by distance bin and estimator. `shown`: the numbers of estimators, each with its bins.
pub(in crate::evaluation) fn errors_by_distance(
    shown: &[(usize, &[DistanceBin])],
) -> Result<String> {
    let estimators = shown.len();
    let bins = || shown.iter().flat_map(|(_, bins)| bins.iter());
    let width_nm = bins().next().map_or(1.0, |bin| bin.to_nm - bin.from_nm);
    let boxes: Vec<(usize, usize, f64, BoxFigures)> = (shown.iter().enumerate())
        .flat_map(|(slot, (which, bins))| {
            let bins = bins.iter();
            bins.filter_map(move |bin| Some((slot, *which, bin.from_nm, bin.signed?)))
        })
        .collect();
    let first = boxes.iter().map(|b| b.2).reduce(f64::min).unwrap_or(0.0);
    let last = boxes.iter().map(|b| b.2).reduce(f64::max).unwrap_or(0.0) + width_nm;
    let distances = axis(first, last);
    let labels = (((last - first) / width_nm).round() as usize + 1).min(MAX_LABELS);
    let ends = boxes.iter().flat_map(|b| b.3.whiskers_pct).map(f64::abs);
    // Whiskers of the worst estimators must not flatten all boxes: they are cut off at the image's edge.
    let reach = reach_pct(ends.collect(), 0.7, 0.02, 1.15);
    let decimals = if reach < 0.5 { 2 } else { 1 };
    svg("the spread of errors by distance", 430, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .build_cartesian_2d(distances, -reach..reach)?;
        axes(&mut chart)
            .disable_x_mesh()
            .x_labels(labels)
            .y_label_formatter(&|y| format!("{y:+.decimals$}"))
            .x_desc("distance to touchdown, NM")
            .y_desc("percentage error, % (+ = too far)")
            .draw()?;
        chart.draw_series([PathElement::new(
            vec![(first, 0.0), (last, 0.0)],
            INK.mix(0.6),
        )])?;
        let slot_nm = width_nm * 0.84 / estimators.max(1) as f64;
        for (slot, which, from_nm, numbers) in &boxes {
            let colour = COLOURS[which % COLOURS.len()];
            let left = from_nm + width_nm * 0.08 + slot_nm * *slot as f64 + slot_nm * 0.1;
            let right = left + slot_nm * 0.8;
            let middle = (left + right) / 2.0;
            let cut = |y: f64| y.clamp(-reach, reach);
            let [low, median, high] = numbers.quartiles_pct.map(cut);
            let [bottom, top] = numbers.whiskers_pct.map(cut);
            let lines = [
                vec![(middle, bottom), (middle, low)],
                vec![(middle, high), (middle, top)],
                vec![(left, median), (right, median)],
            ];
            let fill = colour.mix(if is_hollow(*which) { 0.0 } else { 0.35 });
            chart.draw_series([
                Rectangle::new([(left, low), (right, high)], fill.filled()),
                Rectangle::new([(left, low), (right, high)], colour.stroke_width(1)),
            ])?;
            chart.draw_series(lines.map(|line| PathElement::new(line, colour.stroke_width(2))))?;
        }
        Ok(())
    })
}

/// A line of the convergence plot.
struct ConvergenceLine {
    name: String,
    validation: Vec<(f64, f64)>,
    training: Vec<(f64, f64)>,
}

/// Errors over the steps of both stages, on the validation side and in the batches.
pub(in crate::evaluation) fn convergence(log: &Convergence) -> Result<String> {
    let of_view = |of: fn(&CalibrationLogEntry) -> &Vec<Option<f64>>, view: usize| {
        let entries = log.calibration.iter();
        entries
            .filter_map(|entry| Some((entry.step as f64, (*of(entry).get(view)?)?)))
            .collect()
    };
    let views = log.views.iter().enumerate();
    let mut lines: Vec<ConvergenceLine> = views
        .map(|(view, name)| ConvergenceLine {
            name: format!("calibration network {name}"),
            validation: of_view(|entry| &entry.validation_mape_pct, view),
            training: of_view(|entry| &entry.training_mape_pct, view),
        })
        .collect();
    let offset = log.calibration.last().map_or(0, |entry| entry.step) as f64;
    let estimator = || log.estimator.iter().map(|e| (offset + e.step as f64, e));
    lines.push(ConvergenceLine {
        name: "distance estimator (stage two)".into(),
        validation: estimator()
            .map(|(step, e)| (step, e.validation_mape_pct))
            .collect(),
        training: estimator()
            .filter_map(|(step, e)| Some((step, e.training_mape_pct?)))
            .collect(),
    });
    let points = || {
        lines
            .iter()
            .flat_map(|line| line.validation.iter().copied())
    };
    let last = points().map(|p| p.0).fold(1.0, f64::max);
    // The first entries, of hardly trained networks, may leave the plot.
    let errors = points().map(|p| p.1).filter(|error| error.is_finite());
    let high = reach_pct(errors.collect(), 0.95, 0.01, 1.2);
    let [steps, errors] = [axis(0.0, last), axis(0.0, high)];
    svg("errors during training", 360, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            // Half of the last label.
            .margin_right(28)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .build_cartesian_2d(steps.clone(), errors.clone())?;
        axes(&mut chart)
            .y_label_formatter(&|y| {
                if *y < 1.0 {
                    format!("{y:.2}")
                } else {
                    format!("{y:.1}")
                }
            })
            .x_desc("training step (mini-batches)")
            .y_desc("MAPE, %")
            .draw()?;
        // Phases in which only some views continue training: a bar along the top in the colour of each of them.
        let phases: Vec<_> = log
            .calibration
            .chunk_by(|a, b| a.optimised == b.optimised)
            .collect();
        let ends = phases.iter().skip(1).map(|next| next[0].step);
        let last_step = log.calibration.last().map_or(0, |entry| entry.step);
        let ended = phases.iter().zip(ends.chain([last_step]));
        for (phase, end) in ended.take(MAX_POINTS) {
            let optimised = &phase[0].optimised;
            if optimised.iter().all(|&optimised| optimised) {
                continue;
            }
            for view in (0..optimised.len()).filter(|&view| optimised[view]) {
                let colour = convergence_colour(view, lines.len());
                let (from, to) = (phase[0].step as f64, end as f64);
                let bar = Rectangle::new([(from, high * 0.94), (to, high)], colour.filled());
                chart.draw_series([bar])?;
            }
        }
        for (which, line) in lines.iter().enumerate() {
            let colour = convergence_colour(which, lines.len());
            let inside =
                |points: &[(f64, f64)]| shown_points(points.iter().copied(), &steps, &errors);
            let of_batches = colour.mix(0.3).stroke_width(1);
            chart.draw_series(LineSeries::new(inside(&line.training), of_batches))?;
            chart
                .draw_series(LineSeries::new(
                    inside(&line.validation),
                    colour.stroke_width(2),
                ))?
                .label(&line.name)
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(3))
                });
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .margin(18)
            .background_style(WHITE.mix(0.85))
            .border_style(GRID)
            .label_font((FONT, 13).into_font().color(&INK))
            .draw()
    })
}

/// Stage two has the colour of `paper_lstm` in all plots; views take the others.
fn convergence_colour(line: usize, lines: usize) -> RGBColor {
    if line + 1 == lines {
        COLOURS[0]
    } else {
        COLOURS[1 + (line * 3) % (COLOURS.len() - 1)]
    }
}

/// One scenario over time: distances above, errors below. `of`: its ticks with the outcomes of an estimator of this number.
pub(super) fn flight<'a>(of: impl Fn(usize) -> Vec<(&'a Sample, Outcome<'a>)>) -> Result<String> {
    // The monoscopic formulas are far off the scale of the two-view methods; two of those are shown.
    let two_view: Vec<_> = Estimator::ALL
        .into_iter()
        .enumerate()
        .filter(|(_, shown)| matches!(shown, Estimator::PaperLstm | Estimator::InverseRange))
        .map(|(which, shown)| (which, shown, of(which)))
        .collect();
    let ticks = || two_view.iter().take(1).flat_map(|(.., ticks)| ticks);
    let time_s = |sample: &Sample| sample.time_ns as f64 / 1e9;
    let nm = |metres: f64| metres / dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
    let times = || ticks().map(|(sample, _)| time_s(sample));
    let times_s = axis(
        times().reduce(f64::min).unwrap_or(0.0),
        times().reduce(f64::max).unwrap_or(1.0),
    );
    let farthest = ticks()
        .map(|(sample, _)| nm(sample.dtd_m))
        .fold(0.0, f64::max);
    let distances_nm = axis(0.0, farthest * 1.05);
    let errors = two_view.iter().flat_map(|(.., ticks)| {
        let errors = ticks.iter().map(|(_, outcome)| outcome.signed_error_pct());
        errors.flatten().map(f64::abs)
    });
    let reach = reach_pct(errors.collect(), 0.98, 0.05, 1.2);
    let errors_pct = -reach..reach;
    svg("distances and errors of a held-out flight", 560, |area| {
        let (above, below) = area.split_vertically(300);
        let mut distances = ChartBuilder::on(&above)
            .margin(8)
            .x_label_area_size(24)
            .y_label_area_size(58)
            .build_cartesian_2d(times_s.clone(), distances_nm.clone())?;
        axes(&mut distances)
            .y_label_formatter(&|y| format!("{y:.0}"))
            .y_desc("distance to touchdown, NM")
            .draw()?;
        let truth = ticks().map(|(sample, _)| (time_s(sample), nm(sample.dtd_m)));
        let truth = shown_points(truth, &times_s, &distances_nm);
        distances
            .draw_series(LineSeries::new(truth, INK.stroke_width(1)))?
            .label("true")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], INK.stroke_width(2)));
        for (which, shown, ticks) in &two_view {
            let colour = COLOURS[which % COLOURS.len()];
            let points = ticks
                .iter()
                .filter_map(|(sample, outcome)| Some((time_s(sample), nm(outcome.predicted_m?))));
            let points = shown_points(points, &times_s, &distances_nm).into_iter();
            distances
                .draw_series(points.map(|point| Circle::new(point, 2, colour.filled())))?
                .label(shown.name())
                .legend(move |(x, y)| Circle::new((x + 9, y), 3, colour.filled()));
        }
        distances
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(GRID)
            .label_font((FONT, 13).into_font().color(&INK))
            .draw()?;
        let mut errors = ChartBuilder::on(&below)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .build_cartesian_2d(times_s.clone(), errors_pct.clone())?;
        axes(&mut errors)
            .y_label_formatter(&|y| format!("{y:+.1}"))
            .x_desc("time since the start of the scenario, s")
            .y_desc("percentage error, %")
            .draw()?;
        errors.draw_series([PathElement::new(
            vec![(times_s.start, 0.0), (times_s.end, 0.0)],
            INK.mix(0.6),
        )])?;
        for (which, _, ticks) in two_view.iter().rev() {
            let colour = COLOURS[which % COLOURS.len()];
            let points = ticks.iter().filter_map(|(sample, outcome)| {
                Some((time_s(sample), outcome.signed_error_pct()?))
            });
            let points = shown_points(points, &times_s, &errors_pct).into_iter();
            errors
                .draw_series(points.map(|point| Circle::new(point, 2, colour.mix(0.8).filled())))?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::paper_lstm::EstimatorLogEntry;
    use crate::evaluation::metrics::{EstimatorMetrics, WithoutViews};
    use crate::evaluation::rules::EvaluationRules;

    /// A plot of extreme values must still open: finite numbers, and not too many of them.
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
                let without = WithoutViews::default();
                let metrics = EstimatorMetrics::of(&outcomes, &common, without, &rules);
                let bins = &metrics.by_distance_nm[..];
                let shown: Vec<_> = (0..Estimator::ALL.len())
                    .map(|which| (which, bins))
                    .collect();
                assert_sound(&errors_by_distance(&shown).unwrap());
                assert_sound(&best_by_distance(&[(0, bins), (7, bins)]).unwrap());
                let of = |_| samples.iter().zip(outcomes.iter().copied()).collect();
                assert_sound(&flight(of).unwrap());
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
        assert_sound(&flight(of).unwrap());
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
        assert_sound(&convergence(&log).unwrap());
    }
}
