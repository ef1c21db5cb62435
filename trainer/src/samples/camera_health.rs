//! Correction for cameras that turned, shook or repeated images.
//!
//! `dtd detect` measures each camera's direction from the ground in its images ([`dataset::tables::health`]). In hindsight the directions
//! of a flight are one walk ([`sight::walk`]): at each tick, boxes and registered shifts are mapped from there to the flight's usual
//! direction, and what remains uncertain makes shifts less certain. A view is ignored while its image repeats an earlier one, and while it
//! may look several pixels elsewhere.

pub(crate) mod late_images;

use std::collections::BTreeMap;
use std::fmt;
use std::ops::AddAssign;

use dataset::geometry::camera::Camera;
use dataset::tables::health::{CameraTurn, HealthState, ViewHealth};
use glam::DVec2;
use sight::ground::Motion;
use sight::walk::{self, Turned};
use sight::watched::Measured;

use crate::samples::Observation;

/// Boxes whose direction is less certain do not count, pixels: they are themselves off by up to a pixel.
const MAX_SD_PX: f64 = 3.0;

/// Directions of a scenario's cameras.
pub(crate) struct CameraHealth<'a> {
    cameras: &'a [Camera],
    directions: BTreeMap<(u32, usize), Direction>,
}

/// Direction of a camera at a tick.
struct Direction {
    /// Relative to the flight's usual one; `None` if the image does not count.
    turned: Option<Turned>,
    /// True for a camera that moved, shook or repeated an image.
    is_ill: bool,
}

/// Effects on boxes from faulty cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Corrections {
    /// Corrected boxes.
    pub moved: usize,
    /// Rejected boxes.
    pub withheld: usize,
    /// Boxes in late images, moved to the time of their tick.
    pub late: usize,
    /// Rejected boxes in late images.
    pub late_withheld: usize,
}

impl AddAssign for Corrections {
    fn add_assign(&mut self, other: Self) {
        self.moved += other.moved;
        self.withheld += other.withheld;
        self.late += other.late;
        self.late_withheld += other.late_withheld;
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
            late,
            late_withheld,
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
        ];
        let parts = parts.into_iter().filter(|(count, _)| *count > 0);
        let parts: Vec<String> = parts.map(|(_, text)| text).collect();
        f.write_str(&parts.join("; "))
    }
}

/// The first of several lines for users, with the number of others.
pub(crate) fn first_of(lines: &[String]) -> Option<String> {
    let (first, others) = lines.split_first()?;
    Some(match others.len() {
        0 => first.clone(),
        count => format!("{first} (and {count} more)"),
    })
}

/// A measured direction.
pub(crate) fn measured(turn: &CameraTurn) -> Measured {
    Measured {
        turn: Motion {
            shift_px: DVec2::new(turn.shift_x_px, turn.shift_y_px),
            roll_rad: turn.roll_deg.to_radians(),
            ..Motion::default()
        },
        sd_px: turn.shift_sd_px,
    }
}

impl<'a> CameraHealth<'a> {
    /// `cameras` are in the order of `views`; `times_s`: of the ticks.
    pub(crate) fn of(
        views: &[String],
        cameras: &'a [Camera],
        rows: &[ViewHealth],
        times_s: &BTreeMap<u32, f64>,
    ) -> Self {
        let mut directions = BTreeMap::new();
        for (view, (name, camera)) in views.iter().zip(cameras).enumerate() {
            let is_timed = |row: &&ViewHealth| row.view == *name && times_s.contains_key(&row.tick);
            let mut rows_of_view: Vec<&ViewHealth> = rows.iter().filter(is_timed).collect();
            rows_of_view.sort_by_key(|row| row.tick);
            let times_s: Vec<f64> = rows_of_view.iter().map(|row| times_s[&row.tick]).collect();
            let turns = rows_of_view.iter().map(|row| {
                let turn = row.motion.as_ref();
                turn.filter(|_| row.state != HealthState::Frozen)
                    .map(measured)
            });
            let half_px = f64::from(camera.width_px) / 2.0;
            let walk = walk::smoothed(&times_s, &turns.collect::<Vec<_>>(), half_px);
            for (index, row) in rows_of_view.into_iter().enumerate() {
                let walked = walk.as_ref().map(|walk| walk[index]);
                // Without any measurement, a camera without a finding looks in its usual direction.
                if walked.is_some() || !row.state.is_well() {
                    let direction = Direction::of(row, walked);
                    directions.insert((row.tick, view), direction);
                }
            }
        }
        Self {
            cameras,
            directions,
        }
    }

    /// Maps a tick to the usual directions, and counts the changes.
    pub(crate) fn corrected(&self, observed: Observation, counts: &mut Corrections) -> Observation {
        let direction = |view: usize| self.directions.get(&(observed.tick, view));
        if (0..observed.views()).all(|view| direction(view).is_none()) {
            return observed;
        }
        for (view, _) in observed.seen() {
            match direction(view).filter(|of| of.is_ill) {
                Some(of) if of.turned.is_none() => counts.withheld += 1,
                Some(_) => counts.moved += 1,
                None => {}
            }
        }
        let turned = |view: usize| direction(view)?.turned;
        observed
            .without_images(|view| direction(view).is_some_and(|of| of.turned.is_none()))
            .moved(|view, place_px| {
                let turn = turned(view).map(|of| of.turn);
                let turn = turn.filter(|turn| *turn != Motion::default());
                Some(turn.map_or(place_px, |of| of.usual_px(&self.cameras[view], place_px)))
            })
            .widened(|view| turned(view).map_or(DVec2::ZERO, |of| of.sd_px))
    }
}

impl Direction {
    /// `walked`: by the measured directions, if there are any.
    fn of(row: &ViewHealth, walked: Option<Turned>) -> Self {
        let counts =
            |of: &Turned| row.state != HealthState::Frozen && of.sd_px.max_element() <= MAX_SD_PX;
        Self {
            turned: walked.filter(counts),
            is_ill: !row.state.is_well(),
        }
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::camera::Camera;
    use testkit::rig::{VIEWS, placed};

    use super::*;

    fn row(tick: u32, view: &str, state: HealthState) -> ViewHealth {
        ViewHealth {
            tick,
            view: view.to_owned(),
            state,
            motion: None,
            state_live: HealthState::Unknown,
        }
    }

    /// The tick in a flight of 20 ticks, one second apart.
    fn corrected(rows: &[ViewHealth], tick: u32) -> (Observation, Corrections) {
        let views = VIEWS.map(str::to_owned);
        let cameras = VIEWS.map(|view| Camera::from_pose(&placed(view), 1920, 1280));
        let times_s = (0..20).map(|tick| (tick, f64::from(tick))).collect();
        let health = CameraHealth::of(&views, &cameras, rows, &times_s);
        let mut counts = Corrections::default();
        (health.corrected(observed(tick), &mut counts), counts)
    }

    fn observed(tick: u32) -> Observation {
        Observation::registered(tick, [500.0; 2])
    }

    #[test]
    fn boxes_between_two_directions_far_apart_do_not_count() {
        let rows = (0..20).map(|tick| {
            let motion = |shift_x_px: f64| CameraTurn {
                shift_x_px,
                shift_y_px: 0.0,
                roll_deg: 0.0,
                shift_sd_px: 0.02,
            };
            let (state, motion) = match tick {
                0..7 => (HealthState::Steady, Some(motion(0.0))),
                7..13 => (HealthState::Moved, None),
                _ => (HealthState::Moved, Some(motion(20.0))),
            };
            ViewHealth {
                motion,
                ..row(tick, "right", state)
            }
        });
        let rows: Vec<ViewHealth> = rows.collect();
        let column = |tick: u32| {
            let (observed, counts) = corrected(&rows, tick);
            (observed.best(1).map(|seen| seen.cx_px), counts)
        };
        let there_px = observed(3).best(1).unwrap().cx_px;
        for (tick, expected_px) in [(3, there_px), (15, there_px - 20.0)] {
            let (seen_px, counts) = column(tick);
            assert!((seen_px.unwrap() - expected_px).abs() < 0.1, "{seen_px:?}");
            assert_eq!(
                (counts.moved, counts.withheld),
                (usize::from(tick == 15), 0)
            );
        }
        let (seen_px, counts) = column(10);
        assert_eq!((seen_px, counts.withheld), (None, 1));
    }
}
