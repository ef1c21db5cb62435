//! The charts of the report as SVG.

use plotters::prelude::*;
use report_page::Result;
use report_page::chart::{COLOURS, axes, axis, svg};

use crate::recall::RecallBin;

/// A line of a chart: its points, each with the ends of its interval if it has one.
pub(super) struct Line {
    points: Vec<(f64, f64)>,
    intervals: Vec<(f64, [f64; 2])>,
}

impl Line {
    /// Recall over distance, percent.
    pub(super) fn of_recall(bins: &[RecallBin]) -> Self {
        let percent = |share: f64| 100.0 * share;
        let before_touchdown = || bins.iter().filter(|bin| bin.from_nm >= 0.0);
        let middle = |bin: &RecallBin| f64::midpoint(bin.from_nm, bin.to_nm);
        Self {
            points: before_touchdown()
                .filter_map(|bin| Some((middle(bin), percent(bin.recall.recall?))))
                .collect(),
            intervals: before_touchdown()
                .map(|bin| (middle(bin), bin.recall.interval.map(percent)))
                .collect(),
        }
    }

    /// Some values over distance.
    pub(super) fn of(points: impl Iterator<Item = (f64, f64)>) -> Self {
        Self {
            points: points.collect(),
            intervals: Vec::new(),
        }
    }
}

/// Recall over distance; one colour a line, in their order.
pub(super) fn recall(lines: &[Line]) -> Result<String> {
    chart("recall by distance", lines, 0.0..102.0, "found, %", 0)
}

/// Deviations over distance.
pub(super) fn deviations(lines: &[Line], what: &'static str) -> Result<String> {
    let values = lines
        .iter()
        .flat_map(|line| line.points.iter().map(|point| point.1));
    let highest = values.fold(0.0, f64::max);
    chart(
        "deviations by distance",
        lines,
        axis(0.0, 1.1 * highest),
        what,
        2,
    )
}

fn chart(
    name: &'static str,
    lines: &[Line],
    values: std::ops::Range<f64>,
    what: &'static str,
    decimals: usize,
) -> Result<String> {
    let points = || lines.iter().flat_map(|line| line.points.iter());
    let farthest = points().map(|point| point.0).fold(1.0, f64::max).ceil();
    svg(name, 300, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .build_cartesian_2d(axis(0.0, farthest), values.clone())?;
        axes(&mut chart)
            .x_labels(farthest as usize + 1)
            .y_label_formatter(&|y| format!("{y:.decimals$}"))
            .x_desc("distance to touchdown, NM")
            .y_desc(what)
            .draw()?;
        for (line, colour) in lines.iter().zip(COLOURS.iter().cycle()) {
            chart.draw_series(line.intervals.iter().map(|(x, [low, high])| {
                PathElement::new([(*x, *low), (*x, *high)], colour.mix(0.35).stroke_width(3))
            }))?;
            chart.draw_series(LineSeries::new(
                line.points.iter().copied(),
                colour.stroke_width(2),
            ))?;
            chart.draw_series(
                line.points
                    .iter()
                    .map(|point| Circle::new(*point, 3, colour.filled())),
            )?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_of_nothing_and_of_absurd_values_end() {
        let lines = |points: &[(f64, f64)]| vec![Line::of(points.iter().copied())];
        for points in [&[][..], &[(0.5, 0.0)], &[(0.5, 1e300), (12.5, 1e-300)]] {
            for svg in [recall(&lines(points)), deviations(&lines(points), "px")] {
                let svg = svg.unwrap();
                assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN"), "{svg}");
            }
        }
    }
}
