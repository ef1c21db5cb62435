use super::*;

const COVER_0: &str = "sim/weather/region/cloud_coverage_percent[0]";
const BASE_0: &str = "sim/weather/region/cloud_base_msl_m[0]";

/// A separate sky, with datarefs.
struct Outdoors {
    datarefs: Datarefs,
    sky: Sky,
}

impl Outdoors {
    fn new(generation: Generation, quirks: &str) -> Self {
        let mut datarefs = Datarefs::new(generation);
        let sky = Sky::new(generation, quirks.parse().unwrap(), &mut datarefs);
        Self { datarefs, sky }
    }

    fn twelve(quirks: &str) -> Self {
        Self::new(Generation::XPlane12, quirks)
    }

    fn write(&mut self, path: &str, value: f64) {
        let before = self.datarefs.get(path);
        self.datarefs.write_exact(path, value).unwrap();
        self.sky.written(path, before, &mut self.datarefs);
    }

    fn regenerate(&mut self) {
        self.sky.regenerate(&mut self.datarefs);
    }

    /// Frame by frame.
    fn wait(&mut self, seconds: f64) {
        for _ in 0..(seconds * 10.0).round() as usize {
            self.sky.advance(&mut self.datarefs, 0.1, false);
        }
    }

    fn pause(&mut self, seconds: f64) {
        self.sky.advance(&mut self.datarefs, seconds, true);
    }

    fn reads(&self, path: &str) -> f64 {
        self.datarefs.get(path)
    }

    fn cover(&self) -> f64 {
        let clouds = self.sky.weather().clouds;
        clouds.iter().map(|cloud| cloud.cover_ratio).sum()
    }
}

#[test]
fn twelve_shows_all_but_clouds_once_it_may_update() {
    let mut outdoors = Outdoors::twelve("none");
    let visibility_m = |outdoors: &Outdoors| outdoors.sky.weather().visibility_m;
    let before_m = visibility_m(&outdoors);
    outdoors.write(names::VISIBILITY_SM, 5.0);
    assert_eq!(visibility_m(&outdoors), before_m);
    outdoors.write(COVER_0, 0.75);
    outdoors.write(names::UPDATE_IMMEDIATELY, 1.0);
    assert!((visibility_m(&outdoors) - 8_046.72).abs() < 1e-3);
    assert_eq!(outdoors.cover(), 0.0);
    outdoors.write(names::VISIBILITY_SM, 6.0);
    assert!((visibility_m(&outdoors) - 9_656.064).abs() < 1e-3);
    let effective_m = outdoors.reads("sim/graphics/view/visibility_effective_m");
    assert!((effective_m - 9_656.064).abs() < 1e-2);
}

#[test]
fn clouds_of_twelve_want_the_command_or_to_be_told_soon_after_it() {
    let mut outdoors = Outdoors::twelve("none");
    outdoors.write(COVER_0, 0.75);
    assert_eq!(outdoors.cover(), 0.0);
    outdoors.regenerate();
    assert_eq!(outdoors.cover(), 0.75);
    outdoors.write(COVER_0, 0.5);
    assert_eq!(outdoors.cover(), 0.5);
    // Long after the command no writes are accepted any more.
    outdoors.wait(70.0);
    outdoors.write(COVER_0, 0.25);
    assert_eq!(outdoors.cover(), 0.5);
}

#[test]
fn eleven_shows_everything_at_once() {
    let mut outdoors = Outdoors::new(Generation::XPlane11, "none");
    for (path, value) in [
        ("sim/weather/visibility_reported_m", 5_000.0),
        ("sim/weather/cloud_type[0]", 3.0),
        ("sim/weather/cloud_base_msl_m[0]", 600.0),
        ("sim/weather/wind_speed_kt[0]", 10.0),
    ] {
        outdoors.write(path, value);
    }
    let weather = outdoors.sky.weather();
    assert_eq!(weather.visibility_m, 5_000.0);
    assert_eq!(weather.clouds[0].base_msl_m, 600.0);
    assert!((weather.wind_speed_mps - 5.144).abs() < 1e-3);
    let knots = outdoors.reads("sim/cockpit2/gauges/indicators/wind_speed_kts");
    assert!((knots - 10.0).abs() < 1e-3);
}

#[test]
fn a_regeneration_restores_the_preset() {
    let mut outdoors = Outdoors::twelve("regeneration_restores_preset");
    outdoors.write(COVER_0, 0.75);
    outdoors.write(names::TEMPERATURE_C, -10.0);
    outdoors.write(names::VISIBILITY_SM, 3.0);
    outdoors.regenerate();
    assert_eq!((outdoors.cover(), outdoors.reads(COVER_0)), (0.0, 0.0));
    assert_eq!(outdoors.reads(names::TEMPERATURE_C), 28.0);
    assert_eq!(outdoors.reads(names::VISIBILITY_SM), 3.0);
    outdoors.write(COVER_0, 0.75);
    assert_eq!(outdoors.cover(), 0.75);
}

#[test]
fn late_clouds_read_and_show_the_old_ones_in_all_slots_and_then_come_at_once() {
    let mut outdoors = Outdoors::twelve("late_clouds");
    outdoors.regenerate();
    outdoors.write(COVER_0, 0.75);
    outdoors.write(BASE_0, 600.0);
    outdoors.wait(10.0);
    // A further write makes all wait again.
    outdoors.write("sim/weather/region/cloud_type[2]", 3.0);
    outdoors.wait(54.5);
    assert_eq!(
        (outdoors.reads(COVER_0), outdoors.reads(BASE_0)),
        (0.0, 0.0)
    );
    assert_eq!(outdoors.reads("sim/weather/region/cloud_type[2]"), 2.0);
    assert_eq!(outdoors.cover(), 0.0);
    outdoors.wait(1.0);
    assert_eq!(
        (outdoors.reads(COVER_0), outdoors.reads(BASE_0)),
        (0.75, 600.0)
    );
    assert_eq!(outdoors.reads("sim/weather/region/cloud_type[2]"), 3.0);
    assert_eq!(outdoors.cover(), 0.75);
    // Other quantities are not delayed.
    outdoors.write(names::RAIN, 0.5);
    assert_eq!(outdoors.reads(names::RAIN), 0.5);
}

#[test]
fn late_clouds_that_were_never_regenerated_read_right_and_show_the_old_ones() {
    let mut outdoors = Outdoors::twelve("late_clouds");
    outdoors.write(COVER_0, 0.75);
    outdoors.wait(60.0);
    assert_eq!((outdoors.reads(COVER_0), outdoors.cover()), (0.75, 0.0));
}

#[test]
fn a_cloud_base_settles_some_metres_off_and_no_cloud_stays_at_zero() {
    let mut outdoors = Outdoors::twelve("cloud_base_off");
    outdoors.write(BASE_0, 600.0);
    outdoors.write("sim/weather/region/cloud_base_msl_m[1]", 0.0);
    assert_eq!(outdoors.reads(BASE_0), 603.5);
    assert_eq!(
        outdoors.reads("sim/weather/region/cloud_base_msl_m[1]"),
        0.0
    );
}

#[test]
fn the_temperature_slides_for_minutes_and_holds_then() {
    let mut outdoors = Outdoors::twelve("sliding_temperature");
    outdoors.write(names::TEMPERATURE_C, 15.0);
    outdoors.wait(10.0);
    let slid_c = outdoors.reads(names::TEMPERATURE_C);
    assert!((slid_c - 22.0).abs() < 0.2, "{slid_c}");
    outdoors.wait(141.0);
    outdoors.write(names::TEMPERATURE_C, 15.0);
    outdoors.wait(100.0);
    assert_eq!(outdoors.reads(names::TEMPERATURE_C), 15.0);
}

#[test]
fn in_a_pause_the_weather_waits_for_time_to_run() {
    let mut outdoors = Outdoors::twelve("paused_weather,late_clouds");
    outdoors.write(names::UPDATE_IMMEDIATELY, 1.0);
    outdoors.pause(1.0);
    let before_m = outdoors.sky.weather().visibility_m;
    outdoors.write(names::VISIBILITY_SM, 3.0);
    outdoors.regenerate();
    outdoors.write(COVER_0, 0.75);
    outdoors.pause(100.0);
    assert_eq!(outdoors.reads(names::VISIBILITY_SM), 3.0);
    assert_eq!(outdoors.sky.weather().visibility_m, before_m);
    assert_eq!(outdoors.reads(COVER_0), 0.0);
    outdoors.wait(56.0);
    assert!(outdoors.sky.weather().visibility_m < 5_000.0);
    assert_eq!(outdoors.reads(COVER_0), 0.75);
}

#[test]
fn real_weather_overwrites_what_is_written_until_it_is_switched_off() {
    for (generation, switch, off, visibility) in [
        (
            Generation::XPlane12,
            names::CHANGE_MODE,
            3.0,
            names::VISIBILITY_SM,
        ),
        (
            Generation::XPlane11,
            "sim/weather/use_real_weather_bool",
            0.0,
            "sim/weather/visibility_reported_m",
        ),
    ] {
        let mut outdoors = Outdoors::new(generation, "real_weather_at_start");
        let real = outdoors.reads(visibility);
        outdoors.write(visibility, real / 2.0);
        outdoors.wait(0.1);
        assert_eq!(outdoors.reads(visibility), real, "{generation:?}");
        assert!(!outdoors.sky.weather().clouds.is_empty());
        let source = |outdoors: &Outdoors| outdoors.reads("sim/weather/region/weather_source");
        let twelve = f64::from(u8::from(generation == Generation::XPlane12));
        assert_eq!(source(&outdoors), twelve);
        outdoors.write(switch, off);
        outdoors.write(visibility, real / 2.0);
        outdoors.wait(100.0);
        assert_eq!(outdoors.reads(visibility), real / 2.0, "{generation:?}");
        assert_eq!(source(&outdoors), 0.0);
    }
}

#[test]
fn a_regeneration_freezes_the_simulator_once() {
    let mut outdoors = Outdoors::twelve("regeneration_freeze");
    assert_eq!(outdoors.sky.take_freeze_s(), None);
    outdoors.regenerate();
    assert_eq!(outdoors.sky.take_freeze_s(), Some(3.0));
    assert_eq!(outdoors.sky.take_freeze_s(), None);
}

#[test]
fn the_weather_of_a_new_flight_shows_without_a_regeneration_but_its_clouds_are_late_as_well() {
    for (quirks, wait_s) in [("none", 0.0), ("late_clouds", 56.0)] {
        let mut outdoors = Outdoors::twelve(quirks);
        outdoors.sky.open_for_flight();
        outdoors.write(COVER_0, 0.75);
        outdoors.write(names::VISIBILITY_SM, 3.0);
        outdoors.sky.close_for_flight(&mut outdoors.datarefs);
        assert!(outdoors.sky.weather().visibility_m < 5_000.0);
        assert_eq!(outdoors.cover() > 0.0, wait_s == 0.0);
        outdoors.wait(wait_s);
        assert_eq!(outdoors.cover(), 0.75);
    }
}

#[test]
fn the_clear_preset_takes_the_clouds_away() {
    let mut outdoors = Outdoors::twelve("none");
    outdoors.regenerate();
    outdoors.write(COVER_0, 0.75);
    outdoors.write("sim/weather/region/weather_preset", 0.0);
    assert_eq!((outdoors.cover(), outdoors.reads(COVER_0)), (0.0, 0.0));
}

#[test]
fn reports_that_contradict_each_other_make_another_sky_each() {
    for (quirk, wind_mps, visible) in [
        ("none", 10.0, true),
        ("wind_in_knots", 5.144, true),
        ("regeneration_needed", 0.0, false),
    ] {
        let mut outdoors = Outdoors::twelve(quirk);
        outdoors.write(names::UPDATE_IMMEDIATELY, 1.0);
        for (path, value) in [
            ("sim/weather/region/wind_speed_msc[0]", 10.0),
            (names::VISIBILITY_SM, 5.0),
            (COVER_0, 0.75),
        ] {
            outdoors.write(path, value);
            assert_eq!(outdoors.reads(path), value, "{quirk}");
        }
        let weather = outdoors.sky.weather();
        assert!((weather.wind_speed_mps - wind_mps).abs() < 1e-3, "{quirk}");
        assert_eq!(weather.visibility_m < 9_000.0, visible, "{quirk}");
        assert_eq!(outdoors.cover(), 0.0, "{quirk}");
        outdoors.regenerate();
        assert!(outdoors.sky.weather().visibility_m < 9_000.0, "{quirk}");
        assert!(outdoors.cover() > 0.0, "{quirk}");
    }
}
