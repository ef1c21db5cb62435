//! Runways from the tables that X-Plane and OurAirports publish. The runway here is invented: 3,000 m long, at 50 degrees north.

use std::fs;
use std::path::{Path, PathBuf};
use std::slice;

use dataset::geometry::geodesy::LatLon;
use generator::airports::{Imported, import, in_file};

const START: LatLon = LatLon {
    latitude_deg: 50.0,
    longitude_deg: 8.0,
};
const COURSE_DEG: f64 = 70.0;
const LENGTH_M: f64 = 3_000.0;

fn along(from: LatLon, metres: f64, right_m: f64) -> LatLon {
    let on_line = from.destination(COURSE_DEG, metres);
    on_line.destination(COURSE_DEG + 90.0, right_m)
}

fn write(folder: &Path, name: &str, text: String) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

/// The airport's apt.dat, with the far end of the runway moved sideways.
fn apt_dat(folder: &Path, far_right_m: f64) -> PathBuf {
    let far = along(START, LENGTH_M, far_right_m);
    let text = format!(
        "I\n1000 Version\n\n1  300 0 0 ZZZZ Nowhere\n100 45.00 1 0 0.25 1 3 1 07  {:.8} {:.8} 200.00 0.00 3 1 1 0 25 {:.8} {:.8} 0.00 0.00 2 0 1 0\n",
        START.latitude_deg, START.longitude_deg, far.latitude_deg, far.longitude_deg
    );
    write(folder, "apt.dat", text)
}

fn our_airports(folder: &Path) -> PathBuf {
    let far = along(START, LENGTH_M, 0.0);
    let text = format!(
        "\"id\",\"airport_ident\",\"length_ft\",\"le_ident\",\"le_latitude_deg\",\"le_longitude_deg\",\"le_elevation_ft\",\
         \"le_displaced_threshold_ft\",\"he_ident\",\"he_latitude_deg\",\"he_longitude_deg\",\"he_elevation_ft\",\"he_displaced_threshold_ft\"\n\
         1,\"ZZZZ\",{:.0},\"07\",{},{},328.084,656.168,\"25\",{},{},330,\n",
        LENGTH_M / 0.3048,
        START.latitude_deg,
        START.longitude_deg,
        far.latitude_deg,
        far.longitude_deg
    );
    write(folder, "runways.csv", text)
}

/// Localizer and glide path in the form of version 1100, with a region.
fn earth_nav(folder: &Path) -> PathBuf {
    let localizer = along(START, LENGTH_M + 300.0, 0.0);
    let antenna = along(START, 200.0 + 310.0, 120.0);
    let text = format!(
        "I\n1100 Version\n\n4 {:.8} {:.8} 330 11030 18 24190.000 IZZ ZZZZ ED 07 ILS-cat-I\n6 {:.8} {:.8} 329 11030 18 320070.000 IZZ ZZZZ ED 07 GS\n",
        localizer.latitude_deg,
        localizer.longitude_deg,
        antenna.latitude_deg,
        antenna.longitude_deg
    );
    write(folder, "earth_nav.dat", text)
}

fn imported(files: &[PathBuf]) -> Imported {
    import("ZZZZ", "07", files).unwrap()
}

/// The runway from three tables: X-Plane's with the far end moved sideways, OurAirports', and localizers.
fn from_three_tables(
    folder: &Path,
    far_right_m: f64,
    localizers: fn(&Path) -> PathBuf,
) -> Imported {
    imported(&[
        apt_dat(folder, far_right_m),
        our_airports(folder),
        localizers(folder),
    ])
}

#[test]
fn a_runway_has_the_course_between_its_ends_the_displaced_threshold_and_the_origin_of_its_glide_path()
 {
    let folder = tempfile::tempdir().unwrap();
    let found = from_three_tables(folder.path(), 0.0, earth_nav);
    let runway = &found.runway;
    assert_eq!(found.conflicts, []);
    let threshold = along(START, 200.0, 0.0);
    assert!(threshold.distance_m(runway.threshold.lat_lon()) < 0.05);
    assert!((runway.threshold.altitude_msl_m - 100.0).abs() < 0.01);
    // Meridians converge over 200 m.
    assert!(
        (runway.course_true_deg - COURSE_DEG).abs() < 0.01,
        "{runway:?}"
    );
    assert!(
        (runway.touchdown_past_threshold_m - 310.0).abs() < 0.2,
        "{runway:?}"
    );
    assert_eq!(
        (runway.glide_path_deg, runway.ils_frequency_mhz),
        (3.2, Some(110.3))
    );
}

#[test]
fn tables_that_differ_are_named_and_the_one_on_the_localizers_axis_is_recommended() {
    let folder = tempfile::tempdir().unwrap();
    let found = from_three_tables(folder.path(), 12.0, earth_nav);
    let [conflict] = &found.conflicts[..] else {
        panic!("{:?}", found.conflicts);
    };
    assert_eq!(conflict.figure, "course_true_deg");
    assert!(
        conflict.recommended.starts_with("OurAirports"),
        "{conflict:?}"
    );
    assert!((found.runway.course_true_deg - COURSE_DEG).abs() < 0.01);
}

#[test]
fn apt_dat_alone_gives_a_runway_at_the_elevation_of_the_field_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let found = imported(&[apt_dat(folder.path(), 0.0)]);
    assert!((found.runway.threshold.altitude_msl_m - 91.44).abs() < 0.01);
    let text = found.toml();
    let threshold = text
        .lines()
        .find(|line| line.starts_with("threshold"))
        .unwrap();
    assert!(
        threshold.contains("# ASSUMED: elevation of the field"),
        "{text}"
    );
    let path = apt_dat(folder.path(), 0.0);
    let far_away = fs::read_to_string(&path).unwrap().replace(" 25 ", " 25 -");
    fs::write(&path, far_away).unwrap();
    let said = import("ZZZZ", "07", &[path]).unwrap_err().to_string();
    assert!(said.contains("m apart, expected 300 to 8000 m"), "{said}");
}

#[test]
fn what_is_missing_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let apt = apt_dat(folder.path(), 0.0);
    let message = |airport: &str, runway: &str, files: &[PathBuf]| {
        import(airport, runway, files).unwrap_err().to_string()
    };
    assert!(message("ZZZZ", "09", slice::from_ref(&apt)).contains("they have runways 07, 25"));
    assert!(
        message("YYYY", "07", slice::from_ref(&apt)).contains("the airport is in none of them")
    );
    let other = write(folder.path(), "apt.dat", "some text\n".into());
    assert!(message("ZZZZ", "07", &[other]).contains("is no table of runways"));
    let broken = write(
        folder.path(),
        "broken",
        "I\n1000 Version\n1 300 0 0 ZZZZ Nowhere\n100 45 1 0 0.25 1 3 1 07 x 8.0 0 0 3 1 1 0 25 50.1 8.1 0 0 2 0 1 0\n".into(),
    );
    assert!(
        message("ZZZZ", "07", &[broken]).contains(":4: the latitude is \"x\"; expected -90 to 90")
    );
}

#[test]
fn a_table_that_is_far_from_the_localizer_is_never_recommended_and_the_output_is_a_sweeps_table() {
    let folder = tempfile::tempdir().unwrap();
    let found = from_three_tables(folder.path(), 160.0, earth_nav);
    assert!((found.runway.course_true_deg - COURSE_DEG).abs() < 0.01);
    let file = write(folder.path(), "runway.toml", found.toml());
    assert_eq!(in_file(&file, "ZZZZ", "07").unwrap(), found.runway);
}

/// Localizers of both directions, 30 m to the right of the runway.
fn localizers_aside(folder: &Path) -> PathBuf {
    localizers_of(folder, 30.0)
}

/// Localizers of both directions.
fn localizers_of(folder: &Path, right_m: f64) -> PathBuf {
    let row = |metres: f64, runway: &str| {
        let place = along(START, metres, 0.0).destination(COURSE_DEG + 90.0, right_m);
        format!(
            "4 {:.8} {:.8} 330 11030 18 24190.000 IZZ ZZZZ ED {runway} ILS-cat-I\n",
            place.latitude_deg, place.longitude_deg
        )
    };
    let rows = row(LENGTH_M + 300.0, "07") + &row(-300.0, "25");
    write(
        folder,
        "earth_nav.dat",
        format!("I\n1100 Version\n\n{rows}"),
    )
}

fn aside(from: LatLon) -> LatLon {
    from.destination(COURSE_DEG + 90.0, 30.0)
}

#[test]
fn ends_that_all_miss_the_localizers_are_moved_onto_the_axis_of_both() {
    let folder = tempfile::tempdir().unwrap();
    // Both tables are beside the localizers, and differ from each other.
    let found = from_three_tables(folder.path(), 12.0, localizers_aside);
    let threshold = aside(along(START, 200.0, 0.0));
    let off_m = threshold.distance_m(found.runway.threshold.lat_lon());
    assert!(off_m < 0.5, "{off_m} m: {found:?}");
    let first = &found.conflicts[0];
    assert!(
        first.recommended.starts_with("the axis of both localizers"),
        "{first:?}"
    );
}

#[test]
fn localizers_beside_a_runway_do_not_move_one_on_which_two_tables_agree() {
    let folder = tempfile::tempdir().unwrap();
    let found = from_three_tables(folder.path(), 0.0, localizers_aside);
    let off_m = along(START, 200.0, 0.0).distance_m(found.runway.threshold.lat_lon());
    assert!(off_m < 0.5, "{off_m} m: {found:?}");
    let [conflict] = &found.conflicts[..] else {
        panic!("{:?}", found.conflicts);
    };
    assert!(
        conflict.found.contains("the localizer stands beside it"),
        "{conflict:?}"
    );
}

#[test]
fn a_runway_is_confirmed_by_sources_that_agree_or_named_as_unconfirmed() {
    let folder = tempfile::tempdir().unwrap();
    let ours = our_airports(folder.path());
    // 2 m at the far end are 0.04 degrees, less than a conflict.
    for (far_right_m, confirmed_by) in [(0.0, vec!["OurAirports"]), (2.0, vec![])] {
        let found = imported(&[apt_dat(folder.path(), far_right_m), ours.clone()]);
        assert_eq!(found.conflicts, []);
        assert_eq!(found.confirmed_by, confirmed_by);
        assert_eq!(found.toml().contains("unconfirmed"), far_right_m != 0.0);
    }
    let localizers = localizers_of(folder.path(), 0.0);
    let found = imported(&[ours, localizers]);
    assert!(
        found.confirmed_by[0].starts_with("the axis of both localizers"),
        "{found:?}"
    );
}

#[test]
fn the_magnetic_course_is_the_models_and_another_stated_one_is_a_conflict() {
    let folder = tempfile::tempdir().unwrap();
    let tables = [our_airports(folder.path()), earth_nav(folder.path())];
    let found = imported(&tables);
    let magnetic_deg = found.runway.course_magnetic_deg.unwrap();
    // 3.4 degrees east in 2023.
    assert!((magnetic_deg - 66.6).abs() < 0.5, "{magnetic_deg}");
    assert!(found.toml().contains("World Magnetic Model"));
    let text = fs::read_to_string(&tables[1]).unwrap();
    fs::write(&tables[1], text.replace("24190.000", "27070.000")).unwrap();
    let [conflict] = &imported(&tables).conflicts[..] else {
        panic!("no conflict");
    };
    assert!(
        conflict.found.starts_with("75.0 by earth_nav.dat, 66."),
        "{conflict:?}"
    );
}
