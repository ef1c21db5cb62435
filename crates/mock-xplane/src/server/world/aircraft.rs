//! The user's aircraft: its position, how it got there, and the datarefs for it.

use airframe::AircraftType;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::numbers::units::MPS_PER_KNOT;
use glam::{DQuat, DVec3, EulerRot};
use xplane_bridge::datarefs as names;
use xplane_bridge::packet::Position;

use super::airport::{GROUND_MSL_M, ON_THRESHOLD};
use super::motion::{self, Rates};
use super::scenery::local_frame::LocalFrame;
use crate::datarefs::Datarefs;

/// Prefix of datarefs with which clients may turn or move the aircraft.
pub(super) const POSITION: &str = "sim/flightmodel/position/";
/// Text dataref with the aircraft's file.
pub(super) const FILE: &str = "sim/aircraft/view/acf_relative_path";
/// Text dataref with its description for people.
const DESCRIPTION: &str = "sim/aircraft/view/acf_descrip";
/// The airliner that flies without anything being loaded.
pub(super) const STAND_IN: &str = "Aircraft/Stand-in/airliner.acf";
/// X-Plane's default aircraft.
pub(super) const C172: &str = "Aircraft/Laminar Research/Cessna 172 SP/Cessna_172SP.acf";
/// Wing span and length, metres.
const SIZE_C172_M: (f64, f64) = (11.0, 8.3);
/// Displacement of the origin of local coordinates while scenery loads, degrees.
const ORIGIN_OFF_DEG: f64 = 1.0;
/// Names of the gear's handle.
const GEAR_HANDLES: [&str; 2] = [
    "sim/cockpit2/controls/gear_handle_down",
    "sim/cockpit/switches/gear_handle_status",
];
/// A flight that has just started stands still for this long, seconds, whatever speed was requested.
const STANDSTILL_S: f64 = 0.5;
/// Accepted deviation of a quaternion's squared length from 1.
const NEARLY_UNIT: f64 = 1e-3;

/// The user's aircraft.
#[derive(Debug, Clone)]
pub(super) struct Aircraft {
    state: FlightState,
    rates: Rates,
    frame: LocalFrame,
    /// Values of `lat_ref` and `lon_ref`: the origin before it moved.
    published_origin: Geodetic,
    /// Speed to come, and how long until then.
    speed_to_come: Option<(f64, f64)>,
}

impl Aircraft {
    /// Parked at a place.
    pub(super) fn parked(pose: Pose) -> Self {
        let frame = LocalFrame::around(pose.position());
        Self {
            state: at_rest(pose),
            rates: Rates::default(),
            frame,
            published_origin: frame.origin,
            speed_to_come: None,
        }
    }

    /// The local coordinates that it is in.
    pub(super) fn frame(&self) -> LocalFrame {
        self.frame
    }

    /// Switches it to other local coordinates; its position on earth stays.
    pub(super) fn set_frame(&mut self, frame: LocalFrame) {
        self.frame = frame;
    }

    /// Current speed, or speed at which the aircraft will start to fly, metres per second.
    pub(super) fn speed_to_come_mps(&self) -> f64 {
        let FlightState {
            velocity_north_mps: north,
            velocity_east_mps: east,
            ..
        } = self.state;
        self.speed_to_come
            .map_or(north.hypot(east), |(speed_mps, _)| speed_mps)
    }

    /// Moves the origin of local coordinates for loading scenery, or to its proper position.
    pub(super) fn move_origin(&mut self, loading: bool) {
        let mut frame = LocalFrame::around(self.state.pose.position());
        if loading {
            frame.origin.latitude_deg -= ORIGIN_OFF_DEG;
            frame.origin.longitude_deg += ORIGIN_OFF_DEG;
        }
        self.frame = frame;
    }

    pub(super) fn state(&self) -> &FlightState {
        &self.state
    }

    /// Shows a flight's state, or a drawn scenario's.
    pub(super) fn show(&mut self, state: FlightState) {
        self.state = state;
        self.rates = Rates::default();
        self.speed_to_come = None;
    }

    /// Starts a flight. Velocities read zero at first, as they do in X-Plane.
    pub(super) fn start(&mut self, pose: Pose, speed_mps: f64) {
        self.show(at_rest(pose));
        self.settle_in(pose);
        if !self.state.on_ground && speed_mps > 0.0 {
            self.speed_to_come = Some((speed_mps, STANDSTILL_S));
        }
    }

    /// Lets time pass with the flight model running.
    pub(super) fn fly_on(&mut self, elapsed_s: f64) {
        let mut elapsed_s = elapsed_s;
        if let Some((speed_mps, wait_s)) = self.speed_to_come {
            if elapsed_s < wait_s {
                self.speed_to_come = Some((speed_mps, wait_s - elapsed_s));
                return;
            }
            self.speed_to_come = None;
            self.set_speed(speed_mps);
            elapsed_s -= wait_s;
        }
        self.rates = Rates::default();
        if motion::is_flying(&self.state) {
            self.rates = motion::fly_on(&mut self.state, elapsed_s);
            if self.state.pose.altitude_msl_m <= ON_THRESHOLD.altitude_msl_m {
                let mut pose = self.state.pose;
                pose.altitude_msl_m = ON_THRESHOLD.altitude_msl_m;
                self.show(at_rest(pose));
            }
        }
    }

    /// A client wrote a dataref that starts with [`POSITION`]: the aircraft follows. Returns whether that moved or turned it.
    pub(super) fn follow(&mut self, name: &str, datarefs: &mut Datarefs) -> bool {
        let read = |name: &str| datarefs.get(&format!("{POSITION}{name}"));
        let FlightState { pose, .. } = &mut self.state;
        match name {
            "psi" => pose.heading_true_deg = read("psi"),
            "theta" => pose.pitch_deg = read("theta"),
            "phi" => pose.roll_deg = read("phi"),
            "q" => {
                let [w, x, y, z] = ["q[0]", "q[1]", "q[2]", "q[3]"].map(read);
                let attitude = DQuat::from_xyzw(x, y, z, w);
                // Elements are written one by one: until the last one, this is not a rotation.
                if (attitude.length_squared() - 1.0).abs() > NEARLY_UNIT {
                    return false;
                }
                let (heading, pitch, roll) = attitude.normalize().to_euler(EulerRot::ZYX);
                pose.heading_true_deg = heading.to_degrees().rem_euclid(360.0);
                pose.pitch_deg = pitch.to_degrees();
                pose.roll_deg = roll.to_degrees();
            }
            "local_x" | "local_y" | "local_z" => {
                let local = DVec3::new(read("local_x"), read("local_y"), read("local_z"));
                *pose = pose.moved_to(self.frame.world(local));
                self.state.on_ground = is_on_ground(pose);
            }
            "local_vx" => self.state.velocity_east_mps = read("local_vx"),
            "local_vy" => self.state.velocity_down_mps = -read("local_vy"),
            "local_vz" => self.state.velocity_north_mps = -read("local_vz"),
            _ => return false,
        }
        self.publish(datarefs);
        true
    }

    /// The position in `RPOS`.
    pub(super) fn position(&self) -> Position {
        let FlightState { pose, .. } = &self.state;
        Position {
            longitude_deg: pose.longitude_deg,
            latitude_deg: pose.latitude_deg,
            elevation_msl_m: pose.altitude_msl_m,
            height_agl_m: self.height_above_ground_m() as f32,
            pitch_deg: pose.pitch_deg as f32,
            heading_true_deg: pose.heading_true_deg as f32,
            roll_deg: pose.roll_deg as f32,
            velocity_east_mps: self.state.velocity_east_mps as f32,
            velocity_up_mps: -self.state.velocity_down_mps as f32,
            velocity_south_mps: -self.state.velocity_north_mps as f32,
            roll_rate_rad_s: self.rates.roll_deg_s.to_radians() as f32,
            pitch_rate_rad_s: self.rates.pitch_deg_s.to_radians() as f32,
            yaw_rate_rad_s: self.rates.yaw_deg_s.to_radians() as f32,
        }
    }

    /// Updates all datarefs of the aircraft.
    pub(super) fn publish(&self, datarefs: &mut Datarefs) {
        let FlightState {
            pose,
            controls,
            velocity_north_mps: north,
            velocity_east_mps: east,
            velocity_down_mps: down,
            true_airspeed_mps,
            on_ground,
            ..
        } = self.state;
        let local = self.frame.local(pose.position());
        let attitude = DQuat::from_euler(
            EulerRot::ZYX,
            pose.heading_true_deg.to_radians(),
            pose.pitch_deg.to_radians(),
            pose.roll_deg.to_radians(),
        );
        for (name, value) in [
            ("latitude", pose.latitude_deg),
            ("longitude", pose.longitude_deg),
            ("elevation", pose.altitude_msl_m),
            ("lat_ref", self.published_origin.latitude_deg),
            ("lon_ref", self.published_origin.longitude_deg),
            ("local_x", local.x),
            ("local_y", local.y),
            ("local_z", local.z),
            ("y_agl", self.height_above_ground_m()),
            ("psi", pose.heading_true_deg),
            ("theta", pose.pitch_deg),
            ("phi", pose.roll_deg),
            ("q[0]", attitude.w),
            ("q[1]", attitude.x),
            ("q[2]", attitude.y),
            ("q[3]", attitude.z),
            ("local_vx", east),
            ("local_vy", -down),
            ("local_vz", -north),
            // Degrees per second here, radians in RPOS.
            ("P", self.rates.roll_deg_s),
            ("Q", self.rates.pitch_deg_s),
            ("R", self.rates.yaw_deg_s),
            ("groundspeed", north.hypot(east)),
            ("true_airspeed", true_airspeed_mps),
            // Knots, unlike its neighbours. Near sea level the two airspeeds are equal.
            ("indicated_airspeed", true_airspeed_mps / MPS_PER_KNOT),
        ] {
            datarefs.set(&format!("{POSITION}{name}"), value);
        }
        let Controls {
            flap_ratio,
            gear_ratio,
        } = controls;
        datarefs.set("sim/flightmodel2/controls/flap1_deploy_ratio", flap_ratio);
        datarefs.set("sim/flightmodel2/gear/deploy_ratio", gear_ratio);
        let on_ground = f64::from(u8::from(on_ground));
        datarefs.set("sim/flightmodel/failures/onground_any", on_ground);
    }

    fn settle_in(&mut self, pose: Pose) {
        self.frame = LocalFrame::around(pose.position());
        self.published_origin = self.frame.origin;
    }

    fn set_speed(&mut self, speed_mps: f64) {
        let (sin, cos) = self.state.pose.heading_true_deg.to_radians().sin_cos();
        self.state.velocity_north_mps = speed_mps * cos;
        self.state.velocity_east_mps = speed_mps * sin;
        self.state.true_airspeed_mps = speed_mps;
    }

    fn height_above_ground_m(&self) -> f64 {
        self.state.pose.altitude_msl_m - GROUND_MSL_M - airframe::WHEEL_HEIGHT_BELOW_CG_M
    }
}

/// Loads the aircraft in a file, as far as datarefs reflect it.
pub(super) fn load(file: &str, datarefs: &mut Datarefs) {
    datarefs.set_text(FILE, file);
    let known = type_in(file);
    let (icao, description) = match known {
        Some(of) => (of.designator.as_str(), of.title.as_str()),
        None if file.ends_with("/Cessna_172SP.acf") => ("C172", "Cessna 172SP Skyhawk"),
        // ICAO's designator of types without one.
        None => ("ZZZZ", ""),
    };
    datarefs.set_text(names::AIRCRAFT_ICAO, icao);
    datarefs.set_text(DESCRIPTION, description);
    let (span_m, length_m) = if icao == "C172" {
        SIZE_C172_M
    } else {
        let of = known.unwrap_or(AircraftType::boeing_737_800());
        (of.published.span_m, of.published.length_m)
    };
    datarefs.set(names::AIRCRAFT_WIDTH_M, span_m);
    datarefs.set(names::AIRCRAFT_LENGTH_M, length_m);
}

/// The type in a file, by the file's name; none if only X-Plane has such an aircraft.
fn type_in(file: &str) -> Option<&'static AircraftType> {
    let name = |path: &str| path.rsplit('/').next().unwrap_or(path).to_owned();
    if name(file) == name(STAND_IN) {
        return Some(AircraftType::boeing_737_800());
    }
    let mut types = AircraftType::all().iter();
    types.find(|of| {
        let own = name(&of.stand_in_file()) == name(file);
        own || of.x_plane.paths().any(|path| name(path) == name(file))
    })
}

/// The type whose shape is drawn.
pub(super) fn drawn_type(datarefs: &Datarefs) -> &'static AircraftType {
    let designator: String = (0..4)
        .map(|at| datarefs.get(&format!("{}[{at}]", names::AIRCRAFT_ICAO)) as u8)
        .filter(u8::is_ascii_alphanumeric)
        .map(char::from)
        .collect();
    AircraftType::named(&designator).unwrap_or(AircraftType::boeing_737_800())
}

/// Size of the drawn aircraft relative to its type.
pub(super) fn scale(datarefs: &Datarefs) -> f64 {
    datarefs.get(names::AIRCRAFT_WIDTH_M) / drawn_type(datarefs).published.span_m
}

/// The two names of the gear's handle are one handle.
pub(super) fn written(path: &str, datarefs: &mut Datarefs) {
    let [one, other] = GEAR_HANDLES;
    if path == one {
        datarefs.set(other, datarefs.get(one));
    } else if path == other {
        datarefs.set(one, datarefs.get(other));
    }
}

/// A state without motion.
pub(super) fn at_rest(pose: Pose) -> FlightState {
    FlightState {
        time_s: 0.0,
        pose,
        velocity_north_mps: 0.0,
        velocity_east_mps: 0.0,
        velocity_down_mps: 0.0,
        true_airspeed_mps: 0.0,
        controls: Controls::default(),
        on_ground: is_on_ground(&pose),
    }
}

fn is_on_ground(pose: &Pose) -> bool {
    pose.altitude_msl_m <= ON_THRESHOLD.altitude_msl_m
}
