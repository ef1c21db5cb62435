//! `[profile.NAME]`: vertical profiles. The profile itself, above mean sea level, is [`ApproachProfile`].

use std::collections::BTreeMap;

use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::runway::Runway;
use dataset::numbers::limits::{self, Limits};
use dataset::numbers::units::{METERS_PER_FOOT, METERS_PER_NAUTICAL_MILE};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::sweep::check::fault::{Checked, Fault, fault, legal_name};
use crate::sweep::check::limits::check_number;

/// Steepest descent from the start to the touchdown target, degrees. From steeper ones the flight model lands far beyond the target, or not
/// at all.
const STEEPEST_DEG: f64 = 25.0;
/// Allowed start heights over the runway, metres.
const OVER_RUNWAY_M: (f64, f64) = (100.0, 6_000.0);

/// Level at 2500 ft until the aircraft meets the glide path.
pub(crate) const LEVEL_THEN_GLIDE_PATH: &str = "level-then-glide-path";
/// The chart of WSSS 02L: 2500 ft until D7.6, 1500 ft until D4.4.
const STEP_DOWN: &str = "step-down";
/// Descent from 3000 ft without a level segment.
const CONTINUOUS: &str = "continuous";

/// Elevation of the runway for which the built-in profiles are charted, WSSS 02L, metres.
const CHARTED_ELEVATION_M: f64 = 6.71;

/// `[profile.NAME]`: each altitude above mean sea level, or above the runway.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum ProfileTable {
    /// Level until the aircraft meets the glide path, then down the glide path.
    GlidePath {
        /// Altitude of the level segment above mean sea level, metres. Either this or `level_above_runway_m`.
        level_altitude_msl_m: Option<f64>,
        /// The same above the runway, metres.
        level_above_runway_m: Option<f64>,
    },
    /// Level at the upper altitude until a fix, down to the lower altitude faster than the glide path, level there until the
    /// glide path is met. The defaults are the chart of WSSS 02L: 2500 ft until D7.6, 1500 ft until D4.4.
    StepDown {
        /// Upper level above mean sea level, metres.
        upper_altitude_msl_m: Option<f64>,
        /// The same above the runway, metres.
        upper_above_runway_m: Option<f64>,
        /// Distance of the first fix before the threshold (Changi's DME reads zero there), metres.
        step_from_threshold_m: Option<f64>,
        /// Lower level above mean sea level, metres. It is left where the glide path crosses it.
        lower_altitude_msl_m: Option<f64>,
        /// The same above the runway, metres.
        lower_above_runway_m: Option<f64>,
    },
    /// No level segment: from the start straight towards the glide path, and down it.
    ContinuousDescent {
        /// Altitude of the start above mean sea level, metres. Either this or `start_above_runway_m`.
        start_altitude_msl_m: Option<f64>,
        /// The same above the runway, metres.
        start_above_runway_m: Option<f64>,
    },
}

impl ProfileTable {
    /// The profile at a runway.
    fn at(&self, name: &str, runway: &Runway) -> Checked<ApproachProfile> {
        let ground_m = runway.threshold.altitude_msl_m;
        let over_runway = Limits::new(
            OVER_RUNWAY_M.0,
            OVER_RUNWAY_M.1,
            "a height in metres above the runway",
        );
        let altitude = |what: &str, msl_m: Option<f64>, above_m: Option<f64>| {
            let key = format!("profile.{name}.{what}_above_runway_m");
            match (msl_m, above_m) {
                (Some(_), Some(_)) => fault(
                    key,
                    format!("{what}_altitude_msl_m is given as well; expected one of them"),
                ),
                (msl_m, None) => Ok(msl_m),
                (None, Some(above_m)) => {
                    check_number(key, above_m, over_runway)?;
                    Ok(Some(ground_m + above_m))
                }
            }
        };
        let needed = |what: &str, altitude_m: Option<f64>| {
            let altitude_m = altitude_m.ok_or_else(|| Fault {
                key: format!("profile.{name}"),
                message: format!(
                    "missing field `{what}_altitude_msl_m`; expected it or {what}_above_runway_m"
                ),
            })?;
            let key = format!("profile.{name}.{what}_altitude_msl_m");
            check_number(key, altitude_m, above_ground(runway))?;
            Ok(altitude_m)
        };
        Ok(match *self {
            Self::GlidePath {
                level_altitude_msl_m,
                level_above_runway_m,
            } => {
                let level_m = altitude("level", level_altitude_msl_m, level_above_runway_m)?;
                ApproachProfile::GlidePath {
                    level_altitude_msl_m: needed("level", level_m)?,
                }
            }
            Self::StepDown {
                upper_altitude_msl_m,
                upper_above_runway_m,
                step_from_threshold_m,
                lower_altitude_msl_m,
                lower_above_runway_m,
            } => {
                let upper_m = altitude("upper", upper_altitude_msl_m, upper_above_runway_m)?;
                let lower_m = altitude("lower", lower_altitude_msl_m, lower_above_runway_m)?;
                // Where one level is above the runway, the chart's other one is as well.
                let is_lifted = upper_above_runway_m.or(lower_above_runway_m).is_some();
                let charted_m = |feet: f64| {
                    let higher_m = ground_m - CHARTED_ELEVATION_M;
                    is_lifted.then_some(feet * METERS_PER_FOOT + higher_m)
                };
                let upper_m = upper_m.or(charted_m(2_500.0));
                let lower_m = lower_m.or(charted_m(1_500.0));
                ApproachProfile::step_down(upper_m, step_from_threshold_m, lower_m)
            }
            Self::ContinuousDescent {
                start_altitude_msl_m,
                start_above_runway_m,
            } => {
                let start_m = altitude("start", start_altitude_msl_m, start_above_runway_m)?;
                ApproachProfile::ContinuousDescent {
                    start_altitude_msl_m: needed("start", start_m)?,
                }
            }
        })
    }
}

/// The profiles that the sweep defines, checked, and the built-in ones.
pub(crate) fn all(
    tables: &BTreeMap<String, ProfileTable>,
    runway: &Runway,
) -> Checked<BTreeMap<String, ApproachProfile>> {
    let mut profiles = BTreeMap::new();
    for (name, table) in tables {
        legal_name(format!("profile.{name}"), name)?;
        let profile = table.at(name, runway)?;
        check_steps(name, &profile, runway)?;
        profiles.insert(name.clone(), profile);
    }
    add_built_in(&mut profiles, runway);
    Ok(profiles)
}

/// Adds the built-in profiles that the sweep does not override: as high above its runway as they are above WSSS 02L.
fn add_built_in(profiles: &mut BTreeMap<String, ApproachProfile>, runway: &Runway) {
    let higher_m = runway.threshold.altitude_msl_m - CHARTED_ELEVATION_M;
    let built_in = [
        (
            LEVEL_THEN_GLIDE_PATH,
            ApproachProfile::GlidePath {
                level_altitude_msl_m: 2_500.0 * METERS_PER_FOOT + higher_m,
            },
        ),
        (STEP_DOWN, ApproachProfile::charted_step_down(higher_m)),
        (
            CONTINUOUS,
            ApproachProfile::ContinuousDescent {
                start_altitude_msl_m: 3_000.0 * METERS_PER_FOOT + higher_m,
            },
        ),
    ];
    for (name, profile) in built_in {
        profiles.entry(name.into()).or_insert(profile);
    }
}

/// Limits of altitudes above mean sea level over a runway.
fn above_ground(runway: &Runway) -> Limits {
    let ground_m = runway.threshold.altitude_msl_m;
    let (least_m, most_m) = OVER_RUNWAY_M;
    Limits::new(
        ground_m + least_m,
        ground_m + most_m,
        "an altitude in metres, above the runway,",
    )
}

/// Rejects a step-down that cannot be flown to a runway; its levels may be the chart's.
fn check_steps(name: &str, profile: &ApproachProfile, runway: &Runway) -> Checked<()> {
    let ApproachProfile::StepDown {
        upper_altitude_msl_m: upper_m,
        step_from_threshold_m,
        lower_altitude_msl_m: lower_m,
    } = *profile
    else {
        return Ok(());
    };
    let key = |field: &str| format!("profile.{name}.{field}");
    let above_ground = above_ground(runway);
    check_number(key("upper_altitude_msl_m"), upper_m, above_ground)?;
    let below_upper = Limits::new(
        above_ground.least,
        upper_m,
        "an altitude in metres, not above the upper level,",
    );
    check_number(key("lower_altitude_msl_m"), lower_m, below_upper)?;
    check_number(
        key("step_from_threshold_m"),
        step_from_threshold_m,
        limits::STEP_FROM_THRESHOLD_M,
    )
}

/// Rejects a start that needs a dive: `start` is the distance to the target and the height above the profile.
pub(crate) fn check_descent(
    name: &str,
    profile: &ApproachProfile,
    start: (f64, f64),
    runway: &Runway,
) -> Checked<()> {
    let (distance_m, above_m) = start;
    let height_m =
        profile.start_altitude_msl_m() + above_m - runway.touchdown_target().altitude_msl_m;
    let descent_deg = height_m.atan2(distance_m).to_degrees();
    if descent_deg <= STEEPEST_DEG {
        return Ok(());
    }
    let least_nm = height_m / STEEPEST_DEG.to_radians().tan() / METERS_PER_NAUTICAL_MILE;
    fault(
        "start.dtd_nm",
        format!(
            "profile {name} begins {height_m:.0} m above the runway, a descent of {descent_deg:.0} degrees from {distance_m:.0} m before \
             the target; expected at most {STEEPEST_DEG}: begin at {least_nm:.1} NM or more, or define a lower profile"
        ),
    )
}
