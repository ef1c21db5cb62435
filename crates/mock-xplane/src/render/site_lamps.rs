//! Fixed lamps: runway edge lights, red end lights, ships' lights, a city on the islands.

use glam::{DVec3, Vec3};

use crate::render::air::Air;
use crate::render::ground::{Ground, ISLANDS_M};
use crate::render::lamps::Spot;
use crate::render::noise::unit_hash;
use crate::render::tone::Tone;
use crate::render::view::View;

/// Spacing of edge lights, metres (ICAO Annex 14).
const EDGE_SPACING_M: f64 = 60.0;
/// Windows and street lamps on the islands.
const CITY_LAMPS: u32 = 160;

const WARM: Vec3 = Vec3::new(1.25, 0.95, 0.55);
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

/// A lamp between foot and ridge of an island, if there is one in its direction.
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

/// Image of a lamp of some candela.
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
