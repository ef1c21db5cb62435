//! The simulator's clock: free-running, or following the computer's.

use std::time::{SystemTime, UNIX_EPOCH};

use chrono::{DateTime, Datelike, Timelike, Utc};
use dataset::numbers::units::SECONDS_PER_DAY;
use xplane_bridge::datarefs as names;

use super::PAUSED;
use crate::datarefs::Datarefs;

pub(super) const DAYS_PER_YEAR: u32 = 365;

/// Lets time pass.
pub(super) fn run(datarefs: &mut Datarefs, elapsed_s: f64) {
    if datarefs.get(names::USE_SYSTEM_TIME) != 0.0 {
        follow_system(datarefs);
    } else if datarefs.get(PAUSED) == 0.0 {
        let zulu_s = datarefs.get(names::ZULU_TIME_S) + elapsed_s;
        datarefs.set(names::ZULU_TIME_S, zulu_s.rem_euclid(SECONDS_PER_DAY));
    }
    let longitude_deg = datarefs.get("sim/flightmodel/position/longitude");
    let local_s = datarefs.get(names::ZULU_TIME_S) + longitude_deg * (SECONDS_PER_DAY / 360.0);
    datarefs.set(
        "sim/time/local_time_sec",
        local_s.rem_euclid(SECONDS_PER_DAY),
    );
}

/// Sets the clock to UTC on a day, counted from 0.
pub(super) fn set_zulu(datarefs: &mut Datarefs, day: u32, zulu_s: f64) {
    let days = f64::from(day) + (zulu_s / SECONDS_PER_DAY).floor();
    datarefs.set(names::USE_SYSTEM_TIME, 0.0);
    datarefs.set(names::DATE_DAYS, days.rem_euclid(DAYS_PER_YEAR.into()));
    datarefs.set(names::ZULU_TIME_S, zulu_s.rem_euclid(SECONDS_PER_DAY));
}

/// Sets the clock to the computer's.
pub(super) fn follow_system(datarefs: &mut Datarefs) {
    let since_epoch = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    let now: DateTime<Utc> = DateTime::UNIX_EPOCH + since_epoch;
    let seconds = f64::from(now.num_seconds_from_midnight());
    datarefs.set(names::ZULU_TIME_S, seconds);
    // X-Plane has no leap day.
    datarefs.set(names::DATE_DAYS, f64::from(now.ordinal0().min(364)));
}
