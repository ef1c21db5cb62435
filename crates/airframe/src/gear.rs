//! Landing gear: a nose leg that swings forward and two main legs that swing inward.

use glam::{DMat3, DVec3};

use crate::{Material, Mesh, at, solid::add_revolution};

/// Distance of the lowest point of the extended wheels below the centre of gravity, metres. All wheels reach it.
pub const WHEEL_HEIGHT_BELOW_CG_M: f64 = 3.2;

/// Even, so that one point of every tyre lies exactly at the bottom.
const TYRE_SEGMENTS: usize = 20;
const LEG_SEGMENTS: usize = 8;

/// Leg with two wheels.
struct Leg {
    hinge: DVec3,
    /// Axis about which retraction turns the leg, by the right-hand rule.
    hinge_axis: DVec3,
    wheel_radius_m: f64,
    wheel_width_m: f64,
    /// Lateral offset of each wheel's centre.
    half_track_m: f64,
    leg_radius_m: f64,
}

fn legs() -> [Leg; 3] {
    let main = |side: f64| Leg {
        hinge: at(19.6, side * 2.86, 1.10),
        hinge_axis: DVec3::X * side,
        wheel_radius_m: 0.565,
        wheel_width_m: 0.40,
        half_track_m: 0.43,
        leg_radius_m: 0.14,
    };
    let nose = Leg {
        hinge: at(4.0, 0.0, 1.10),
        hinge_axis: DVec3::Y,
        wheel_radius_m: 0.345,
        wheel_width_m: 0.20,
        half_track_m: 0.21,
        leg_radius_m: 0.10,
    };
    [nose, main(1.0), main(-1.0)]
}

pub(crate) fn add(mesh: &mut Mesh, gear_ratio: f64) {
    // Retracted gear is behind closed doors.
    if gear_ratio > 0.0 {
        for leg in legs() {
            leg.add(mesh, gear_ratio);
        }
    }
}

impl Leg {
    fn add(&self, mesh: &mut Mesh, gear_ratio: f64) {
        let swing = DMat3::from_axis_angle(
            self.hinge_axis,
            (1.0 - gear_ratio) * std::f64::consts::FRAC_PI_2,
        );
        let to_axle_m = WHEEL_HEIGHT_BELOW_CG_M - self.wheel_radius_m - self.hinge.z;
        let (down, across, ahead) = (swing * DVec3::Z, swing * DVec3::Y, swing * DVec3::X);
        let r = self.leg_radius_m;
        let strut = [
            (-0.2, r),
            (0.55 * to_axle_m, r),
            (0.55 * to_axle_m, 0.7 * r),
            (to_axle_m, 0.7 * r),
        ];
        add_revolution(mesh, self.hinge, down, across, LEG_SEGMENTS, &strut, |_| {
            Material::Leg
        });
        for side in [1.0, -1.0] {
            let middle = self.hinge + down * to_axle_m + across * (side * self.half_track_m);
            let (half, radius) = (self.wheel_width_m / 2.0, self.wheel_radius_m);
            let tyre = [
                (-0.95 * half, 0.55 * radius),
                (-half, 0.88 * radius),
                (-0.5 * half, radius),
                (0.5 * half, radius),
                (half, 0.88 * radius),
                (0.95 * half, 0.55 * radius),
            ];
            add_revolution(
                mesh,
                middle,
                across * side,
                ahead,
                TYRE_SEGMENTS,
                &tyre,
                |ring| {
                    if ring == 0 || ring == 4 {
                        Material::Leg
                    } else {
                        Material::Tyre
                    }
                },
            );
        }
    }
}
