//! Fixed lamps: runway edge lights, red end lights, approach lights, ships' lights, a city on the islands.

use glam::{DVec3, Vec3};

use crate::render::air::Air;
use crate::render::backdrop::ground::{Ground, ISLANDS_M};
use crate::render::backdrop::noise::unit_hash;
use crate::render::imaging::tone::Tone;
use crate::render::lamps::Spot;
use crate::render::view::View;

/// Spacing of edge lights, metres (ICAO Annex 14).
const EDGE_SPACING_M: f64 = 60.0;
/// Approach lights of category I (ICAO Annex 14): bars of five lamps, 4 m wide, every 30 m out to 900 m, and a crossbar of 30 m at 300 m.
const BARS: u32 = 30;
const BAR_SPACING_M: f64 = 30.0;
const CROSSBAR: u32 = 10;
/// They shine towards the approach, within this angle of their axis, radians, and three degrees up.
const BEAM_RAD: f64 = 0.26;
const BEAM_UP: f64 = 0.052;
/// Windows and street lamps on the islands.
const CITY_LAMPS: u32 = 160;

const WARM: Vec3 = Vec3::new(1.25, 0.95, 0.55);
const WHITE: Vec3 = Vec3::new(1.05, 1.0, 0.85);
const RED: Vec3 = Vec3::new(1.0, 0.06, 0.03);

/// All lamps of the site inside the image.
pub(crate) fn spots(view: &View, air: &Air, tone: &Tone, ground: &Ground) -> Vec<Spot> {
    let mut lamps: Vec<(DVec3, Vec3)> = Vec::new();
    let on_field = |past_threshold_m: f64, right_m: f64| {
        view.at_height(
            view.on_runway(past_threshold_m - view.threshold_before_target_m, right_m),
            view.ground_msl_m + 0.5,
        )
    };
    let edges = (ground.pavement.length_m / EDGE_SPACING_M) as u32;
    for i in 0..=edges {
        for side in [-1.0, 1.0] {
            lamps.push((
                on_field(
                    f64::from(i) * EDGE_SPACING_M,
                    side * (ground.pavement.half_width_m + 1.5),
                ),
                WARM * 60.0,
            ));
        }
    }
    // From behind, the green lights of the threshold are the red ones of the opposite runway's end.
    lamps.extend((-5..=5).map(|i| (on_field(-2.0, f64::from(i) * 5.5), RED * 40.0)));
    for bar in 1..=BARS {
        let before_m = f64::from(bar) * BAR_SPACING_M;
        let half = if bar == CROSSBAR { 15 } else { 2 };
        let places = (-half..=half).map(|i| on_field(-before_m, f64::from(i)));
        lamps.extend(places.filter_map(|place| Some((place, WHITE * beam_candela(view, place)?))));
    }
    lamps.extend(
        ground
            .ships
            .iter()
            .map(|ship| (ship.position_m + DVec3::Z * 12.0, WARM * 120.0)),
    );
    lamps.extend((0..CITY_LAMPS).filter_map(|i| city_lamp(view, ground, i)));

    lamps
        .into_iter()
        .filter_map(|(position_m, candela)| spot(view, air, tone, position_m, candela))
        .filter(|spot| {
            let (w, h) = (
                f64::from(view.camera.width_px),
                f64::from(view.camera.height_px),
            );
            (-50.0..w + 50.0).contains(&spot.pixel.x) && (-50.0..h + 50.0).contains(&spot.pixel.y)
        })
        .collect()
}

/// Approach light intensity towards the camera, candela; `None` outside its beam.
fn beam_candela(view: &View, lamp_m: DVec3) -> Option<f32> {
    const BRIGHTEST_CD: f64 = 20_000.0;
    let axis = (DVec3::Z * BEAM_UP - view.course).normalize();
    let off_rad = axis.angle_between(view.position_m - lamp_m);
    // A tenth at the beam's edge.
    let part = (-std::f64::consts::LN_10 * (off_rad / BEAM_RAD).powi(2)).exp();
    (off_rad < 2.0 * BEAM_RAD).then_some((BRIGHTEST_CD * part) as f32)
}

/// A lamp between an island's foot and ridge, if there is an island in its direction.
fn city_lamp(view: &View, ground: &Ground, i: u32) -> Option<(DVec3, Vec3)> {
    let before = (-view.course).truncate();
    let aside = (f64::from(unit_hash(i, 1, 9)) - 0.5) * 1.2;
    let direction = glam::DVec2::from_angle(aside).rotate(before);
    let ridge_rad = ground.island_elevation_rad(direction.extend(0.0));
    let ridge_m = view.position_m + (direction * ISLANDS_M).extend(ridge_rad * ISLANDS_M);
    let foot_msl_m = ground.horizon_msl_m();
    let height_msl_m =
        foot_msl_m + (view.height_msl_m(ridge_m) - foot_msl_m) * f64::from(unit_hash(i, 2, 9));
    let place = view.at_height(ridge_m.truncate(), height_msl_m);
    // Below the horizon it would shine through the water.
    let visible = view
        .distances_to_height(
            (place - view.position_m).normalize(),
            ground.horizon_msl_m(),
        )
        .is_none();
    visible.then(|| (place, WARM * (100.0 + 900.0 * unit_hash(i, 3, 9).powi(3))))
}

/// Image of a lamp with this intensity.
pub(crate) fn spot(
    view: &View,
    air: &Air,
    tone: &Tone,
    position_m: DVec3,
    candela: Vec3,
) -> Option<Spot> {
    let distance_m = position_m.distance(view.position_m);
    let pixel = view.project(position_m)?;
    let per_pixel = f64::from(air.transmittance(distance_m))
        / (distance_m * distance_m * view.pixel_solid_angle_sr());
    Some(Spot {
        pixel,
        energy: tone.expose(candela * per_pixel as f32),
    })
}

#[cfg(test)]
mod tests {
    use dataset::geometry::camera::{Camera, CameraPose};
    use dataset::geometry::geodesy::Geodetic;
    use dataset::geometry::pose::Pose;

    use super::*;
    use crate::render::air::beta_per_m;
    use crate::render::light::Light;
    use crate::render::tests::{changi_02l, clear, clock_at_local};

    /// A camera on the centreline that looks along the course, or back.
    fn camera(along_track_m: f64, looks_back: bool) -> Camera {
        let runway = changi_02l();
        let place = runway.point_on_approach(along_track_m, 0.0);
        let pose = Pose {
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            altitude_msl_m: 100.0,
            heading_true_deg: runway.course_true_deg + if looks_back { 180.0 } else { 0.0 },
            pitch_deg: -2.0,
            roll_deg: 0.0,
        };
        let hfov_deg = 20.0;
        Camera::from_pose(&CameraPose { pose, hfov_deg }, 320, 192)
    }

    #[test]
    fn approach_lights_shine_towards_the_approach_and_not_to_cameras_behind_the_threshold() {
        let runway = changi_02l();
        let lamp_of = |view: &View| {
            view.at_height(
                view.on_runway(-300.0 - view.threshold_before_target_m, 0.0),
                view.ground_msl_m,
            )
        };
        let ahead = View::new(&camera(3_000.0, false), &runway);
        let behind = View::new(&camera(-1_500.0, true), &runway);
        assert!(beam_candela(&ahead, lamp_of(&ahead)).unwrap() > 15_000.0);
        assert_eq!(beam_candela(&behind, lamp_of(&behind)), None);
    }

    #[test]
    fn at_night_their_bars_lie_before_the_threshold() {
        let (camera, runway) = (camera(3_000.0, false), changi_02l());
        let view = View::new(&camera, &runway);
        let beta_per_m = beta_per_m(40_000.0);
        let position = Geodetic::from_ecef(camera.center_ecef_m);
        let light = Light::new(position, &clock_at_local(2.0), &clear(), beta_per_m);
        let air = Air::new(beta_per_m, light);
        let ground = Ground::new(&view, &runway, &air, &light, 0.0);
        let lamps = spots(&view, &air, &Tone::for_horizon(1e-3), &ground);
        let around = |past_threshold_m: f64| {
            let place = view.at_height(
                view.on_runway(past_threshold_m - view.threshold_before_target_m, 0.0),
                view.ground_msl_m + 0.5,
            );
            let pixel = view.project(place).unwrap();
            let near = lamps.iter().filter(|spot| spot.pixel.distance(pixel) < 1.0);
            near.count()
        };
        assert!(around(-300.0) > 5 && around(-600.0) > 0);
        assert_eq!(around(300.0), 0);
    }
}
