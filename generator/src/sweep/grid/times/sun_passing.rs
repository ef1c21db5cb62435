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
