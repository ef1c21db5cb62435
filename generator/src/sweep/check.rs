//! From the form of a sweep to its meaning: every value in its range, every name defined.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::path::Path;

use dataset::conditions::Weather;
use dataset::geodesy::Geodetic;
use dataset::runway::Runway;
use dataset::units::METERS_PER_FOOT;
use xplane_bridge::fly::ApproachProfile;

use super::document::{
    AirportTable, Camera, DEFAULT_PROFILE, Document, Grid, Picture, RecordedRule, Rig, RunwayTable,
    SplitFractions, Start,
};
use super::{RecordedFlights, Sweep};
use crate::airports;
use crate::recording::{Recording, matching_files};
use crate::time_of_day::TimeOfDay;

/// A value that cannot be used.
pub(super) struct Fault {
    /// Dotted key of the value, for [`super::locate`].
    pub(super) key: String,
    /// What was found and what was expected.
    pub(super) message: String,
}

type Checked<T> = Result<T, Fault>;

/// Identifiers have four digits.
const MOST_SCENARIOS: usize = 9_999;
/// Pictures beyond this are a slip of the finger.
const PICTURE_SIDES_PX: std::ops::RangeInclusive<u32> = 64..=8_192;
const HIGHEST_FRAME_RATE_HZ: f64 = 240.0;
/// X-Plane has room for so many cloud layers.
const MOST_CLOUD_LAYERS: usize = 3;
const AIRCRAFT: [&str; 1] = ["B737-800"];

fn fault<T>(key: impl Into<String>, message: impl Into<String>) -> Checked<T> {
    Err(Fault {
        key: key.into(),
        message: message.into(),
    })
}

/// Refuses a number outside a range; NaN is in no range.
fn within(
    key: impl Into<String>,
    value: f64,
    (least, most): (f64, f64),
    what: &str,
) -> Checked<()> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        fault(
            key,
            format!("{value} is out of range; expected {what} from {least} to {most}"),
        )
    }
}

fn legal_name(key: impl Into<String>, name: &str) -> Checked<()> {
    let legal = !name.is_empty()
        && name
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    if legal {
        Ok(())
    } else {
        fault(
            key,
            format!("{name:?} names files; expected letters, digits, - and _ only"),
        )
    }
}

fn list(names: impl IntoIterator<Item = impl Display>) -> String {
    let names: Vec<String> = names.into_iter().map(|name| name.to_string()).collect();
    if names.is_empty() {
        "none".into()
    } else {
        names.join(", ")
    }
}

pub(super) fn check(document: Document, folder: &Path, text: &str) -> Checked<Sweep> {
    let Document {
        corpus,
        approach,
        grid,
        picture,
        video,
        start,
        split,
        weather,
        rig,
        mut profile,
        airport,
        recorded,
    } = document;
    if !AIRCRAFT.contains(&approach.aircraft.as_str()) {
        return fault(
            "approach.aircraft",
            format!(
                "aircraft {:?} is not known; known are {}",
                approach.aircraft,
                list(AIRCRAFT)
            ),
        );
    }
    check_airports(&airport)?;
    let runway = runway(&approach.airport, &approach.runway, &airport)?;
    for (name, weather) in &weather {
        check_weather(name, weather)?;
    }
    for (name, rig) in &rig {
        check_rig(name, rig)?;
    }
    let Some(used_rig) = rig.get(&approach.rig) else {
        let known = list(rig.keys());
        return fault(
            "approach.rig",
            format!("rig {:?} is not defined; defined are {known}", approach.rig),
        );
    };
    let times = check_grid(&grid, &weather)?;
    check_picture(&picture)?;
    if let Some((setting, message)) = video.fault() {
        return fault(format!("video.{setting}"), message);
    }
    profile
        .entry(DEFAULT_PROFILE.into())
        .or_insert(ApproachProfile::GlidePath {
            level_altitude_msl_m: 2_500.0 * METERS_PER_FOOT,
        });
    check_profiles(&profile, &runway)?;
    check_start(&start, &profile)?;
    check_split(&split)?;
    let recorded = recorded
        .into_iter()
        .enumerate()
        .map(|(index, rule)| read_recordings(index, rule, &grid, folder, &runway, &start))
        .collect::<Checked<Vec<_>>>()?;
    Ok(Sweep {
        corpus,
        runway,
        aircraft: approach.aircraft,
        rig_name: approach.rig,
        cameras: used_rig.cameras.clone(),
        grid,
        times,
        picture,
        video,
        start,
        split,
        weathers: weather,
        profiles: profile,
        recorded,
        text: text.to_owned(),
    })
}

fn check_grid(grid: &Grid, weathers: &BTreeMap<String, Weather>) -> Checked<Vec<TimeOfDay>> {
    let mut times = Vec::new();
    for (index, text) in grid.times.iter().enumerate() {
        let key = format!("grid.times.{index}");
        match TimeOfDay::parse(text) {
            None => {
                return fault(
                    key,
                    format!("{text:?} is no time of day; expected HH:MM from 00:00 to 23:59"),
                );
            }
            Some(time) if times.contains(&time) => {
                return fault(key, format!("{text} is listed twice; use repeats"));
            }
            Some(time) => times.push(time),
        }
    }
    let mut seen = BTreeSet::new();
    for (index, name) in grid.weathers.iter().enumerate() {
        let key = format!("grid.weathers.{index}");
        if !weathers.contains_key(name) {
            let known = list(weathers.keys());
            return fault(
                key,
                format!(
                    "weather {name:?} is not defined; defined are {known}; add a table [weather.{name}]"
                ),
            );
        }
        if !seen.insert(name) {
            return fault(key, format!("{name} is listed twice; use repeats"));
        }
    }
    if times.is_empty() || grid.weathers.is_empty() || grid.repeats == 0 {
        return fault(
            "grid",
            "the grid is empty; expected at least one time, one weather and one repeat",
        );
    }
    let scenarios = times.len() * grid.weathers.len() * grid.repeats as usize;
    if scenarios > MOST_SCENARIOS {
        return fault(
            "grid.repeats",
            format!("the grid has {scenarios} scenarios; expected at most {MOST_SCENARIOS}"),
        );
    }
    within(
        "grid.day_of_year",
        f64::from(grid.day_of_year),
        (1.0, 365.0),
        "a day of the year",
    )?;
    within(
        "grid.utc_offset_h",
        grid.utc_offset_h,
        (-12.0, 14.0),
        "hours that local time is ahead of UTC",
    )?;
    Ok(times)
}

fn check_picture(picture: &Picture) -> Checked<()> {
    for (name, side_px) in [
        ("width_px", picture.width_px),
        ("height_px", picture.height_px),
    ] {
        if !PICTURE_SIDES_PX.contains(&side_px) || side_px % 2 == 1 {
            let (least, most) = (PICTURE_SIDES_PX.start(), PICTURE_SIDES_PX.end());
            return fault(
                format!("picture.{name}"),
                format!(
                    "{side_px} pixels cannot be recorded; expected an even number from {least} to {most}"
                ),
            );
        }
    }
    let rate = picture.frame_rate;
    if 1.0 / rate.period_s() > HIGHEST_FRAME_RATE_HZ {
        return fault(
            "picture.frame_rate",
            format!("{rate} is too fast; expected at most {HIGHEST_FRAME_RATE_HZ} per second"),
        );
    }
    Ok(())
}

fn check_weather(name: &str, weather: &Weather) -> Checked<()> {
    let key = |field: &str| format!("weather.{name}.{field}");
    legal_name(format!("weather.{name}"), name)?;
    within(
        key("visibility_m"),
        weather.visibility_m,
        (50.0, 200_000.0),
        "a visibility in metres",
    )?;
    within(
        key("rain_ratio"),
        weather.rain_ratio,
        (0.0, 1.0),
        "a rain intensity",
    )?;
    within(
        key("wind_speed_mps"),
        weather.wind_speed_mps,
        (0.0, 60.0),
        "a wind speed in m/s",
    )?;
    within(
        key("wind_from_true_deg"),
        weather.wind_from_true_deg,
        (0.0, 360.0),
        "a true direction in degrees",
    )?;
    within(
        key("turbulence_ratio"),
        weather.turbulence_ratio,
        (0.0, 1.0),
        "a turbulence intensity",
    )?;
    if weather.clouds.len() > MOST_CLOUD_LAYERS {
        let found = weather.clouds.len();
        return fault(
            key("clouds"),
            format!("{found} cloud layers; expected at most {MOST_CLOUD_LAYERS}"),
        );
    }
    let mut below_msl_m = f64::NEG_INFINITY;
    for (index, layer) in weather.clouds.iter().enumerate() {
        let key = |field: &str| key(&format!("clouds.{index}.{field}"));
        within(
            key("cover_ratio"),
            layer.cover_ratio,
            (0.0, 1.0),
            "a part of the sky",
        )?;
        within(
            key("base_msl_m"),
            layer.base_msl_m,
            (0.0, 20_000.0),
            "a height in metres",
        )?;
        within(
            key("top_msl_m"),
            layer.top_msl_m,
            (layer.base_msl_m, 25_000.0),
            "a height in metres above the base,",
        )?;
        if layer.base_msl_m < below_msl_m {
            return fault(
                key("base_msl_m"),
                format!(
                    "base at {} m, but the layer before reaches to {below_msl_m} m; expected lowest first, apart",
                    layer.base_msl_m
                ),
            );
        }
        below_msl_m = layer.top_msl_m;
    }
    Ok(())
}

fn check_rig(name: &str, rig: &Rig) -> Checked<()> {
    legal_name(format!("rig.{name}"), name)?;
    if rig.cameras.is_empty() {
        return fault(
            format!("rig.{name}.cameras"),
            "a rig without cameras; expected at least one",
        );
    }
    let mut seen = BTreeSet::new();
    for (index, camera) in rig.cameras.iter().enumerate() {
        let key = |field: &str| format!("rig.{name}.cameras.{index}.{field}");
        legal_name(key("id"), &camera.id)?;
        if !seen.insert(&camera.id) {
            return fault(
                key("id"),
                format!(
                    "two cameras are called {:?}; expected different ones",
                    camera.id
                ),
            );
        }
        let Camera {
            beyond_touchdown_m,
            beyond_threshold_m,
            inward_deg,
            heading_true_deg,
            ..
        } = camera;
        let place = exactly_one(*beyond_touchdown_m, *beyond_threshold_m).ok_or_else(|| Fault {
            key: key(""),
            message: format!(
                "camera {:?} needs either beyond_touchdown_m or beyond_threshold_m",
                camera.id
            ),
        })?;
        let aim = exactly_one(*inward_deg, *heading_true_deg).ok_or_else(|| Fault {
            key: key(""),
            message: format!(
                "camera {:?} needs either inward_deg or heading_true_deg",
                camera.id
            ),
        })?;
        let place_key = if beyond_touchdown_m.is_some() {
            "beyond_touchdown_m"
        } else {
            "beyond_threshold_m"
        };
        within(
            key(place_key),
            place,
            (-50_000.0, 50_000.0),
            "a distance in metres",
        )?;
        let aim_key = if inward_deg.is_some() {
            "inward_deg"
        } else {
            "heading_true_deg"
        };
        within(key(aim_key), aim, (-180.0, 360.0), "an angle in degrees")?;
        within(
            key("right_m"),
            camera.right_m,
            (-50_000.0, 50_000.0),
            "a distance in metres",
        )?;
        within(
            key("height_m"),
            camera.height_m,
            (0.0, 5_000.0),
            "a height over the touchdown target in metres",
        )?;
        within(
            key("pitch_deg"),
            camera.pitch_deg,
            (-89.0, 89.0),
            "an elevation in degrees",
        )?;
        within(
            key("hfov_deg"),
            camera.hfov_deg,
            (0.1, 150.0),
            "a field of view in degrees",
        )?;
    }
    Ok(())
}

fn exactly_one(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    match (a, b) {
        (Some(value), None) | (None, Some(value)) => Some(value),
        _ => None,
    }
}

fn check_airports(airports: &BTreeMap<String, AirportTable>) -> Checked<()> {
    for (icao, airport) in airports {
        for (name, table) in &airport.runway {
            let key = |field: &str| format!("airport.{icao}.runway.{name}.{field}");
            let RunwayTable {
                threshold,
                course_true_deg,
                glide_path_deg,
                touchdown_past_threshold_m,
                ..
            } = table;
            if let Some(Geodetic {
                latitude_deg,
                longitude_deg,
                altitude_msl_m,
            }) = *threshold
            {
                within(
                    key("threshold.latitude_deg"),
                    latitude_deg,
                    (-85.0, 85.0),
                    "a latitude in degrees",
                )?;
                within(
                    key("threshold.longitude_deg"),
                    longitude_deg,
                    (-180.0, 180.0),
                    "a longitude in degrees",
                )?;
                within(
                    key("threshold.altitude_msl_m"),
                    altitude_msl_m,
                    (-500.0, 6_000.0),
                    "a height in metres",
                )?;
            }
            let fields = [
                (
                    "course_true_deg",
                    course_true_deg,
                    (0.0, 360.0),
                    "a true course in degrees",
                ),
                (
                    "glide_path_deg",
                    glide_path_deg,
                    (1.0, 10.0),
                    "an angle in degrees",
                ),
                (
                    "touchdown_past_threshold_m",
                    touchdown_past_threshold_m,
                    (0.0, 3_000.0),
                    "a distance in metres",
                ),
            ];
            for (field, value, range, what) in fields {
                if let Some(value) = value {
                    within(key(field), *value, range, what)?;
                }
            }
        }
    }
    Ok(())
}

/// The runway of the sweep: as the program knows it, with what the sweep says otherwise; or wholly defined by the sweep.
fn runway(icao: &str, name: &str, airports: &BTreeMap<String, AirportTable>) -> Checked<Runway> {
    let table = airports
        .get(icao)
        .and_then(|airport| airport.runway.get(name));
    let known = airports::bundled(icao, name);
    if table.is_none() && known.is_none() {
        let bundled = airports::BUNDLED
            .iter()
            .map(|(airport, runway)| format!("{airport} {runway}"));
        let defined = airports
            .iter()
            .flat_map(|(airport, t)| t.runway.keys().map(move |r| format!("{airport} {r}")));
        let all = list(bundled.chain(defined));
        let airport_is_known = airports.contains_key(icao)
            || airports::BUNDLED
                .iter()
                .any(|(airport, _)| *airport == icao);
        let (key, what) = if airport_is_known {
            ("approach.runway", format!("runway {name:?} of {icao}"))
        } else {
            ("approach.airport", format!("airport {icao:?}"))
        };
        return fault(
            key,
            format!(
                "{what} is not known; known are {all}; define it in [airport.{icao}.runway.{name}]"
            ),
        );
    }
    let RunwayTable {
        threshold,
        course_true_deg,
        glide_path_deg,
        touchdown_past_threshold_m,
        ils_frequency_mhz,
        course_magnetic_deg,
    } = table.cloned().unwrap_or_default();
    let needed = |field: &str| Fault {
        key: format!("airport.{icao}.runway.{name}"),
        message: format!(
            "{field} is missing: the program does not know this runway, so the sweep has to define it whole"
        ),
    };
    Ok(Runway {
        airport: icao.into(),
        name: name.into(),
        threshold: threshold
            .or(known.as_ref().map(|k| k.threshold))
            .ok_or_else(|| needed("threshold"))?,
        course_true_deg: course_true_deg
            .or(known.as_ref().map(|k| k.course_true_deg))
            .ok_or_else(|| needed("course_true_deg"))?,
        glide_path_deg: glide_path_deg
            .or(known.as_ref().map(|k| k.glide_path_deg))
            .ok_or_else(|| needed("glide_path_deg"))?,
        touchdown_past_threshold_m: touchdown_past_threshold_m
            .or(known.as_ref().map(|k| k.touchdown_past_threshold_m))
            .ok_or_else(|| needed("touchdown_past_threshold_m"))?,
        ils_frequency_mhz: ils_frequency_mhz.or(known.as_ref().and_then(|k| k.ils_frequency_mhz)),
        course_magnetic_deg: course_magnetic_deg
            .or(known.as_ref().and_then(|k| k.course_magnetic_deg)),
    })
}

fn check_profiles(profiles: &BTreeMap<String, ApproachProfile>, runway: &Runway) -> Checked<()> {
    let ground = runway.threshold.altitude_msl_m;
    for (name, profile) in profiles {
        let key = |field: &str| format!("profile.{name}.{field}");
        let above_ground = (ground + 100.0, ground + 6_000.0);
        let what = "an altitude in metres, above the runway,";
        match *profile {
            ApproachProfile::GlidePath {
                level_altitude_msl_m,
            } => {
                within(
                    key("level_altitude_msl_m"),
                    level_altitude_msl_m,
                    above_ground,
                    what,
                )?;
            }
            ApproachProfile::StepDown {
                upper_altitude_msl_m,
                step_from_threshold_m,
                lower_altitude_msl_m,
            } => {
                within(
                    key("upper_altitude_msl_m"),
                    upper_altitude_msl_m,
                    above_ground,
                    what,
                )?;
                within(
                    key("lower_altitude_msl_m"),
                    lower_altitude_msl_m,
                    (above_ground.0, upper_altitude_msl_m),
                    "an altitude in metres, not above the upper level,",
                )?;
                within(
                    key("step_from_threshold_m"),
                    step_from_threshold_m,
                    (500.0, 60_000.0),
                    "a distance in metres",
                )?;
            }
            ApproachProfile::ContinuousDescent {
                start_altitude_msl_m,
            } => {
                within(
                    key("start_altitude_msl_m"),
                    start_altitude_msl_m,
                    above_ground,
                    what,
                )?;
            }
        }
    }
    Ok(())
}

fn check_start(start: &Start, profiles: &BTreeMap<String, ApproachProfile>) -> Checked<()> {
    let spreads = [
        ("dtd_nm", &start.dtd_nm, (0.5, 40.0), "nautical miles"),
        (
            "cross_track_m",
            &start.cross_track_m,
            (-5_000.0, 5_000.0),
            "metres",
        ),
        (
            "above_profile_m",
            &start.above_profile_m,
            (-500.0, 1_000.0),
            "metres",
        ),
        (
            "heading_offset_deg",
            &start.heading_offset_deg,
            (-60.0, 60.0),
            "degrees",
        ),
        ("speed_mps", &start.speed_mps, (55.0, 150.0), "m/s"),
    ];
    for (field, spread, range, unit) in spreads {
        let (least, most) = spread.range();
        for value in [least, most] {
            within(
                format!("start.{field}"),
                value,
                range,
                &format!("all that can be drawn, in {unit},"),
            )?;
        }
    }
    for (index, name) in start.profiles.iter().enumerate() {
        if !profiles.contains_key(name) {
            let known = list(profiles.keys());
            return fault(
                format!("start.profiles.{index}"),
                format!(
                    "profile {name:?} is not defined; defined are {known}; add a table [profile.{name}]"
                ),
            );
        }
    }
    if start.profiles.is_empty() {
        return fault("start.profiles", "no profile to fly; expected at least one");
    }
    Ok(())
}

fn check_split(split: &SplitFractions) -> Checked<()> {
    for (side, part) in [
        ("train", split.train),
        ("validation", split.validation),
        ("test", split.test),
    ] {
        within(format!("split.{side}"), part, (0.0, 1.0), "a part")?;
    }
    let sum = split.train + split.validation + split.test;
    if (sum - 1.0).abs() > 1e-6 {
        return fault("split", format!("the parts add up to {sum}, expected 1"));
    }
    Ok(())
}

fn read_recordings(
    index: usize,
    rule: RecordedRule,
    grid: &Grid,
    folder: &Path,
    runway: &Runway,
    start: &Start,
) -> Checked<RecordedFlights> {
    let key = |field: &str| format!("recorded.{index}.{field}");
    for (i, time) in rule.times.iter().enumerate() {
        if !grid.times.contains(time) {
            let known = list(&grid.times);
            return fault(
                key(&format!("times.{i}")),
                format!("{time:?} is no time of the grid; those are {known}"),
            );
        }
    }
    for (i, weather) in rule.weathers.iter().enumerate() {
        if !grid.weathers.contains(weather) {
            let known = list(&grid.weathers);
            return fault(
                key(&format!("weathers.{i}")),
                format!("{weather:?} is no weather of the grid; those are {known}"),
            );
        }
    }
    for (i, repeat) in rule.repeats.iter().enumerate() {
        let most = grid.repeats;
        if !(1..=most).contains(repeat) {
            return fault(
                key(&format!("repeats.{i}")),
                format!("there is no repeat {repeat}; expected 1 to {most}"),
            );
        }
    }
    let files = matching_files(&folder.join(&rule.files))
        .or_else(|message| fault(key("files"), message))?;
    let (_, longest_nm) = start.dtd_nm.range();
    let recordings = files
        .iter()
        .map(|file| {
            let recording = Recording::read(file)?;
            let longest_m = longest_nm * dataset::units::METERS_PER_NAUTICAL_MILE;
            recording
                .trajectory
                .approach(runway, longest_m)
                .map_err(|e| format!("{} {e}", file.display()))?;
            Ok(recording)
        })
        .collect::<Result<Vec<_>, String>>()
        .or_else(|message| fault(key("files"), message))?;
    Ok(RecordedFlights { rule, recordings })
}
