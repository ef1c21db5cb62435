//! Position of the aircraft in the image, and other positions at which it can be shown for a probe.

use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::{FlightState, Pose};
use glam::{DVec2, DVec3};

use crate::pixels::Rectangle;

/// Half size of a box around airliners like the Boeing 737: forward, right and down from the centre of gravity, metres.
const HALF_SIZE_M: DVec3 = DVec3::new(22.0, 19.0, 8.0);
/// Margin for a lamp, a blur or a shadow edge around the box, pixels.
const AROUND_PX: f64 = 3.0;
/// A displaced aircraft is at least this far from its place, pixels.
const MIN_SHIFT_PX: f64 = 8.0;
/// Ticks before and after a probe that may be on the screen while it is watched.
const TICKS_AROUND: usize = 7;

/// The displaced aircraft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Displaced {
    /// Displaced pose.
    pub(super) pose: Pose,
    /// Rectangle of that pose in the image.
    pub(super) place: Rectangle,
}

/// A place in the image away from a tick's aircraft and its neighbours. `None` if the aircraft is not in the image, or fills too much.
pub(super) fn displaced(
    placed: &CameraPose,
    (width_px, height_px): (u32, u32),
    states: &[FlightState],
    tick: usize,
) -> Option<Displaced> {
    let camera = Camera::from_pose(placed, width_px, height_px);
    let pose = states.get(tick)?.pose;
    let here = place_of(&camera, &pose)?;
    let around = tick.saturating_sub(TICKS_AROUND)..(tick + TICKS_AROUND + 1).min(states.len());
    let taken: Vec<Extent> = states[around]
        .iter()
        .filter_map(|state| place_of(&camera, &state.pose))
        .collect();
    let size = here.high - here.low;
    let seen = camera.to_camera(pose.position().to_ecef());
    let meters_per_pixel = seen.z / camera.focal_px;
    // First up: no shadow falls there.
    let ways = [DVec2::NEG_Y, DVec2::NEG_X, DVec2::X, DVec2::Y];
    ways.into_iter()
        .flat_map(|way| [1.0, 1.5, 2.0, 3.0].map(|times| way * (size + MIN_SHIFT_PX) * times))
        .find_map(|shift_px| {
            let moved = camera.ecef_from_camera * (shift_px * meters_per_pixel).extend(0.0);
            let pose = moved_by(pose, moved);
            let place = place_of(&camera, &pose)?;
            let is_free = place.is_inside(width_px, height_px)
                && taken.iter().all(|other| !place.overlaps(*other));
            is_free.then(|| Displaced {
                pose,
                place: place.pixels(),
            })
        })
}

fn moved_by(pose: Pose, ecef_m: DVec3) -> Pose {
    pose.moved_to(Geodetic::from_ecef(pose.position().to_ecef() + ecef_m))
}

/// A rectangle in an image, with fractions of pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    pub(super) low: DVec2,
    pub(super) high: DVec2,
}

impl Extent {
    fn overlaps(self, other: Self) -> bool {
        self.low.cmplt(other.high).all() && other.low.cmplt(self.high).all()
    }

    fn is_inside(self, width_px: u32, height_px: u32) -> bool {
        let size = DVec2::new(f64::from(width_px), f64::from(height_px));
        self.low.cmpge(DVec2::ZERO).all() && self.high.cmple(size - 1.0).all()
    }
    /// The part inside an image.
    pub(super) fn cut_off(self, width_px: u32, height_px: u32) -> Option<Rectangle> {
        let size = DVec2::new(f64::from(width_px), f64::from(height_px));
        let (low, high) = (self.low.max(DVec2::ZERO), self.high.min(size - 1.0));
        low.cmple(high).all().then(|| Self { low, high }.pixels())
    }

    fn pixels(self) -> Rectangle {
        let [x, y] = self.low.floor().to_array();
        let [right, bottom] = self.high.ceil().to_array();
        Rectangle {
            x_px: x as u32,
            y_px: y as u32,
            width_px: (right - x) as u32 + 1,
            height_px: (bottom - y) as u32 + 1,
        }
    }
}

/// Corners of the aircraft's box, ECEF.
pub(super) fn corners(pose: &Pose) -> impl Iterator<Item = DVec3> {
    (0..8_u8).map(|corner| {
        let sign = |bit: u8| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
        pose.body_point_to_ecef(HALF_SIZE_M * DVec3::new(sign(0), sign(1), sign(2)))
    })
}

/// The aircraft in the image; `None` if a part is behind the camera.
fn place_of(camera: &Camera, pose: &Pose) -> Option<Extent> {
    let mut extent = Extent {
        low: DVec2::INFINITY,
        high: DVec2::NEG_INFINITY,
    };
    for corner in corners(pose) {
        let at = camera.project(corner)?;
        extent.low = extent.low.min(at);
        extent.high = extent.high.max(at);
    }
    extent.low -= AROUND_PX;
    extent.high += AROUND_PX;
    Some(extent)
}

/// The aircraft's rectangle in an image, cut off at its edges; `None` if it is outside.
pub(super) fn aircraft_place(
    placed: &CameraPose,
    (width_px, height_px): (u32, u32),
    pose: &Pose,
) -> Option<Rectangle> {
    let camera = Camera::from_pose(placed, width_px, height_px);
    place_of(&camera, pose)?.cut_off(width_px, height_px)
}

#[cfg(test)]
mod tests {
    use dataset::geometry::pose::Controls;

    use super::*;

    const SIZE_PX: (u32, u32) = (1_920, 1_280);

    /// A camera 300 m beside a runway to the north, which looks to the south.
    fn camera() -> CameraPose {
        CameraPose {
            pose: pose(0.0135, 0.0027, 15.0, 180.0, 1.5),
            hfov_deg: 10.0,
        }
    }

    fn pose(
        latitude_deg: f64,
        longitude_deg: f64,
        altitude_msl_m: f64,
        heading: f64,
        pitch: f64,
    ) -> Pose {
        Pose {
            latitude_deg,
            longitude_deg,
            altitude_msl_m,
            heading_true_deg: heading,
            pitch_deg: pitch,
            roll_deg: 0.0,
        }
    }

    /// An approach from the south, one state per second.
    fn approach() -> Vec<FlightState> {
        (0..200)
            .map(|second| {
                let to_go_m = 15_000.0 - 72.0 * f64::from(second);
                FlightState {
                    time_s: f64::from(second),
                    pose: pose(-to_go_m / 110_574.0, 0.0, to_go_m * 0.0524, 0.0, 3.0),
                    velocity_north_mps: 72.0,
                    velocity_east_mps: 0.0,
                    velocity_down_mps: 3.8,
                    true_airspeed_mps: 72.0,
                    controls: Controls::default(),
                    on_ground: false,
                }
            })
            .collect()
    }

    #[test]
    fn a_displaced_aircraft_is_in_the_picture_and_in_no_place_of_its_neighbours() {
        let states = approach();
        for tick in 0..150 {
            let Displaced { pose, place } = displaced(&camera(), SIZE_PX, &states, tick).unwrap();
            let projected = Camera::from_pose(&camera(), SIZE_PX.0, SIZE_PX.1);
            let centre = projected.project(pose.position().to_ecef()).unwrap();
            let inside = |low: u32, size: u32, at: f64| {
                (f64::from(low)..f64::from(low + size)).contains(&at)
            };
            assert!(
                inside(place.x_px, place.width_px, centre.x)
                    && inside(place.y_px, place.height_px, centre.y)
            );
            assert!(place.right_px() <= SIZE_PX.0 && place.bottom_px() <= SIZE_PX.1);
            let own = projected
                .project(states[tick].pose.position().to_ecef())
                .unwrap();
            assert!((centre - own).length() >= MIN_SHIFT_PX, "tick {tick}");
            let around = states
                .iter()
                .enumerate()
                .skip(tick.saturating_sub(5))
                .take(11);
            for (other, state) in around {
                let at = projected.project(state.pose.position().to_ecef()).unwrap();
                let overlaps = inside(place.x_px, place.width_px, at.x)
                    && inside(place.y_px, place.height_px, at.y);
                assert!(!overlaps, "tick {tick} over {other}");
            }
        }
    }

    #[test]
    fn an_aircraft_behind_the_camera_has_no_place() {
        let mut states = approach();
        states[0].pose = pose(0.05, 0.0, 100.0, 0.0, 0.0);
        assert_eq!(displaced(&camera(), SIZE_PX, &states, 0), None);
        assert_eq!(aircraft_place(&camera(), SIZE_PX, &states[0].pose), None);
        assert!(aircraft_place(&camera(), SIZE_PX, &states[1].pose).is_some());
    }
}
