//! Local times of day as a sweep writes them, and the simulator's clock.

use std::fmt;

use dataset::conditions::Clock;
use dataset::numbers::units::SECONDS_PER_DAY;

/// A local time of day, to the minute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TimeOfDay {
    /// Hour, 0 to 23.
    pub hour: u32,
    /// Minute, 0 to 59.
    pub minute: u32,
}

const DAYS_PER_YEAR: i64 = 365;

impl TimeOfDay {
    /// Reads `HH:MM`.
    pub fn parse(text: &str) -> Option<Self> {
        let (hour, minute) = text.split_once(':')?;
        let two_digits = |part: &str, limit: u32| {
            let right_form = part.len() == 2 && part.bytes().all(|b| b.is_ascii_digit());
            part.parse()
                .ok()
                .filter(|value| right_form && *value < limit)
        };
        Some(Self {
            hour: two_digits(hour, 24)?,
            minute: two_digits(minute, 60)?,
        })
    }

    /// Minutes since midnight.
    pub fn minutes(self) -> u32 {
        self.hour * 60 + self.minute
    }

    pub(crate) fn from_minutes(minutes: u32) -> Self {
        Self {
            hour: minutes / 60 % 24,
            minute: minutes % 60,
        }
    }

    /// `0600`, for identifiers.
    pub fn digits(self) -> String {
        format!("{:02}{:02}", self.hour, self.minute)
    }

    /// The simulator's clock at this local time. Far from Greenwich, UTC may be on the previous or next day.
    pub fn clock(self, day_of_year: u32, utc_offset_h: f64) -> Clock {
        let local_s = f64::from(self.hour * 3_600 + self.minute * 60);
        let zulu_s = local_s - utc_offset_h * 3_600.0;
        let days = (zulu_s / SECONDS_PER_DAY).floor();
        let day = (i64::from(day_of_year) - 1 + days as i64).rem_euclid(DAYS_PER_YEAR) + 1;
        Clock {
            day_of_year: day as u32,
            zulu_time_s: zulu_s - days * SECONDS_PER_DAY,
        }
    }
}

/// `06:00`, as a sweep writes it.
impl fmt::Display for TimeOfDay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:02}:{:02}", self.hour, self.minute)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_four_digits_with_a_colon_are_a_time() {
        assert_eq!(
            TimeOfDay::parse("06:05"),
            Some(TimeOfDay { hour: 6, minute: 5 })
        );
        for wrong in [
            "6:00", "24:00", "12:60", "1200", "+6:00", "06:00:00", "noon",
        ] {
            assert_eq!(TimeOfDay::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn six_in_the_morning_at_changi_is_22_utc_of_the_day_before() {
        for (time, day_of_year, zulu) in [
            ("06:00", 172, (171, 22.0)),
            ("12:00", 172, (172, 4.0)),
            ("06:00", 1, (365, 22.0)),
        ] {
            let clock = TimeOfDay::parse(time).unwrap().clock(day_of_year, 8.0);
            let found = (clock.day_of_year, clock.zulu_time_s / 3_600.0);
            assert_eq!(found, zulu, "{time} on day {day_of_year}");
        }
    }
}
