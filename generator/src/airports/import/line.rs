//! A runway as one table has it, and the comparison with other tables.

use dataset::geometry::geodesy::LatLon;
use dataset::geometry::runway::RunwayCoordinates;
use dataset::numbers::units::Degrees;

use super::{Conflict, PLACE_TOLERANCE_M};
use crate::airports::sources::Ends;

/// Courses contradict each other beyond this difference, degrees.
const COURSE_TOLERANCE_DEG: f64 = 0.05;
/// A localizer further from the centreline, metres, belongs to an approach at an angle.
const OFFSET_LOCALIZER_M: f64 = 100.0;
/// Two centrelines are equally near to the localizer within this, metres.
const EQUALLY_NEAR_M: f64 = 3.0;
/// A line between localizers that is turned by more, degrees, belongs to a different approach.
const SAME_RUNWAY_DEG: f64 = 0.3;

/// A runway by one table.
pub(super) struct Line<'a> {
    pub(super) ends: &'a Ends,
    pub(super) threshold: LatLon,
    pub(super) course_deg: f64,
    /// Between the ends of the pavement, metres.
    pub(super) length_m: f64,
    /// Length from the landing threshold on, metres.
    pub(super) landing_m: f64,
    /// Distance of the localizer's antenna from the centreline, metres.
    pub(super) localizer_m: Option<f64>,
}

impl<'a> Line<'a> {
    pub(super) fn of(ends: &'a Ends, localizer: Option<LatLon>) -> Self {
        let (near, far) = (&ends.near, &ends.far);
        let towards_deg = near.place.azimuth_to_deg(far.place);
        let threshold = match near.displaced_m {
            0.0 => near.place,
            displaced_m => near.place.destination(towards_deg, displaced_m),
        };
        let mut line = Self {
            ends,
            threshold,
            course_deg: Degrees(threshold.azimuth_to_deg(far.place)).wrapped_360().0,
            length_m: near.place.distance_m(far.place),
            landing_m: threshold.distance_m(far.place),
            localizer_m: None,
        };
        let offset_m = localizer.map(|place| line.place(place).cross_track_m.abs());
        line.localizer_m = offset_m.filter(|offset_m| *offset_m < OFFSET_LOCALIZER_M);
        line
    }

    /// Moves the ends sideways onto the line between the localizers of both directions; `None` if that line belongs to a different runway.
    pub(super) fn onto_axis(&self, opposite: LatLon, localizer: LatLon) -> Option<Ends> {
        let course_deg = opposite.azimuth_to_deg(localizer);
        let turned_deg = Degrees(course_deg - self.course_deg).wrapped_180().0;
        if turned_deg.abs() > SAME_RUNWAY_DEG
            || self.place(opposite).cross_track_m.abs() > OFFSET_LOCALIZER_M
        {
            return None;
        }
        let moved = |place: LatLon| {
            let from_opposite = RunwayCoordinates::of(
                place.at_altitude_m(0.0),
                opposite.at_altitude_m(0.0),
                course_deg,
            );
            opposite.destination(course_deg, -from_opposite.along_track_m)
        };
        let mut ends = self.ends.clone();
        ends.source = "the axis of both localizers in earth_nav.dat";
        ends.near.place = moved(ends.near.place);
        ends.far.place = moved(ends.far.place);
        Some(ends)
    }

    fn place(&self, place: LatLon) -> RunwayCoordinates {
        RunwayCoordinates::of(
            place.at_altitude_m(0.0),
            self.threshold.at_altitude_m(0.0),
            self.course_deg,
        )
    }

    /// Offset from the centreline, to the right when landing, metres.
    pub(super) fn across_m(&self, place: LatLon) -> f64 {
        self.place(place).cross_track_m
    }

    pub(super) fn along_m(&self, place: LatLon) -> f64 {
        self.place(place).along_track_m
    }

    pub(super) fn off_length_m(&self, stated_m: f64) -> f64 {
        (self.length_m - stated_m).abs()
    }
}

/// Table in best agreement with independent evidence, and the reasons.
pub(super) fn recommended<'a, 'b>(lines: &'b [Line<'a>]) -> Option<(&'b Line<'a>, String)> {
    let stated_m = lines.iter().find_map(|line| line.ends.stated_length_m);
    // A centreline that is far from the localizer is the worst, unless all are: then it belongs to an approach at an angle.
    let far_m = if lines.iter().any(|line| line.localizer_m.is_some()) {
        f64::MAX
    } else {
        0.0
    };
    let aside_m = |line: &Line<'_>| line.localizer_m.unwrap_or(far_m);
    let off_m = |line: &Line<'_>| stated_m.map_or(0.0, |stated_m| line.off_length_m(stated_m));
    let mut best = lines.first()?;
    for line in &lines[1..] {
        let nearer_m = aside_m(best) - aside_m(line);
        let is_better = if nearer_m.abs() > EQUALLY_NEAR_M {
            nearer_m > 0.0
        } else {
            off_m(line) + PLACE_TOLERANCE_M < off_m(best)
        };
        if is_better {
            best = line;
        }
    }
    let of_each = |what: &dyn Fn(&Line<'_>) -> Option<f64>| {
        let each = lines
            .iter()
            .filter_map(|line| Some((line.ends.source, what(line)?)));
        each.map(|(source, metres)| format!("{metres:.1} m ({source})"))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let mut reasons = Vec::new();
    if best.localizer_m.is_some() {
        reasons.push(format!(
            "its centreline misses the localizer by {}",
            of_each(&|line| line.localizer_m)
        ));
    }
    if let Some(stated_m) = stated_m {
        let lengths = of_each(&|line| Some(line.off_length_m(stated_m)));
        reasons.push(format!(
            "its length differs from the stated {stated_m:.0} m by {lengths}"
        ));
    }
    let reason = reasons.join("; ");
    Some((
        best,
        if reason.is_empty() {
            reason
        } else {
            format!("; {reason}")
        },
    ))
}

/// Contradictions between the recommended table and a second one.
pub(super) fn differences(best: &Line<'_>, other: &Line<'_>, reason: &str) -> Vec<Conflict> {
    let (one, two) = (best.ends.source, other.ends.source);
    let recommended = format!("{one}{reason}");
    let mut found = Vec::new();
    let off_deg = Degrees(other.course_deg - best.course_deg).wrapped_180().0;
    if off_deg.abs() > COURSE_TOLERANCE_DEG {
        found.push(Conflict {
            figure: "course_true_deg",
            found: format!(
                "{:.3} by {one}, {:.3} by {two}: {:.0} m at 10 NM",
                best.course_deg,
                other.course_deg,
                18_520.0 * off_deg.abs().to_radians().sin()
            ),
            recommended: recommended.clone(),
        });
    }
    let place = best.place(other.threshold);
    if place.dtd_m > PLACE_TOLERANCE_M {
        found.push(Conflict {
            figure: "threshold",
            found: format!(
                "{two} has it {:.1} m further along the runway and {:.1} m to the right of {one}'s",
                -place.along_track_m, place.cross_track_m
            ),
            recommended,
        });
    }
    found
}
