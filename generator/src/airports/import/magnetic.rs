//! Magnetic courses: by the World Magnetic Model, and as stated by sources.

use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::sun;
use dataset::numbers::units::Degrees;
use world_magnetic_model::GeomagneticField;
use world_magnetic_model::time::Date;
use world_magnetic_model::uom::si::angle::degree;
use world_magnetic_model::uom::si::f32::{Angle, Length};
use world_magnetic_model::uom::si::length::meter;

use super::Conflict;

const MID_YEAR_DAY: u16 = 183;
/// A stated magnetic course may be off by this much, degrees: variations are updated every five to ten years, and change by up to 0.2
/// degrees a year.
const STATED_TOLERANCE_DEG: f64 = 2.0;
/// A designator is the magnetic course in tens of degrees, rounded, and changed late.
const DESIGNATOR_TOLERANCE_DEG: f64 = 10.0;

/// Magnetic course in the middle of the sweeps' year, degrees; `None` where the model is not valid.
pub(super) fn course_magnetic_deg(course_true_deg: f64, threshold: Geodetic) -> Option<f64> {
    let date = Date::from_ordinal_date(sun::YEAR, MID_YEAR_DAY).ok()?;
    // Single precision is enough: the model is good to 0.3 degrees.
    let angle = |degrees: f64| Angle::new::<degree>(degrees as f32);
    let field = GeomagneticField::new(
        Length::new::<meter>(threshold.altitude_msl_m as f32),
        angle(threshold.latitude_deg),
        angle(threshold.longitude_deg),
        date,
    )
    .ok()?;
    let east_deg = f64::from(field.declination().get::<degree>());
    Some(Degrees(course_true_deg - east_deg).wrapped_360().0)
}

/// Contradictions with the stated magnetic course and with the runway's designator.
pub(super) fn contradictions(
    magnetic_deg: f64,
    stated_deg: Option<f64>,
    designator: &str,
) -> Vec<Conflict> {
    let off_deg = |other_deg: f64| Degrees(other_deg - magnetic_deg).wrapped_180().0;
    let mut found = Vec::new();
    let year = sun::YEAR;
    let conflict = |found: String| Conflict {
        figure: "course_magnetic_deg",
        found,
        recommended: format!("the World Magnetic Model: {magnetic_deg:.1}"),
    };
    if let Some(stated_deg) =
        stated_deg.filter(|stated_deg| off_deg(*stated_deg).abs() > STATED_TOLERANCE_DEG)
    {
        found.push(conflict(format!(
            "{stated_deg:.1} by earth_nav.dat, {magnetic_deg:.1} by the World Magnetic Model in {year}"
        )));
    }
    let digits = designator.trim_end_matches(|letter: char| !letter.is_ascii_digit());
    let named_deg = digits.parse::<f64>().ok().map(|tens| tens * 10.0);
    if let Some(named_deg) =
        named_deg.filter(|named_deg| off_deg(*named_deg).abs() > DESIGNATOR_TOLERANCE_DEG)
    {
        found.push(conflict(format!(
            "{named_deg:.0} by the designator {designator}, {magnetic_deg:.1} by the World Magnetic Model in {year}: another or a renamed runway?"
        )));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(latitude_deg: f64, longitude_deg: f64) -> Geodetic {
        Geodetic {
            latitude_deg,
            longitude_deg,
            altitude_msl_m: 0.0,
        }
    }

    #[test]
    fn variations_are_those_of_charts() {
        // Changi: 0.3 degrees east; Cape Town: 26 west; New York: 13 west; Sydney: 13 east.
        for (place, east_deg) in [
            (at(1.35, 103.98), 0.3),
            (at(-33.97, 18.6), -26.0),
            (at(40.64, -73.78), -12.8),
            (at(-33.95, 151.18), 12.9),
        ] {
            let magnetic_deg = course_magnetic_deg(90.0, place).unwrap();
            assert!(
                (90.0 - magnetic_deg - east_deg).abs() < 0.6,
                "{place:?}: {magnetic_deg}"
            );
        }
    }

    #[test]
    fn stated_courses_and_designators_that_contradict_the_model_are_named() {
        assert_eq!(contradictions(23.0, Some(24.5), "02L"), []);
        assert_eq!(contradictions(358.0, Some(359.5), "36"), []);
        let found = contradictions(23.0, Some(27.0), "05");
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].found.starts_with("27.0 by earth_nav.dat, 23.0"));
        assert!(found[1].found.contains("designator 05"));
    }
}
