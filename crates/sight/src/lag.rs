//! Lag between two cameras' images, and when it changes, from an aircraft that both see.
//!
//! Where the aircraft is in the first view tells its row in the second. An image that was taken at a different time shows it off that row
//! by its motion in between: almost nothing on the glide path far out, two pixels per second in level flight and near the runway. A camera
//! that looks elsewhere moves rows too, by a linear function of the places, which is fitted with the lag; how far it may move them is
//! known ([`Rows::sd_px`]). Columns tell no lag: along them, lag and distance cannot be distinguished.
//!
//! A lost image makes all later ones come too early: then the lag changes in mid flight ([`changing`]), and the view whose own path jumps
//! at that moment has lost it ([`skipped_s`]).

use dataset::geometry::rays::LAG_STEP_S;
use dataset::numbers::least_squares::robust_fit;
use dataset::numbers::motion::{Motion, motion_at, scatter};
use glam::DVec2;

use crate::sight::CERTAIN_SD;

/// Terms of what cameras add to rows: constant, and change with column and row in the first view and with the columns between the views.
pub const PLACE_TERMS: usize = 4;
/// Terms of the cameras, and one of the size.
const TERMS: usize = PLACE_TERMS + 1;
/// Unit of places and widths, pixels.
pub const UNIT_PX: f64 = 1_000.0;
/// Images that were taken at different times show an aircraft in different sizes. A registration then follows a point beside the one that
/// it should, by part of the height: rows are off by up to this much for each second of lag, for an aircraft that is a unit wide. Views
/// that were five seconds late had -1.2 (`late-5s` of scripts/moved_cameras.py).
const SIZE_SD_PX_PER_S: f64 = 1.5;
/// Minimum number of sightings before and after a change.
const MIN_SIGHTINGS: usize = 5;
/// Standard deviation of a lag before any sighting, seconds; a fit that ends beyond it has failed. `dtd detect` writes no larger lag.
const PRIOR_SD_S: f64 = 10.0;
/// Maximum step of a lag in one round of the fit, seconds: a cubic follows the path for such a time, so lags of five seconds converge.
const MAX_STEP_S: f64 = 3.0;
/// A change that is smaller than this ends the fit, seconds.
const EXACTLY_S: f64 = 1e-3;
const ROUNDS: usize = 12;
/// Rounds of reweighting.
const REWEIGHTINGS: usize = 5;
/// Reduction of the loss by which a change of the lag is certain. In 32 flights without one, no change reduced it by more than 6; a view
/// that began to be late by a second reduced it by hundreds.
const CERTAIN: f64 = 50.0;

/// An aircraft in the images of two cameras that have the same time, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Time of the images.
    pub time_s: f64,
    /// Lag that was already taken off the time of the second view's image, s.
    pub taken_off_s: f64,
    /// In the first view and in the second.
    pub places_px: [DVec2; 2],
    /// Its width in the first view.
    pub width_px: f64,
    /// Standard deviation of its rows.
    pub sd_px: f64,
}

/// Expected rows in the second view.
pub struct Rows<'a> {
    /// Pixels down from the expected row, by the places in both views; `None` where there is none.
    pub off_px: &'a dyn Fn([DVec2; 2]) -> Option<f64>,
    /// Standard deviations of what a flight's cameras add to it, pixels: a constant, and slopes over a thousand pixels.
    pub sd_px: [f64; PLACE_TERMS],
}

/// Lag of the second view behind the first, until the next one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// Time of the first image that has it; negative infinity for the first lag.
    pub from_s: f64,
    /// Seconds by which the second view shows an earlier aircraft; negative if the first one does.
    pub seconds: f64,
    /// Standard deviation, seconds.
    pub sd_s: f64,
}

/// The lag that counts at a time.
pub fn lag_at(lags: &[Lag], time_s: f64) -> Option<Lag> {
    lags.iter().rev().find(|lag| lag.from_s <= time_s).copied()
}

/// Motion of one object from a time on, by its places; `None` where it is not known, or farther than it was seen.
pub fn moved(places: &[(f64, DVec2)], time_s: f64, by_s: f64) -> Option<[Motion; 2]> {
    let (first, last) = (places.first()?, places.last()?);
    let is_seen = (first.0 - LAG_STEP_S..=last.0 + LAG_STEP_S).contains(&(time_s + by_s));
    let ends = [time_s, time_s + by_s].map(|at_s| motion_at(places, at_s));
    let [Some(from), Some(to)] = ends.map(|end| end.filter(|_| is_seen)) else {
        return None;
    };
    Some([from, to])
}

/// Standard deviation of a movement between two times, for places that scatter by `scatter_px`.
pub fn moved_sd_px([from, to]: &[Motion; 2], by_s: f64, scatter_px: DVec2) -> DVec2 {
    // Places near each other follow from the same ones.
    let near = by_s.abs() * from.unit_sd_per_s.max(to.unit_sd_per_s);
    scatter_px * near.min((from.unit_variance + to.unit_variance).sqrt())
}

/// Parts of a track, from each change of the lag to the next: within a part, places follow one motion.
pub fn with_one_lag<'a, T>(
    track: &'a [T],
    lags: &'a [Lag],
    time_s: impl Fn(&T) -> f64 + 'a,
) -> impl Iterator<Item = &'a [T]> {
    let number = move |one: &T| lags.iter().filter(|lag| lag.from_s <= time_s(one)).count();
    track.chunk_by(move |a, b| number(a) == number(b))
}

/// Seconds of flight that a view's own path skips at a time, and their standard deviation; `None` if it is not seen on both sides.
pub fn skipped_s(places: &[(f64, DVec2)], at_s: f64) -> Option<[f64; 2]> {
    let (before, after) = places.split_at(places.partition_point(|(time_s, _)| *time_s < at_s));
    let middle_s = (before.last()?.0 + after.first()?.0) / 2.0;
    let [before, after] = [motion_at(before, middle_s)?, motion_at(after, middle_s)?];
    let motion = (before.per_s + after.per_s) / 2.0;
    let direction = motion.try_normalize()?;
    let scatter_px = scatter(places).dot(direction.abs());
    let sd_px = scatter_px * (before.unit_variance + after.unit_variance).sqrt();
    Some([
        (after.place - before.place).dot(direction) / motion.length(),
        sd_px / motion.length(),
    ])
}

/// An equation for the lag: what is left of the row after the lag so far.
struct Equation {
    time_s: f64,
    terms: [f64; TERMS],
    off_px: f64,
    /// Change with a longer lag.
    per_s: f64,
    sd_px: f64,
}

/// Solution for a step of the fit.
struct Solution {
    /// Changes of the lags, seconds, and standard deviations of the lags.
    by_s: Vec<f64>,
    sds_s: Vec<f64>,
    best_s: f64,
    sightings: usize,
    loss: f64,
    /// See [`Fit::excess`].
    excess: f64,
}

/// The lags of a flight, and what its cameras add to the rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// At least one, by time.
    pub lags: Vec<Lag>,
    /// Time for which the lags are known best.
    pub best_s: f64,
    /// Number of sightings that count, about one a second.
    pub sightings: usize,
    /// Scatter of the rows that no lag explains, in their standard deviations, at least 1.
    pub excess: f64,
}

impl Sighting {
    /// Time of the second view's image by its own clock.
    fn own_s(&self) -> f64 {
        self.time_s + self.taken_off_s
    }

    fn later(&self, by_px: DVec2) -> Self {
        let [first, second] = self.places_px;
        Self {
            places_px: [first, second + by_px],
            ..*self
        }
    }

    fn terms(&self, left_s: f64) -> [f64; TERMS] {
        let [first, second] = self.places_px.map(|place_px| place_px / UNIT_PX);
        let of_size = left_s * self.width_px / UNIT_PX;
        [1.0, first.x, first.y, second.x - first.x, of_size]
    }
}

/// The lag of a whole flight; `None` of too few sightings. `tracks`: of each aircraft, by time; `start_s`: about the lag, if it is known.
pub fn constant(tracks: &[Vec<Sighting>], rows: &Rows, start_s: f64) -> Option<Fit> {
    let first = Lag {
        from_s: f64::NEG_INFINITY,
        seconds: start_s,
        sd_s: PRIOR_SD_S,
    };
    Some(converged(tracks, rows, vec![first])?.0)
}

/// The lags of a flight, with their changes; `None` of too few sightings. `tracks`: of each aircraft, by time.
pub fn changing(tracks: &[Vec<Sighting>], rows: &Rows) -> Option<Fit> {
    let mut fit = constant(tracks, rows, 0.0)?;
    loop {
        let lags = &fit.lags;
        let equations = equations(tracks, rows, lags);
        let Some(now) = solved(&equations, rows, lags) else {
            return Some(fit);
        };
        let Some(change_s) = change(&equations, rows, lags) else {
            return Some(fit);
        };
        let (place, split) = split(lags, change_s);
        let Some((changed, better)) = converged(tracks, rows, split) else {
            return Some(fit);
        };
        let [before, after] = [changed.lags[place - 1], changed.lags[place]];
        let jump = (after.seconds - before.seconds).abs() / after.sd_s.hypot(before.sd_s);
        if now.loss - better.loss < CERTAIN * better.excess.powi(2) || jump < CERTAIN_SD {
            return Some(fit);
        }
        fit = changed;
    }
}

/// Fits the lags between known changes.
fn converged(tracks: &[Vec<Sighting>], rows: &Rows, mut lags: Vec<Lag>) -> Option<(Fit, Solution)> {
    let mut solution = None;
    for _ in 0..ROUNDS {
        let found = solved(&equations(tracks, rows, &lags), rows, &lags)?;
        for (lag, (by_s, sd_s)) in lags.iter_mut().zip(found.by_s.iter().zip(&found.sds_s)) {
            lag.seconds += by_s.clamp(-MAX_STEP_S, MAX_STEP_S);
            lag.sd_s = *sd_s;
        }
        let is_exact = found.by_s.iter().all(|by_s| by_s.abs() < EXACTLY_S);
        solution = Some(found);
        if is_exact {
            break;
        }
    }
    let solution = solution?;
    let is_known = lags.iter().all(|lag| lag.seconds.abs() <= PRIOR_SD_S);
    let fit = Fit {
        best_s: solution.best_s,
        sightings: solution.sightings,
        excess: solution.excess,
        lags,
    };
    is_known.then_some((fit, solution))
}

fn equations(tracks: &[Vec<Sighting>], rows: &Rows, lags: &[Lag]) -> Vec<Equation> {
    let mut all = Vec::new();
    for part in tracks
        .iter()
        .flat_map(|track| with_one_lag(track, lags, |seen| seen.time_s))
    {
        let mut places: Vec<(f64, DVec2)> = part
            .iter()
            .map(|seen| (seen.own_s(), seen.places_px[1]))
            .collect();
        // What was taken off may have changed.
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some(lag) = part.first().and_then(|seen| lag_at(lags, seen.time_s)) else {
            continue;
        };
        let scatter_px = if part.iter().all(|seen| seen.taken_off_s == lag.seconds) {
            DVec2::ZERO
        } else {
            scatter(&places)
        };
        let mut last_s = f64::NEG_INFINITY;
        for seen in part {
            if seen.time_s < last_s + LAG_STEP_S {
                continue;
            }
            last_s = seen.time_s;
            let left_s = lag.seconds - seen.taken_off_s;
            all.extend(equation(seen, (&places, left_s, scatter_px), rows));
        }
    }
    all.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    all
}

fn equation(
    seen: &Sighting,
    (places, left_s, scatter_px): (&[(f64, DVec2)], f64, DVec2),
    rows: &Rows,
) -> Option<Equation> {
    /// Time of a small motion, seconds.
    const STEP_S: f64 = 0.01;
    let moved = moved(places, seen.own_s(), left_s)?;
    let then = seen.later(moved[1].place - moved[0].place);
    let off_px = (rows.off_px)(then.places_px)?;
    let by_px = |by_px: DVec2| Some((rows.off_px)(then.later(by_px).places_px)? - off_px);
    let down = DVec2::new(by_px(DVec2::X)?, by_px(DVec2::Y)?);
    let moved_sd_px = moved_sd_px(&moved, left_s, scatter_px) * down;
    Some(Equation {
        time_s: seen.time_s,
        terms: seen.terms(left_s),
        off_px,
        per_s: by_px(STEP_S * moved[1].per_s)? / STEP_S,
        sd_px: seen.sd_px.hypot(moved_sd_px.length()),
    })
}

/// Solves for changes of the lags by robust least squares.
fn solved(equations: &[Equation], rows: &Rows, lags: &[Lag]) -> Option<Solution> {
    let number = |of: &Equation| lags.iter().filter(|lag| lag.from_s <= of.time_s).count();
    let mut counts = vec![0; lags.len()];
    for of in equations {
        counts[number(of) - 1] += 1;
    }
    if counts.iter().any(|count| *count < MIN_SIGHTINGS) {
        return None;
    }
    let point = |of: &Equation| {
        let mut row = of.terms.to_vec();
        row.resize(TERMS + lags.len(), 0.0);
        // A longer lag leaves less.
        row[TERMS + number(of) - 1] = -of.per_s;
        (row, of.off_px, of.sd_px)
    };
    let points: Vec<_> = equations.iter().map(point).collect();
    let of_terms = [&rows.sd_px[..], &[SIZE_SD_PX_PER_S]].concat();
    let prior = |unknown: usize, _| of_terms.get(unknown).unwrap_or(&PRIOR_SD_S).powi(-2);
    let fit = robust_fit(&points, prior, 1.0, REWEIGHTINGS)?;
    let covariance = fit.covariance()?;
    Some(Solution {
        by_s: fit.unknowns[TERMS..].to_vec(),
        best_s: best_s(equations),
        sightings: equations.len(),
        sds_s: (TERMS..covariance.len())
            .map(|i| fit.deviation * covariance[i][i].sqrt())
            .collect(),
        loss: fit.loss(),
        excess: fit.deviation,
    })
}

/// Mean time, weighted by what each equation tells of the lag.
fn best_s(equations: &[Equation]) -> f64 {
    let weight = |of: &Equation| (of.per_s / of.sd_px).powi(2);
    let of_all: f64 = equations.iter().map(weight).sum();
    let sum_s: f64 = equations.iter().map(|of| weight(of) * of.time_s).sum();
    sum_s / of_all.max(f64::MIN_POSITIVE)
}

/// Lags with one that begins at a time, and its index.
fn split(lags: &[Lag], from_s: f64) -> (usize, Vec<Lag>) {
    let place = lags.partition_point(|lag| lag.from_s <= from_s);
    let mut split = lags.to_vec();
    split.insert(
        place,
        Lag {
            from_s,
            ..lags[place - 1]
        },
    );
    (place, split)
}

/// Time at which another change of the lag explains most.
fn change(equations: &[Equation], rows: &Rows, lags: &[Lag]) -> Option<f64> {
    let loss = |from_s: f64| {
        let (_, changed) = split(lags, from_s);
        Some((solved(equations, rows, &changed)?.loss, from_s))
    };
    let losses = equations.iter().filter_map(|of| loss(of.time_s));
    let best = losses.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels per second across the line in level flight, seconds, and afterwards.
    const LEVEL_PX_S: f64 = 1.8;
    const LEVEL_S: f64 = 90.0;
    const DESCENT_PX_S: f64 = 0.1;

    fn place_px(time_s: f64) -> DVec2 {
        let level_s = time_s.min(LEVEL_S);
        let down_px = LEVEL_PX_S * level_s + DESCENT_PX_S * (time_s - level_s);
        DVec2::new(
            500.0 + 0.9 * time_s + 0.004 * time_s * time_s,
            380.0 + down_px,
        )
    }

    /// A track of an aircraft; the second view shows it late, in a camera that is turned down a little.
    fn track(late_s: impl Fn(f64) -> f64) -> Vec<Sighting> {
        let sighting = |tick: u32| {
            let time_s = f64::from(tick);
            let noise_px = 0.05 * (time_s * 12.9898).sin();
            let second = place_px(time_s - late_s(time_s)) + DVec2::new(70.0, noise_px + 0.04);
            Sighting {
                time_s,
                taken_off_s: 0.0,
                places_px: [place_px(time_s), second],
                width_px: 30.0,
                sd_px: 0.05,
            }
        };
        (0..180).map(sighting).collect()
    }

    fn rows(sd_px: f64) -> Rows<'static> {
        Rows {
            off_px: &|[first, second]| Some(second.y - first.y),
            sd_px: [sd_px; PLACE_TERMS],
        }
    }

    fn assert_near(found: &Lag, expected_s: f64, most_s: f64) {
        let error_s = (found.seconds - expected_s).abs();
        assert!(
            error_s < most_s && error_s < 3.0 * found.sd_s.max(0.003),
            "{expected_s}: {found:?}"
        );
    }

    #[test]
    fn a_lag_of_milliseconds_or_of_seconds_is_told_by_known_rows_and_by_those_of_wrong_cameras() {
        for late_s in [-0.3, 0.0, 0.05, 0.5, 5.0] {
            let tracks = [track(|_| late_s)];
            let known = constant(&tracks, &rows(0.1), 0.0).unwrap();
            assert_near(&known.lags[0], late_s, 0.02);
            assert!(known.lags[0].sd_s < 0.03, "{late_s}: {known:?}");
            let unknown = constant(&tracks, &rows(12.0), 0.0).unwrap();
            assert_near(&unknown.lags[0], late_s, 0.1);
        }
    }

    #[test]
    fn a_lag_that_begins_in_mid_flight_is_told_with_its_time_and_none_is_invented() {
        for late_s in [1.0, -1.0] {
            let tracks = [track(|time_s| if time_s < 50.0 { 0.0 } else { late_s })];
            let fit = changing(&tracks, &rows(0.1)).unwrap();
            let [before, after] = fit.lags[..] else {
                panic!("{fit:?}")
            };
            assert_near(&before, 0.0, 0.03);
            assert_near(&after, late_s, 0.05);
            assert_eq!(after.from_s, 50.0);
        }
        assert_eq!(
            changing(&[track(|_| 0.2)], &rows(0.1)).unwrap().lags.len(),
            1
        );
    }

    #[test]
    fn a_path_that_skips_a_second_is_told_from_one_that_does_not() {
        let path = |late_s: &dyn Fn(f64) -> f64| -> Vec<(f64, DVec2)> {
            let seen = track(late_s).into_iter();
            seen.map(|seen| (seen.time_s, seen.places_px[1])).collect()
        };
        let [skipped, sd_s] = skipped_s(
            &path(&|time_s| if time_s < 50.0 { 0.0 } else { -1.0 }),
            50.0,
        )
        .unwrap();
        assert!(
            (skipped - 1.0).abs() < 0.15 && sd_s < 0.2,
            "{skipped} {sd_s}"
        );
        let [skipped, _] = skipped_s(&path(&|_| 0.0), 50.0).unwrap();
        assert!(skipped.abs() < 0.15, "{skipped}");
    }

    #[test]
    fn sightings_of_something_else_hardly_change_the_lag() {
        let track = track(|_| 0.5);
        let wrong = |seen: &Sighting| seen.later(DVec2::new(0.0, 30.0));
        let others: Vec<Sighting> = track.iter().step_by(7).map(wrong).collect();
        let tracks = [track, others];
        let fit = constant(&tracks, &rows(0.1), 0.0).unwrap();
        assert_near(&fit.lags[0], 0.5, 0.1);
    }

    #[test]
    fn too_few_sightings_tell_nothing() {
        assert_eq!(
            constant(&[track(|_| 0.0)[..4].to_vec()], &rows(0.1), 0.0),
            None
        );
    }
}
