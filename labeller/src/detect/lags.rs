//! Lag of each view's images behind the first view's, from the registrations of the whole flight ([`sight::lag`]).
//!
//! At any time, the aircraft is on the epipolar line of the first view's pixel in the second view. Cameras may be wrong by half a degree:
//! wrong directions, rolls and focal lengths displace the line by a linear function of the places in both images, which is fitted with the
//! lag.

use std::collections::BTreeMap;

use dataset::corpus::detections::{Detection, Detections};
use dataset::geometry::camera::Camera;
use dataset::geometry::rays::{EpipolarLine, across_sd_px};
use dataset::tables::health::{HealthState, MIN_LAG_SD_MS, ViewHealth, ViewLag};
use dataset::tables::registrations::Registration;
use glam::DVec2;
use sight::lag::{self, PLACE_TERMS, Rows, Sighting};

use super::pictures::ViewTicks;
use crate::view_health::MIN_OFF_PX;

/// Maximum lag, and maximum standard deviation of lags, ms. The motion changes too much during longer ones.
const MAX_LAG_MS: f64 = 10_000.0;
/// Minimum number of sightings.
const MIN_SIGHTINGS: usize = 40;
/// Standard deviations of what wrong cameras add to rows, pixels: a constant, and slopes over a thousand pixels, for two masts surveyed to
/// half a degree. Within a few miles of the runway, the only part visible in fog, the motion is nearly a linear function of the places.
const CAMERA_SD_PX: [f64; PLACE_TERMS] = [100.0, 12.0, 12.0, 12.0];

struct Flight<'a> {
    views: Vec<(&'a str, &'a Camera)>,
    detections: &'a Detections,
    registrations: &'a [Registration],
    times_s: BTreeMap<u32, f64>,
}

/// Adds the lags of all views.
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
        .map(|(view, _)| (*view, flight.lag_of(view, health)))
        .collect();
    for row in health {
        row.lag = lags.get(row.view.as_str()).copied().flatten();
    }
}

impl Flight<'_> {
    /// `None` if both views saw the aircraft too rarely.
    fn lag_of(&self, view: &str, health: &[ViewHealth]) -> Option<ViewLag> {
        let rows: BTreeMap<(u32, &str), &ViewHealth> = (health.iter())
            .map(|row| ((row.tick, row.view.as_str()), row))
            .collect();
        // One entry per aircraft: the tracks of both views.
        let mut seen: BTreeMap<[Option<u32>; 2], Vec<Sighting>> = BTreeMap::new();
        let mut reference = None;
        for row in self.registrations.iter().filter(|row| row.view == view) {
            let Ok(shift) = &row.result else { continue };
            let first_px = DVec2::new(shift.x_px, shift.y_px);
            let second_px = first_px + DVec2::new(shift.dx_px, shift.dy_px);
            let (first, second) = (row.reference.as_str(), row.view.as_str());
            let found = [(first, first_px), (second, second_px)].map(|(view, place_px)| {
                let seen = self.box_at(row.tick, view, place_px)?;
                let usual_px = self.usual_px(rows.get(&(row.tick, view))?, place_px)?;
                Some((seen, usual_px))
            });
            let [Some((in_first, first_px)), Some((in_second, second_px))] = found else {
                continue;
            };
            reference = Some(first);
            let time_s = *self.times_s.get(&row.tick)?;
            let of_tracks = seen.entry([in_first.track, in_second.track]);
            of_tracks.or_default().push(Sighting {
                time_s,
                taken_off_s: 0.0,
                places_px: [first_px, second_px],
                width_px: in_first.pixel_box.width_px,
                sd_px: across_sd_px(in_second.pixel_box.width_px),
            });
        }
        let cameras = [self.camera(reference?)?, self.camera(view)?];
        let rows = Rows {
            off_px: &|[first, second]| Some(EpipolarLine::of(cameras, first)?.off_px(second)),
            sd_px: CAMERA_SD_PX,
        };
        let tracks: Vec<Vec<Sighting>> = seen.into_values().collect();
        let fit = lag::constant(&tracks, &rows, 0.0);
        let fit = fit.filter(|fit| fit.sightings >= MIN_SIGHTINGS)?;
        let lag = ViewLag {
            lag_ms: 1e3 * fit.lags[0].seconds,
            lag_sd_ms: (1e3 * fit.lags[0].sd_s).hypot(MIN_LAG_SD_MS),
        };
        (lag.lag_ms.abs().max(lag.lag_sd_ms) <= MAX_LAG_MS).then_some(lag)
    }

    fn camera(&self, view: &str) -> Option<&Camera> {
        let mut views = self.views.iter();
        views.find(|(id, _)| *id == view).map(|(_, camera)| *camera)
    }

    /// The box that counts at a place; `None` if there is none.
    fn box_at(&self, tick: u32, view: &str, place_px: DVec2) -> Option<&Detection> {
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
        here.find(holds)
    }

    /// The place in the usual image; `None` if it is not known.
    fn usual_px(&self, row: &ViewHealth, place_px: DVec2) -> Option<DVec2> {
        match row.state {
            HealthState::Steady | HealthState::Unknown => Some(place_px),
            HealthState::Frozen => None,
            HealthState::Moved | HealthState::Shaking => {
                let turn = row.motion.filter(|turn| turn.shift_sd_px <= MIN_OFF_PX)?;
                Some(turn.usual_place(self.camera(&row.view)?, place_px))
            }
        }
    }
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

    /// Pixel position on the glide path, `time_s` after it is 18 km away.
    fn place_px(camera: &Camera, time_s: f64) -> DVec2 {
        let runway = changi_02l();
        let along_m = 18_000.0 - 75.0 * time_s;
        let height_m = along_m * 3_f64.to_radians().tan();
        let at: Geodetic = runway
            .point_on_approach(along_m, 0.0)
            .at_altitude_m(runway.threshold.altitude_msl_m + height_m);
        camera.project(at.to_ecef()).unwrap()
    }

    /// Health of both views; the right one is late. `dark`: ticks with a repeated image.
    fn compared(late_s: f64, dark: std::ops::Range<u32>) -> Vec<ViewHealth> {
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
                    state_live: HealthState::Steady,
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
        health
    }

    #[test]
    fn the_lag_of_a_flight_is_measured_and_repeated_images_do_not_count() {
        for late_s in [0.0, 0.45, -0.2] {
            let health = compared(late_s, 60..70);
            assert_eq!(health[0].lag, None, "the others are compared with it");
            let ViewLag { lag_ms, lag_sd_ms } = health[1].lag.unwrap();
            assert!((lag_ms - 1e3 * late_s).abs() < 20.0, "{late_s}: {lag_ms}");
            // Boxes that do not grow say less than an arrival's.
            assert!((20.0..110.0).contains(&lag_sd_ms), "{lag_sd_ms}");
        }
    }
}
