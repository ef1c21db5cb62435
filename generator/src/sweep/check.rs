//! Validates a parsed sweep: every value in its range, every name defined. Checks within a table are next to the table; here are those
//! across tables.

pub(crate) mod fault;
pub(crate) mod limits;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::LazyLock;

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

use super::document::Document;
use super::grid::times::LocalDay;
use super::grid::{Names, combinations};
use super::schema::schema_with_limits;
use super::start::{profiles, recorded};
use super::{Sweep, rigs, runways, traffic as other_aircraft};
use fault::{Checked, distinct_names, fault};

/// The schema, with the limits of each number.
static SCHEMA: LazyLock<serde_json::Value> = LazyLock::new(|| schema_with_limits().to_value());

/// Checks a sweep: `tables` and `text` are the file's content, paths are relative to `folder`.
pub(super) fn check(
    document: Document,
    tables: toml::Table,
    folder: &Path,
    text: &str,
) -> Checked<Sweep> {
    let tables = toml::Value::Table(tables);
    limits::check(&tables, &SCHEMA)?;
    let Document {
        corpus,
        approach,
        grid,
        exclude,
        include,
        picture,
        video,
        start,
        split,
        weather,
        rig,
        profile,
        airport,
        recorded,
        traffic,
        aim,
        jitter,
        imaging,
    } = document;
    if corpus.name.is_empty() {
        return fault("corpus.name", "the name is empty; expected one for people");
    }
    if corpus.name.chars().any(char::is_control) {
        return fault(
            "corpus.name",
            format!(
                "the name {:?} has a control character; expected one line of text",
                corpus.name
            ),
        );
    }
    let aircraft = approach.aircraft.checked()?;
    let runway = runways::runway(&approach.airport, &approach.runway, &airport)?;
    distinct_names("weather", weather.keys())?;
    for (name, weather) in &weather {
        weather.check(name, runway.threshold.altitude_msl_m)?;
    }
    let day = LocalDay::of(grid.day_of_year, grid.utc_offset_h, &runway, &airport)?;
    let cameras = rigs::cameras(&approach.rig, &rig)?;
    distinct_names(
        &format!("rig.{}.camera", approach.rig),
        cameras.iter().map(|camera| &camera.id),
    )?;
    let profile = profiles::all(&profile, &runway)?;
    distinct_names("profile", profile.keys())?;
    let names = Names {
        weathers: weather.keys().collect(),
        profiles: profile.keys().collect(),
    };
    let combinations = combinations(&grid, &exclude, &include, &names, &day)?;
    let picture = picture.checked()?;
    if let Some(aim) = &aim {
        aim.check()?;
    }
    if let Some(jitter) = &jitter {
        jitter.check(&cameras)?;
    }
    let imaging = match (imaging, tables.get("imaging")) {
        (Some(table), Some(toml::Value::Table(own))) => Some(table.checked(own)?),
        (table, _) => table,
    };
    rigs::check_lenses(&rig, picture, jitter.as_ref())?;
    if let Some((setting, message)) = video.fault() {
        return fault(format!("video.{setting}"), message);
    }
    start.check(&names.profiles, grid.profiles.is_some())?;
    let start_profiles = start.profiles();
    split.check()?;
    let (nearest_nm, longest_nm) = start.dtd_nm.range();
    let (recorded, rule_of) =
        recorded::read(recorded, &combinations, folder, &runway, longest_nm, &day)?;
    let traffic = other_aircraft::read(&traffic, &combinations, &day, &aircraft)?;
    let flown_by_profile = combinations
        .iter()
        .zip(&rule_of)
        .filter(|(_, rule)| rule.is_none());
    let names: BTreeSet<&String> = flown_by_profile
        .flat_map(|(combination, _)| match &combination.profile {
            Some(name) => std::slice::from_ref(name),
            None => start_profiles.as_slice(),
        })
        .collect();
    for name in names {
        let (_, above_m) = start.above_profile_m.range();
        let from = (nearest_nm * METERS_PER_NAUTICAL_MILE, above_m);
        profiles::check_descent(name, &profile[name], from, &runway)?;
    }
    let sweep = Sweep {
        corpus,
        runway,
        aircraft,
        rig_name: approach.rig,
        cameras,
        aim,
        jitter,
        imaging,
        combinations,
        day_of_year: day.day_of_year,
        utc_offset_h: day.utc_offset_h,
        zone_offset_h: day.zone_offset_h,
        picture,
        video,
        start,
        start_profiles,
        split,
        weathers: weather,
        profiles: profile,
        recorded,
        traffic,
        rule_of,
        text: text.to_owned(),
    };
    other_aircraft::check_separations(&sweep)?;
    Ok(sweep)
}
