//! X-Plane's `earth_nav.dat`: rows 4 and 5 are localizers, row 6 glide paths. From version 1100 on they name a region before the runway.

use std::io::BufRead;

use dataset::numbers::units::METERS_PER_FOOT;

use super::{Aid, Facts, Lines, Wanted};

/// Field index of the airport; version 810 has the runway next.
const AIRPORT: usize = 8;
const ELEVATION_FT: std::ops::RangeInclusive<f64> = -1_500.0..=16_000.0;
/// Frequencies in units of 10 kHz.
const FREQUENCY: std::ops::RangeInclusive<f64> = 10_800.0..=11_200.0;
/// Glide path angle in units of 0.01 degrees times 1,000, plus the bearing.
const ANGLE: std::ops::RangeInclusive<f64> = 200_000.0..=800_000.0;
/// The true bearing, degrees; from version 1100 on with 360 times the magnetic course, in whole degrees.
const BEARING: std::ops::RangeInclusive<f64> = 0.0..=130_320.0;

pub(super) fn is_one(head: &str) -> bool {
    let is_aid = |line: &str| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        matches!(fields.first(), Some(&("2" | "3" | "4" | "5" | "6"))) && fields.len() >= 9
    };
    head.lines().any(is_aid)
}

pub(super) fn read<R: BufRead>(
    mut lines: Lines<'_, R>,
    wanted: &Wanted<'_>,
    facts: &mut Facts,
) -> dataset::Result<()> {
    let opposite = wanted.opposite();
    while let Some(line) = lines.next()? {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let is_aid = matches!(fields.first(), Some(&("4" | "5" | "6")));
        let is_here = fields
            .get(AIRPORT)
            .is_some_and(|icao| *icao == wanted.airport);
        let after = fields.get(AIRPORT + 1..).unwrap_or_default();
        let is_of = |runway: &str| after.iter().take(2).any(|name| *name == runway);
        let is_runway = is_of(wanted.runway);
        let is_opposite = fields.first() != Some(&"6") && opposite.as_deref().is_some_and(is_of);
        if !(is_aid && is_here && (is_runway || is_opposite)) {
            continue;
        }
        let field = |at: usize| fields.get(at).copied();
        let place = lines.place(field(1), field(2))?;
        if is_opposite {
            facts.opposite.get_or_insert(place);
            continue;
        }
        facts.aids.push(if fields[0] == "6" {
            let coded = lines.number("the glide path's angle and bearing", field(6), ANGLE)?;
            let elevation_ft = lines.number("the elevation", field(3), ELEVATION_FT)?;
            Aid::GlidePath {
                place,
                elevation_m: elevation_ft * METERS_PER_FOOT,
                angle_deg: (coded / 1_000.0).floor() / 100.0,
            }
        } else {
            let coded = lines.number("the localizer's bearing", field(6), BEARING)?;
            Aid::Localizer {
                place,
                frequency_mhz: lines.number("the frequency", field(4), FREQUENCY)? / 100.0,
                course_magnetic_deg: (coded > 360.0).then(|| (coded / 360.0).floor()),
            }
        });
    }
    Ok(())
}
