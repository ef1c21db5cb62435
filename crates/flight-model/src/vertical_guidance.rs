//! Target climb rate: level segments, steps, glide path and flare.
//!
//! Input: the requested profile, the aircraft's position relative to the touchdown target, its motion. Output: the climb rate to
//! fly. Segments are joined by taking the lower (or higher) of two climb rates, so a capture is smooth without a schedule: the
//! glide path's law demands a climb as long as the path is far above, and takes over once it demands less than the previous
//! segment.
//!
//! The glide path's height over the ellipsoid is the distance to the target times the tangent of the angle, without the earth's curvature
//! (27 m at 10 NM): that is how charts place their fixes and how the recorded flights went down.

use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::runway::Runway;

/// Time constant for correcting a height error, seconds.
const PATH_TIME_S: f64 = 4.5;
const LEVEL_TIME_S: f64 = 5.5;
/// Largest correction to the glide path's own rate of descent, metres per second.
const MAX_PATH_CORRECTION_MPS: f64 = 2.5;
/// Fastest descent and climb between levels, metres per second (1,000 and 800 ft/min).
const MAX_DESCENT_MPS: f64 = 5.1;
const MAX_CLIMB_MPS: f64 = 4.1;
/// A step goes down this much steeper than the glide path: from D7.6 of the Changi chart it reaches 1,500 ft before D4.4.
const STEP_STEEPER: f64 = 1.35;
/// Nearer to a level than this counts as being there, metres.
const LEVELLED_M: f64 = 25.0;
/// Descent angles towards a glide path met from above or below without a level segment, relative to the glide path's.
const STEEPER_FROM_ABOVE: f64 = 1.3;
const SHALLOWER_FROM_BELOW: f64 = 0.25;

/// Past the target by this much the crew puts the aircraft down rather than let it float, with this much more sink per further
/// metre.
const LONG_FLARE_M: f64 = 150.0;
const SINK_PER_LONG_M: f64 = 0.01;

/// Position and motion of the aircraft, as guidance needs them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Situation {
    /// Distance along the course to the touchdown target, metres.
    pub(crate) to_target_m: f64,
    pub(crate) right_of_course_m: f64,
    /// Rate of that offset, metres per second.
    pub(crate) right_rate_mps: f64,
    /// Height of the centre of gravity over the touchdown target, metres.
    pub(crate) height_m: f64,
    /// Height of the wheels over the ground, metres.
    pub(crate) wheel_height_m: f64,
    pub(crate) ground_speed_mps: f64,
    pub(crate) climb_mps: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    BeforeGlidePath,
    GlidePath,
    Flare { time_constant_s: f64 },
}

#[derive(Debug)]
pub(crate) struct VerticalGuidance {
    profile: ApproachProfile,
    target_msl_m: f64,
    past_threshold_m: f64,
    glide_slope: f64,
    flare_height_m: f64,
    touchdown_sink_mps: f64,
    phase: Phase,
    from_above: Option<bool>,
}

impl VerticalGuidance {
    /// Guidance down `profile` to `runway`; the flare begins with the wheels at `flare_height_m` and ends at
    /// `touchdown_sink_mps`.
    pub(crate) fn new(
        profile: ApproachProfile,
        runway: &Runway,
        flare_height_m: f64,
        touchdown_sink_mps: f64,
    ) -> Self {
        Self {
            profile,
            target_msl_m: runway.threshold.altitude_msl_m,
            past_threshold_m: runway.touchdown_past_threshold_m,
            glide_slope: runway.glide_path_deg.to_radians().tan(),
            flare_height_m,
            touchdown_sink_mps,
            phase: Phase::BeforeGlidePath,
            from_above: None,
        }
    }

    /// True if the flare has begun.
    pub(crate) fn is_flaring(&self) -> bool {
        matches!(self.phase, Phase::Flare { .. })
    }

    /// The climb rate to fly now, metres per second, up positive.
    pub(crate) fn climb_mps(&mut self, now: &Situation) -> f64 {
        if !self.is_flaring() && now.wheel_height_m < self.flare_height_m {
            // An exponential from the rate of descent on the glide path to the one at touchdown, which is reached with the wheels at zero.
            // It does not start from the present rate: a flare that began in a downdraught would continue with it.
            let sink_mps =
                (self.glide_slope * now.ground_speed_mps).max(self.touchdown_sink_mps + 0.8);
            self.phase = Phase::Flare {
                time_constant_s: now.wheel_height_m.max(0.1) / (sink_mps - self.touchdown_sink_mps),
            };
        }
        match self.phase {
            Phase::Flare { time_constant_s } => {
                let long_m = (-now.to_target_m - LONG_FLARE_M).max(0.0);
                -now.wheel_height_m.max(0.0) / time_constant_s
                    - self.touchdown_sink_mps
                    - SINK_PER_LONG_M * long_m
            }
            Phase::GlidePath => self.glide_path_climb_mps(now, MAX_PATH_CORRECTION_MPS),
            Phase::BeforeGlidePath => self.climb_before_glide_path_mps(now),
        }
    }

    fn glide_path_climb_mps(&self, now: &Situation, largest_correction_mps: f64) -> f64 {
        let below_path_m = self.glide_slope * now.to_target_m - now.height_m;
        let correction_mps = below_path_m / PATH_TIME_S;
        -self.glide_slope * now.ground_speed_mps
            + correction_mps.clamp(-largest_correction_mps, largest_correction_mps)
    }

    fn climb_before_glide_path_mps(&mut self, now: &Situation) -> f64 {
        // Unlimited here: a distant path must not look as if it were near.
        let path = self.glide_path_climb_mps(now, f64::INFINITY);
        let above_path = now.height_m > self.glide_slope * now.to_target_m;
        let from_above = *self.from_above.get_or_insert(above_path);
        let (segment, may_capture) = match self.profile {
            ApproachProfile::StepDown {
                upper_altitude_msl_m,
                step_from_threshold_m,
                lower_altitude_msl_m,
            } => {
                let before_threshold_m = now.to_target_m - self.past_threshold_m;
                if before_threshold_m > step_from_threshold_m {
                    (self.level_climb_mps(upper_altitude_msl_m, now), false)
                } else {
                    let step = -STEP_STEEPER * self.glide_slope * now.ground_speed_mps;
                    let lower = self.level_climb_mps(lower_altitude_msl_m, now);
                    // The path is met from the lower level, not on the way down to it.
                    let over_lower_m = now.height_m + self.target_msl_m - lower_altitude_msl_m;
                    let path_over_lower_m = self.glide_slope * now.to_target_m + self.target_msl_m
                        - lower_altitude_msl_m;
                    let is_there = over_lower_m < LEVELLED_M || path_over_lower_m < -LEVELLED_M;
                    (lower.max(step), is_there)
                }
            }
            _ if from_above => (
                -STEEPER_FROM_ABOVE * self.glide_slope * now.ground_speed_mps,
                true,
            ),
            ApproachProfile::GlidePath {
                level_altitude_msl_m,
            } => (self.level_climb_mps(level_altitude_msl_m, now), true),
            ApproachProfile::ContinuousDescent { .. } => (
                -SHALLOWER_FROM_BELOW * self.glide_slope * now.ground_speed_mps,
                true,
            ),
        };
        let stepping = matches!(self.profile, ApproachProfile::StepDown { .. });
        let captured = if from_above && !stepping {
            path >= segment
        } else {
            path <= segment
        };
        if may_capture && captured {
            self.phase = Phase::GlidePath;
            return path;
        }
        segment
    }

    fn level_climb_mps(&self, altitude_msl_m: f64, now: &Situation) -> f64 {
        ((altitude_msl_m - self.target_msl_m - now.height_m) / LEVEL_TIME_S)
            .clamp(-MAX_DESCENT_MPS, MAX_CLIMB_MPS)
    }
}
