//! Lags of images behind the tables, and between two views, in seconds.
//!
//! The aircraft's outline is centred in its box, but for its motion in the image during the lag: `offset = -lag * motion`. The lag is
//! fitted by least squares, where outliers have the weight of Huber (1964, Annals of Mathematical Statistics 35, 73). An outline that is
//! larger or smaller than the box has its own error: half of the difference if only one side causes it.
//!
//! The standard error must hold for offsets that err alike: light, attitude and the clouds behind the aircraft change slowly, so residuals
//! near in time have the same sign. They are summed over blocks of time before they are squared (Liang and Zeger 1986, Biometrika 73, 13).
//! Two views see the same aircraft in the same blocks, so common errors cancel in their difference. A fin that is too thin to be seen is
//! missing from every outline, on the same side: half of the difference in size of all outlines, with the same sign, is the bound of this
//! part of the error. A lag within it proves no fault.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Scenario;
use super::outline::ERROR_PX;
use crate::faults::Faults;

/// Error of the outline's middle besides [`ERROR_PX`]: a part of the size ...
const ERROR_OF_SIZE: f64 = 0.005;
/// ... and a part of the difference in size.
const ERROR_OF_EXCESS: f64 = 0.5;
/// An outline is whole if it is smaller than the box by at most this part and this many pixels ...
const MAX_OF_SIZE: f64 = 0.08;
const MAX_SMALLER_PX: f64 = 1.5;
/// ... or larger by the same part and this many pixels: blur, encoding and lamps widen it.
const MAX_LARGER_PX: f64 = 4.0;
const ROUNDS: usize = 30;
/// Minimum number of offsets for a lag.
const MIN_OFFSETS: usize = 6;
/// Offsets that are further apart have independent errors, seconds.
const BLOCK_S: f64 = 30.0;
/// A lag is a fault if it exceeds its bound by this many times its standard error. Of normally distributed lags 6 in 10 million are that
/// large: of 3,000 corpora with 200 scenarios of two views, which are 600 comparisons, one gets a false fault ...
const MIN_STANDARD_ERRORS: f64 = 5.0;
/// ... and if the aircraft flies further in this time, metres: six times the standard deviation of untouched views (0.3 m), whose
/// systematic part no standard error holds.
const MIN_WAY_M: f64 = 2.0;

/// The lag between two views.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairProof {
    /// Identifier of the scenario.
    pub scenario: String,
    /// Identifiers of the views.
    pub views: [String; 2],
    /// Lag of the first view's images behind the second view's, milliseconds.
    pub lag_ms: f64,
    /// Standard error of the lag, milliseconds.
    pub lag_error_ms: f64,
}

/// A view whose lag was measured.
pub(crate) struct MeasuredView<'a> {
    pub(super) view: &'a str,
    /// Video of the view.
    pub(super) file: String,
    pub(super) lag: Lag,
}

/// Judges the lag of each view, and of every two views that have no fault of their own.
pub(crate) fn judge_lags(
    scenario: &Scenario,
    views: &[MeasuredView<'_>],
    faults: &mut Faults,
) -> Vec<PairProof> {
    let period_s = scenario.record.frame_rate.period_s();
    let mut is_late = Vec::new();
    for measured in views {
        let fault = measured.lag.fault(period_s);
        is_late.push(fault.is_some());
        if let Some(message) = fault {
            faults.view(&measured.file, measured.view, message);
        }
    }
    let mut proofs = Vec::new();
    for (index, one) in views.iter().enumerate() {
        for (other_index, other) in views.iter().enumerate().skip(index + 1) {
            let difference = one.lag.behind(&other.lag);
            proofs.push(PairProof {
                scenario: scenario.record.id.clone(),
                views: [one.view.to_owned(), other.view.to_owned()],
                lag_ms: difference.lag_s * 1e3,
                lag_error_ms: difference.error_s() * 1e3,
            });
            if let Some(message) = difference.fault_beside(other.view)
                && !is_late[index]
                && !is_late[other_index]
            {
                faults.view(&one.file, one.view, message);
            }
        }
    }
    proofs
}

/// An outline's offset along one axis of the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Offset {
    /// Time of the image since the first one, seconds.
    pub(super) time_s: f64,
    /// Middle of the outline relative to the centre of the box, pixels.
    pub(super) offset_px: f64,
    /// Motion of the box, pixels per second.
    pub(super) motion_px_s: f64,
    /// Size of the box, pixels.
    pub(super) size_px: f64,
    /// Size of the outline, pixels.
    pub(super) outline_px: f64,
    /// Speed of the aircraft over ground, metres per second.
    pub(super) speed_mps: f64,
}

impl Offset {
    fn is_of_whole_outline(&self) -> bool {
        let larger_px = self.outline_px - self.size_px;
        let part_px = MAX_OF_SIZE * self.size_px;
        (-(part_px + MAX_SMALLER_PX)..=part_px + MAX_LARGER_PX).contains(&larger_px)
    }

    /// Offset that a lag does not explain, pixels.
    fn residual_px(&self, lag_s: f64) -> f64 {
        self.offset_px + lag_s * self.motion_px_s
    }

    fn error_of_excess_px(&self) -> f64 {
        ERROR_OF_EXCESS * (self.outline_px - self.size_px).abs()
    }

    fn error_px(&self) -> f64 {
        let of_size_px = ERROR_OF_SIZE * self.size_px;
        ERROR_PX.hypot(of_size_px).hypot(self.error_of_excess_px())
    }
}

/// The lag of a view behind the tables, or behind a second view.
#[derive(Debug, Clone)]
pub(super) struct Lag {
    /// Lag of the images, seconds.
    pub(super) lag_s: f64,
    /// Standard error of the lag, as far as it changes from block to block, seconds.
    scatter_s: f64,
    /// Bound of the error that all outlines have in common, seconds.
    bound_s: f64,
    /// Offsets beyond the one that the lag needs.
    freedom: f64,
    /// Mean speed of the aircraft, metres per second.
    speed_mps: f64,
    /// Ticks that were measured.
    ticks: usize,
    /// Standard error if the errors of all offsets are independent and of the expected size, seconds.
    least_scatter_s: f64,
    /// Error of the lag that comes from each block of time, seconds.
    blocks: BTreeMap<u64, f64>,
}

impl Lag {
    /// Fits the lag to the offsets of whole outlines; `None` if there are too few, or none moves.
    pub(super) fn of(offsets: &[Offset]) -> Option<Self> {
        let offsets: Vec<Offset> = (offsets.iter().copied())
            .filter(Offset::is_of_whole_outline)
            .collect();
        let count = offsets.len() as f64;
        let mut weights: Vec<f64> = (offsets.iter())
            .map(|offset| offset.error_px().powi(-2))
            .collect();
        let (mut lag_s, mut information): (f64, f64) = (0.0, 0.0);
        for _ in 0..ROUNDS {
            let weighted = || offsets.iter().zip(&weights);
            information = weighted()
                .map(|(offset, weight)| weight * offset.motion_px_s.powi(2))
                .sum();
            let moment: f64 = weighted()
                .map(|(offset, weight)| weight * offset.motion_px_s * offset.offset_px)
                .sum();
            if offsets.len() < MIN_OFFSETS || information <= 0.0 {
                return None;
            }
            lag_s = -moment / information;
            for (offset, weight) in offsets.iter().zip(&mut weights) {
                let error_px = offset.error_px();
                let residual = offset.residual_px(lag_s).abs() / error_px;
                // Residuals of more than a standard error have less weight.
                *weight = 1.0 / (residual.max(1.0) * error_px.powi(2));
            }
        }
        let mut blocks: BTreeMap<u64, f64> = BTreeMap::new();
        let (mut misfit, mut bound_s): (f64, f64) = (0.0, 0.0);
        for (offset, weight) in offsets.iter().zip(&weights) {
            let residual_px = offset.residual_px(lag_s);
            misfit += weight * residual_px.powi(2);
            let block = (offset.time_s / BLOCK_S) as u64;
            let lag_per_px = weight * offset.motion_px_s / information;
            *blocks.entry(block).or_insert(0.0) -= lag_per_px * residual_px;
            bound_s += lag_per_px.abs() * offset.error_of_excess_px();
        }
        let least_scatter_s = information.powf(-0.5);
        // If the offsets scatter more than expected, so does the lag.
        let independent_s = least_scatter_s * (misfit / (count - 1.0)).max(1.0).sqrt();
        let mut times: Vec<f64> = offsets.iter().map(|offset| offset.time_s).collect();
        times.dedup();
        Some(Self {
            lag_s,
            scatter_s: independent_s.max(error_of(blocks.values().copied())),
            bound_s,
            freedom: count - 1.0,
            speed_mps: offsets.iter().map(|offset| offset.speed_mps).sum::<f64>() / count,
            ticks: times.len(),
            least_scatter_s,
            blocks,
        })
    }

    /// The lag of this view behind a second one.
    pub(super) fn behind(&self, other: &Self) -> Self {
        let mut blocks = self.blocks.clone();
        for (block, error_s) in &other.blocks {
            *blocks.entry(*block).or_insert(0.0) -= error_s;
        }
        let least_s = self.least_scatter_s.hypot(other.least_scatter_s);
        Self {
            lag_s: self.lag_s - other.lag_s,
            scatter_s: error_of(blocks.values().copied()).max(least_s),
            bound_s: self.bound_s + other.bound_s,
            freedom: self.freedom.min(other.freedom),
            speed_mps: (self.speed_mps + other.speed_mps) / 2.0,
            ticks: self.ticks.min(other.ticks),
            least_scatter_s: least_s,
            blocks,
        }
    }

    /// Standard error of the lag, seconds.
    pub(super) fn error_s(&self) -> f64 {
        // Any common error within the bound is equally likely.
        self.scatter_s.hypot(self.bound_s / 3_f64.sqrt())
    }

    /// Way of the aircraft during the lag, metres.
    fn way_m(&self) -> f64 {
        self.lag_s * self.speed_mps
    }

    /// True if the lag is certain, and the aircraft goes far during it.
    fn is_fault(&self) -> bool {
        let least_s = self.bound_s + sure(self.freedom) * self.scatter_s;
        self.lag_s.abs() >= least_s && self.way_m().abs() >= MIN_WAY_M
    }

    /// The sentence about a view's lag that is a fault.
    pub(super) fn fault(&self, period_s: f64) -> Option<String> {
        let (lag_s, error_s, ticks) = (self.lag_s, self.error_s(), self.ticks);
        self.is_fault().then(|| {
            format!(
                "shows the aircraft {}, {:.1} m {} along its track ({:.0} standard errors, measured in {ticks} ticks of {:.0} ms); expected \
                 0 ms, at most {MIN_WAY_M} m: look at the clock and the delay of this camera, and for lost images",
                in_words(lag_s, error_s),
                self.way_m().abs(),
                if lag_s > 0.0 { "back" } else { "ahead" },
                (lag_s / error_s).abs(),
                period_s * 1e3,
            )
        })
    }

    /// The sentence about a lag behind another view that is a fault.
    pub(super) fn fault_beside(&self, other: &str) -> Option<String> {
        let (lag_s, error_s) = (self.lag_s, self.error_s());
        self.is_fault().then(|| {
            format!(
                "shows the aircraft {} of view {other}, {:.1} m along its track ({:.0} standard errors); expected 0 ms, at most \
                 {MIN_WAY_M} m: look at the clocks and delays of both cameras",
                in_words(lag_s, error_s),
                self.way_m().abs(),
                (lag_s / error_s).abs(),
            )
        })
    }
}

/// The quantile of Student's t that is as rare as [`MIN_STANDARD_ERRORS`] of the normal distribution (Abramowitz and Stegun 1964, 26.7.5).
fn sure(freedom: f64) -> f64 {
    let cubic = MIN_STANDARD_ERRORS.powi(3) + MIN_STANDARD_ERRORS;
    let quintic = 5.0 * MIN_STANDARD_ERRORS.powi(5)
        + 16.0 * MIN_STANDARD_ERRORS.powi(3)
        + 3.0 * MIN_STANDARD_ERRORS;
    MIN_STANDARD_ERRORS + cubic / (4.0 * freedom) + quintic / (96.0 * freedom.powi(2))
}

fn in_words(lag_s: f64, error_s: f64) -> String {
    let late = if lag_s > 0.0 { "late" } else { "early" };
    format!(
        "{:.0} ms {late} (+-{:.0})",
        lag_s.abs() * 1e3,
        error_s * 1e3
    )
}

/// Standard error of the contributions' sum.
fn error_of(contributions: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = contributions.len() as f64;
    let squares: f64 = contributions.map(|error| error * error).sum();
    (squares * count / (count - 1.0).max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 2.0;

    /// An approaching aircraft that crosses the image ever faster, as a view sees it that is late.
    fn approach(late_s: f64) -> Vec<Offset> {
        let ticks = (0..40).map(|tick| (tick, 12_000.0 - 140.0 * f64::from(tick)));
        ticks
            .flat_map(|(tick, range_m)| {
                let jitter_px = 0.1 * (f64::from(tick * 7 % 5) - 2.0);
                [(36.0, 3e8), (12.0, -1e8)].map(|(size_m, motion)| {
                    let motion_px_s = motion / (range_m * range_m);
                    let size_px = size_m * 11_000.0 / range_m;
                    Offset {
                        time_s: PERIOD_S * f64::from(tick),
                        offset_px: jitter_px - late_s * motion_px_s,
                        motion_px_s,
                        size_px,
                        outline_px: size_px + 0.3,
                        speed_mps: 70.0,
                    }
                })
            })
            .collect()
    }

    fn lag(late_s: f64) -> Lag {
        Lag::of(&approach(late_s)).unwrap()
    }

    #[test]
    fn a_view_in_step_has_no_fault() {
        let lag = lag(0.0);
        assert!(lag.lag_s.abs() < 2.0 * lag.error_s(), "{lag:?}");
        assert_eq!(lag.fault(PERIOD_S), None);
    }

    #[test]
    fn a_tenth_of_a_tick_is_a_fault_with_its_size_and_what_to_look_at() {
        let late = lag(0.2);
        assert!((late.lag_s - 0.2).abs() < 2.0 * late.error_s(), "{late:?}");
        let message = late.fault(PERIOD_S).unwrap();
        let words = [
            "ms late (+-",
            "m back along its track",
            "40 ticks of 2000 ms",
            "expected",
            "look at",
        ];
        for words in words {
            assert!(message.contains(words), "{message}");
        }
        let early = lag(-0.2).fault(PERIOD_S).unwrap();
        assert!(
            early.contains("ms early") && early.contains("m ahead"),
            "{early}"
        );
    }

    #[test]
    fn a_lag_within_its_error_or_within_two_metres_is_no_fault() {
        let mut uncertain = lag(0.2);
        uncertain.scatter_s = 0.05;
        assert_eq!(uncertain.fault(PERIOD_S), None);
        let mut short = lag(0.0);
        (short.lag_s, short.scatter_s) = (0.9 * MIN_WAY_M / short.speed_mps, 1e-4);
        short.bound_s = 0.0;
        assert_eq!(short.fault(PERIOD_S), None);
    }

    #[test]
    fn a_fin_that_is_missing_from_every_outline_is_no_lag() {
        let mut offsets = approach(0.0);
        for offset in offsets.iter_mut().skip(1).step_by(2) {
            offset.outline_px = offset.size_px - 1.2;
            offset.offset_px = 0.6;
        }
        let lag = Lag::of(&offsets).unwrap();
        assert_eq!(lag.fault(PERIOD_S), None, "{lag:?}");
        assert!(lag.lag_s.abs() <= lag.bound_s, "{lag:?}");
    }

    #[test]
    fn an_outline_that_lacks_a_wing_says_nothing_about_time() {
        let mut offsets = approach(0.0);
        for offset in offsets.iter_mut().step_by(2) {
            offset.outline_px = 0.6 * offset.size_px;
            offset.offset_px = 0.2 * offset.size_px;
        }
        let lag = Lag::of(&offsets).unwrap();
        assert!(lag.lag_s.abs() < 2.0 * lag.error_s(), "{lag:?}");
        assert!(Lag::of(&offsets[..10]).is_none());
    }

    #[test]
    fn errors_that_last_count_more_than_those_that_change_with_each_tick() {
        let with_errors = |sign: fn(usize) -> f64| {
            let mut offsets = approach(0.0);
            for (index, offset) in offsets.iter_mut().enumerate() {
                offset.offset_px += sign(index / 2);
            }
            Lag::of(&offsets).unwrap().scatter_s
        };
        let alternating = with_errors(|tick| if tick % 2 == 0 { 1.0 } else { -1.0 });
        let lasting = with_errors(|tick| if tick / 15 % 2 == 0 { 1.0 } else { -1.0 });
        assert!(lasting > 1.3 * alternating, "{lasting} {alternating}");
    }

    #[test]
    fn few_offsets_have_to_be_surer() {
        assert!((sure(10.0) - 10.1).abs() < 0.1, "{}", sure(10.0));
        assert!((sure(1e6) - MIN_STANDARD_ERRORS).abs() < 1e-3);
    }

    #[test]
    fn what_two_views_have_in_common_is_no_lag_between_them() {
        let (left, right) = (lag(0.15), lag(0.15));
        let same = right.behind(&left);
        assert!(same.lag_s.abs() < 1e-9);
        assert_eq!(same.fault_beside("left"), None);
        let message = lag(0.4).behind(&left).fault_beside("left").unwrap();
        assert!(message.contains("250 ms late (+-"), "{message}");
        assert!(message.contains("of view left"), "{message}");
    }
}
