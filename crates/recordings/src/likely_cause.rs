//! Likely causes of a clock's offset.

/// GPS time has no leap seconds, and is 18 s ahead since 2017.
pub(crate) const GPS_AHEAD_S: f64 = 18.0;
/// Offsets from a cause that are within this are explained by it, seconds: what a clock that is set by network is off by.
const NEAR_S: f64 = 0.3;

/// The likely cause of an offset that is known within a standard deviation, seconds.
pub(crate) fn likely_cause(offset_s: f64, sd_s: f64) -> Option<String> {
    let near_s = NEAR_S.max(3.0 * sd_s);
    let half_hours = (offset_s / 1_800.0).round();
    let rest_s = offset_s - 1_800.0 * half_hours;
    let is_near = |cause_s: f64| (rest_s.abs() - cause_s).abs() < near_s;
    let small = if is_near(GPS_AHEAD_S) {
        Some("GPS time instead of UTC (18 s)")
    } else if is_near(1.0) {
        Some("a leap second, or times of the image before or after (1 s)")
    } else {
        None
    };
    let zone = (half_hours != 0.0)
        .then(|| format!("local time instead of UTC ({:+.1} h)", -half_hours / 2.0));
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
        let said = |offset_s| likely_cause(offset_s, 0.01).unwrap_or_default();
        assert_eq!(said(-28_800.1), "local time instead of UTC (+8.0 h)");
        assert_eq!(said(19_800.0), "local time instead of UTC (-5.5 h)");
        assert!(said(-17.9).starts_with("GPS time"));
        assert!(said(1.02).starts_with("a leap second"));
        assert!(said(-28_818.0).contains("+8.0 h) and GPS time"));
        assert_eq!(likely_cause(7.3, 0.01), None);
    }
}
