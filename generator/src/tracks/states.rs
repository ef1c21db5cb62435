//! From an arrival to states: path and height are smoothed, everything else follows from them.

use std::fmt::Write;

use dataset::geometry::runway::Runway;
use dataset::numbers::spread::{mean_and_deviation, median};
use dataset::numbers::units::Degrees;

use super::arrival::{ArrivalFix, NoArrival, arrival, passings, without_jumps};
use super::attitude::{
    density, final_speed_mps, gear, measured_attitude, measured_roll_deg, pitch_deg, roll_deg,
};
use super::flaps::{FlapSchedule, Moment};
use super::formats::{Attitude, Fix, Track};
use super::height::{Datum, NORMAL_90};
use super::smoother::{Measured, Noise, Smoothed, at, smooth};

/// Time between states, seconds.
const STEP_S: f64 = 0.5;
/// Positions scatter along the course by their age, and less across.
const ALONG: Noise = Noise {
    place_m: 15.0,
    speed_mps: 2.0,
    acceleration: 0.2,
};
const ACROSS: Noise = Noise {
    place_m: 3.0,
    speed_mps: 1.0,
    acceleration: 0.05,
};
/// Altitudes have steps of 25 ft.
const HEIGHT: Noise = Noise {
    place_m: 3.0,
    speed_mps: 1.0,
    acceleration: 0.05,
};
/// Maximum share of outliers: 16 real arrivals have at most 0.6 %, two feeds that are 35 s apart 60 %.
const MAX_OUTLIERS: f64 = 0.05;
/// Rounding error of simulated positions, metres.
const EXACT_M: f64 = 1.0;
/// Maximum distance of a correct altitude from its neighbours' median, metres.
const SPIKE_M: f64 = 100.0;
const NEIGHBOURS: usize = 5;
/// Greater heights are wrong altitudes, metres: within 25 NM, no arrival is there.
const MAX_HEIGHT_M: f64 = 6_000.0;
/// Landed if below this height, metres, and sinking no faster than this, m/s: altitudes have steps.
const LOW_M: f64 = 12.0;
const SINKS_NO_MORE_MPS: f64 = 0.4;
/// Height of the centre of gravity when the wheels touch the runway, metres.
const ON_WHEELS_M: f64 = 3.5;
/// Limits of the sink rate after the last altitude, m/s.
const SINKS_MPS: (f64, f64) = (1.5, 4.5);
/// Over this time before touchdown a remaining height is taken away, seconds.
const CORRECTED_S: f64 = 20.0;
/// The roll: its duration, its deceleration, and the least speed.
const ROLL_S: f64 = 8.0;
const BRAKES_MPS2: f64 = 2.0;
const TAXI_MPS: f64 = 20.0;
/// A state without a fix this near is derived, seconds.
const MEASURED_S: f64 = 2.0;
/// Turn rates are taken over this time on both sides, seconds: of the path, and of reported tracks, which have steps.
const TURN_S: f64 = 2.0;
const TURNS_S: f64 = 5.0;

const HEADER: &str = "t_s,latitude_deg,longitude_deg,altitude_msl_m,pitch_deg,roll_deg,heading_true_deg,tas_mps,v_north_mps,v_east_mps,v_down_mps,flap_norm,gear_norm,on_ground,altitude_90_m,attitude,position";

pub(super) struct Made {
    rows: Vec<Row>,
    /// UTC of the first row, seconds since 1970.
    pub(super) start_utc_s: f64,
    /// Mean time between positions, seconds.
    spacing_s: f64,
    pub(super) stretch_sd: f64,
    pub(super) along_sd_m: f64,
    pub(super) across_sd_m: f64,
    pub(super) outliers: usize,
    pub(super) continued_s: f64,
}

struct Row {
    time_s: f64,
    numbers: [f64; 12],
    on_ground: bool,
    is_measured: bool,
    /// The measured part of the attitude.
    attitude: &'static str,
    /// Half-width of the 90 % interval of the height.
    height_90_m: f64,
}

struct Path<'a> {
    runway: &'a Runway,
    to_go: Vec<Smoothed>,
    right: Vec<Smoothed>,
    height: Vec<Smoothed>,
    /// Last fix.
    ends_s: f64,
    touchdown_s: f64,
    /// Height that is left at touchdown by the smoothed heights.
    left_m: f64,
    datum: Datum,
    final_mps: f64,
    flaps: FlapSchedule,
}

/// Deviations of the measured positions from the path, metres (standard deviation).
struct Scatter {
    along_m: f64,
    across_m: f64,
    outliers: usize,
}

/// The arrivals of a track, and the reasons for those that cannot be used; at least one of either.
pub(super) fn of_track(track: &Track, runway: &Runway) -> Vec<Result<Made, String>> {
    let parts = passings(&track.fixes, runway).into_iter();
    let mut made: Vec<_> = parts.map(|part| of_arrival(&part, runway)).collect();
    // Whoever goes around, or passes by, may land later.
    made.retain(|made| !matches!(made, Err(NoArrival::Elsewhere(_))));
    if !made.iter().any(Result::is_ok) {
        // Of mixed tracks, later parts are fragments.
        made.truncate(1);
    }
    if made.is_empty() {
        made.push(of_arrival(&track.fixes, runway));
    }
    let said = |reason: NoArrival| match track.coarse {
        0 => reason.to_string(),
        coarse => format!(
            "{reason}; {coarse} positions from multilateration or radar, which scatter by tens of metres, do not count"
        ),
    };
    made.into_iter().map(|made| made.map_err(said)).collect()
}

fn of_arrival(fixes: &[Fix], runway: &Runway) -> Result<Made, NoArrival> {
    let (kept, jumps) = without_jumps(fixes);
    let judged = |outliers: usize, positions: usize| {
        if outliers as f64 <= MAX_OUTLIERS * positions as f64 {
            return Ok(());
        }
        Err(NoArrival::Unusable(format!(
            "{outliers} of its {positions} positions are not on one path, expected at most {:.0} %: are two aircraft or two feeds mixed, or \
             positions from multilateration?",
            100.0 * MAX_OUTLIERS
        )))
    };
    let seen =
        arrival(&kept, runway).or_else(|reason| judged(jumps, fixes.len()).and(Err(reason)))?;
    let datum = Datum::of(&seen, runway)?;
    let (path, scatter) = Path::through(&seen, datum, runway);
    let outliers = jumps + scatter.outliers;
    judged(outliers, jumps + seen.len())?;
    let first_s = seen[0].fix.time_s;
    let last_s = path.touchdown_s + ROLL_S;
    let count = ((last_s - first_s) / STEP_S).floor() as usize + 1;
    let times = (0..count).map(|step| first_s + step as f64 * STEP_S);
    let lasts_s = seen[seen.len() - 1].fix.time_s - first_s;
    Ok(Made {
        start_utc_s: first_s,
        stretch_sd: datum.stretch_sd(),
        spacing_s: lasts_s / (seen.len() - 1).max(1) as f64,
        rows: times
            .map(|time_s| path.row(time_s, first_s, &seen))
            .collect(),
        along_sd_m: scatter.along_m,
        across_sd_m: scatter.across_m,
        outliers,
        continued_s: (last_s - path.ends_s).max(0.0),
    })
}

/// Heights near the median of their neighbours.
fn without_spikes(heights: &[Measured]) -> Vec<Measured> {
    let is_near = |index: &usize| {
        let around = index.saturating_sub(NEIGHBOURS)..(index + NEIGHBOURS + 1).min(heights.len());
        let mut near: Vec<f64> = heights[around].iter().map(|seen| seen.place_m).collect();
        (heights[*index].place_m - median(&mut near)).abs() < SPIKE_M
    };
    let kept = (0..heights.len()).filter(is_near);
    kept.map(|index| heights[index]).collect()
}

/// Acceleration of the turn around a fix, by the reported tracks.
fn turns_mps2(seen: &[ArrivalFix], index: usize) -> f64 {
    let here_s = seen[index].fix.time_s;
    let first = seen.partition_point(|at| at.fix.time_s < here_s - TURNS_S);
    let last = seen.partition_point(|at| at.fix.time_s <= here_s + TURNS_S) - 1;
    let tracks = seen[first].fix.track_deg.zip(seen[last].fix.track_deg);
    let (Some((before, after)), Some(speed_mps)) = (tracks, seen[index].fix.ground_speed_mps)
    else {
        return 0.0;
    };
    let lasts_s = seen[last].fix.time_s - seen[first].fix.time_s;
    if lasts_s <= 0.0 {
        return 0.0;
    }
    speed_mps * Degrees(after - before).wrapped_180().0.to_radians() / lasts_s
}

impl<'a> Path<'a> {
    fn through(seen: &[ArrivalFix], datum: Datum, runway: &'a Runway) -> (Self, Scatter) {
        let velocity_mps = |at: &ArrivalFix| {
            let (Some(track_deg), Some(speed_mps)) = (at.fix.track_deg, at.fix.ground_speed_mps)
            else {
                return [None; 2];
            };
            let off = (track_deg - runway.course_true_deg).to_radians();
            [-off.cos(), off.sin()].map(|part| Some(part * speed_mps))
        };
        let mut measured: [Vec<Measured>; 3] = [Vec::new(), Vec::new(), Vec::new()];
        for (index, at) in seen.iter().enumerate() {
            let velocity_mps = if at.fix.on_ground {
                [None; 2]
            } else {
                velocity_mps(at)
            };
            let turns_mps2 = turns_mps2(seen, index);
            let one = |place_m, speed_mps| Measured {
                time_s: at.fix.time_s,
                place_m,
                speed_mps,
                turns_mps2,
            };
            measured[0].push(one(at.to_go_m, velocity_mps[0]));
            measured[1].push(one(at.right_m, velocity_mps[1]));
            if let Some(height_m) = datum.height_m(&at.fix).filter(|m| *m < MAX_HEIGHT_M) {
                measured[2].push(Measured {
                    turns_mps2: 0.0,
                    ..one(height_m, None)
                });
            }
        }
        let [along, across, heights] = measured;
        let heights = without_spikes(&heights);
        let noise = |noise: Noise| Noise {
            place_m: if datum.is_exact {
                EXACT_M
            } else {
                noise.place_m
            },
            ..noise
        };
        let (to_go, along_outliers) = smooth(&along, noise(ALONG));
        let (right, across_outliers) = smooth(&across, noise(ACROSS));
        let (height, _) = smooth(&heights, noise(HEIGHT));
        let is_outlier: Vec<bool> = (along_outliers.iter().zip(&across_outliers))
            .map(|(along, across)| *along || *across)
            .collect();
        let deviation = |measured: &[Measured], path: &[Smoothed]| {
            let errors = measured
                .iter()
                .zip(path)
                .zip(&is_outlier)
                .filter(|(_, outlier)| !**outlier);
            let errors = errors.map(|((seen, path), _)| seen.place_m - path.place_m);
            mean_and_deviation(errors)[1]
        };
        let scatter = Scatter {
            along_m: deviation(&along, &to_go),
            across_m: deviation(&across, &right),
            outliers: is_outlier.iter().filter(|outlier| **outlier).count(),
        };
        let final_mps = final_speed_mps(seen, &to_go);
        let mut path = Self {
            runway,
            ends_s: seen[seen.len() - 1].fix.time_s,
            to_go,
            right,
            height,
            touchdown_s: f64::INFINITY,
            left_m: 0.0,
            datum,
            final_mps,
            flaps: FlapSchedule::of(&[], runway.glide_path_deg),
        };
        path.land(seen);
        let (first_s, last_s) = (seen[0].fix.time_s, path.touchdown_s);
        let steps = ((last_s - first_s) / STEP_S).max(0.0) as usize;
        let moments: Vec<Moment> = (0..=steps)
            .map(|step| path.moment(first_s + step as f64 * STEP_S))
            .collect();
        path.flaps = FlapSchedule::of(&moments, runway.glide_path_deg);
        (path, scatter)
    }

    /// Finds the touchdown: by the first fix on the ground, or where the path reaches it; after the end of the track by its last sink rate.
    /// Single reports in mid flight claim the ground by mistake.
    fn land(&mut self, seen: &[ArrivalFix]) {
        let flies = seen.iter().rposition(|at| !at.fix.on_ground);
        let rolls_s = seen
            .get(flies.map_or(0, |last| last + 1))
            .map(|at| at.fix.time_s);
        let last = self.height[self.height.len() - 1];
        let from_s = self.height[0].time_s;
        let steps = ((last.time_s - from_s) / STEP_S) as usize;
        let reaches_s = (0..=steps)
            .map(|step| from_s + step as f64 * STEP_S)
            .find(|time_s| {
                let height = at(&self.height, *time_s);
                let is_level = height.speed_mps > -SINKS_NO_MORE_MPS;
                height.place_m <= ON_WHEELS_M || (height.place_m <= LOW_M && is_level)
            });
        let sinks_mps = (-last.speed_mps).clamp(SINKS_MPS.0, SINKS_MPS.1);
        let continued_s = last.time_s + (last.place_m - ON_WHEELS_M).max(0.0) / sinks_mps;
        let touchdown_s = reaches_s.unwrap_or(continued_s);
        self.touchdown_s = rolls_s.map_or(touchdown_s, |rolls_s| touchdown_s.min(rolls_s));
        self.left_m = (self.falling_m(self.touchdown_s) - ON_WHEELS_M).max(0.0);
    }

    /// Height by altitudes and, after the last one, by the sink rate.
    fn falling_m(&self, time_s: f64) -> f64 {
        let last = self.height[self.height.len() - 1];
        if time_s <= last.time_s {
            return at(&self.height, time_s).place_m;
        }
        let sinks_mps = (-last.speed_mps).clamp(SINKS_MPS.0, SINKS_MPS.1);
        last.place_m - sinks_mps * (time_s - last.time_s)
    }

    fn height_m(&self, time_s: f64) -> f64 {
        if time_s >= self.touchdown_s {
            return ON_WHEELS_M;
        }
        let part = 1.0 - ((self.touchdown_s - time_s) / CORRECTED_S).min(1.0);
        (self.falling_m(time_s) - part * self.left_m).max(ON_WHEELS_M)
    }

    /// Distance to go and offset with their rates; after the last fix the aircraft brakes on the centreline.
    fn place(&self, time_s: f64) -> [Smoothed; 2] {
        if time_s <= self.ends_s {
            return [at(&self.to_go, time_s), at(&self.right, time_s)];
        }
        let mut to_go = at(&self.to_go, self.ends_s);
        let right = at(&self.right, self.ends_s);
        let flies_s = (self.touchdown_s.max(self.ends_s) - self.ends_s).min(time_s - self.ends_s);
        to_go.place_m += to_go.speed_mps * flies_s;
        let brakes_s = time_s - self.ends_s - flies_s;
        let least_mps = TAXI_MPS.min(-to_go.speed_mps);
        let stops_s = ((-to_go.speed_mps - least_mps) / BRAKES_MPS2).max(0.0);
        let slowing_s = brakes_s.min(stops_s);
        to_go.place_m += to_go.speed_mps * slowing_s + BRAKES_MPS2 * slowing_s * slowing_s / 2.0;
        to_go.speed_mps += BRAKES_MPS2 * slowing_s;
        to_go.place_m += to_go.speed_mps * (brakes_s - slowing_s);
        let steady = Smoothed {
            speed_mps: 0.0,
            ..right
        };
        [to_go, steady]
    }

    /// North and east.
    fn velocity_mps(&self, time_s: f64) -> [f64; 2] {
        let [to_go, right] = self.place(time_s);
        let (sin, cos) = self.runway.course_true_deg.to_radians().sin_cos();
        let ahead_mps = -to_go.speed_mps;
        [
            cos * ahead_mps - sin * right.speed_mps,
            sin * ahead_mps + cos * right.speed_mps,
        ]
    }

    fn moment(&self, time_s: f64) -> Moment {
        let [north, east] = self.velocity_mps(time_s);
        let speed_mps = north.hypot(east);
        let height_m = self.height_m(time_s);
        // Indicated airspeeds fall with the root of the density.
        let field_msl_m = self.runway.threshold.altitude_msl_m;
        let thinner = density(field_msl_m + height_m) / density(field_msl_m);
        Moment {
            time_s,
            to_go_m: self.place(time_s)[0].place_m,
            height_m,
            climbs_deg: -self.sink_mps(time_s).atan2(speed_mps).to_degrees(),
            faster: speed_mps * thinner.sqrt() / self.final_mps,
        }
    }

    fn sink_mps(&self, time_s: f64) -> f64 {
        let half_s = STEP_S / 2.0;
        (self.height_m(time_s - half_s) - self.height_m(time_s + half_s)) / STEP_S
    }

    fn track_deg(&self, time_s: f64) -> f64 {
        let [north, east] = self.velocity_mps(time_s);
        east.atan2(north).to_degrees()
    }

    fn row(&self, time_s: f64, first_s: f64, seen: &[ArrivalFix]) -> Row {
        let [to_go, right] = self.place(time_s);
        let target = self.runway.touchdown_target();
        let here = self.runway.point_on_approach(to_go.place_m, right.place_m);
        let [north, east] = self.velocity_mps(time_s);
        let speed_mps = north.hypot(east);
        let on_ground = time_s >= self.touchdown_s;
        let sink_mps = self.sink_mps(time_s);
        let turn = Degrees(self.track_deg(time_s + TURN_S) - self.track_deg(time_s - TURN_S))
            .wrapped_180()
            .0;
        let bank_deg = roll_deg(speed_mps, turn / (2.0 * TURN_S));
        let nearest = seen.partition_point(|at| at.fix.time_s < time_s);
        let near = nearest.checked_sub(1).into_iter().chain([nearest]);
        let is_measured = near
            .filter_map(|index| seen.get(index))
            .any(|at| (at.fix.time_s - time_s).abs() <= MEASURED_S);
        let flaps = self.flaps.at(time_s);
        let measured = measured_attitude(seen, time_s);
        let measured_roll_deg = measured_roll_deg(seen, time_s).filter(|_| !on_ground);
        let attitude = measured.unwrap_or_else(|| {
            let derived = |value_deg: f64| if on_ground { 0.0 } else { value_deg };
            let Moment {
                climbs_deg, faster, ..
            } = self.moment(time_s);
            Attitude {
                pitch_deg: derived(pitch_deg(climbs_deg, faster, flaps, bank_deg)),
                roll_deg: measured_roll_deg.unwrap_or(derived(bank_deg)),
                heading_true_deg: None,
            }
        });
        let heading_deg = attitude
            .heading_true_deg
            .unwrap_or_else(|| self.track_deg(time_s));
        Row {
            time_s: time_s - first_s,
            numbers: [
                here.latitude_deg,
                here.longitude_deg,
                target.altitude_msl_m + self.height_m(time_s),
                attitude.pitch_deg,
                attitude.roll_deg,
                Degrees(heading_deg).wrapped_360().0,
                speed_mps,
                north,
                east,
                sink_mps,
                flaps,
                gear(to_go.place_m),
            ],
            on_ground,
            is_measured,
            attitude: match (measured, measured_roll_deg) {
                (Some(_), _) => "measured",
                (None, Some(_)) => "roll",
                (None, None) => "derived",
            },
            height_90_m: self.datum.half_width_90_m(self.height_m(time_s)),
        }
    }
}

impl Made {
    /// Standard deviations of the smoothed positions along the course and across it, and of the heights, metres. A path under white
    /// acceleration of density q, through places with white errors of density r, has the variance `r^(3/4) q^(1/4) / (2 sqrt 2)`.
    pub(super) fn position_sd_m(&self) -> [f64; 3] {
        let smoothed = |scatter_m: f64, noise: Noise| {
            let density = scatter_m * scatter_m * self.spacing_s;
            (density.powf(0.75) * noise.acceleration.powf(0.25) / 8.0_f64.sqrt()).sqrt()
        };
        let mut heights: Vec<f64> = self.rows.iter().map(|row| row.height_90_m).collect();
        [
            smoothed(self.along_sd_m, ALONG),
            smoothed(self.across_sd_m, ACROSS),
            median(&mut heights) / NORMAL_90,
        ]
    }

    /// The recording as a table.
    pub(super) fn csv(&self) -> String {
        let mut text = format!("{HEADER}\n");
        for row in &self.rows {
            // A string has room for everything.
            let _ = write!(text, "{:.3}", row.time_s);
            for (index, number) in row.numbers.iter().enumerate() {
                let digits = if index < 2 { 9 } else { 4 };
                let _ = write!(text, ",{number:.digits$}");
            }
            let position = if row.is_measured {
                "measured"
            } else {
                "derived"
            };
            let attitude = row.attitude;
            let on_ground = u8::from(row.on_ground);
            let _ = writeln!(
                text,
                ",{on_ground},{:.1},{attitude},{position}",
                row.height_90_m
            );
        }
        text
    }
}

#[cfg(test)]
mod tests;
