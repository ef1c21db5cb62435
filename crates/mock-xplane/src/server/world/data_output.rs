//! Rows of X-Plane's data output table, out and in.

use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use xplane_bridge::datarefs as names;
use xplane_bridge::packet::{DataRow, LEAVE_ALONE};

use super::aircraft::POSITION;
use super::{RUNNING_TIME_S, World};

/// Times.
const TIMES: i32 = 1;
/// Speeds, knots.
const SPEEDS: i32 = 3;
/// Gear and brakes.
const GEAR: i32 = 14;
/// Angular velocities: pitch, roll, yaw, radians per second.
const RATES: i32 = 16;
/// Pitch, roll, true heading, degrees.
const ATTITUDE: i32 = 17;
/// Latitude, longitude, height above the sea and above ground in feet.
const PLACE: i32 = 20;
/// Local position and velocity, metres.
const LOCAL: i32 = 21;
/// Value of unused columns.
const UNUSED: f64 = LEAVE_ALONE as f64;

impl World {
    /// The rows that the stand-in has.
    pub(in crate::server) fn data_rows(&self) -> Vec<DataRow> {
        let at = |name: &str| self.state.datarefs.get(&format!("{POSITION}{name}"));
        let get = |name: &str| self.state.datarefs.get(name);
        let knots = |speed_mps: f64| speed_mps / MPS_PER_KNOT;
        let feet = |height_m: f64| height_m / METERS_PER_FOOT;
        let hours = |time_s: f64| time_s / 3_600.0;
        let airspeed_kt = knots(at("true_airspeed"));
        let rows: [(i32, &[f64]); 7] = [
            (
                TIMES,
                &[
                    get(RUNNING_TIME_S),
                    get(RUNNING_TIME_S),
                    UNUSED,
                    UNUSED,
                    UNUSED,
                    hours(get(names::ZULU_TIME_S)),
                    hours(get("sim/time/local_time_sec")),
                ],
            ),
            (
                SPEEDS,
                &[
                    airspeed_kt,
                    airspeed_kt,
                    airspeed_kt,
                    knots(at("groundspeed")),
                ],
            ),
            (GEAR, &[get("sim/flightmodel2/gear/deploy_ratio")]),
            (RATES, &[at("Q"), at("P"), at("R")].map(f64::to_radians)),
            (ATTITUDE, &[at("theta"), at("phi"), at("psi")]),
            (
                PLACE,
                &[
                    at("latitude"),
                    at("longitude"),
                    feet(at("elevation")),
                    feet(at("y_agl")),
                ],
            ),
            (
                LOCAL,
                &[
                    "local_x", "local_y", "local_z", "local_vx", "local_vy", "local_vz",
                ]
                .map(at),
            ),
        ];
        rows.into_iter()
            .map(|(index, known)| {
                let mut values = [LEAVE_ALONE; 8];
                for (value, known) in values.iter_mut().zip(known) {
                    *value = *known as f32;
                }
                DataRow { index, values }
            })
            .collect()
    }

    /// A client sets values of a row; returns whether it is settable.
    pub(in crate::server) fn set_data_row(&mut self, row: &DataRow) -> bool {
        let names: &[&str] = match row.index {
            GEAR => &["sim/cockpit2/controls/gear_handle_down"],
            ATTITUDE => &[
                "sim/flightmodel/position/theta",
                "sim/flightmodel/position/phi",
                "sim/flightmodel/position/psi",
            ],
            _ => return false,
        };
        for (name, &value) in names.iter().zip(&row.values) {
            if value != LEAVE_ALONE && self.write(name, value).is_err() {
                return false;
            }
        }
        true
    }
}
