//! Lag between two cameras' images, from an aircraft that both see.
//!
//! At any time, the aircraft is on the epipolar line of the first view's pixel in the second view. An image taken at a different time shows
//! it off the line by its motion across the line. That motion is mostly vertical: almost none on the glide path far out, two pixels per
//! second in level flight and near the runway. So the distance from the line is linear in the motion, and the lag is the slope. Along the
//! line, lag and displacement cannot be distinguished.
//!
//! Cameras may be wrong by half a degree: wrong directions, rolls and focal lengths displace the line by a linear function of the places in
//! both images, which is fitted with the lag.

use dataset::geometry::camera::Camera;
use dataset::geometry::rays::{EpipolarLine, across_sd_px};
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::deviation_from_zero;
use glam::DVec2;

/// Constant, and change with column and row in the first view and with the columns between the views; the lag.
const UNKNOWNS: usize = 5;
const OF_PLACES: std::ops::Range<usize> = 1..4;
const LAG: usize = 4;
/// Unit of the places in the fit, px.
const UNIT_PX: f64 = 1_000.0;
/// Weight of zero slopes. Wrong cameras displace lines by 12 px in 1,000 (standard deviation): two masts surveyed to half a degree. Within
/// a few miles of the runway, the only part visible in fog, the motion is nearly a linear function of the places, and its errors would turn
/// half of the lag into a camera error.
const PRIOR_WEIGHT: f64 = 7e-3;
/// Minimum number of sightings.
const MIN_SIGHTINGS: usize = 40;
/// Residual with half the weight, in standard deviations, and number of rounds.
const CAUCHY: f64 = 2.5;
const ROUNDS: usize = 20;

/// An aircraft that two cameras see, in images whose times are the same as far as is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CommonSighting {
    row: [f64; UNKNOWNS],
    /// Distance from the line in the second view, and its usual standard deviation.
    off_px: f64,
    sd_px: f64,
}

impl CommonSighting {
    /// From places in both images, width, and motion per second in the second view; `None` without an epipolar line.
    pub(crate) fn of(
        cameras: [&Camera; 2],
        places_px: [DVec2; 2],
        width_px: f64,
        motion_px_s: DVec2,
    ) -> Option<Self> {
        let [first, second] = places_px;
        let line = EpipolarLine::of(cameras, first)?;
        let (x, y) = (first.x / UNIT_PX, first.y / UNIT_PX);
        let apart = (second.x - first.x) / UNIT_PX;
        Some(Self {
            row: [1.0, x, y, apart, line.across.dot(motion_px_s)],
            off_px: line.off_px(second),
            sd_px: across_sd_px(width_px),
        })
    }

    fn off_px_by(&self, unknowns: &[f64; UNKNOWNS]) -> f64 {
        let terms = self.row.iter().zip(unknowns);
        self.off_px - terms.map(|(factor, unknown)| factor * unknown).sum::<f64>()
    }
}

/// Normal equations of the relation, with the prior for the cameras' errors.
fn with_prior() -> NormalEquations {
    let mut normal = NormalEquations::new(UNKNOWNS);
    for unknown in OF_PLACES {
        let mut row = [0.0; UNKNOWNS];
        row[unknown] = 1.0;
        normal.add(&row, 0.0, PRIOR_WEIGHT);
    }
    normal
}

/// Relation of places in two views, as most sightings have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewRelation {
    /// Time difference, added to the second view's times, s: negative for late images.
    pub(crate) offset_s: f64,
    pub(crate) offset_sd_s: f64,
    /// Standard deviation of the distances from the line that it leaves, pixels.
    pub(crate) sd_px: f64,
    unknowns: [f64; UNKNOWNS],
}

impl ViewRelation {
    pub(crate) fn robust(sightings: &[CommonSighting]) -> Option<Self> {
        if sightings.len() < MIN_SIGHTINGS {
            return None;
        }
        let mut weights = vec![1.0; sightings.len()];
        let mut relation: Option<Self> = None;
        for _ in 0..ROUNDS {
            let mut normal = with_prior();
            for (sighting, weight) in sightings.iter().zip(&weights) {
                let weight = weight * sighting.sd_px.powi(-2);
                normal.add(&sighting.row, sighting.off_px, weight);
            }
            let unknowns: [f64; UNKNOWNS] = normal.solve_for()?;
            let off_px = |sighting: &CommonSighting| sighting.off_px_by(&unknowns);
            let off = |sighting: &CommonSighting| off_px(sighting) / sighting.sd_px;
            // Errors that are larger than usual count, smaller ones may be chance.
            let excess = deviation_from_zero(sightings.iter().map(off)).max(1.0);
            for (sighting, weight) in sightings.iter().zip(&mut weights) {
                *weight = 1.0 / (1.0 + (off(sighting) / (CAUCHY * excess)).powi(2));
            }
            let offset_s = unknowns[LAG];
            let offset_sd_s = excess * normal.inverse()?[LAG][LAG].sqrt();
            if !(offset_s.is_finite() && offset_sd_s.is_finite()) {
                return None;
            }
            relation = Some(Self {
                offset_s,
                offset_sd_s,
                sd_px: deviation_from_zero(sightings.iter().map(off_px)),
                unknowns,
            });
        }
        relation
    }

    /// Signed distance from the expected line in the second view, px down.
    pub(crate) fn off_px(&self, sighting: &CommonSighting) -> f64 {
        sighting.off_px_by(&self.unknowns)
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::Geodetic;
    use glam::{DMat3, DVec3};
    use testkit::changi_02l;
    use testkit::rig::{VIEWS, placed};

    use super::*;

    const LEVEL_M: f64 = 900.0;
    const SPEED_MPS: f64 = 75.0;

    /// The aircraft a time after it is 24 km from the target: level, then on the glide path.
    fn place_m(time_s: f64) -> DVec3 {
        let runway = changi_02l();
        let along_m = 24_000.0 - SPEED_MPS * time_s;
        let height_m = LEVEL_M.min(along_m * 3_f64.to_radians().tan());
        let altitude_m = runway.threshold.altitude_msl_m + height_m;
        let at: Geodetic = runway
            .point_on_approach(along_m, 0.0)
            .at_altitude_m(altitude_m);
        at.to_ecef()
    }

    /// An arrival whose second view has a clock that is slow by this much, by cameras that are rolled apart by some degrees.
    fn sightings(offset_s: f64, roll_deg: f64) -> Vec<CommonSighting> {
        sightings_at(0..560, offset_s, roll_deg, 0.0)
    }

    /// Sightings in some half seconds, with motion errors up to this, px/s.
    fn sightings_at(
        half_seconds: std::ops::Range<u32>,
        offset_s: f64,
        roll_deg: f64,
        motion_px_s: f64,
    ) -> Vec<CommonSighting> {
        let [left, right] = VIEWS.map(|view| Camera::from_pose(&placed(view), 1920, 1280));
        let rolled = |camera: Camera, roll_deg: f64| Camera {
            ecef_from_camera: camera.ecef_from_camera
                * DMat3::from_rotation_z(roll_deg.to_radians()),
            ..camera
        };
        let stated = [rolled(left, roll_deg), rolled(right, -roll_deg)];
        let sighting = |tick: u32| {
            let flown_s = f64::from(tick) / 2.0;
            let seen = |later_s: f64| {
                right
                    .project(place_m(flown_s + offset_s + later_s))
                    .unwrap()
            };
            let noise = |phase: f64| 0.14 * (f64::from(tick) * 12.9898 + phase).sin();
            let there = seen(0.0) + DVec2::new(noise(0.3) + 1.5, noise(1.7) - 0.8);
            let here = left.project(place_m(flown_s)).unwrap();
            let error = motion_px_s * (f64::from(tick) * 78.233 + 0.7).sin();
            let motion = (seen(0.1) - seen(-0.1)) / 0.2 + DVec2::new(0.0, error);
            CommonSighting::of([&stated[0], &stated[1]], [here, there], 20.0, motion).unwrap()
        };
        half_seconds.map(sighting).collect()
    }

    #[test]
    fn an_arrival_with_a_level_segment_tells_the_offset_of_the_clocks_also_by_rolled_cameras() {
        for (offset_s, roll_deg) in [(-0.3, 0.0), (0.0, 0.0), (0.5, 0.0), (0.5, 1.0)] {
            let sightings = sightings(offset_s, roll_deg);
            let found = ViewRelation::robust(&sightings).unwrap();
            let error_s = found.offset_s - offset_s;
            assert!(error_s.abs() < 0.02, "{offset_s} {roll_deg}: {found:?}");
            assert!(
                error_s.abs() < 3.0 * found.offset_sd_s,
                "{offset_s}: {found:?}"
            );
            assert!(found.offset_sd_s < 0.03, "{offset_s}: {found:?}");
        }
    }

    #[test]
    fn in_fog_the_last_four_miles_show_half_of_a_lag_although_the_motion_is_known_badly() {
        for roll_deg in [0.0, 0.25] {
            // To 1.1 km.
            let near = sightings_at(442..610, -0.5, roll_deg, 0.3);
            let found = ViewRelation::robust(&near).unwrap();
            assert!(
                (-0.6..-0.2).contains(&found.offset_s),
                "{roll_deg}: {found:?}"
            );
        }
    }

    #[test]
    fn sightings_of_something_else_hardly_change_the_robust_offset() {
        let mut sightings = sightings(0.5, 0.0);
        for sighting in sightings.iter_mut().step_by(7) {
            sighting.off_px += 30.0;
        }
        let relation = ViewRelation::robust(&sightings).unwrap();
        assert!((relation.offset_s - 0.5).abs() < 0.03, "{relation:?}");
        let off_px = relation.off_px(&sightings[7]);
        assert!((off_px - 30.0).abs() < 1.0, "{off_px}");
        assert!(relation.off_px(&sightings[8]).abs() < 1.0);
    }

    #[test]
    fn too_little_is_said_to_be_unknown() {
        assert_eq!(ViewRelation::robust(&sightings(0.0, 0.0)[..39]), None);
    }
}
