//! The simulated world: datarefs, the aircraft, the clock, and whether all of it is frozen.

use std::time::{SystemTime, UNIX_EPOCH};

use chrono::{DateTime, Datelike, Timelike, Utc};
use dataset::conditions::{Clock, Weather};
use dataset::pose::{Controls, FlightState, Pose};
use dataset::runway::Runway;
use xplane_bridge::datarefs as names;
use xplane_bridge::fly::FlyRequest;
use xplane_bridge::packet::{PlaceAircraft, PlaceAtStart, Position};

use crate::datarefs::{Datarefs, Ignored};

/// Where the aircraft stands before anybody moves it: the threshold of WSSS 02L, with its wheels on the ground.
const PARKED: Pose = Pose {
    latitude_deg: 1.348_971_96,
    longitude_deg: 103.977_501_24,
    altitude_msl_m: GROUND_MSL_M + airframe::WHEEL_HEIGHT_BELOW_CG_M,
    heading_true_deg: 23.02,
    pitch_deg: 0.0,
    roll_deg: 0.0,
};
/// The stand-in's earth is as high as WSSS 02L everywhere.
const GROUND_MSL_M: f64 = 6.71;
/// Kind of `PREL` start that gives a position.
const START_AT_POSITION: i32 = 6;
const SECONDS_PER_DAY: f64 = 86_400.0;
const PAUSED: &str = "sim/time/paused";

/// Everything that has a state.
#[derive(Debug)]
pub(super) struct World {
    datarefs: Datarefs,
    aircraft: FlightState,
    /// The runway of the scenario while frozen.
    frozen: Option<Runway>,
    drawn_frames: u64,
}

impl Default for World {
    fn default() -> Self {
        let mut world = Self {
            datarefs: Datarefs::default(),
            aircraft: at_rest(PARKED),
            frozen: None,
            drawn_frames: 0,
        };
        world.publish_aircraft();
        world.follow_system_clock();
        world
    }
}

impl World {
    /// Makes the capture link known to clients.
    pub(super) fn publish_capture_port(&mut self, port: u16) {
        self.datarefs.set(names::CAPTURE_PORT, f64::from(port));
    }

    /// A dataref as RREF carries it.
    pub(super) fn read(&self, path: &str) -> f32 {
        self.datarefs.read(path)
    }

    /// A client's write.
    pub(super) fn write(&mut self, path: &str, value: f32) -> Result<(), Ignored> {
        self.datarefs.write(path, value)?;
        if path.starts_with("sim/flightmodel/position/") {
            self.take_over_attitude();
        }
        Ok(())
    }

    /// A client's command; says whether it has any effect here.
    pub(super) fn command(&mut self, path: &str) -> bool {
        let (dataref, value) = match path {
            names::COMMAND_PAUSE_ON => (PAUSED, 1.0),
            names::COMMAND_PAUSE_OFF => (PAUSED, 0.0),
            names::COMMAND_SERVOS_ON => (names::AUTOPILOT_MODE, 2.0),
            "sim/autopilot/servos_off" => (names::AUTOPILOT_MODE, 0.0),
            "sim/autopilot/autothrottle_on" => ("sim/cockpit/autopilot/autothrottle_enabled", 1.0),
            "sim/autopilot/NAV" => ("sim/cockpit2/autopilot/nav_status", 1.0),
            "sim/autopilot/glide_slope" => ("sim/cockpit2/autopilot/glideslope_status", 1.0),
            "sim/autopilot/approach" => ("sim/cockpit2/autopilot/approach_status", 1.0),
            // The stand-in's weather is always as its datarefs say.
            names::COMMAND_REGENERATE_WEATHER => return true,
            _ => return false,
        };
        self.datarefs.set(dataref, value);
        true
    }

    /// Lets `elapsed_s` of time pass.
    pub(super) fn advance(&mut self, elapsed_s: f64) {
        self.add("sim/time/total_running_time_sec", elapsed_s);
        if self.frozen.is_some() {
            return;
        }
        if self.datarefs.get(names::USE_SYSTEM_TIME) != 0.0 {
            self.follow_system_clock();
        } else if self.datarefs.get(PAUSED) == 0.0 {
            let zulu_s = self.datarefs.get(names::ZULU_TIME_S) + elapsed_s;
            self.datarefs
                .set(names::ZULU_TIME_S, zulu_s.rem_euclid(SECONDS_PER_DAY));
        }
    }

    /// `VEHX`, `VEHS`: moves the aircraft, and stops the flight model for the first of them.
    pub(super) fn place(&mut self, place: &PlaceAircraft) {
        if place.freeze {
            self.datarefs.set(names::OVERRIDE_FLIGHT_MODEL, 1.0);
        }
        self.put_at(Pose {
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            altitude_msl_m: place.elevation_msl_m,
            heading_true_deg: f64::from(place.heading_true_deg),
            pitch_deg: f64::from(place.pitch_deg),
            roll_deg: f64::from(place.roll_deg),
        });
    }

    /// `PREL`: begins a flight at a position; says whether this kind of start is known here.
    pub(super) fn start(&mut self, start: &PlaceAtStart) -> bool {
        if start.start_type == START_AT_POSITION {
            self.put_at(Pose {
                latitude_deg: start.latitude_deg,
                longitude_deg: start.longitude_deg,
                altitude_msl_m: start.elevation_msl_m,
                heading_true_deg: start.heading_true_deg,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            });
            let (sin, cos) = start.heading_true_deg.to_radians().sin_cos();
            self.aircraft.velocity_north_mps = start.speed_mps * cos;
            self.aircraft.velocity_east_mps = start.speed_mps * sin;
            self.aircraft.true_airspeed_mps = start.speed_mps;
            self.publish_aircraft();
        }
        start.start_type == START_AT_POSITION
    }

    /// What `RPOS` says.
    pub(super) fn position(&self) -> Position {
        let FlightState { pose, .. } = &self.aircraft;
        Position {
            longitude_deg: pose.longitude_deg,
            latitude_deg: pose.latitude_deg,
            elevation_msl_m: pose.altitude_msl_m,
            height_agl_m: self.height_above_ground_m() as f32,
            pitch_deg: pose.pitch_deg as f32,
            heading_true_deg: pose.heading_true_deg as f32,
            roll_deg: pose.roll_deg as f32,
            velocity_east_mps: self.aircraft.velocity_east_mps as f32,
            velocity_up_mps: -self.aircraft.velocity_down_mps as f32,
            velocity_south_mps: -self.aircraft.velocity_north_mps as f32,
            roll_rate_rad_s: 0.0,
            pitch_rate_rad_s: 0.0,
            yaw_rate_rad_s: 0.0,
        }
    }

    /// The weather as the datarefs have it: what clients wrote is what is flown and drawn.
    pub(super) fn weather(&self) -> Weather {
        names::weather_from_datarefs(|path| self.datarefs.read(path))
    }

    /// The clock as the datarefs have it.
    pub(super) fn clock(&self) -> Clock {
        names::clock_from_datarefs(|path| self.datarefs.read(path))
    }

    /// Stops flight model, clock and clouds.
    pub(super) fn freeze(&mut self, runway: Runway) {
        self.datarefs.set(names::OVERRIDE_FLIGHT_MODEL, 1.0);
        self.frozen = Some(runway);
    }

    /// Lets everything run again.
    pub(super) fn release(&mut self) {
        self.datarefs.set(names::OVERRIDE_FLIGHT_MODEL, 0.0);
        self.frozen = None;
    }

    /// The runway while frozen.
    pub(super) fn frozen_runway(&self) -> Option<&Runway> {
        self.frozen.as_ref()
    }

    /// Refuses a flight that X-Plane's autopilot could not fly: it must be engaged, with the receiver on the landing system.
    pub(super) fn check_autopilot(&self, request: &FlyRequest) -> Result<(), String> {
        let mode = self.datarefs.get(names::AUTOPILOT_MODE);
        if mode != 2.0 {
            return Err(format!(
                "the autopilot is off ({} is {mode}, expected 2)",
                names::AUTOPILOT_MODE
            ));
        }
        let tuned = self.datarefs.get(names::NAV1_FREQUENCY);
        match request
            .runway
            .ils_frequency_mhz
            .map(names::nav_frequency_10khz)
        {
            Some(wanted) if wanted != tuned => Err(format!(
                "the landing system of {} {} is not tuned ({} is {tuned}, expected {wanted})",
                request.runway.airport,
                request.runway.name,
                names::NAV1_FREQUENCY
            )),
            _ => Ok(()),
        }
    }

    /// Shows the aircraft in a state of a flight.
    pub(super) fn show(&mut self, state: FlightState) {
        self.aircraft = state;
        self.publish_aircraft();
    }

    /// Poses the aircraft for a picture and returns the number of the frame that shows it.
    pub(super) fn pose_for_frame(&mut self, pose: Pose, controls: Controls) -> u64 {
        self.show(FlightState {
            controls,
            ..at_rest(pose)
        });
        self.drawn_frames += 1;
        self.drawn_frames
    }

    fn put_at(&mut self, pose: Pose) {
        self.show(FlightState {
            controls: self.aircraft.controls,
            ..at_rest(pose)
        });
    }

    fn height_above_ground_m(&self) -> f64 {
        self.aircraft.pose.altitude_msl_m - GROUND_MSL_M - airframe::WHEEL_HEIGHT_BELOW_CG_M
    }

    fn publish_aircraft(&mut self) {
        let FlightState { pose, controls, .. } = self.aircraft;
        let ground_speed_mps = self
            .aircraft
            .velocity_north_mps
            .hypot(self.aircraft.velocity_east_mps);
        for (path, value) in [
            ("sim/flightmodel/position/latitude", pose.latitude_deg),
            ("sim/flightmodel/position/longitude", pose.longitude_deg),
            ("sim/flightmodel/position/elevation", pose.altitude_msl_m),
            (
                "sim/flightmodel/position/y_agl",
                self.height_above_ground_m(),
            ),
            ("sim/flightmodel/position/psi", pose.heading_true_deg),
            ("sim/flightmodel/position/theta", pose.pitch_deg),
            ("sim/flightmodel/position/phi", pose.roll_deg),
            (
                "sim/flightmodel/position/local_vx",
                self.aircraft.velocity_east_mps,
            ),
            (
                "sim/flightmodel/position/local_vy",
                -self.aircraft.velocity_down_mps,
            ),
            (
                "sim/flightmodel/position/local_vz",
                -self.aircraft.velocity_north_mps,
            ),
            ("sim/flightmodel/position/groundspeed", ground_speed_mps),
            (
                "sim/flightmodel/position/true_airspeed",
                self.aircraft.true_airspeed_mps,
            ),
            (
                "sim/flightmodel/failures/onground_any",
                f64::from(u8::from(self.aircraft.on_ground)),
            ),
            (
                "sim/flightmodel2/controls/flap1_deploy_ratio",
                controls.flap_ratio,
            ),
            ("sim/flightmodel2/gear/deploy_ratio", controls.gear_ratio),
        ] {
            self.datarefs.set(path, value);
        }
    }

    /// Attitude that a client wrote turns the aircraft.
    fn take_over_attitude(&mut self) {
        self.aircraft.pose.heading_true_deg = self.datarefs.get("sim/flightmodel/position/psi");
        self.aircraft.pose.pitch_deg = self.datarefs.get("sim/flightmodel/position/theta");
        self.aircraft.pose.roll_deg = self.datarefs.get("sim/flightmodel/position/phi");
    }

    fn follow_system_clock(&mut self) {
        let since_epoch = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let now: DateTime<Utc> = DateTime::UNIX_EPOCH + since_epoch;
        self.datarefs.set(
            names::ZULU_TIME_S,
            f64::from(now.num_seconds_from_midnight()),
        );
        // X-Plane has no leap day.
        self.datarefs
            .set(names::DATE_DAYS, f64::from(now.ordinal0().min(364)));
    }

    fn add(&mut self, path: &str, amount: f64) {
        let sum = self.datarefs.get(path) + amount;
        self.datarefs.set(path, sum);
    }
}

fn at_rest(pose: Pose) -> FlightState {
    FlightState {
        time_s: 0.0,
        pose,
        velocity_north_mps: 0.0,
        velocity_east_mps: 0.0,
        velocity_down_mps: 0.0,
        true_airspeed_mps: 0.0,
        controls: Controls::default(),
        on_ground: pose.altitude_msl_m <= PARKED.altitude_msl_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runway() -> Runway {
        Runway {
            airport: "WSSS".into(),
            name: "02L".into(),
            threshold: PARKED.position(),
            course_true_deg: 23.02,
            glide_path_deg: 3.0,
            touchdown_past_threshold_m: 340.1,
            ils_frequency_mhz: Some(110.9),
            course_magnetic_deg: None,
        }
    }

    #[test]
    fn the_clock_runs_unless_paused_or_frozen_and_is_the_computers_until_told_otherwise() {
        let mut world = World::default();
        world.write(names::ZULU_TIME_S, 100.0).unwrap();
        world.advance(1.0);
        let system_s = world.clock().zulu_time_s;
        world.write(names::USE_SYSTEM_TIME, 0.0).unwrap();
        world.write(names::ZULU_TIME_S, 86_399.5).unwrap();
        world.advance(1.0);
        assert_eq!(world.clock().zulu_time_s, 0.5);
        assert_ne!(
            system_s, 101.0,
            "the system clock should have overwritten the time"
        );
        world.command(names::COMMAND_PAUSE_ON);
        world.advance(1.0);
        assert_eq!(world.clock().zulu_time_s, 0.5);
        world.command(names::COMMAND_PAUSE_OFF);
        world.freeze(runway());
        world.advance(1.0);
        assert_eq!(world.clock().zulu_time_s, 0.5);
        world.release();
        world.advance(1.0);
        assert_eq!(world.clock().zulu_time_s, 1.5);
        // Frozen is frozen, even for a clock that would follow the computer's.
        world.freeze(runway());
        world.write(names::USE_SYSTEM_TIME, 1.0).unwrap();
        world.advance(1.0);
        assert_eq!(world.clock().zulu_time_s, 1.5);
    }

    #[test]
    fn a_placed_aircraft_is_where_it_was_placed_with_all_bits() {
        let mut world = World::default();
        world.place(&PlaceAircraft {
            freeze: true,
            plane: 0,
            latitude_deg: 1.194_827_667,
            longitude_deg: 103.912_427_524,
            elevation_msl_m: 762.008_5,
            heading_true_deg: 23.0,
            pitch_deg: 5.25,
            roll_deg: -0.5,
        });
        assert_eq!(world.position().longitude_deg, 103.912_427_524);
        assert_eq!(world.read(names::OVERRIDE_FLIGHT_MODEL), 1.0);
        assert_eq!(world.read("sim/flightmodel/position/theta"), 5.25);
        // RREF has 32 bits only.
        assert_eq!(
            world.read("sim/flightmodel/position/longitude"),
            103.912_427_524_f64 as f32
        );
    }

    #[test]
    fn written_attitude_turns_the_aircraft() {
        let mut world = World::default();
        world.write("sim/flightmodel/position/phi", -12.5).unwrap();
        assert_eq!(world.position().roll_deg, -12.5);
    }

    #[test]
    fn without_autopilot_or_tuned_receiver_nothing_flies() {
        use xplane_bridge::fly::{ApproachProfile, FlightStart};
        let request = FlyRequest {
            start: FlightStart {
                position: PARKED.position(),
                heading_true_deg: 23.0,
                speed_mps: 80.0,
            },
            runway: runway(),
            profile: ApproachProfile::charted_step_down(),
            seed: 1,
            time_limit_s: 600.0,
        };
        let mut world = World::default();
        assert!(
            world
                .check_autopilot(&request)
                .unwrap_err()
                .contains("autopilot is off")
        );
        world.command(names::COMMAND_SERVOS_ON);
        assert!(
            world
                .check_autopilot(&request)
                .unwrap_err()
                .contains("expected 11090")
        );
        world.write(names::NAV1_FREQUENCY, 11_090.0).unwrap();
        assert_eq!(world.check_autopilot(&request), Ok(()));
    }
}
