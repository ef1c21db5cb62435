//! Sources that confirm the recommended centreline: its offset and its course, not the position along it.

use dataset::geometry::geodesy::LatLon;
use dataset::numbers::units::Degrees;

use super::line::Line;

/// Two sources agree within these differences: metres across at the threshold, degrees.
const ACROSS_TOLERANCE_M: f64 = 5.0;
const COURSE_TOLERANCE_DEG: f64 = 0.02;

/// Names of the sources that agree with a line: other tables, the axis of both localizers. Without one the runway is unconfirmed.
pub(super) fn confirmed_by(
    best: &Line<'_>,
    lines: &[Line<'_>],
    localizers: Option<(LatLon, LatLon)>,
) -> Vec<String> {
    let agrees = |other: &Line<'_>| {
        let turned_deg = Degrees(other.course_deg - best.course_deg).wrapped_180().0;
        best.across_m(other.threshold).abs() <= ACROSS_TOLERANCE_M
            && turned_deg.abs() <= COURSE_TOLERANCE_DEG
    };
    let others = lines
        .iter()
        .filter(|line| line.ends.source != best.ends.source);
    let mut found: Vec<String> = others
        .filter(|line| agrees(line))
        .map(|line| line.ends.source.to_owned())
        .collect();
    let axis = localizers.and_then(|(localizer, opposite)| best.onto_axis(opposite, localizer));
    if let Some(axis) =
        axis.filter(|axis| axis.source != best.ends.source && agrees(&Line::of(axis, None)))
    {
        found.push(axis.source.to_owned());
    }
    found
}
