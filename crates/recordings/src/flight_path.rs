//! The path of an arrival by its track, by UTC.

use std::sync::Arc;

use dataset::corpus::scenario::SourceFile;
use dataset::geometry::runway::Runway;
use generator::tracks::Arrival;
use generator::trajectory::Trajectory;
use glam::DVec3;

/// Time between the points of the path, seconds.
const STEP_S: f64 = 0.5;

/// An arrival.
#[derive(Debug, Clone)]
pub(crate) struct FlightPath {
    /// Identifier of the trajectory.
    pub(crate) id: String,
    pub(crate) source: SourceFile,
    /// Hash of the smoothed states: the flight's identity.
    pub(crate) states_blake3: String,
    pub(crate) trajectory: Arc<Trajectory>,
    /// UTC of time 0 of the trajectory, seconds.
    pub(crate) origin_s: f64,
    /// First and last usable UTC, seconds: from the beginning of the approach until the target is passed.
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    /// Earth-centred positions, velocities, and heights above the target, each half second.
    points: Vec<(DVec3, DVec3, f64)>,
    /// Standard deviations along the course, across it, and of the height, metres.
    pub(crate) position_sd_m: [f64; 3],
    /// Standard deviation of an error of the heights in proportion to them.
    pub(crate) stretch_sd: f64,
    /// True if the positions have hardly any error: then heights are known as well.
    pub(crate) is_exact: bool,
    pub(crate) delay_sd_s: f64,
}

/// A position on a path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PathPoint {
    pub(crate) place_m: DVec3,
    pub(crate) velocity_mps: DVec3,
    /// Height above the target.
    pub(crate) height_m: f64,
}

impl PathPoint {
    /// Directions along the path, to the right of it, and up.
    pub(crate) fn axes(&self) -> [DVec3; 3] {
        let up = self.place_m.normalize();
        let along = (self.velocity_mps - up * self.velocity_mps.dot(up)).normalize_or_zero();
        [along, along.cross(up), up]
    }
}

impl FlightPath {
    /// The path of an arrival, up to the target.
    pub(crate) fn of(
        arrival: &Arrival,
        runway: &Runway,
        source: SourceFile,
        origin_s: f64,
        longest_m: f64,
    ) -> Option<Self> {
        let trajectory = arrival.recording.trajectory.clone();
        let window = trajectory.approach(runway, longest_m).ok()?;
        let (from_s, to_s) = (window.start_s, window.passing_s.unwrap_or(window.last_s));
        let steps = ((to_s - from_s) / STEP_S).ceil().max(1.0) as usize;
        let target_m = runway.touchdown_target().altitude_msl_m;
        let point = |step: usize| {
            let state = trajectory.at(from_s + step as f64 * STEP_S);
            let height_m = state.pose.altitude_msl_m - target_m;
            (state.position_ecef(), state.velocity_ecef(), height_m)
        };
        let stem = arrival.recording.file.trim_end_matches(".csv");
        Some(Self {
            id: stem.to_owned(),
            source,
            states_blake3: arrival.recording.blake3.clone(),
            points: (0..=steps).map(point).collect(),
            trajectory,
            origin_s,
            from_s: origin_s + from_s,
            to_s: origin_s + to_s,
            position_sd_m: arrival.position_sd_m,
            stretch_sd: arrival.stretch_sd,
            is_exact: false,
            delay_sd_s: 0.0,
        })
    }

    /// The position at a UTC, seconds; `None` outside the approach.
    pub(crate) fn at(&self, utc_s: f64) -> Option<PathPoint> {
        if !(self.from_s..=self.to_s).contains(&utc_s) {
            return None;
        }
        let steps = (utc_s - self.from_s) / STEP_S;
        let before = (steps as usize).min(self.points.len().checked_sub(2)?);
        let u = steps - before as f64;
        let [(p0, v0, h0), (p1, v1, h1)] = [self.points[before], self.points[before + 1]];
        let (m0, m1, way) = (v0 * STEP_S, v1 * STEP_S, p1 - p0);
        let bend = m0 + m1 - 2.0 * way;
        let slope = 3.0 * way - 2.0 * m0 - m1;
        Some(PathPoint {
            place_m: p0 + u * (m0 + u * (slope + u * bend)),
            velocity_mps: (m0 + u * (2.0 * slope + 3.0 * u * bend)) / STEP_S,
            height_m: h0 + u * (h1 - h0),
        })
    }
}
