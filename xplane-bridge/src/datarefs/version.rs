//! X-Plane's version from its number.

use std::fmt;

/// First version number of X-Plane 12.
const FIRST_OF_12: u32 = 120_000;

/// Set of weather datarefs by X-Plane generation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Generation {
    /// `sim/weather/`, up to 11.55.
    XPlane11,
    /// `sim/weather/region/`, since 12.0.
    XPlane12,
}

impl Generation {
    /// Generation for a value of [`super::VERSION`].
    pub(crate) fn of_version(internal_version: f32) -> Self {
        Version::of_number(internal_version as u32).generation()
    }
}

/// A version in human notation: 11.55, 12.4.0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// 11, 12.
    pub major: u32,
    /// Two digits before X-Plane 12, one since.
    pub minor: u32,
    /// Since X-Plane 12; 0 before.
    pub patch: u32,
}

impl Version {
    /// Decodes [`super::VERSION`], the "build" in X-Plane's `Log.txt`: 124009 is 12.4.0-r2, 121407 is 12.1.4-r3; before X-Plane 12 the
    /// minor number has two digits, 115501 is 11.55. The last two digits count builds.
    pub fn of_number(internal_version: u32) -> Self {
        let digit = |unit: u32| internal_version / unit % 10;
        let major = internal_version / 10_000;
        if internal_version < FIRST_OF_12 {
            Self {
                major,
                minor: internal_version / 100 % 100,
                patch: 0,
            }
        } else {
            Self {
                major,
                minor: digit(1_000),
                patch: digit(100),
            }
        }
    }

    /// Generation of weather datarefs.
    pub fn generation(self) -> Generation {
        if self.major < 12 {
            Generation::XPlane11
        } else {
            Generation::XPlane12
        }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.generation() {
            Generation::XPlane11 => write!(f, "{}.{:02}", self.major, self.minor),
            Generation::XPlane12 => write!(f, "{}.{}.{}", self.major, self.minor, self.patch),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_logs_are_the_versions_that_they_belong_to() {
        for (number, text) in [
            (104_501, "10.45"),
            (115_501, "11.55"),
            (115_202, "11.52"),
            (120_008, "12.0.0"),
            (120_403, "12.0.4"),
            (121_407, "12.1.4"),
            (124_009, "12.4.0"),
            (124_311, "12.4.3"),
            (124_410, "12.4.4"),
        ] {
            let version = Version::of_number(number);
            assert_eq!(version.to_string(), text);
            assert_eq!(
                version.generation() == Generation::XPlane12,
                text.starts_with("12")
            );
        }
        assert!(Version::of_number(120_403) < Version::of_number(121_407));
    }
}
