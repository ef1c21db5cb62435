//! The vertical profile of a flight, with the fixes of the chart (figure 2 of the paper).

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::tables::frames::TickRow;
use report_page::chart::{Axis, INK, Panel, Stroke, colour, svg};

/// Fixes of the approach chart, nautical miles before the threshold.
const FIXES_NM: [f64; 2] = [7.6, 4.4];

/// Height over distance to touchdown.
pub(super) fn chart(rows: &[TickRow], to_threshold_m: f64) -> String {
    let flown = rows.iter().filter_map(|row| {
        let labels = row.labels.filter(|labels| labels.along_track_m > 0.0)?;
        let nm = labels.dtd_m / METERS_PER_NAUTICAL_MILE;
        Some((nm, labels.height_over_target_m))
    });
    let flown: Vec<(f64, f64)> = flown.collect();
    let largest = |of: fn(&(f64, f64)) -> f64| flown.iter().map(of).fold(0.0, f64::max);
    let distances = Axis::linear("distance to touchdown, NM", 0.0, largest(|point| point.0));
    let heights = Axis::linear("height over the target, m", 0.0, largest(|point| point.1));
    let highest = heights.end();
    let mut panel = Panel::new(300, distances, heights);
    for fix_nm in FIXES_NM {
        let nm = fix_nm + to_threshold_m / METERS_PER_NAUTICAL_MILE;
        panel.line([(nm, 0.0), (nm, highest)], Stroke::new(INK, 1));
        panel.text((nm, highest), &format!("D{fix_nm}"));
    }
    panel.line(flown, Stroke::new(colour(0), 2));
    svg("height by distance to touchdown", &[panel])
}
