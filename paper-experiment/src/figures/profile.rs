//! The vertical profile of a flight, with the fixes of the chart (figure 2 of the paper).

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::tables::frames::TickRow;
use plotters::prelude::*;
use report_page::chart::{COLOURS, FONT, INK, axes, axis, svg};

use crate::error::Result;

/// Fixes of the approach chart, nautical miles before the threshold.
const FIXES_NM: [f64; 2] = [7.6, 4.4];
/// Room above the flight.
const MARGIN: f64 = 1.15;
/// Distance of a fix's name from its line, nautical miles.
const NAME_GAP_NM: f64 = 0.05;

/// Height over distance to touchdown.
pub(super) fn chart(rows: &[TickRow], to_threshold_m: f64) -> Result<String> {
    let flown = rows.iter().filter_map(|row| {
        let labels = row.labels.filter(|labels| labels.along_track_m > 0.0)?;
        let nm = labels.dtd_m / METERS_PER_NAUTICAL_MILE;
        Some((nm, labels.height_over_target_m))
    });
    let flown: Vec<(f64, f64)> = flown.collect();
    let largest = |of: fn(&(f64, f64)) -> f64| flown.iter().map(of).fold(0.0, f64::max);
    let farthest = axis(0.0, largest(|point| point.0));
    let highest = MARGIN * largest(|point| point.1);
    let heights = axis(0.0, highest);
    Ok(svg("height by distance to touchdown", 300, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(8)
            .x_label_area_size(44)
            .y_label_area_size(58)
            .build_cartesian_2d(farthest.clone(), heights.clone())?;
        axes(&mut chart)
            .x_desc("distance to touchdown, NM")
            .y_desc("height over the target, m")
            .y_label_formatter(&|y| format!("{y:.0}"))
            .draw()?;
        for fix_nm in FIXES_NM {
            let nm = fix_nm + to_threshold_m / METERS_PER_NAUTICAL_MILE;
            chart.draw_series([PathElement::new(vec![(nm, 0.0), (nm, highest)], INK)])?;
            let name = Text::new(
                format!("D{fix_nm}"),
                (nm + NAME_GAP_NM, highest),
                (FONT, 13).into_font().color(&INK),
            );
            chart.draw_series([name])?;
        }
        chart.draw_series(LineSeries::new(
            flown.iter().copied(),
            COLOURS[0].stroke_width(2),
        ))?;
        Ok(())
    })?)
}
