//! Correction for cameras that moved, shook or repeated images.
//!
//! `dtd detect` measures each camera's direction from the ground in its images ([`dataset::tables::health`]). Where a camera is off, its
//! boxes and registered shifts are mapped to the flight's usual direction. The error that several measured directions share is a common
//! error; the rest makes each shift less certain. A view is ignored while its image repeats an earlier one, or while its direction is off
//! by a poorly known amount; only a shaking camera whose direction fog hides keeps its shifts, with their larger uncertainty. Other ticks
//! remain bit-identical.

pub(crate) mod late_images;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::AddAssign;

use dataset::geometry::camera::Camera;
use dataset::numbers::spread::deviation_from_zero;
use dataset::tables::health::{HealthState, ViewHealth};
use glam::DVec2;

use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{CommonError, Observation};

/// Maximum standard deviation for corrected directions, pixels: at ten nautical miles, with masts 600 m apart, it causes an error in
/// distance of 0.1 %.
const MAX_SD_PX: f64 = 0.3;

/// Camera health in a scenario, for ticks with a fault.
pub(crate) struct CameraHealth<'a> {
    views: &'a [String],
    cameras: &'a [Camera],
    rows: BTreeMap<(u32, usize), ViewHealth>,
    /// Standard deviation of a shaking camera's usual direction per view, pixels: the minimum over its measured directions.
    usual_sd_px: Vec<f64>,
    /// Standard deviation of a shaking camera's direction per view while its background is hidden, pixels, from the contradictions between
    /// the aircraft's rows. `None` without contradictions.
    hidden_sd_px: Vec<Option<f64>>,
}

/// Effects on boxes from faulty cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Corrections {
    /// Corrected boxes.
    pub moved: usize,
    /// Rejected boxes.
    pub withheld: usize,
    /// Boxes with less certain shifts: the camera shakes, and fog hides its direction.
    pub uncertain: usize,
    /// Boxes in late images, moved to the time of their tick.
    pub late: usize,
    /// Rejected boxes in late images.
    pub late_withheld: usize,
    /// Boxes in late images that remain unchanged, because the lag is unknown live.
    pub late_kept: usize,
    /// Rejected shifts between views that cannot show the same aircraft.
    pub contradicting: usize,
}

impl AddAssign for Corrections {
    fn add_assign(&mut self, other: Self) {
        self.moved += other.moved;
        self.withheld += other.withheld;
        self.uncertain += other.uncertain;
        self.late += other.late;
        self.late_withheld += other.late_withheld;
        self.late_kept += other.late_kept;
        self.contradicting += other.contradicting;
    }
}

impl Corrections {
    /// The sum as a line for users; `None` if nothing changed.
    pub(crate) fn line(all: impl Iterator<Item = Self>) -> Option<String> {
        let mut sum = Self::default();
        all.for_each(|of_scenario| sum += of_scenario);
        (sum != Self::default()).then(|| sum.to_string())
    }
}

impl fmt::Display for Corrections {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            moved,
            withheld,
            uncertain,
            late,
            late_withheld,
            late_kept,
            contradicting,
        } = self;
        let parts = [
            (
                moved + withheld,
                format!(
                    "boxes of cameras that moved, shook or repeated images: {moved} corrected, {withheld} left out"
                ),
            ),
            (
                late + late_withheld,
                format!("boxes of late images: {late} corrected, {late_withheld} left out"),
            ),
            (
                *uncertain,
                format!("boxes of cameras that shake in fog: {uncertain} with less certain shifts"),
            ),
            (
                *late_kept,
                format!(
                    "boxes of late images: {late_kept} not corrected, since only whole flights tell the lag; expect errors of distances"
                ),
            ),
            (
                *contradicting,
                format!(
                    "shifts between views that contradict each other: {contradicting} left out"
                ),
            ),
        ];
        let parts = parts.into_iter().filter(|(count, _)| *count > 0);
        let parts: Vec<String> = parts.map(|(_, text)| text).collect();
        f.write_str(&parts.join("; "))
    }
}

/// True for an image from a shaking camera without a visible background.
fn is_hidden_shake(row: &ViewHealth) -> bool {
    row.state == HealthState::Shaking && row.motion.is_none()
}

/// Standard deviation of the aircraft's rows at ticks with such images, pixels: relative to the first view, or between the first view and
/// all others.
fn hidden_sd_px(view: &str, rows: &[ViewHealth]) -> Option<f64> {
    let hidden = || {
        rows.iter()
            .filter(|row| row.view == view && is_hidden_shake(row))
    };
    let mut off_px: Vec<f64> = hidden().filter_map(|row| row.vertical_px).collect();
    if rows
        .iter()
        .all(|row| row.view != view || row.vertical_px.is_none())
    {
        let ticks: BTreeSet<u32> = hidden().map(|row| row.tick).collect();
        let there = rows.iter().filter(|row| ticks.contains(&row.tick));
        off_px = there.filter_map(|row| row.vertical_px).collect();
    }
    (!off_px.is_empty()).then(|| deviation_from_zero(off_px.into_iter()))
}

impl<'a> CameraHealth<'a> {
    /// `cameras` are in the order of `views`.
    pub(crate) fn of(views: &'a [String], cameras: &'a [Camera], rows: Vec<ViewHealth>) -> Self {
        let hidden_sd_px = views.iter().map(|view| hidden_sd_px(view, &rows)).collect();
        let ill = rows.into_iter().filter(|row| !row.state.is_well());
        let placed = ill.filter_map(|row| {
            let view = views.iter().position(|view| *view == row.view)?;
            Some(((row.tick, view), row))
        });
        let rows: BTreeMap<(u32, usize), ViewHealth> = placed.collect();
        let mut usual_sd_px = vec![f64::INFINITY; views.len()];
        for ((_, view), row) in &rows {
            if let (HealthState::Shaking, Some(turn)) = (row.state, row.motion) {
                usual_sd_px[*view] = turn.shift_sd_px.min(usual_sd_px[*view]);
            }
        }
        Self {
            views,
            cameras,
            rows,
            usual_sd_px,
            hidden_sd_px,
        }
    }

    /// Standard deviations of a view's direction in a row, pixels: the part shared with other ticks, and the rest.
    fn sds_px(&self, view: usize, row: &ViewHealth) -> [f64; 2] {
        if let Some(sd_px) = self.hidden_sd_px[view].filter(|_| is_hidden_shake(row)) {
            return [0.0, sd_px];
        }
        let whole_px = row.motion.map_or(0.0, |turn| turn.shift_sd_px);
        let common_px = match row.state {
            HealthState::Shaking => whole_px.min(self.usual_sd_px[view]),
            // A camera that stays turned is measured with the same error each time.
            _ => whole_px,
        };
        let own_px = (whole_px.powi(2) - common_px.powi(2)).max(0.0).sqrt();
        [common_px, own_px]
    }

    /// Maps a tick to the usual directions, and counts the changes.
    pub(crate) fn corrected(&self, observed: Observation, counts: &mut Corrections) -> Observation {
        let row = |view: usize| self.rows.get(&(observed.tick, view));
        let views = 0..self.views.len();
        if views.clone().all(|view| row(view).is_none()) {
            return observed;
        }
        // `None`: the view is ignored.
        let usual = |view: usize, place: DVec2| match row(view) {
            None => Some(place),
            Some(row) if row.state == HealthState::Frozen => None,
            Some(row) if is_hidden_shake(row) && self.hidden_sd_px[view].is_some() => Some(place),
            Some(row) => {
                let turn = row.motion.filter(|turn| turn.shift_sd_px <= MAX_SD_PX)?;
                Some(turn.usual_place(&self.cameras[view], place))
            }
        };
        for (view, seen) in observed.boxes.iter().enumerate() {
            let Some(seen) = seen.as_ref().filter(|_| row(view).is_some()) else {
                continue;
            };
            match usual(view, centre_and_size(seen).0) {
                Some(_) if row(view).is_some_and(is_hidden_shake) => counts.uncertain += 1,
                Some(_) => counts.moved += 1,
                None => counts.withheld += 1,
            }
        }
        let is_kept = |view: usize| usual(view, DVec2::ZERO).is_some();
        let sds_px = |view: usize| match row(view).filter(|_| is_kept(view)) {
            Some(row) => self.sds_px(view, row),
            None => [0.0; 2],
        };
        let sds_px: Vec<[f64; 2]> = views.map(sds_px).collect();
        let common = sds_px
            .iter()
            .enumerate()
            .flat_map(|(view, [common_px, _])| {
                [DVec2::X, DVec2::Y].map(|axis| CommonError {
                    view,
                    sd_px: *common_px * axis,
                })
            });
        observed
            .without_images(|view| !is_kept(view))
            .moved(usual)
            .widened(|view| DVec2::splat(sds_px[view][1]))
            .with_common(common)
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::camera::Camera;
    use testkit::rig::{VIEWS, placed};

    use super::*;

    fn observed(tick: u32) -> Observation {
        Observation::registered(tick, [500.0; 2])
    }

    #[test]
    fn boxes_of_a_camera_that_shakes_in_fog_stay_and_are_as_uncertain_as_rows_contradict() {
        let views = VIEWS.map(str::to_owned);
        let cameras = VIEWS.map(|view| Camera::from_pose(&placed(view), 1920, 1280));
        let row = |tick: u32, view: &str, off_px: Option<f64>| ViewHealth {
            tick,
            view: view.to_owned(),
            state: if view == "right" {
                HealthState::Shaking
            } else {
                HealthState::Unknown
            },
            motion: None,
            state_live: HealthState::Unknown,
            lag: None,
            vertical_px: off_px.filter(|_| view == "right"),
        };
        let corrected = |off_px: fn(u32) -> Option<f64>| {
            let rows = (0..20).flat_map(|tick| VIEWS.map(|view| row(tick, view, off_px(tick))));
            let health = CameraHealth::of(&views, &cameras, rows.collect());
            let mut counts = Corrections::default();
            let corrected = health.corrected(observed(3), &mut counts);
            (corrected, counts)
        };
        let (shaken, counts) = corrected(|tick| Some(if tick % 2 == 0 { 1.0 } else { -1.0 }));
        assert_eq!(shaken.boxes, observed(3).boxes);
        let sd_px = shaken.shifts[1].unwrap().sd_px;
        assert!((1.4..1.6).contains(&sd_px.x), "{sd_px}");
        assert_eq!((counts.uncertain, counts.moved, counts.withheld), (1, 0, 0));
        // Without contradicting rows, the shake may have any size.
        let (alone, counts) = corrected(|_| None);
        assert_eq!(
            (alone.boxes[0], alone.boxes[1]),
            (observed(3).boxes[0], None)
        );
        assert_eq!((counts.uncertain, counts.withheld), (0, 1));
    }
}
