//! Position of the sun at a simulator's clock, which has no year.

use chrono::{Days, NaiveDate, NaiveDateTime, NaiveTime, TimeDelta};
use solar_positioning::{Location, RefractionCorrection, SolarPositions};

use crate::conditions::Clock;
use crate::geometry::geodesy::Geodetic;

/// X-Plane's clock has no year: any will do, as long as it stays the same. Positions in other years differ by up to 0.4 degrees.
pub const YEAR: i32 = 2023;
/// Difference of terrestrial and universal time around that year, seconds.
const DELTA_T_S: f64 = 69.2;

/// Direction to the centre of the sun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Clockwise from north, degrees.
    pub azimuth_deg: f64,
    /// Elevation above the horizontal plane, degrees.
    pub elevation_deg: f64,
}

impl Sun {
    /// The geometric position, without refraction.
    pub fn true_at(place: Geodetic, clock: &Clock) -> Self {
        Self::at(place, clock, None)
    }

    /// The apparent position, through air at 1010 hPa and 10 degrees Celsius.
    pub fn apparent_at(place: Geodetic, clock: &Clock) -> Self {
        Self::at(place, clock, Some(RefractionCorrection::standard()))
    }

    fn at(place: Geodetic, clock: &Clock, refraction: Option<RefractionCorrection>) -> Self {
        let location = Location {
            latitude: place.latitude_deg,
            longitude: place.longitude_deg,
        };
        let time = utc(clock).and_utc();
        let position = SolarPositions::new()
            .at(&time, location, place.altitude_msl_m, DELTA_T_S, refraction)
            .expect("latitudes are checked when a runway is read");
        Self {
            azimuth_deg: position.azimuth(),
            elevation_deg: position.elevation_angle(),
        }
    }
}

/// The clock in [`YEAR`].
fn utc(clock: &Clock) -> NaiveDateTime {
    let first =
        NaiveDate::from_ymd_opt(YEAR, 1, 1).expect("the first of January exists in every year");
    let day = first + Days::new(u64::from(clock.day_of_year.saturating_sub(1)));
    day.and_time(NaiveTime::MIN) + TimeDelta::milliseconds((clock.zulu_time_s * 1e3) as i64)
}
