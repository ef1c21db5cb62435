//! Limits of every number from outside: the one table for sweeps, recordings, simulators' answers, records, tables and settings alike.
//!
//! Limits are wide: values beyond them are mistakes or damage, never an unusual flight. They are enforced on reading and on writing. NaN
//! and infinities are always out of range. The pages of `docs/reference/` list them.

use std::fmt;

/// Minimum and maximum, with a description of the number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// The least value.
    pub least: f64,
    /// The maximum.
    pub most: f64,
    /// Description of the number, with its unit: "a pitch in degrees".
    pub what: &'static str,
}

/// Interpolation may exceed a range by rounding: this part of the larger end.
const ROUNDING: f64 = 1e-9;

impl Limits {
    /// Limits with their description.
    pub const fn new(least: f64, most: f64, what: &'static str) -> Self {
        Self { least, most, what }
    }

    /// True if a number is within the limits, except for rounding; false for NaN.
    pub fn hold(&self, value: f64) -> bool {
        let slack = ROUNDING * self.least.abs().max(self.most.abs());
        (self.least - slack..=self.most + slack).contains(&value)
    }

    /// Rejects a number outside the limits.
    pub fn check(&self, value: f64) -> Result<(), OutOfLimits> {
        if self.hold(value) {
            Ok(())
        } else {
            Err(OutOfLimits {
                value,
                limits: *self,
            })
        }
    }
}

/// A number outside its limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutOfLimits {
    /// The number.
    pub value: f64,
    /// The allowed range.
    pub limits: Limits,
}

impl fmt::Display for OutOfLimits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Limits { least, most, what } = self.limits;
        let value = Legible(self.value);
        write!(
            f,
            "{value} is out of range; expected {what} from {least} to {most}"
        )
    }
}

/// A float in readable form: `1e308`, not three hundred digits.
struct Legible(f64);

impl fmt::Display for Legible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0.abs();
        if size == 0.0 || (1e-5..1e15).contains(&size) || !size.is_finite() {
            write!(f, "{}", self.0)
        } else {
            write!(f, "{:e}", self.0)
        }
    }
}

/// Collects a record's numbers that are outside their limits.
#[derive(Debug, Default)]
pub struct Check {
    /// Path in the record.
    place: Vec<String>,
    found: Vec<FieldOutOfLimits>,
}

/// A field with a number outside its limits.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldOutOfLimits {
    /// Name of the field or column: `conditions.weather.visibility_m`.
    pub field: String,
    /// Its value and limits.
    pub number: OutOfLimits,
}

impl fmt::Display for FieldOutOfLimits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.field, self.number)
    }
}

impl Check {
    /// Looks at a number.
    pub fn number(&mut self, field: &str, value: impl Into<f64>, limits: Limits) {
        if let Err(number) = limits.check(value.into()) {
            let mut names = self.place.clone();
            names.push(field.to_owned());
            self.found.push(FieldOutOfLimits {
                field: names.join("."),
                number,
            });
        }
    }

    /// Checks the numbers in a part of the record.
    pub fn part(&mut self, name: impl fmt::Display, look: impl FnOnce(&mut Self)) {
        self.place.push(name.to_string());
        look(self);
        self.place.pop();
    }

    /// Takes the numbers found outside their limits.
    pub(crate) fn into_found(self) -> Vec<FieldOutOfLimits> {
        self.found
    }

    /// The first number found.
    pub fn first(self) -> Option<FieldOutOfLimits> {
        self.found.into_iter().next()
    }
}

/// Checks a struct's fields by their names, each with its limits; of `optional` ones, those that are there.
macro_rules! check_fields {
    ($check:ident, $of:expr, optional { $($field:ident: $limits:expr),+ $(,)? }) => {
        $(if let Some(number) = $of.$field {
            $check.number(stringify!($field), number, $limits);
        })+
    };
    ($check:ident, $of:expr, { $($field:ident: $limits:expr),+ $(,)? }) => {
        $($check.number(stringify!($field), $of.$field, $limits);)+
    };
}
pub(crate) use check_fields;

/// A share, or the position of a part between two end stops.
pub const RATIO: Limits = Limits::new(0.0, 1.0, "a ratio");

// Places.

/// Positions of runways, aircraft and cameras.
pub const LATITUDE_DEG: Limits = Limits::new(-85.0, 85.0, "a latitude in degrees");
/// Positions of runways, aircraft and cameras.
pub const LONGITUDE_DEG: Limits = Limits::new(-180.0, 180.0, "a longitude in degrees");
/// Aircraft and cameras.
pub const ALTITUDE_MSL_M: Limits = Limits::new(-1_000.0, 20_000.0, "an altitude in metres");
/// Coordinates in an earth-centred frame.
pub(crate) const ECEF_M: Limits = Limits::new(-7e6, 7e6, "an earth-centred coordinate in metres");

// Runways.

/// Threshold elevation.
pub const ELEVATION_MSL_M: Limits = Limits::new(-500.0, 6_000.0, "a height in metres");
/// Landing course.
pub const COURSE_TRUE_DEG: Limits = Limits::new(0.0, 360.0, "a true course in degrees");
/// Elevation of the sun's centre.
pub const SUN_ELEVATION_DEG: Limits = Limits::new(-90.0, 90.0, "an elevation in degrees");
/// Localizer course.
pub const COURSE_MAGNETIC_DEG: Limits = Limits::new(0.0, 360.0, "a magnetic course in degrees");
/// Angle of the glide path.
pub const GLIDE_PATH_DEG: Limits = Limits::new(1.0, 10.0, "an angle in degrees");
/// Distance from the threshold to the touchdown target.
pub const TOUCHDOWN_PAST_THRESHOLD_M: Limits = Limits::new(0.0, 3_000.0, "a distance in metres");
/// Pavement length, from the landing threshold on.
pub const RUNWAY_LENGTH_M: Limits = Limits::new(300.0, 10_000.0, "a length in metres");
/// Pavement width.
pub const RUNWAY_WIDTH_M: Limits = Limits::new(10.0, 200.0, "a width in metres");
/// Localizer frequency.
pub const ILS_MHZ: Limits = Limits::new(108.0, 112.0, "a localizer's frequency in MHz");

// An airliner on approach.

/// Accepts either convention for a full turn.
pub const HEADING_TRUE_DEG: Limits = Limits::new(-360.0, 360.0, "a true heading in degrees");
/// Nose up positive.
pub const PITCH_DEG: Limits = Limits::new(-45.0, 45.0, "an aircraft's pitch in degrees");
/// Right wing down positive.
pub const ROLL_DEG: Limits = Limits::new(-75.0, 75.0, "an aircraft's roll in degrees");
/// Negative with a tailwind, on the ground.
pub const TRUE_AIRSPEED_MPS: Limits = Limits::new(-50.0, 350.0, "a true airspeed in m/s");
/// North or east.
pub const VELOCITY_MPS: Limits = Limits::new(-400.0, 400.0, "a velocity over ground in m/s");
/// Down positive.
pub const VELOCITY_DOWN_MPS: Limits = Limits::new(-150.0, 150.0, "a vertical velocity in m/s");
/// Time in a recorded flight: from any clock, even a computer's.
pub const FLIGHT_TIME_S: Limits = Limits::new(-1e10, 1e10, "a time in seconds");

// Start of live flights, as in sweeps.

/// Distance to the touchdown target.
pub const START_DTD_NM: Limits = Limits::new(0.5, 40.0, "a distance in nautical miles");
/// Distance to the touchdown target in metres, as in a plan.
pub(crate) const START_DTD_M: Limits =
    Limits::new(0.5 * 1_852.0, 40.0 * 1_852.0, "a distance in metres");
/// Right of the course.
pub const START_CROSS_TRACK_M: Limits = Limits::new(-5_000.0, 5_000.0, "an offset in metres");
/// Height above the profile.
pub const START_ABOVE_PROFILE_M: Limits = Limits::new(-500.0, 1_000.0, "a height in metres");
/// Right of the course.
pub const START_HEADING_OFFSET_DEG: Limits = Limits::new(-60.0, 60.0, "an angle in degrees");
/// True airspeed.
pub const START_SPEED_MPS: Limits = Limits::new(55.0, 150.0, "an airspeed in m/s");
/// Distance from the threshold where a stepped descent continues.
pub const STEP_FROM_THRESHOLD_M: Limits = Limits::new(500.0, 60_000.0, "a distance in metres");
/// Time by which another aircraft is behind the first one.
pub const TRAFFIC_AFTER_S: Limits = Limits::new(-900.0, 900.0, "a time in seconds");
/// Distance by which another aircraft is behind the first one.
pub const TRAFFIC_SPACING_NM: Limits = Limits::new(-20.0, 20.0, "a distance in nautical miles");
/// Share of a side of the split.
pub const SPLIT_PART: Limits = Limits::new(0.0, 1.0, "a part");

// Cameras.

/// Along or across the course.
pub const MAST_DISTANCE_M: Limits = Limits::new(-50_000.0, 50_000.0, "a distance in metres");
/// Camera height.
pub const MAST_HEIGHT_M: Limits =
    Limits::new(0.0, 5_000.0, "a height over the touchdown target in metres");
/// Turn of a rig's optical axis.
pub const MAST_TURN_DEG: Limits = Limits::new(-180.0, 360.0, "an angle in degrees");
/// The point of the glide path that cameras aim at.
pub const AIM_DTD_NM: Limits = Limits::new(-0.5, 40.0, "a distance to touchdown in nautical miles");
/// Direction of an optical axis.
pub const DIRECTION_TRUE_DEG: Limits = Limits::new(0.0, 360.0, "a true direction in degrees");
/// Placement error. A larger one would be a different rig, or centimetres instead of metres.
pub const JITTER_M: Limits = Limits::new(-50.0, 50.0, "a small offset in metres");
/// Aiming error. A larger one would be a different rig, or arcseconds instead of degrees.
pub const JITTER_DEG: Limits = Limits::new(-10.0, 10.0, "a small angle in degrees");
/// Elevation of a rig's optical axis.
pub const MAST_PITCH_DEG: Limits = Limits::new(-89.0, 89.0, "an elevation in degrees");
/// Elevation of an optical axis as placed: including jitter.
pub(crate) const CAMERA_PITCH_DEG: Limits =
    Limits::new(-100.0, 100.0, "a camera's elevation in degrees");
/// About an optical axis.
pub(crate) const CAMERA_ROLL_DEG: Limits = Limits::new(-180.0, 180.0, "a camera's roll in degrees");
/// Over an image's whole width.
pub const HFOV_DEG: Limits = Limits::new(0.1, 150.0, "a field of view in degrees");
/// Image width or height.
pub const PICTURE_SIDE_PX: Limits = Limits::new(64.0, 8_192.0, "a size of an image in pixels");
/// Intrinsics.
pub const FOCAL_LENGTH_PX: Limits = Limits::new(1.0, 1e8, "a focal length in pixels");
/// Intrinsics.
pub(crate) const PRINCIPAL_POINT_PX: Limits = Limits::new(-8_192.0, 16_384.0, "a place in pixels");
/// Elements of rotation matrices.
pub(crate) const ROTATION: Limits = Limits::new(-1.0, 1.0, "an element of a rotation matrix");
/// OpenCV's. [`crate::geometry::distortion::Distortion::check`] decides whether they are a valid lens.
pub(crate) const DISTORTION: Limits = Limits::new(-1e6, 1e6, "a distortion coefficient");

// Image degradation.

/// Refraction: at 1, light follows the earth's curvature.
pub const REFRACTION_COEFFICIENT: Limits = Limits::new(-1.0, 0.9, "a coefficient of refraction");
/// Blur of the optics.
pub const BLUR_SIGMA_PX: Limits = Limits::new(0.0, 20.0, "a standard deviation in pixels");
/// Electrons per white pixel.
pub const FULL_WELL_ELECTRONS: Limits = Limits::new(100.0, 1e6, "a full well in electrons");
/// Read noise per pixel.
pub const READ_NOISE_ELECTRONS: Limits = Limits::new(0.0, 1_000.0, "a read noise in electrons");
/// Image motion by turbulence.
pub const TILT_RMS_ARCSEC: Limits = Limits::new(0.0, 200.0, "a motion in seconds of arc");
/// Blur by turbulence.
pub const SEEING_BLUR_ARCSEC: Limits = Limits::new(0.0, 200.0, "a blur in seconds of arc");
/// Correlation time of turbulence.
pub const CORRELATION_S: Limits = Limits::new(0.001, 100.0, "a time in seconds");
/// Across the line of sight.
pub const CROSSWIND_MPS: Limits = Limits::new(0.1, 60.0, "a wind speed in m/s");
/// Lens aperture.
pub const APERTURE_M: Limits = Limits::new(0.001, 1.0, "an aperture in metres");
/// Relative to the exposure for the horizon.
pub const EXPOSURE_EV: Limits = Limits::new(-4.0, 4.0, "an exposure in stops");
/// Image motion by a swaying mast.
pub const SWAY_RMS_PX: Limits = Limits::new(0.0, 20.0, "a motion in pixels");
/// Mast frequency.
pub const SWAY_FREQUENCY_HZ: Limits = Limits::new(0.01, 50.0, "a frequency in hertz");
/// Camera bit rate; 0 is no stream.
pub const STREAM_MBIT_PER_S: Limits = Limits::new(0.0, 200.0, "a bit rate in Mbit/s");

// Weather and time.

/// Meteorological.
pub const VISIBILITY_M: Limits = Limits::new(50.0, 200_000.0, "a visibility in metres");
/// Rain, none to heavy.
pub const RAIN_RATIO: Limits = Limits::new(0.0, 1.0, "a rain intensity");
/// Wind at 10 m above ground.
pub const WIND_SPEED_MPS: Limits = Limits::new(0.0, 60.0, "a wind speed in m/s");
/// The direction that it comes from.
pub const WIND_FROM_TRUE_DEG: Limits = Limits::new(0.0, 360.0, "a true direction in degrees");
/// Turbulence, none to severe.
pub const TURBULENCE_RATIO: Limits = Limits::new(0.0, 1.0, "a turbulence intensity");
/// Cloud cover.
pub const COVER_RATIO: Limits = Limits::new(0.0, 1.0, "a part of the sky");
/// Cloud base.
pub const CLOUD_BASE_MSL_M: Limits = Limits::new(0.0, 20_000.0, "a height in metres");
/// Cloud top.
pub const CLOUD_TOP_MSL_M: Limits = Limits::new(0.0, 25_000.0, "a height in metres");
/// A simulator's report: anything that it may draw.
pub(crate) const REPORTED_VISIBILITY_M: Limits =
    Limits::new(0.0, 1e7, "a reported visibility in metres");
/// A simulator's report.
pub(crate) const REPORTED_WIND_SPEED_MPS: Limits =
    Limits::new(-1_000.0, 1_000.0, "a reported wind speed in m/s");
/// A simulator's report.
pub(crate) const REPORTED_WIND_FROM_DEG: Limits =
    Limits::new(-720.0, 720.0, "a reported direction in degrees");
/// A simulator's report: rain or cloud cover.
pub(crate) const REPORTED_RATIO: Limits = Limits::new(-1_000.0, 1_000.0, "a reported ratio");
/// X-Plane supports this many cloud layers.
pub const MAX_CLOUD_LAYERS: usize = 3;
/// X-Plane has no leap years.
pub const DAY_OF_YEAR: Limits = Limits::new(1.0, 365.0, "a day of the year");
/// Offset of local time.
pub const UTC_OFFSET_H: Limits = Limits::new(-12.0, 14.0, "hours that local time is ahead of UTC");
/// Since midnight.
pub const ZULU_TIME_S: Limits = Limits::new(0.0, 86_400.0, "a time of day in seconds");

// Scenarios.

/// Three times the longest approach: 40 NM at the slowest speed.
pub const MAX_APPROACH_S: f64 = 4_000.0;
/// Ticks per scenario: an approach at 240 per second.
pub const MAX_TICKS: u32 = 1_000_000;
/// See [`MAX_TICKS`].
pub const TICKS: Limits = Limits::new(1.0, MAX_TICKS as f64, "a number of ticks");
/// Views per scenario.
pub const MAX_VIEWS: usize = 64;
/// Images per scenario.
pub const MAX_PICTURES: u64 = MAX_TICKS as u64 * MAX_VIEWS as u64;
/// Images per second, and the largest terms of their fraction.
pub(crate) const FRAME_RATE_HZ: Limits = Limits::new(1.0 / 60.0, 240.0, "a frame rate per second");
/// See [`FRAME_RATE_HZ`].
pub(crate) const MAX_FRAME_RATE_TERM: u32 = 1_000_000;

// Labels and boxes.

/// Over ground.
pub const DTD_M: Limits = Limits::new(0.0, 500_000.0, "a distance to touchdown in metres");
/// Standard deviation of a distance.
pub(crate) const SD_M: Limits = Limits::new(0.0, 100_000.0, "a standard deviation in metres");
/// Along or across the course.
pub(crate) const TRACK_M: Limits = Limits::new(-500_000.0, 500_000.0, "a distance in metres");
/// Height of the aircraft.
pub(crate) const HEIGHT_OVER_TARGET_M: Limits =
    Limits::new(-25_000.0, 25_000.0, "a height in metres");
/// Negative past the target.
pub(crate) const TIME_TO_TOUCHDOWN_S: Limits =
    Limits::new(-6e7, 6e7, "a time to touchdown in seconds");
/// Middle of boxes.
pub const BOX_PLACE_PX: Limits = Limits::new(-8_192.0, 16_384.0, "a place in pixels");
/// Box width or height.
pub(crate) const BOX_SIZE_PX: Limits = Limits::new(0.0, 16_384.0, "a size in pixels");
/// Boxes per image: more than one aircraft means false detections anyway.
pub(crate) const MAX_DETECTIONS_PER_PICTURE: u64 = 1_000;
/// Detector confidence.
pub const SCORE: Limits = Limits::new(0.0, 1.0, "a score");
/// Standard deviation of the positions and sizes of boxes that a network was trained with.
pub const FEATURE_SCALE_PX: Limits = Limits::new(1e-9, 16_384.0, "a standard deviation in pixels");
/// Shift of the aircraft between two views.
pub(crate) const SHIFT_PX: Limits = Limits::new(-16_384.0, 16_384.0, "a shift in pixels");
/// A less certain shift carries no information.
pub(crate) const SHIFT_SD_PX: Limits = Limits::new(0.0, 100.0, "a standard deviation in pixels");
/// Second passes in one image.
pub const WINDOWS: Limits = Limits::new(1.0, 1_000.0, "a number of windows");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_in_no_range_and_rounding_is_forgiven() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -5.0] {
            assert!(RATIO.check(value).is_err(), "{value}");
        }
        for value in [0.0, 1.0, 1.0 + 1e-15, -1e-16] {
            assert!(RATIO.hold(value), "{value}");
        }
        assert!(!RATIO.hold(1.001));
    }

    #[test]
    fn a_message_names_the_field_the_value_and_the_range() {
        let mut check = Check::default();
        check.part("states[3]", |check| {
            check.number("pitch_deg", 1e17, PITCH_DEG);
            check.number("roll_deg", 10.0, ROLL_DEG);
        });
        let found = check.into_found();
        assert_eq!(found.len(), 1);
        assert_eq!(
            found[0].to_string(),
            "states[3].pitch_deg 1e17 is out of range; expected an aircraft's pitch in degrees from -45 to 45"
        );
    }
}
