//! Landing gear: a nose leg that swings forward and main legs that swing inward.

use glam::{DMat3, DVec3};

use crate::{Material, Mesh, frame::Frame, solid::add_revolution};

/// Distance of the lowest point of the 737's extended wheels below the centre of gravity, metres. All wheels reach it.
pub const WHEEL_HEIGHT_BELOW_CG_M: f64 = 3.2;

/// Even, so that one point of every tyre lies exactly at the bottom.
const TYRE_SEGMENTS: usize = 20;
const LEG_SEGMENTS: usize = 8;

/// Leg with two wheels on each axle.
pub(crate) struct Leg {
    pub(crate) hinge: DVec3,
    /// Axis about which retraction turns the leg, by the right-hand rule.
    pub(crate) hinge_axis: DVec3,
    pub(crate) wheel_radius_m: f64,
    pub(crate) wheel_width_m: f64,
    /// Lateral offset of each wheel's centre.
    pub(crate) half_track_m: f64,
    pub(crate) leg_radius_m: f64,
    pub(crate) axles: u32,
}

/// Distance between the axles of a bogie, wheel diameters: 777 (1.45 m, wheels of 1.32 m), A330 (1.98 m, wheels of 1.40 m).
const AXLE_SPACING: f64 = 1.25;

/// The legs of the 737.
pub(crate) fn legs(frame: &Frame) -> [Leg; 3] {
    let main = |side: f64| Leg {
        hinge: frame.at(19.6, side * 2.86, 1.10),
        hinge_axis: DVec3::X * side,
        wheel_radius_m: 0.565,
        wheel_width_m: 0.40,
        half_track_m: 0.43,
        leg_radius_m: 0.14,
        axles: 1,
    };
    let nose = Leg {
        hinge: frame.at(4.0, 0.0, 1.10),
        hinge_axis: DVec3::Y,
        wheel_radius_m: 0.345,
        wheel_width_m: 0.20,
        half_track_m: 0.21,
        leg_radius_m: 0.10,
        axles: 1,
    };
    [nose, main(1.0), main(-1.0)]
}

/// Adds legs whose wheels reach `ground_m` below the centre of gravity when they are down.
pub(crate) fn add(mesh: &mut Mesh, legs: &[Leg; 3], ground_m: f64, gear_ratio: f64) {
    // Retracted gear is behind closed doors.
    if gear_ratio > 0.0 {
        for leg in legs {
            leg.add(mesh, ground_m, gear_ratio);
        }
    }
}

impl Leg {
    fn add(&self, mesh: &mut Mesh, ground_m: f64, gear_ratio: f64) {
        let swing = DMat3::from_axis_angle(
            self.hinge_axis,
            (1.0 - gear_ratio) * std::f64::consts::FRAC_PI_2,
        );
        let to_axle_m = ground_m - self.wheel_radius_m - self.hinge.z;
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
        let wheels = (0..self.axles).flat_map(|axle| [(axle, 1.0), (axle, -1.0)]);
        for (axle, side) in wheels {
            let from_middle = f64::from(axle) - f64::from(self.axles - 1) / 2.0;
            let middle = self.hinge
                + down * to_axle_m
                + across * (side * self.half_track_m)
                + ahead * (from_middle * AXLE_SPACING * 2.0 * self.wheel_radius_m);
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
