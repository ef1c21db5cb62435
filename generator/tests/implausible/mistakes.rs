//! Kinds of mistakes in recordings, made from a good one.

use super::table::Table;

const COURSE_DEG: f64 = 23.02;
const VELOCITIES: &[&str] = &["v_north_mps", "v_east_mps"];
const PLACES: &[&str] = &["latitude_deg", "longitude_deg"];

/// A kind of mistake, the columns whose values are changed, the change, and words of the reason.
type Mistake = (
    &'static str,
    &'static [&'static str],
    fn(f64) -> f64,
    &'static str,
);

#[rustfmt::skip]
const OF_COLUMNS: [Mistake; 43] = [
    ("pressure altitude of a low", &["altitude_msl_m"], |m| m - 123.0, "below the runway"),
    ("pressure altitude of a high", &["altitude_msl_m"], |m| m + 123.0, "pressure altitude"),
    ("flight level", &["altitude_msl_m"], |m| m + 10_900.0, "pressure altitude"),
    ("altitude in feet", &["altitude_msl_m"], |m| m * 3.280_84, "altitude_msl_m that look like feet"),
    ("altitude in kilometres", &["altitude_msl_m"], |m| m * 1e-3, "altitude_msl_m falls by 1 m"),
    ("altitude in hundreds of feet", &["altitude_msl_m"], |m| m * 0.032_808_4, "altitude_msl_m falls by"),
    ("no altitude", &["altitude_msl_m"], |_| 0.0, "altitude_msl_m falls by 0 m"),
    ("climb instead of sink", &["v_down_mps"], |mps| -mps, "v_down_mps that look like velocities upwards"),
    ("sink in feet per minute", &["v_down_mps"], |mps| mps * 19.685, "v_down_mps"),
    ("sink in feet per second", &["v_down_mps"], |mps| mps * 3.280_84, "v_down_mps that look like feet per second"),
    ("no sink", &["v_down_mps"], |_| 0.0, "v_down_mps"),
    ("velocities in knots", VELOCITIES, |mps| mps * 1.943_84, "v_north_mps and v_east_mps that look like knots"),
    ("velocities in km/h", VELOCITIES, |mps| mps * 3.6, "look like kilometres per hour"),
    ("velocities in feet per second", VELOCITIES, |mps| mps * 3.280_84, "look like feet per second"),
    ("velocities of the opposite direction", VELOCITIES, |mps| -mps, "look like velocities of the opposite direction"),
    ("airspeed in knots", &["tas_mps"], |mps| mps * 1.943_84, "tas_mps"),
    ("airspeed in km/h", &["tas_mps"], |mps| mps * 3.6 * 0.55, "tas_mps"),
    ("airspeed as a Mach number", &["tas_mps"], |mps| mps / 340.0, "tas_mps is 0.00 times"),
    ("no airspeed", &["tas_mps"], |_| 0.0, "tas_mps is 0.00 times"),
    ("places in radians", PLACES, f64::to_radians, "look like radians"),
    ("southern latitude", &["latitude_deg"], |deg| -deg, "southern latitudes"),
    ("western longitude", &["longitude_deg"], |deg| -deg, "western longitudes"),
    ("positions in steps of a hundredth of a degree", PLACES, |deg| (deg * 1e2).round() / 1e2, "velocities"),
    ("positions in degrees, minutes and seconds", PLACES, minutes_and_seconds, "is never between"),
    ("heading in radians", &["heading_true_deg"], f64::to_radians, "heading_true_deg that look like radians"),
    ("flying backwards", &["heading_true_deg"], |deg| (deg + 180.0) % 360.0, "flies backwards"),
    ("flying sideways", &["heading_true_deg"], |deg| (deg + 90.0) % 360.0, "heading and track differ"),
    ("attitude in radians", &["pitch_deg", "roll_deg"], f64::to_radians, "pitch_deg that look like radians"),
    ("pitch in radians", &["pitch_deg"], f64::to_radians, "pitch_deg that look like radians"),
    ("pitch far too high", &["pitch_deg"], |deg| deg + 12.0, "above the path"),
    ("a heading of 0 throughout", &["heading_true_deg"], |_| 0.0, "heading_true_deg is 0 in every row"),
    ("an airspeed that is too low", &["tas_mps"], |mps| mps * 0.6, "tas_mps is"),
    ("gear retracted", &["gear_norm"], |_| 0.0, "gear_norm is 0"),
    ("gear down as 0", &["gear_norm"], |ratio| 1.0 - ratio, "gear_norm is 0"),
    ("flaps extended as 0", &["flap_norm"], |ratio| 1.0 - ratio, "flap_norm falls"),
    ("times in milliseconds", &["t_s"], |s| s * 1e3, "t_s that look like milliseconds"),
    ("times in minutes", &["t_s"], |s| s / 60.0, "t_s that look like minutes"),
    ("time that stands still", &["t_s"], |_| 0.0, "t_s goes from 0 to 0"),
    ("time that runs backwards", &["t_s"], |s| -s, "t_s goes from"),
    ("always on the ground", &["on_ground"], |_| 1.0, "on_ground"),
    ("ground and air exchanged", &["on_ground"], |ground| 1.0 - ground, "on_ground is true"),
    ("flaps in degrees", &["flap_norm"], |ratio| ratio * 40.0, "expected a ratio from 0 to 1"),
    ("gear in per cent", &["gear_norm"], |ratio| ratio * 100.0, "expected a ratio from 0 to 1"),
];

/// Kinds of mistakes, and words of the reason.
pub(crate) fn mistakes(good: &Table) -> Vec<(&'static str, Table, &'static str)> {
    let changed = |(kind, columns, change, words): Mistake| {
        let table = columns
            .iter()
            .fold(good.clone(), |table, column| table.changed(column, change));
        (kind, table, words)
    };
    let mut all: Vec<_> = OF_COLUMNS.into_iter().map(changed).collect();
    let mut add = |kind, words, table| all.push((kind, table, words));
    let moved = |azimuth_deg: f64, metres: f64| good.clone().moved(azimuth_deg, metres);

    let of_angle = |factor: f64| {
        const FIELD_M: f64 = 6.71;
        // Otherwise the pitch gives it away.
        let table = good.clone().changed("pitch_deg", |_| 2.5);
        let table = table.changed("altitude_msl_m", |m| {
            FIELD_M + factor * (m - FIELD_M).max(0.0)
        });
        table.changed("v_down_mps", |mps| factor * mps)
    };
    add(
        "an approach of 9.8 degrees",
        "m above the runway",
        of_angle(3.3),
    );
    add(
        "an approach of 0.9 degrees",
        "m above the runway",
        of_angle(0.3),
    );
    let swapped = good.clone().swapped("latitude_deg", "longitude_deg");
    add("places swapped", "swapped coordinates", swapped);
    let swapped = good.clone().swapped("v_north_mps", "v_east_mps");
    let words = "look like velocities with north and east exchanged";
    add("north and east swapped", words, swapped);
    let beside = moved(COURSE_DEG + 90.0, 1_500.0);
    add("parallel runway", "m right of the centreline", beside);
    let beside = moved(COURSE_DEG - 90.0, 20_000.0);
    add("far to the side", "m left of the centreline", beside);
    let behind = moved(COURSE_DEG + 180.0, 300_000.0);
    add("another airport", "is never between", behind);
    let turned = good.clone().turned_around();
    add("the runway's other direction", "is never between", turned);

    let mut two_rows = good.clone();
    let passing = good.passing();
    two_rows.rows = good.rows[passing - 1..=passing].to_vec();
    add("two rows", "allow = [\"part\"]", two_rows);
    let mut half = good.clone();
    half.rows.truncate(good.rows.len() / 2);
    let words =
        "m before the touchdown target of WSSS 02L; if this is meant, add `allow = [\"part\"]`";
    add("half an approach", words, half);
    let mut climbing = good.clone();
    climbing.rows.truncate(passing + 1);
    let climbing = climbing.continued(60, 6.0, 0.0);
    add("a go-around", "goes around", climbing);
    let hole = good
        .clone()
        .without(|_, row| (60.0..120.0).contains(&row[0]));
    add("a hole of a minute", "s after the one before it", hole);

    let words = "from where the velocities put it";
    let mut frozen = good.clone();
    for row in 201..350 {
        for column in PLACES.iter().map(|name| good.place(name)) {
            frozen.rows[row][column] = good.rows[200][column];
        }
    }
    add("a position that freezes for half a minute", words, frozen);
    let mut wrong = good.clone();
    wrong.rows[300][good.place("altitude_msl_m")] += 500.0;
    add("a wrong altitude", words, wrong);
    let other = moved(COURSE_DEG + 90.0, 4_000.0);
    let mut both = good.clone();
    both.rows = (good.rows.iter().zip(other.rows))
        .flat_map(|(one, mut other)| {
            other[0] += 0.1;
            [one.clone(), other]
        })
        .collect();
    add("two aircraft in one file", words, both);
    all
}

/// An angle as its digits are written: 1 degree, 20 minutes, 56 seconds as 1.2056.
fn minutes_and_seconds(angle_deg: f64) -> f64 {
    let minutes = angle_deg.fract() * 60.0;
    angle_deg.trunc() + minutes.trunc() / 100.0 + minutes.fract() * 60.0 / 10_000.0
}
