//! Kinds of mistakes in recordings, made from a good one.

use std::collections::BTreeMap;

use super::table::Table;

/// Kinds of mistakes, and words of the reason.
pub(crate) fn mistakes(good: &Table) -> BTreeMap<&'static str, (Table, &'static str)> {
    let course_deg = 23.02;
    let scaled = |column: &str, factor: f64| good.clone().changed(column, |value| value * factor);
    let velocities = |factor: f64| {
        let north = scaled("v_north_mps", factor);
        north.changed("v_east_mps", |value| value * factor)
    };
    let radians = |columns: &[&str]| {
        columns.iter().fold(good.clone(), |table, column| {
            table.changed(column, f64::to_radians)
        })
    };
    BTreeMap::from([
        (
            "pressure altitude of a low",
            (
                good.clone().changed("altitude_msl_m", |m| m - 123.0),
                "below the runway",
            ),
        ),
        (
            "pressure altitude of a high",
            (
                good.clone().changed("altitude_msl_m", |m| m + 123.0),
                "pressure altitude",
            ),
        ),
        (
            "flight level",
            (
                good.clone().changed("altitude_msl_m", |m| m + 10_900.0),
                "pressure altitude",
            ),
        ),
        (
            "altitude in feet",
            (
                scaled("altitude_msl_m", 3.280_84),
                "altitude_msl_m that look like feet",
            ),
        ),
        (
            "climb instead of sink",
            (
                scaled("v_down_mps", -1.0),
                "v_down_mps that look like velocities upwards",
            ),
        ),
        (
            "sink in feet per minute",
            (scaled("v_down_mps", 19.685), "v_down_mps"),
        ),
        ("no sink", (scaled("v_down_mps", 0.0), "v_down_mps")),
        (
            "velocities in knots",
            (
                velocities(1.943_84),
                "v_north_mps and v_east_mps that look like knots",
            ),
        ),
        (
            "velocities in km/h",
            (velocities(3.6), "look like kilometres per hour"),
        ),
        (
            "airspeed in knots",
            (scaled("tas_mps", 1.943_84), "tas_mps"),
        ),
        (
            "airspeed in km/h",
            (scaled("tas_mps", 3.6 * 0.55), "tas_mps"),
        ),
        (
            "no airspeed",
            (scaled("tas_mps", 0.0), "tas_mps is 0.00 times"),
        ),
        (
            "places in radians",
            (
                radians(&["latitude_deg", "longitude_deg"]),
                "look like radians",
            ),
        ),
        (
            "heading in radians",
            (
                radians(&["heading_true_deg"]),
                "heading_true_deg that look like radians",
            ),
        ),
        (
            "attitude in radians",
            (
                radians(&["pitch_deg", "roll_deg"]),
                "pitch_deg and roll_deg that look like radians",
            ),
        ),
        (
            "latitude and longitude swapped",
            (
                good.clone().swapped("latitude_deg", "longitude_deg"),
                "swapped coordinates",
            ),
        ),
        (
            "southern latitude",
            (scaled("latitude_deg", -1.0), "southern latitudes"),
        ),
        (
            "western longitude",
            (scaled("longitude_deg", -1.0), "western longitudes"),
        ),
        (
            "flying backwards",
            (
                good.clone()
                    .changed("heading_true_deg", |deg| (deg + 180.0) % 360.0),
                "flies backwards",
            ),
        ),
        (
            "flying sideways",
            (
                good.clone()
                    .changed("heading_true_deg", |deg| (deg + 90.0) % 360.0),
                "heading and track differ",
            ),
        ),
        (
            "north and east swapped",
            (
                good.clone().swapped("v_north_mps", "v_east_mps"),
                "look like velocities with north and east exchanged",
            ),
        ),
        (
            "parallel runway",
            (
                good.clone().moved(course_deg + 90.0, 1_500.0),
                "m right of the centreline",
            ),
        ),
        (
            "far to the side",
            (
                good.clone().moved(course_deg - 90.0, 20_000.0),
                "m left of the centreline",
            ),
        ),
        (
            "times in milliseconds",
            (scaled("t_s", 1e3), "t_s that look like milliseconds"),
        ),
        (
            "times in minutes",
            (scaled("t_s", 1.0 / 60.0), "t_s that look like minutes"),
        ),
        (
            "always on the ground",
            (good.clone().changed("on_ground", |_| 1.0), "on_ground"),
        ),
        ("two rows", {
            let mut table = good.clone();
            let passing = table.passing();
            table.rows = table.rows[passing - 1..=passing].to_vec();
            (table, "allow = [\"part\"]")
        }),
        ("half an approach", {
            let mut table = good.clone();
            let rows = table.rows.len();
            table.rows.truncate(rows / 2);
            (
                table,
                "m before the touchdown target of WSSS 02L; if this is meant, add `allow = [\"part\"]`",
            )
        }),
        (
            "time that stands still",
            (scaled("t_s", 0.0), "t_s goes from 0 to 0"),
        ),
        (
            "time that runs backwards",
            (scaled("t_s", -1.0), "t_s goes from"),
        ),
        (
            "velocities in feet per second",
            (velocities(3.280_84), "look like feet per second"),
        ),
        (
            "sink in feet per second",
            (
                scaled("v_down_mps", 3.280_84),
                "v_down_mps that look like feet per second",
            ),
        ),
        (
            "altitude in kilometres",
            (
                scaled("altitude_msl_m", 1e-3),
                "altitude_msl_m falls by 1 m",
            ),
        ),
        (
            "altitude in hundreds of feet",
            (
                scaled("altitude_msl_m", 0.032_808_4),
                "altitude_msl_m falls by",
            ),
        ),
        (
            "no altitude",
            (scaled("altitude_msl_m", 0.0), "altitude_msl_m falls by 0 m"),
        ),
        (
            "airspeed as a Mach number",
            (scaled("tas_mps", 1.0 / 340.0), "tas_mps is 0.00 times"),
        ),
        (
            "velocities of the opposite direction",
            (
                velocities(-1.0),
                "look like velocities of the opposite direction",
            ),
        ),
        (
            "ground and air exchanged",
            (
                good.clone().changed("on_ground", |ground| 1.0 - ground),
                "on_ground is true",
            ),
        ),
        (
            "flaps in degrees",
            (scaled("flap_norm", 40.0), "expected a ratio from 0 to 1"),
        ),
        (
            "gear in per cent",
            (scaled("gear_norm", 100.0), "expected a ratio from 0 to 1"),
        ),
        (
            "another airport",
            (
                good.clone().moved(course_deg + 180.0, 300_000.0),
                "is never between",
            ),
        ),
        (
            "the runway's other direction",
            (good.clone().turned_around(), "is never between"),
        ),
        (
            "a hole of a minute",
            (
                good.clone()
                    .without(|_, row| (60.0..120.0).contains(&row[0])),
                "s after the one before it",
            ),
        ),
        ("a position that freezes for half a minute", {
            let mut table = good.clone();
            let columns = ["latitude_deg", "longitude_deg"].map(|name| table.place(name));
            for row in 201..350 {
                for column in columns {
                    table.rows[row][column] = table.rows[200][column];
                }
            }
            (table, "from where the velocities put it")
        }),
        ("a wrong altitude", {
            let mut table = good.clone();
            let altitude = table.place("altitude_msl_m");
            table.rows[300][altitude] += 500.0;
            (table, "from where the velocities put it")
        }),
        (
            "positions in steps of a hundredth of a degree",
            (
                good.clone()
                    .changed("latitude_deg", |deg| (deg * 1e2).round() / 1e2)
                    .changed("longitude_deg", |deg| (deg * 1e2).round() / 1e2),
                "velocities",
            ),
        ),
        (
            "positions in degrees, minutes and seconds",
            (
                good.clone()
                    .changed("latitude_deg", minutes_and_seconds)
                    .changed("longitude_deg", minutes_and_seconds),
                "is never between",
            ),
        ),
        (
            "a go-around",
            (
                {
                    let passing = good.passing();
                    let mut table = good.clone();
                    table.rows.truncate(passing + 1);
                    table.continued(60, 6.0, 0.0)
                },
                "goes around",
            ),
        ),
        ("two aircraft in one file", {
            let other = good.clone().moved(course_deg + 90.0, 4_000.0);
            let mut table = good.clone();
            table.rows = (good.rows.iter().zip(other.rows))
                .flat_map(|(one, mut other)| {
                    other[0] += 0.1;
                    [one.clone(), other]
                })
                .collect();
            (table, "from where the velocities put it")
        }),
    ])
}

/// An angle as its digits are written: 1 degree, 20 minutes, 56 seconds as 1.2056.
fn minutes_and_seconds(angle_deg: f64) -> f64 {
    let minutes = angle_deg.fract() * 60.0;
    angle_deg.trunc() + minutes.trunc() / 100.0 + minutes.fract() * 60.0 / 10_000.0
}
