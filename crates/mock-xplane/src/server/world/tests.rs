use dataset::geometry::geodesy::LatLon;
use testkit::changi_02l;
use xplane_bridge::packet::PlaceAtStart;

use super::airport::ON_THRESHOLD;
use super::*;

fn world() -> World {
    World::new(Generation::XPlane12, true, Quirks::NONE)
}

fn runway() -> Runway {
    Runway {
        threshold: ON_THRESHOLD.position(),
        ..changi_02l()
    }
}

#[test]
fn the_clock_runs_unless_paused_or_frozen_and_is_the_computers_until_told_otherwise() {
    let mut world = world();
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
fn written_attitude_turns_the_aircraft() {
    let mut world = world();
    world.write("sim/flightmodel/position/phi", -12.5).unwrap();
    assert_eq!(world.position().roll_deg, -12.5);
}

#[test]
fn without_power_or_tuned_receiver_nothing_flies_and_modes_that_are_on_stay_on() {
    use dataset::geometry::approach_profile::ApproachProfile;
    use xplane_bridge::fly::{FlightStart, FlyRequest};
    let request = FlyRequest {
        start: FlightStart {
            position: ON_THRESHOLD.position(),
            heading_true_deg: 23.0,
            speed_mps: 80.0,
        },
        runway: runway(),
        profile: ApproachProfile::charted_step_down(0.0),
        seed: 1,
        time_limit_s: 600.0,
        already_started: false,
    };
    let mut world = world();
    let master = "sim/cockpit2/autopilot/autopilot_electric_master";
    world.write(master, 0.0).unwrap();
    let dead = world.engage_autopilot(&request).unwrap_err();
    assert!(dead.contains("no power"), "{dead}");
    world.write(master, 1.0).unwrap();
    let untuned = world.engage_autopilot(&request).unwrap_err();
    assert!(untuned.contains("expected 11090"), "{untuned}");
    world.write(names::NAV1_FREQUENCY, 11_090.0).unwrap();
    // Pressed once more, the button would switch off.
    for _ in 0..2 {
        assert_eq!(world.engage_autopilot(&request), Ok(()));
        assert!(world.flies_approach());
    }
}

#[test]
fn buttons_of_the_autopilot_switch_off_what_is_on_and_servos_stay_on() {
    let mut world = world();
    let on = |world: &World| {
        [
            names::NAV_STATUS,
            names::GLIDE_SLOPE_STATUS,
            names::APPROACH_STATUS,
        ]
        .map(|mode| world.read(mode) > 0.0)
    };
    for _ in 0..2 {
        world.command(names::COMMAND_SERVOS_ON);
        world.command(names::COMMAND_AUTOTHROTTLE_ON);
    }
    assert_eq!(
        [names::AUTOPILOT_MODE, names::AUTOTHROTTLE].map(|name| world.read(name)),
        [2.0, 1.0]
    );
    world.command(names::COMMAND_NAV);
    assert_eq!(on(&world), [true, false, false]);
    world.command(names::COMMAND_GLIDE_SLOPE);
    assert_eq!(on(&world), [true, true, true]);
    world.command(names::COMMAND_NAV);
    assert_eq!(on(&world), [false, true, false]);
    world.command(names::COMMAND_APPROACH);
    assert_eq!(on(&world), [true, true, true]);
    world.command(names::COMMAND_APPROACH);
    assert_eq!(on(&world), [false, false, false]);
    // One of the vertical modes is on.
    let vertical = |world: &World| {
        ["altitude_hold_status", "vvi_status"]
            .map(|mode| world.read(&format!("sim/cockpit2/autopilot/{mode}")))
    };
    world.command("sim/autopilot/altitude_hold");
    world.command("sim/autopilot/vertical_speed");
    assert_eq!(vertical(&world), [0.0, 1.0]);
    world.command("sim/autopilot/vertical_speed");
    assert_eq!(vertical(&world), [0.0, 0.0]);
}

fn air_start() -> PlaceAtStart {
    PlaceAtStart {
        start_type: 6,
        plane: 0,
        airport: String::new(),
        runway: 0,
        runway_end: 0,
        latitude_deg: 1.2,
        longitude_deg: 103.9,
        elevation_msl_m: 762.0,
        heading_true_deg: 23.0,
        speed_mps: 80.0,
    }
}

#[test]
fn a_started_aircraft_stands_still_at_first_and_then_flies_on_with_rates() {
    let mut world = world();
    assert!(world.start(&air_start()));
    world.advance(0.1);
    assert_eq!(world.position().velocity_east_mps, 0.0);
    world.advance(0.5);
    for _ in 0..600 {
        world.advance(1.0 / 60.0);
    }
    let position = world.position();
    let flown_m = LatLon {
        latitude_deg: position.latitude_deg,
        longitude_deg: position.longitude_deg,
    }
    .distance_m(LatLon {
        latitude_deg: 1.2,
        longitude_deg: 103.9,
    });
    // The 0.6 s before hold half a second of standstill.
    assert!((flown_m - 808.0).abs() < 5.0, "{flown_m}");
    assert!((position.elevation_msl_m - 762.0).abs() < 1.0);
    // The datarefs are in degrees per second.
    let roll_rate_deg_s = f64::from(world.read("sim/flightmodel/position/P"));
    let roll_rate_rad_s = f64::from(position.roll_rate_rad_s);
    assert_ne!(roll_rate_rad_s, 0.0);
    assert!((roll_rate_deg_s.to_radians() - roll_rate_rad_s).abs() < 1e-6);
}

#[test]
fn a_banked_aircraft_turns_at_the_rate_of_its_bank() {
    let mut world = world();
    assert!(world.start(&air_start()));
    world.advance(1.0);
    world.write("sim/flightmodel/position/phi", 30.0).unwrap();
    world.advance(0.01);
    // g tan(30 deg) / 80 m/s, of which the yaw axis sees the cosine of the bank.
    let wanted_rad_s = 9.81 * 30_f64.to_radians().tan() / 80.0 * 30_f64.to_radians().cos();
    let found_rad_s = f64::from(world.position().yaw_rate_rad_s);
    assert!((found_rad_s - wanted_rad_s).abs() < 0.01, "{found_rad_s}");
}

#[test]
fn an_overridden_flight_model_leaves_the_aircraft_where_it_was_put() {
    let mut world = world();
    assert!(world.start(&air_start()));
    world.write(names::OVERRIDE_FLIGHT_MODEL, 1.0).unwrap();
    let before = world.position();
    world.advance(10.0);
    assert_eq!(world.position(), before);
}

#[test]
fn local_coordinates_move_the_aircraft_and_latitude_does_not() {
    let mut world = world();
    let path = "sim/flightmodel/position/local_z";
    let before = world.position();
    let south_m = world.datarefs().get(path);
    world.write_exact(path, south_m - 1_000.0).unwrap();
    let north_m = (world.position().latitude_deg - before.latitude_deg) * 110_575.0;
    assert!((north_m - 1_000.0).abs() < 5.0, "{north_m}");
    assert!(
        world
            .write("sim/flightmodel/position/latitude", 50.0)
            .is_err()
    );
}

#[test]
fn a_quaternion_turns_the_aircraft_as_its_angles_say() {
    let mut world = world();
    // Heading 90 degrees, wings level.
    for (at, value) in [0.5_f64.sqrt(), 0.0, 0.0, 0.5_f64.sqrt()]
        .into_iter()
        .enumerate()
    {
        let path = format!("sim/flightmodel/position/q[{at}]");
        world.write_exact(&path, value).unwrap();
    }
    assert!((world.position().heading_true_deg - 90.0).abs() < 1e-3);
}

#[test]
fn another_aircraft_stands_where_the_old_one_did() {
    let mut world = world();
    let file = |world: &World| world.read(&format!("{}[0]", aircraft::FILE));
    assert_eq!(file(&world), f32::from(b'A'));
    world.load_aircraft("XYZ.acf");
    assert_eq!(file(&world), f32::from(b'X'));
    assert_eq!(world.position().latitude_deg, ON_THRESHOLD.latitude_deg);
}

#[test]
fn the_type_in_a_file_is_drawn_and_any_other_aircraft_looks_like_an_airliner() {
    let mut world = world();
    assert_eq!(world.aircraft_type().name, "B737-800");
    for of in airframe::AircraftType::all() {
        world.load_aircraft(&of.stand_in_file());
        assert_eq!(world.aircraft_type(), of);
        // Datarefs are 32-bit floats.
        assert!((world.aircraft_scale() - 1.0).abs() < 1e-6, "{}", of.name);
    }
    world.load_aircraft("Aircraft/Laminar Research/Airbus A330-300/A330.acf");
    assert_eq!(world.aircraft_type().name, "A330-300");
    world.load_aircraft("Aircraft/Laminar Research/Cessna 172 SP/Cessna_172SP.acf");
    assert_eq!(world.aircraft_type().name, "B737-800");
    assert!(world.aircraft_scale() < 0.4);
}

#[test]
fn a_client_reads_what_aircraft_is_loaded_and_moves_the_levers_of_its_engines() {
    let mut world = world();
    world.load_aircraft("Aircraft/Laminar Research/Cessna 172 SP/Cessna_172SP.acf");
    // As XPlaneConnectX does: a text byte by byte, and all levers at once.
    let letter = |at: usize| world.read(&format!("sim/aircraft/view/acf_descrip[{at}]")) as u8;
    let words: Vec<u8> = (0..11).map(letter).collect();
    assert_eq!(words, b"Cessna 172S");
    let levers = "sim/cockpit2/engine/actuators/throttle_jet_rev_ratio_all";
    world.write(levers, 0.75).unwrap();
    assert_eq!(
        world.read("sim/cockpit2/engine/actuators/throttle_ratio[1]"),
        0.75
    );
}

#[test]
fn whatever_clients_write_into_the_sky_and_the_clock_is_drawn() {
    use dataset::geometry::camera::{Camera, CameraPose};
    use rand::seq::IndexedRandom;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use crate::server::{BuiltIn, Engine, Instants, SceneSetting};

    const CASES: u64 = 60;
    const EXTREMES: [f64; 12] = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f32::MAX as f64,
        f32::MIN as f64,
        i32::MAX as f64,
        -1e9,
        -1.0,
        0.0,
        1e-30,
        2.0,
        1e12,
    ];
    let pose = Pose {
        latitude_deg: ON_THRESHOLD.position().latitude_deg,
        longitude_deg: ON_THRESHOLD.position().longitude_deg,
        altitude_msl_m: 20.0,
        heading_true_deg: 203.0,
        pitch_deg: 2.0,
        roll_deg: 0.0,
    };
    let aircraft = Pose {
        latitude_deg: pose.latitude_deg - 0.02,
        altitude_msl_m: 120.0,
        ..pose
    };
    let camera = CameraPose {
        pose,
        hfov_deg: 40.0,
    };
    let mut random = ChaCha8Rng::seed_from_u64(0);
    for case in 0..CASES {
        let generation = [Generation::XPlane11, Generation::XPlane12][case as usize % 2];
        let mut world = World::new(generation, true, Quirks::NONE);
        let paths: Vec<String> = world
            .datarefs()
            .iter()
            .filter(|(dataref, _)| {
                dataref.writable
                    && (dataref.name.starts_with("sim/weather/")
                        || dataref.name.starts_with("sim/time/"))
            })
            .flat_map(|(dataref, values)| match dataref.length {
                None => vec![dataref.name.to_owned()],
                Some(_) => (0..values.len())
                    .map(|at| format!("{}[{at}]", dataref.name))
                    .collect(),
            })
            .collect();
        let mut write_some = |world: &mut World| {
            for path in &paths {
                if random.random_bool(0.7) {
                    let value = *EXTREMES.choose(&mut random).unwrap();
                    // A rejected write has no effect.
                    let _ = world.write_exact(path, value);
                }
            }
        };
        write_some(&mut world);
        world.command(names::COMMAND_REGENERATE_WEATHER);
        // Clouds of X-Plane 12 must be written again.
        write_some(&mut world);
        world.advance(0.02);
        let camera = Camera::from_pose(&camera, 24, 16);
        let picture = BuiltIn.prepare(&SceneSetting {
            camera: &camera,
            runway: &runway(),
            weather: &world.weather(),
            clock: &world.clock(),
            aircraft: airframe::AircraftType::boeing_737_800(),
            degradation: None,
        });
        let mut rgb = vec![0; 24 * 16 * 3];
        picture.draw(
            (&aircraft, &Controls::default()),
            &[],
            Instants::all(1.0),
            &mut rgb,
        );
    }
}
