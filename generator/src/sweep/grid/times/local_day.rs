//! Local time at the airport: `utc_offset_h` as the grid states it, or as its time zone has it on the day.

use std::collections::BTreeMap;

use chrono::{NaiveDate, Offset, TimeZone};
use chrono_tz::Tz;
use dataset::conditions::Clock;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::Runway;
use dataset::geometry::sun;

use crate::airports;
use crate::sweep::check::fault::{Checked, Fault, fault};
use crate::sweep::runways::AirportTable;
use crate::time_of_day::TimeOfDay;

/// Local time differs from the sun's by up to three hours, in the west of China, and with daylight saving by up to four.
const MAX_FROM_SUN_H: f64 = 4.0;
/// Clocks are changed at night: noon has the offset of the day.
const NOON_H: u32 = 12;

/// The sweep's day at the runway.
#[derive(Debug, Clone, Copy)]
pub(in crate::sweep) struct LocalDay {
    pub(in crate::sweep) place: Geodetic,
    pub(in crate::sweep) day_of_year: u32,
    pub(in crate::sweep) utc_offset_h: f64,
    /// Offset by the airport's time zone, if it is known.
    pub(in crate::sweep) zone_offset_h: Option<f64>,
}

impl LocalDay {
    /// The day at a runway; `stated_h` is the offset from UTC that the sweep states.
    pub(in crate::sweep) fn of(
        day_of_year: u32,
        stated_h: Option<f64>,
        runway: &Runway,
        airports: &BTreeMap<String, AirportTable>,
    ) -> Checked<Self> {
        let zone = zone(&runway.airport, airports)?;
        let by_zone_h = zone.and_then(|zone| utc_offset_h(zone, day_of_year));
        let utc_offset_h = match (stated_h, by_zone_h) {
            (Some(stated_h), by_zone_h) => {
                check_with_sun(stated_h, runway)?;
                // A built-in zone may be wrong for the sweep; `plan` and `generate` warn.
                let states_zone = airports
                    .get(&runway.airport)
                    .is_some_and(|table| table.time_zone.is_some());
                let own = zone.zip(by_zone_h).filter(|_| states_zone);
                check_with_zone(stated_h, own, day_of_year, runway)?;
                stated_h
            }
            (None, Some(by_zone_h)) => {
                check_with_sun(by_zone_h, runway)?;
                by_zone_h
            }
            (None, None) => {
                return fault(
                    "grid",
                    format!(
                        "no utc_offset_h, and the time zone of {0} is not known; expected one of them: time_zone in [airport.{0}] is, for \
                         example, \"Europe/Zurich\"",
                        runway.airport
                    ),
                );
            }
        };
        Ok(Self {
            place: runway.threshold,
            day_of_year,
            utc_offset_h,
            zone_offset_h: by_zone_h,
        })
    }

    /// The simulator's clock at a time of this day.
    pub(in crate::sweep) fn clock(&self, time: TimeOfDay) -> Clock {
        time.clock(self.day_of_year, self.utc_offset_h)
    }
}

/// Airport's time zone, by the sweep or built in.
fn zone(icao: &str, airports: &BTreeMap<String, AirportTable>) -> Checked<Option<Tz>> {
    let stated = airports
        .get(icao)
        .and_then(|table| table.time_zone.as_deref());
    let Some(name) = stated.or_else(|| airports::time_zone(icao)) else {
        return Ok(None);
    };
    name.parse().map(Some).map_err(|_| Fault {
        key: format!("airport.{icao}.time_zone"),
        message: format!(
            "{name:?} is not a time zone; expected a name of the IANA time zone database, e.g. \"Europe/Zurich\""
        ),
    })
}

/// Local time minus UTC on a day, in the simulator's year.
fn utc_offset_h(zone: Tz, day_of_year: u32) -> Option<f64> {
    let noon = NaiveDate::from_yo_opt(sun::YEAR, day_of_year)?.and_hms_opt(NOON_H, 0, 0)?;
    let offset = zone.offset_from_local_datetime(&noon).earliest()?;
    Some(f64::from(offset.fix().local_minus_utc()) / 3_600.0)
}

fn check_with_zone(
    stated_h: f64,
    zone: Option<(Tz, f64)>,
    day_of_year: u32,
    runway: &Runway,
) -> Checked<()> {
    match zone {
        Some((zone, by_zone_h)) if stated_h != by_zone_h => fault(
            "grid.utc_offset_h",
            format!(
                "{stated_h} h, but clocks at {} ({zone}) are {by_zone_h} h ahead of UTC on day {day_of_year}; leave utc_offset_h out, or \
                 give the airport another time_zone",
                runway.airport
            ),
        ),
        _ => Ok(()),
    }
}

/// Rejects a local time that is far from the sun's at the runway: noon would be dark.
fn check_with_sun(utc_offset_h: f64, runway: &Runway) -> Checked<()> {
    let sun_h = runway.threshold.longitude_deg / 15.0;
    // Clocks on both sides of the date line show the same time.
    let off_h = (utc_offset_h - sun_h + 12.0).rem_euclid(24.0) - 12.0;
    if off_h.abs() <= MAX_FROM_SUN_H {
        return Ok(());
    }
    fault(
        "grid.utc_offset_h",
        format!(
            "{utc_offset_h} h, but the sun is {sun_h:.1} h ahead of UTC at {} {}; expected a difference of at most {MAX_FROM_SUN_H} h: is \
             it the offset of another airport?",
            runway.airport, runway.name
        ),
    )
}
