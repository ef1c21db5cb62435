//! The lag of each view's images behind the first view's, from the registrations of a whole flight ([`crate::view_lag`]).

use std::collections::BTreeMap;

use dataset::corpus::detections::{Detection, Detections};
use dataset::geometry::camera::Camera;
use dataset::numbers::motion::motion_at;
use dataset::tables::health::{HealthState, ViewHealth, ViewLag};
use dataset::tables::registrations::Registration;
use glam::DVec2;

use super::pictures::ViewTicks;
use crate::view_lag::{CommonSighting, robust_offset};

/// Sightings that count are so far apart, seconds.
const STEP_S: f64 = 0.5;
/// A direction that is less certain is not corrected, pixels.
const MOST_TURN_SD_PX: f64 = 0.3;
/// Errors of so many sightings in a row are alike.
const ALIKE: f64 = 3.0;
/// Standard deviation of what all sightings of a flight have in common, milliseconds: views from two sides see other parts of a near
/// aircraft. The demo's untouched flights have lags up to 45 ms.
const COMMON_SD_MS: f64 = 20.0;
/// A larger lag, or a less certain one, was not measured: motion changes too much during it, milliseconds.
const MOST_MS: f64 = 10_000.0;

/// What a flight showed.
struct Flight<'a> {
    /// Identifiers and cameras of the views.
    views: Vec<(&'a str, &'a Camera)>,
    detections: &'a Detections,
    registrations: &'a [Registration],
    /// Time of each tick, seconds.
    times_s: BTreeMap<u32, f64>,
}

/// An aircraft that two views see.
struct Seen {
    time_s: f64,
    places_px: [DVec2; 2],
}

/// Adds the lag of each view of a scenario to its rows. `cameras`: of the views.
pub(super) fn add_lags(
    views: &[ViewTicks],
    cameras: &[Camera],
    detections: &Detections,
    registrations: &[Registration],
    health: &mut [ViewHealth],
) {
    let ticks = views.iter().flat_map(|view| &view.ticks);
    let ids = views.iter().map(|view| view.id.as_str());
    let flight = Flight {
        times_s: ticks.map(|tick| (tick.tick, tick.time_s)).collect(),
        views: ids.zip(cameras).collect(),
        detections,
        registrations,
    };
    let lags: BTreeMap<&str, Option<ViewLag>> = (flight.views.iter())
        .map(|(view, _)| (*view, flight.lag(view, health)))
        .collect();
    for row in health {
        row.lag = lags.get(row.view.as_str()).copied().flatten();
    }
}

impl Flight<'_> {
    fn lag(&self, view: &str, health: &[ViewHealth]) -> Option<ViewLag> {
        let rows: BTreeMap<(u32, &str), &ViewHealth> = (health.iter())
            .map(|row| ((row.tick, row.view.as_str()), row))
            .collect();
        // The tracks of both views: one aircraft after another.
        let mut seen: BTreeMap<[Option<u32>; 2], Vec<Seen>> = BTreeMap::new();
        let mut reference = None;
        for row in self.registrations.iter().filter(|row| row.view == view) {
            let Ok(shift) = &row.result else { continue };
            let first_px = DVec2::new(shift.x_px, shift.y_px);
            let second_px = first_px + DVec2::new(shift.dx_px, shift.dy_px);
            let (first, second) = (row.reference.as_str(), row.view.as_str());
            let found = [(first, first_px), (second, second_px)].map(|(view, place_px)| {
                let track = self.track_at(row.tick, view, place_px)?;
                let usual_px = self.usual_px(rows.get(&(row.tick, view))?, place_px)?;
                Some((track, usual_px))
            });
            let [
                Some((first_track, first_px)),
                Some((second_track, second_px)),
            ] = found
            else {
                continue;
            };
            reference = Some(first);
            let time_s = *self.times_s.get(&row.tick)?;
            let of_tracks = seen.entry([first_track, second_track]).or_default();
            of_tracks.push(Seen {
                time_s,
                places_px: [first_px, second_px],
            });
        }
        let cameras = [self.camera(reference?)?, self.camera(view)?];
        let sightings: Vec<_> = (seen.values())
            .flat_map(|seen| sightings(cameras, seen))
            .collect();
        let offset = robust_offset(&sightings)?;
        let lag = ViewLag {
            lag_ms: -1e3 * offset.seconds,
            lag_sd_ms: (1e3 * offset.sd_s * ALIKE.sqrt()).hypot(COMMON_SD_MS),
        };
        (lag.lag_ms.abs().max(lag.lag_sd_ms) <= MOST_MS).then_some(lag)
    }

    fn camera(&self, view: &str) -> Option<&Camera> {
        let mut views = self.views.iter();
        views.find(|(id, _)| *id == view).map(|(_, camera)| *camera)
    }

    /// The track of the box that counts at a place; `None` if there is no such box.
    fn track_at(&self, tick: u32, view: &str, place_px: DVec2) -> Option<Option<u32>> {
        let boxes = &self.detections.boxes;
        let first = boxes.partition_point(|found| found.tick < tick);
        let mut here = boxes[first..].iter().take_while(|found| found.tick == tick);
        let holds = |found: &&Detection| {
            let [left, top, right, bottom] = found.pixel_box.edges();
            let DVec2 { x, y } = place_px;
            found.view == view
                && found.confirmed
                && (left..=right).contains(&x)
                && (top..=bottom).contains(&y)
        };
        here.find(holds).map(|found| found.track)
    }

    /// The place in the usual image; `None` if it is not known.
    fn usual_px(&self, row: &ViewHealth, place_px: DVec2) -> Option<DVec2> {
        match row.state {
            HealthState::Steady | HealthState::Unknown => Some(place_px),
            HealthState::Frozen => None,
            HealthState::Moved | HealthState::Shaking => {
                let turn = row
                    .motion
                    .filter(|turn| turn.shift_sd_px <= MOST_TURN_SD_PX)?;
                Some(turn.usual_place(self.camera(&row.view)?, place_px))
            }
        }
    }
}

fn sightings(cameras: [&Camera; 2], seen: &[Seen]) -> Vec<CommonSighting> {
    let places: Vec<(f64, DVec2)> = (seen.iter())
        .map(|seen| (seen.time_s, seen.places_px[1]))
        .collect();
    let mut last_s = f64::NEG_INFINITY;
    let mut sightings = Vec::new();
    for Seen { time_s, places_px } in seen {
        if *time_s < last_s + STEP_S {
            continue;
        }
        let motion = motion_at(&places, *time_s);
        if let Some(sighting) =
            motion.and_then(|px_s| CommonSighting::of(cameras, *places_px, px_s))
        {
            last_s = *time_s;
            sightings.push(sighting);
        }
    }
    sightings
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::Geodetic;
    use dataset::tables::pixel_box::PixelBox;
    use dataset::tables::registrations::Shift;
    use testkit::changi_02l;
    use testkit::rig::{VIEWS, placed};

    use super::super::pictures::ViewTick;
    use super::*;

    /// Where a view sees an aircraft on the glide path, a time after it is 18 km away.
    fn place_px(camera: &Camera, time_s: f64) -> DVec2 {
        let runway = changi_02l();
        let along_m = 18_000.0 - 75.0 * time_s;
        let height_m = along_m * 3_f64.to_radians().tan();
        let at: Geodetic = runway
            .point_on_approach(along_m, 0.0)
            .at_altitude_m(runway.threshold.altitude_msl_m + height_m);
        camera.project(at.to_ecef()).unwrap()
    }

    /// The lags of both views, of which the right one is late; `dark`: ticks in which it repeats an image.
    fn lags(late_s: f64, dark: std::ops::Range<u32>) -> [Option<ViewLag>; 2] {
        let views = VIEWS.map(|view| (view, Camera::from_pose(&placed(view), 1920, 1280)));
        let (mut boxes, mut registrations, mut health) = (Vec::new(), Vec::new(), Vec::new());
        for tick in 0..210 {
            let time_s = f64::from(tick);
            let late_s = if dark.contains(&tick) { 3.0 } else { late_s };
            let places = [
                place_px(&views[0].1, time_s),
                place_px(&views[1].1, time_s - late_s),
            ];
            for ((view, _), place) in views.iter().zip(places) {
                let pixel_box = PixelBox {
                    cx_px: place.x,
                    cy_px: place.y,
                    width_px: 30.0,
                    height_px: 12.0,
                };
                boxes.push(Detection {
                    track: Some(3),
                    confirmed: true,
                    ..Detection::untracked(tick, *view, pixel_box, 0.9, 0)
                });
                let is_frozen = *view == "right" && dark.contains(&tick);
                health.push(ViewHealth {
                    tick,
                    view: (*view).to_owned(),
                    state: if is_frozen {
                        HealthState::Frozen
                    } else {
                        HealthState::Steady
                    },
                    motion: None,
                    state_live: None,
                    lag: None,
                });
            }
            let shift_px = places[1] - places[0];
            registrations.push(Registration {
                tick,
                view: "right".into(),
                reference: "left".into(),
                result: Ok(Shift {
                    x_px: places[0].x,
                    y_px: places[0].y,
                    dx_px: shift_px.x,
                    dy_px: shift_px.y,
                    sd_x_px: 0.05,
                    sd_y_px: 0.05,
                    scale: 1.0,
                    gain: 1.0,
                    correlation: 0.9,
                }),
            });
        }
        let ticks = (0..210).map(|tick| ViewTick {
            tick,
            time_s: f64::from(tick),
            pts: 0,
        });
        let ticks: Vec<ViewTick> = ticks.collect();
        let of_views = VIEWS.map(|id| ViewTicks {
            id: id.into(),
            ticks: ticks.clone(),
        });
        let cameras = views.map(|(_, camera)| camera);
        let found = Detections::from(boxes);
        add_lags(&of_views, &cameras, &found, &registrations, &mut health);
        [health[0].lag, health[1].lag]
    }

    #[test]
    fn the_lag_of_a_flight_is_measured_and_repeated_images_do_not_count() {
        for late_s in [0.0, 0.45, -0.2] {
            let [first, second] = lags(late_s, 60..70);
            assert_eq!(first, None, "the others are compared with it");
            let ViewLag { lag_ms, lag_sd_ms } = second.unwrap();
            assert!((lag_ms - 1e3 * late_s).abs() < 20.0, "{late_s}: {lag_ms}");
            assert!((20.0..250.0).contains(&lag_sd_ms), "{lag_sd_ms}");
        }
    }
}
