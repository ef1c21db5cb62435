//! Times by the sun: the local minute when its centre passes an elevation (geometric, without refraction).

use dataset::geometry::sun::Sun;
use serde::Deserialize;

use super::local_day::LocalDay;
use crate::time_of_day::TimeOfDay;

/// Civil twilight begins and ends here, degrees.
const TWILIGHT_DEG: f64 = -6.0;
/// The upper edge of the sun is seen at the horizon: half a disc, and refraction, degrees.
const HORIZON_DEG: f64 = -0.833;
const HALF_DAY_MIN: u32 = 12 * 60;

/// Half of the day.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Half {
    /// Rising.
    Morning,
    /// Setting.
    Evening,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SunPassing {
    pub(super) elevation_deg: f64,
    pub(super) half: Half,
}

impl SunPassing {
    /// Named passing: `dawn`, `sunrise`, `sunset`, `dusk`.
    pub(super) fn named(name: &str) -> Option<Self> {
        let (elevation_deg, half) = match name {
            "dawn" => (TWILIGHT_DEG, Half::Morning),
            "sunrise" => (HORIZON_DEG, Half::Morning),
            "sunset" => (HORIZON_DEG, Half::Evening),
            "dusk" => (TWILIGHT_DEG, Half::Evening),
            _ => return None,
        };
        Some(Self {
            elevation_deg,
            half,
        })
    }

    /// The nearest minute; `Err` with the lowest and the highest elevation of this half of the day if the sun does not pass this one.
    pub(super) fn on(self, day: &LocalDay) -> Result<TimeOfDay, [f64; 2]> {
        let noon = noon(day);
        // From noon downwards, into the morning or into the evening.
        let minute = |step: u32| match self.half {
            Half::Morning => noon + 2 * HALF_DAY_MIN - step,
            Half::Evening => noon + step,
        };
        let time = |step: u32| TimeOfDay::from_minutes(minute(step));
        let elevation = |step: u32| elevation_deg(day, time(step));
        let highest = elevation(0);
        let mut last = highest;
        let mut lowest = highest;
        for step in 1..=HALF_DAY_MIN {
            let now = elevation(step);
            if (now..=last).contains(&self.elevation_deg) {
                let is_nearer = self.elevation_deg - now < last - self.elevation_deg;
                return Ok(time(if is_nearer { step } else { step - 1 }));
            }
            lowest = now.min(lowest);
            last = now;
        }
        Err([lowest, highest])
    }
}

/// Minute with the highest sun.
fn noon(day: &LocalDay) -> u32 {
    let elevations =
        (0..2 * HALF_DAY_MIN).map(|minute| elevation_deg(day, TimeOfDay::from_minutes(minute)));
    let highest = elevations
        .enumerate()
        .max_by(|one, other| one.1.total_cmp(&other.1));
    highest.map_or(HALF_DAY_MIN, |(minute, _)| minute as u32)
}

fn elevation_deg(day: &LocalDay, time: TimeOfDay) -> f64 {
    Sun::true_at(day.place, &day.clock(time)).elevation_deg
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::geometry::geodesy::Geodetic;

    fn day(latitude_deg: f64, longitude_deg: f64, day_of_year: u32, utc_offset_h: f64) -> LocalDay {
        LocalDay {
            place: Geodetic {
                latitude_deg,
                longitude_deg,
                altitude_msl_m: 0.0,
            },
            day_of_year,
            utc_offset_h,
            zone_offset_h: None,
        }
    }

    #[test]
    fn the_sun_rises_and_sets_when_an_almanac_says() {
        // Greenwich and Sydney on 21 June 2023 by astral 3.2.
        let greenwich = day(51.48, 0.0, 172, 1.0);
        let sydney = day(-33.87, 151.21, 172, 10.0);
        for (name, day, almanac) in [
            ("sunrise", greenwich, "04:43"),
            ("sunset", greenwich, "21:20"),
            ("sunrise", sydney, "07:00"),
            ("sunset", sydney, "16:54"),
        ] {
            let found = SunPassing::named(name).unwrap().on(&day).unwrap();
            let almanac = TimeOfDay::parse(almanac).unwrap();
            assert!(
                found.minutes().abs_diff(almanac.minutes()) <= 1,
                "{name} {found}"
            );
        }
    }

    #[test]
    fn a_sun_that_stays_up_has_no_dusk() {
        let tromso = day(69.7, 18.9, 172, 2.0);
        let [lowest, highest] = SunPassing::named("dusk").unwrap().on(&tromso).unwrap_err();
        assert!((2.0..4.0).contains(&lowest) && (43.0..44.0).contains(&highest));
    }

    #[test]
    fn each_passing_has_the_elevation_that_it_was_asked_for_within_half_a_minute() {
        let zurich = day(47.48, 8.53, 100, 2.0);
        for half in [Half::Morning, Half::Evening] {
            for elevation_deg in [-18.0, -4.5, 0.0, 20.0, 45.0] {
                let passing = SunPassing {
                    elevation_deg,
                    half,
                };
                let time = passing.on(&zurich).unwrap();
                let found = Sun::true_at(zurich.place, &zurich.clock(time)).elevation_deg;
                assert!((found - elevation_deg).abs() < 0.13, "{time} {found}");
                assert_eq!(time.hour < 13, half == Half::Morning);
            }
        }
    }
}
