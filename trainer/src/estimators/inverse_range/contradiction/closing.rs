//! Growth of the boxes beside the measured distance.
//!
//! An aircraft whose boxes grow comes nearer, so its distance shrinks, unless it flies across and shows its wings instead of its side.

use std::collections::VecDeque;

use glam::DVec2;
use sight::sight::CONTRADICTS_SD;

use super::WINDOW_S;
use super::history::{MIN_TICKS, Residual, remember};
use crate::samples::paired_views::STILL_GROWTH;

/// Minimum speed of an arrival, m/s: a light aircraft against the wind.
pub(crate) const MIN_CLOSING_MPS: f64 = 25.0;
/// Width of the aircraft, m: the wing span of a Cessna 172, whose fuselage is shorter, so that speeds across are overestimated.
const WIDTH_M: f64 = 11.0;

/// A measured distance next to the boxes.
#[derive(Debug, Clone, Copy)]
pub(super) struct SizedTick {
    pub(super) time_s: f64,
    pub(super) distance_m: f64,
    pub(super) variance_m2: f64,
    /// Logarithms of the distance from the cameras, and of the width of the boxes in their mean.
    pub(super) log_range: f64,
    pub(super) log_width: f64,
    /// Place in one of the views, pixels.
    pub(super) place_px: DVec2,
}

/// Recent distances and sizes by one fit's views.
#[derive(Debug, Clone, Default)]
pub(super) struct Closing {
    views: Vec<usize>,
    recent: VecDeque<SizedTick>,
}

impl Closing {
    /// Takes the best measurement of the next tick. Returns the residual; `None` without a verdict.
    pub(super) fn next(&mut self, views: &[usize], next: SizedTick) -> Option<Residual> {
        if self.views != views {
            *self = Self {
                views: views.to_vec(),
                recent: VecDeque::new(),
            };
        }
        remember(&mut self.recent, next, |of| of.time_s, WINDOW_S);
        let since_s = self.recent[0].time_s;
        if next.time_s - since_s < WINDOW_S || self.recent.len() < MIN_TICKS {
            return None;
        }
        let [from, to] = self.halves();
        let seconds = to.time_s - from.time_s;
        let (grown, explained) = (to.log_width - from.log_width, from.log_range - to.log_range);
        let width_px = ((from.log_width + to.log_width) / 2.0).exp();
        let across_m = WIDTH_M * (to.place_px - from.place_px).length() / width_px;
        let speed_mps = (from.distance_m - to.distance_m + across_m) / seconds;
        let sd_mps = (from.variance_m2 + to.variance_m2).sqrt() / seconds;
        let deviations = (MIN_CLOSING_MPS - speed_mps) / sd_mps;
        let is_open = deviations.abs() <= CONTRADICTS_SD;
        let grows = grown - explained > STILL_GROWTH;
        (!is_open && (deviations < 0.0 || grows)).then_some(Residual {
            time_s: since_s,
            deviations,
        })
    }

    /// Means over both halves of the window.
    fn halves(&self) -> [SizedTick; 2] {
        let middle = self.recent.len() / 2;
        [(0, middle), (middle, self.recent.len())].map(|(from, to)| {
            let mean = |of: fn(&SizedTick) -> f64| {
                self.recent.range(from..to).map(of).sum::<f64>() / (to - from) as f64
            };
            SizedTick {
                time_s: mean(|of| of.time_s),
                distance_m: mean(|of| of.distance_m),
                variance_m2: mean(|of| of.variance_m2),
                log_range: mean(|of| of.log_range),
                log_width: mean(|of| of.log_width),
                place_px: DVec2::new(mean(|of| of.place_px.x), mean(|of| of.place_px.y)),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residual for an aircraft at 5 km that flies across at this speed and turns towards the cameras, from its side to its wings.
    fn turning(across_mps: f64) -> Option<Residual> {
        const FOCAL_PX: f64 = 11_000.0;
        let mut closing = Closing::default();
        let ticks = (0..=10).map(f64::from).map(|tick| {
            let (time_s, width_m) = (2.0 * tick, 8.3 + 0.27 * tick);
            SizedTick {
                time_s,
                distance_m: 5_000.0,
                variance_m2: 100.0,
                log_range: 6_000_f64.ln(),
                log_width: (FOCAL_PX * width_m / 6_000.0).ln(),
                place_px: DVec2::new(FOCAL_PX * across_mps * time_s / 6_000.0, 500.0),
            }
        });
        ticks.fold(None, |_, next| closing.next(&[0, 1], next))
    }

    #[test]
    fn an_aircraft_that_grows_without_coming_nearer_contradicts_itself_unless_it_flies_across() {
        let kept = turning(0.0).unwrap();
        assert!(kept.deviations > CONTRADICTS_SD, "{kept:?}");
        let on_base_leg = turning(50.0);
        assert!(
            on_base_leg.is_none_or(|kept| kept.deviations < 0.0),
            "{on_base_leg:?}"
        );
    }
}
