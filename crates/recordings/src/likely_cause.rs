//! Likely causes of a clock's offset.

/// GPS time has no leap seconds, and is 18 s ahead since 2017.
pub(crate) const GPS_AHEAD_S: f64 = 18.0;
/// Standard deviation of a clock that is set by network, seconds.
const SET_SD_S: f64 = 0.1;
/// Prior probability that a clock has a given cause.
const SHARE: f64 = 0.01;
/// Half an hour, the step of time zones, seconds.
const HALF_HOUR_S: f64 = 1_800.0;

/// The likely cause of an offset of `offset_s`, known to `sd_s`, where clocks without a cause are off by `clock_sd_s`. If the offset is
/// opposite to the time zone at this longitude, the camera is right, and the tracks are in local time.
pub(crate) fn likely_cause(
    offset_s: f64,
    sd_s: f64,
    clock_sd_s: f64,
    longitude_deg: f64,
) -> Option<String> {
    let half_hours = (offset_s / HALF_HOUR_S).round();
    let rest_s = offset_s - HALF_HOUR_S * half_hours;
    let density = |off_s: f64, sd_s: f64| (-(off_s / sd_s).powi(2) / 2.0).exp() / sd_s;
    let without = density(rest_s, clock_sd_s.hypot(sd_s).max(SET_SD_S));
    let explains =
        |cause_s: f64| SHARE * density(rest_s.abs() - cause_s, SET_SD_S.hypot(sd_s)) > without;
    let small = if explains(GPS_AHEAD_S) {
        Some("GPS time instead of UTC (18 s)")
    } else if explains(1.0) {
        Some("a leap second, or times of the image before or after (1 s)")
    } else {
        None
    };
    let zone = (half_hours != 0.0).then(|| {
        let (ahead_h, solar_h) = (-half_hours / 2.0, longitude_deg / 15.0);
        if (ahead_h - solar_h).abs() <= (-ahead_h - solar_h).abs() {
            format!("local time instead of UTC ({ahead_h:+.1} h)")
        } else {
            format!("tracks in local time instead of UTC ({:+.1} h)", -ahead_h)
        }
    });
    match (zone, small) {
        (Some(zone), Some(small)) => Some(format!("{zone} and {small}")),
        (Some(zone), None) => Some(zone),
        (None, small) => small.map(str::to_owned),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_half_hours_gps_time_and_a_second_are_named_and_other_offsets_are_not() {
        let at = |longitude_deg, offset_s| likely_cause(offset_s, 0.01, 0.3, longitude_deg);
        let said = |offset_s| at(104.0, offset_s).unwrap_or_default();
        assert_eq!(said(-28_800.1), "local time instead of UTC (+8.0 h)");
        assert_eq!(
            said(28_800.1),
            "tracks in local time instead of UTC (+8.0 h)"
        );
        assert_eq!(
            at(-75.0, 18_000.0).unwrap(),
            "local time instead of UTC (-5.0 h)"
        );
        assert!(said(-17.9).starts_with("GPS time"));
        assert!(said(1.02).starts_with("a leap second"));
        assert!(said(-28_818.0).contains("+8.0 h) and GPS time"));
        assert_eq!(at(104.0, 7.3), None);
    }

    #[test]
    fn an_offset_that_is_near_a_cause_by_chance_is_not_named() {
        assert_eq!(likely_cause(18.3, 0.5, 15.0, 104.0), None, "hardly known");
        assert_eq!(likely_cause(17.4, 0.01, 15.0, 104.0), None, "too far");
        assert_eq!(
            likely_cause(1.0, 0.2, 10.0, 104.0),
            None,
            "clocks are off by as much"
        );
    }
}
