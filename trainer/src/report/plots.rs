//! The plots of the report as SVG.

use plotters::prelude::*;

use super::Shown;
use crate::error::{Error, Result};
use crate::metrics::distance_bins;
use crate::run_folder::Convergence;
use crate::samples::Sample;

const WIDTH: u32 = 960;
/// One colour per estimator, in their order; distinguishable with colour-blind eyes (Okabe and Ito).
const COLOURS: [RGBColor; 5] = [
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(213, 94, 0),
];
const GRID: RGBColor = RGBColor(226, 229, 233);
const INK: RGBColor = RGBColor(55, 60, 67);
const FONT: &str = "sans-serif";

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

/// Runs `draw` on an empty SVG of this height.
fn svg(what: &'static str, height: u32, draw: impl FnOnce(&Area) -> Drawn) -> Result<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
        draw(&area)
            .and_then(|()| area.present().map_err(|error| error.to_string()))
            .map_err(|message| Error::Report { what, message })?;
    }
    // A width in the file would keep the page from scaling the picture.
    Ok(text.replacen(&format!("width=\"{WIDTH}\" height=\"{height}\" "), "", 1))
}

type Drawn = std::result::Result<(), String>;

fn words(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// Quartiles and whiskers of a box.
struct FiveNumbers {
    quartiles: [f64; 3],
    whiskers: [f64; 2],
}

impl FiveNumbers {
    /// Whiskers reach to the last value within 1.5 box lengths; `None` without values.
    fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let (first, last) = (*values.first()?, *values.last()?);
        let quartiles = [0.25, 0.5, 0.75].map(|part| {
            let place = part * (values.len() - 1) as f64;
            let (below, above) = (
                values[place.floor() as usize],
                values[place.ceil() as usize],
            );
            below + (above - below) * place.fract()
        });
        let reach = 1.5 * (quartiles[2] - quartiles[0]);
        let low = values
            .iter()
            .copied()
            .find(|&v| v >= quartiles[0] - reach)
            .unwrap_or(first);
        let high = values
            .iter()
            .copied()
            .rev()
            .find(|&v| v <= quartiles[2] + reach)
            .unwrap_or(last);
        Some(Self {
            quartiles,
            whiskers: [low, high],
        })
    }
}

/// Box plot of the signed percentage error by distance bin and estimator.
pub(super) fn errors_by_distance(shown: &[Shown], bin_nm: f64) -> Result<String> {
    let mut boxes = Vec::new();
    for (which, estimator) in shown.iter().enumerate() {
        for ([from_nm, _], inside) in distance_bins(&estimator.outcomes, bin_nm) {
            let errors = inside
                .iter()
                .filter_map(|outcome| outcome.signed_error_pct())
                .collect();
            if let Some(numbers) = FiveNumbers::of(errors) {
                boxes.push((which, from_nm, numbers));
            }
        }
    }
    // Where no estimator answered there is no box, and an axis without ends would be drawn for ever.
    let first = boxes.iter().map(|b| b.1).reduce(f64::min).unwrap_or(0.0);
    let last = boxes.iter().map(|b| b.1).reduce(f64::max).unwrap_or(0.0) + bin_nm;
    let mut ends: Vec<f64> = boxes
        .iter()
        .flat_map(|b| b.2.whiskers)
        .map(f64::abs)
        .collect();
    ends.sort_by(f64::total_cmp);
    // One wild whisker must not flatten all boxes: it is cut off at the picture's edge.
    let reach = ends
        .get(ends.len().saturating_mul(9) / 10)
        .copied()
        .unwrap_or(1.0)
        .max(0.1)
        * 1.15;
    svg("the box plot", 430, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .build_cartesian_2d(first..last, -reach..reach)
            .map_err(words)?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .axis_style(INK)
            .x_labels(((last - first) / bin_nm).round() as usize + 1)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| format!("{y:+.1}"))
            .x_desc("distance to touchdown, NM")
            .y_desc("percentage error, % (+ = too far)")
            .label_style((FONT, 13).into_font().color(&INK))
            .axis_desc_style((FONT, 14).into_font().color(&INK))
            .draw()
            .map_err(words)?;
        chart
            .draw_series([PathElement::new(
                vec![(first, 0.0), (last, 0.0)],
                INK.mix(0.6),
            )])
            .map_err(words)?;
        let slot = bin_nm * 0.84 / shown.len().max(1) as f64;
        for (which, from_nm, numbers) in &boxes {
            let colour = COLOURS[which % COLOURS.len()];
            let left = from_nm + bin_nm * 0.08 + slot * *which as f64 + slot * 0.1;
            let right = left + slot * 0.8;
            let middle = (left + right) / 2.0;
            let cut = |y: f64| y.clamp(-reach, reach);
            let [low, median, high] = numbers.quartiles.map(cut);
            let [bottom, top] = numbers.whiskers.map(cut);
            let lines = [
                vec![(middle, bottom), (middle, low)],
                vec![(middle, high), (middle, top)],
                vec![(left, median), (right, median)],
            ];
            chart
                .draw_series([
                    Rectangle::new([(left, low), (right, high)], colour.mix(0.35).filled()),
                    Rectangle::new([(left, low), (right, high)], colour.stroke_width(1)),
                ])
                .map_err(words)?;
            chart
                .draw_series(lines.map(|line| PathElement::new(line, colour.stroke_width(2))))
                .map_err(words)?;
        }
        Ok(())
    })
}

/// Validation error over the steps of both stages.
pub(super) fn convergence(log: &Convergence) -> Result<String> {
    let mut lines: Vec<(String, Vec<(f64, f64)>)> = log
        .views
        .iter()
        .enumerate()
        .map(|(view, name)| {
            let points = log
                .calibration
                .iter()
                .filter_map(|e| Some((e.step as f64, e.validation_mape_pct[view]?)));
            (format!("calibration network {name}"), points.collect())
        })
        .collect();
    let offset = log.calibration.last().map_or(0, |entry| entry.step) as f64;
    let estimator = log
        .estimator
        .iter()
        .map(|e| (offset + e.step as f64, e.validation_mape_pct))
        .collect();
    lines.push(("distance estimator (stage two)".into(), estimator));
    let points = || lines.iter().flat_map(|(_, points)| points.iter().copied());
    let last = points().map(|p| p.0).fold(1.0, f64::max);
    // The first entries are those of hardly trained networks: they may leave the picture.
    let mut errors: Vec<f64> = points().map(|p| p.1).collect();
    errors.sort_by(f64::total_cmp);
    let high = errors.get(errors.len() * 19 / 20).copied().unwrap_or(1.0) * 1.2;
    svg("the convergence plot", 360, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .build_cartesian_2d(0.0..last, 0.0..high)
            .map_err(words)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .axis_style(INK)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| {
                if *y < 1.0 {
                    format!("{y:.2}")
                } else {
                    format!("{y:.1}")
                }
            })
            .x_desc("training step (mini-batches)")
            .y_desc("validation MAPE, %")
            .label_style((FONT, 13).into_font().color(&INK))
            .axis_desc_style((FONT, 14).into_font().color(&INK))
            .draw()
            .map_err(words)?;
        // Where only some views train on: a bar along the top in the colour of each view that does.
        for pair in log.calibration.windows(2) {
            let (from, to) = (pair[0].step as f64, pair[1].step as f64);
            if pair[0].optimised.iter().all(|&optimised| optimised) {
                continue;
            }
            for (view, _) in pair[0]
                .optimised
                .iter()
                .enumerate()
                .filter(|(_, optimised)| **optimised)
            {
                let colour = convergence_colour(view, lines.len());
                let bar = Rectangle::new([(from, high * 0.94), (to, high)], colour.filled());
                chart.draw_series([bar]).map_err(words)?;
            }
        }
        for (which, (name, points)) in lines.iter().enumerate() {
            let colour = convergence_colour(which, lines.len());
            chart
                .draw_series(LineSeries::new(
                    points.iter().copied(),
                    colour.stroke_width(2),
                ))
                .map_err(words)?
                .label(name)
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
            .map_err(words)
    })
}

/// Stage two has the colour that `paper_lstm` has everywhere; views take the others.
fn convergence_colour(line: usize, lines: usize) -> RGBColor {
    if line + 1 == lines {
        COLOURS[0]
    } else {
        COLOURS[1 + (line * 3) % (COLOURS.len() - 1)]
    }
}

/// One scenario over time: distances above, errors below.
pub(super) fn flight(shown: &[Shown], test: &[&Sample], scenario: usize) -> Result<String> {
    let rows: Vec<usize> = (0..test.len())
        .filter(|&row| test[row].scenario == scenario)
        .collect();
    let time_s = |row: usize| test[row].time_ns as f64 / 1e9;
    let nm = |metres: f64| metres / dataset::units::METERS_PER_NAUTICAL_MILE;
    let (from, to) = (
        rows.first().map_or(0.0, |&r| time_s(r)),
        rows.last().map_or(1.0, |&r| time_s(r)),
    );
    let farthest = rows
        .iter()
        .map(|&row| nm(test[row].dtd_m))
        .fold(0.0, f64::max)
        * 1.05;
    // The monoscopic formulas are far off the scale that the two-view methods need; two are shown.
    let two_view: Vec<(usize, &Shown)> = shown
        .iter()
        .enumerate()
        .filter(|(_, s)| ["paper_lstm", "triangulation"].contains(&s.description.name))
        .collect();
    let mut errors: Vec<f64> = two_view
        .iter()
        .flat_map(|(_, s)| {
            rows.iter()
                .filter_map(|&row| s.outcomes[row].signed_error_pct().map(f64::abs))
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let reach = errors
        .get(errors.len() * 98 / 100)
        .copied()
        .unwrap_or(1.0)
        .max(0.05)
        * 1.2;
    svg("the plot of a flight", 560, |area| {
        let (above, below) = area.split_vertically(300);
        let mut distances = ChartBuilder::on(&above)
            .margin(8)
            .x_label_area_size(24)
            .y_label_area_size(58)
            .build_cartesian_2d(from..to, 0.0..farthest)
            .map_err(words)?;
        distances
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .axis_style(INK)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| format!("{y:.0}"))
            .y_desc("distance to touchdown, NM")
            .label_style((FONT, 13).into_font().color(&INK))
            .axis_desc_style((FONT, 14).into_font().color(&INK))
            .draw()
            .map_err(words)?;
        let truth = rows.iter().map(|&row| (time_s(row), nm(test[row].dtd_m)));
        distances
            .draw_series(LineSeries::new(truth, INK.stroke_width(1)))
            .map_err(words)?
            .label("true")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], INK.stroke_width(2)));
        for &(which, estimator) in &two_view {
            let colour = COLOURS[which % COLOURS.len()];
            let points = rows
                .iter()
                .filter_map(|&row| Some((time_s(row), nm(estimator.outcomes[row].predicted_m?))));
            distances
                .draw_series(points.map(|point| Circle::new(point, 2, colour.filled())))
                .map_err(words)?
                .label(estimator.description.title)
                .legend(move |(x, y)| Circle::new((x + 9, y), 3, colour.filled()));
        }
        distances
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(GRID)
            .label_font((FONT, 13).into_font().color(&INK))
            .draw()
            .map_err(words)?;
        let mut errors = ChartBuilder::on(&below)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .build_cartesian_2d(from..to, -reach..reach)
            .map_err(words)?;
        errors
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .axis_style(INK)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| format!("{y:+.1}"))
            .x_desc("time since the start of the scenario, s")
            .y_desc("percentage error, %")
            .label_style((FONT, 13).into_font().color(&INK))
            .axis_desc_style((FONT, 14).into_font().color(&INK))
            .draw()
            .map_err(words)?;
        errors
            .draw_series([PathElement::new(vec![(from, 0.0), (to, 0.0)], INK.mix(0.6))])
            .map_err(words)?;
        for &(which, estimator) in two_view.iter().rev() {
            let colour = COLOURS[which % COLOURS.len()];
            let points = rows.iter().filter_map(|&row| {
                Some((time_s(row), estimator.outcomes[row].signed_error_pct()?))
            });
            let points = points.filter(|point| point.1.abs() <= reach);
            errors
                .draw_series(points.map(|point| Circle::new(point, 2, colour.mix(0.8).filled())))
                .map_err(words)?;
        }
        Ok(())
    })
}

/// The colour of an estimator as CSS, for legends outside the plots.
pub(super) fn css_colour(which: usize) -> String {
    let RGBColor(red, green, blue) = COLOURS[which % COLOURS.len()];
    format!("rgb({red},{green},{blue})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_numbers_of_one_to_nine_and_an_outlier() {
        let numbers = FiveNumbers::of(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 100.0]).unwrap();
        assert_eq!(numbers.quartiles, [3.0, 5.0, 7.0]);
        assert_eq!(
            numbers.whiskers,
            [1.0, 8.0],
            "the outlier lies beyond 7 + 1.5 * 4"
        );
        assert!(FiveNumbers::of(Vec::new()).is_none());
    }
}
