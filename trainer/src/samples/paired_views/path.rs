//! Training paths in one view: position and size of the aircraft in the image.
//!
//! Approaches to one runway look alike in a view. Position and size are nearly linear in the inverse distance, so row and width nearly
//! follow from the column. This is only a hint, because flights beside the training's paths differ; it applies to boxes without support
//! from a second view.

use dataset::numbers::spread::{Spread, deviation_from_zero};
use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};
use sight::lag::UNIT_PX;

use super::sighting::{MAX_DEVIATIONS, MAX_GAP_S, MIN_SIZE_SD, RECENT_S, STILL_GROWTH, Sighting};
use crate::samples::robust_line::{FINE_UNIT_PX, robust_line};

/// Minimum number of boxes.
const MIN_BOXES: usize = 30;
/// Minimum standard deviation of the row, px: flights at a different height, or level before the glide path.
const MIN_ROW_SD_PX: f64 = 25.0;
/// Maximum difference between the logarithms of measured and expected growth: boxes of far aircraft err by one pixel in twenty.
const MAX_OTHER_GROWTH: f64 = 0.2;
/// Slowest and fastest approach relative to the training's usual speed: wind, other types, other paths.
const SPEEDS: [f64; 2] = [0.6, 1.6];
/// Maximum scatter of training speeds for a usual speed, relative to it.
const MAX_SPEED_SD: f64 = 0.25;
/// Position error between two boxes, six standard deviations, pixels.
const MOTION_ERROR_PX: f64 = 4.0;

/// Rows, widths and speed in one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Path {
    pub(super) view: usize,
    /// Width, pixels: constant, and change per pixel in column and row.
    width: [f64; 3],
    /// Standard deviation of the logarithm of the width.
    width_sd: f64,
    /// Row, pixels: constant, and change per pixel in column.
    row: [f64; 2],
    row_sd_px: f64,
    /// Usual speed: decrease of the inverse expected width, which is proportional to the distance, per second. `None` if the training's
    /// speeds scatter.
    inverse_width_per_s: Option<f64>,
}

impl Path {
    /// Robust fit to boxes of aircraft, flight by flight in temporal order; `None` with too few.
    pub(super) fn fit(view: usize, flights: &[Vec<Sighting>]) -> Option<Self> {
        let boxes = || flights.iter().flatten().map(|seen| &seen.pixel_box);
        if boxes().count() < MIN_BOXES {
            return None;
        }
        let points = boxes().map(|seen| {
            let terms = [1.0, seen.cx_px / UNIT_PX, seen.cy_px / UNIT_PX];
            let width = seen.width_px / FINE_UNIT_PX;
            (terms, width, width)
        });
        let ([constant, of_x, of_y], _) = robust_line(&points.collect::<Vec<_>>())?;
        let per_px = FINE_UNIT_PX / UNIT_PX;
        let rows = boxes().map(|seen| {
            let terms = [1.0, seen.cx_px / UNIT_PX];
            (terms, seen.cy_px, 1.0)
        });
        let ([row, row_of_x], row_sd_px) = robust_line(&rows.collect::<Vec<_>>())?;
        let mut path = Self {
            view,
            width: [constant * FINE_UNIT_PX, of_x * per_px, of_y * per_px],
            width_sd: 1.0,
            row: [row, row_of_x / UNIT_PX],
            row_sd_px: row_sd_px.max(MIN_ROW_SD_PX),
            inverse_width_per_s: None,
        };
        let residuals = boxes().map(|seen| path.residuals(seen)[0]);
        let width_sd = deviation_from_zero(residuals.filter(|residual| residual.is_finite()));
        path.width_sd = width_sd.max(MIN_SIZE_SD);
        path.inverse_width_per_s = path.usual_speed(flights);
        Some(path)
    }

    fn usual_speed(&self, flights: &[Vec<Sighting>]) -> Option<f64> {
        let inverse = |seen: &Sighting| self.width_px(&seen.pixel_box).recip();
        let speeds = flights.iter().flat_map(|flight| {
            flight.iter().enumerate().filter_map(move |(index, from)| {
                let mut later = flight[index..].iter();
                let to = later.find(|to| to.time_s - from.time_s >= RECENT_S)?;
                let seconds = to.time_s - from.time_s;
                let speed = (inverse(from) - inverse(to)) / seconds;
                (seconds <= MAX_GAP_S && speed.is_finite()).then_some(speed)
            })
        });
        let speeds: Vec<f64> = speeds.collect();
        if speeds.len() < MIN_BOXES {
            return None;
        }
        let usual = Spread::of(speeds)?;
        (usual.deviation < MAX_SPEED_SD * usual.median).then_some(usual.median)
    }

    /// Expected width at a box's position, pixels; 0 where no aircraft is.
    fn width_px(&self, seen: &PixelBox) -> f64 {
        let [constant, of_x, of_y] = self.width;
        (constant + of_x * seen.cx_px + of_y * seen.cy_px).max(0.0)
    }

    /// Residuals of the logarithm of the width and of the row, in standard deviations; the first is not finite where no aircraft is.
    fn residuals(&self, seen: &PixelBox) -> [f64; 2] {
        let width = (seen.width_px / self.width_px(seen)).ln() / self.width_sd;
        let [constant, of_x] = self.row;
        let row = (seen.cy_px - constant - of_x * seen.cx_px) / self.row_sd_px;
        [width, row]
    }

    /// True if an aircraft on the paths may have this box.
    pub(super) fn holds(&self, seen: &PixelBox) -> bool {
        // NaN fails this test.
        let is_within = |residual: f64| residual.abs() <= MAX_DEVIATIONS;
        self.residuals(seen).into_iter().all(is_within)
    }

    /// True if an aircraft on the paths may have had these two boxes some seconds apart: it approaches, and grows as expected.
    pub(super) fn leads(&self, boxes: [&PixelBox; 2]) -> bool {
        let [from, to] = boxes.map(|seen| self.width_px(seen));
        let [first, second] = boxes.map(|seen| seen.width_px);
        let [expected, grown] = [to / from, second / first].map(f64::ln);
        expected >= -STILL_GROWTH && (grown - expected).abs() <= MAX_OTHER_GROWTH
    }

    /// True if the motion between two sightings matches the usual speed.
    pub(super) fn is_as_fast(&self, [first, last]: [&Sighting; 2]) -> bool {
        let Some(usual) = self.inverse_width_per_s else {
            return true;
        };
        let [from_px, to_px] = [first, last].map(|seen| self.width_px(&seen.pixel_box));
        let seconds = last.time_s - first.time_s;
        let expected_px = |speed: f64| {
            let inverse = from_px.recip() - speed * usual * seconds;
            if inverse > 0.0 {
                inverse.recip()
            } else {
                f64::INFINITY
            }
        };
        let [slowest_px, fastest_px] = SPEEDS.map(expected_px);
        let [_, of_x, of_y] = self.width;
        let error_px = MOTION_ERROR_PX * of_x.hypot(of_y);
        (slowest_px - error_px..=fastest_px + error_px).contains(&to_px)
    }

    /// True for positive standard deviations and speed.
    pub(super) fn is_possible(&self) -> bool {
        let is_approach = self.inverse_width_per_s.is_none_or(|speed| speed > 0.0);
        self.width_sd > 0.0 && self.row_sd_px > 0.0 && is_approach
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box on the training's path with this width.
    fn on_path(width_px: f64) -> PixelBox {
        PixelBox {
            cx_px: 1_900.0 - 8.0 * width_px,
            cy_px: 430.0 + 2.0 * width_px,
            width_px,
            height_px: 0.35 * width_px,
        }
    }

    /// On the path, timed from a width of 20 pixels; the inverse width decreases by 1/5000 per second.
    fn at(time_s: f64) -> Sighting {
        let pixel_box = on_path((1.0 / 20.0 - time_s / 5_000.0).recip());
        Sighting { time_s, pixel_box }
    }

    fn path() -> Path {
        let flight = (0..208).map(|second| at(f64::from(second))).collect();
        Path::fit(0, &[flight]).unwrap()
    }

    #[test]
    fn a_box_of_another_size_or_in_another_row_is_not_on_the_path() {
        let path = path();
        let usual = on_path(60.0);
        assert!(path.holds(&usual));
        let small = PixelBox {
            width_px: 25.0,
            ..usual
        };
        let low = PixelBox {
            cy_px: usual.cy_px + 200.0,
            ..usual
        };
        assert!(!path.holds(&small) && !path.holds(&low));
    }

    #[test]
    fn an_aircraft_comes_along_the_path_and_grows_with_it() {
        let path = path();
        let [far, near] = [40.0, 60.0].map(on_path);
        assert!(path.leads([&far, &near]));
        assert!(!path.leads([&near, &far]), "it goes away");
        let as_small = PixelBox {
            width_px: far.width_px,
            ..near
        };
        assert!(!path.leads([&far, &as_small]), "it does not grow");
        assert!(path.leads([&far, &far]), "too short a time to tell");
    }

    #[test]
    fn an_aircraft_moves_along_the_path_about_as_fast_as_those_of_the_training() {
        let path = path();
        for from_s in [0.0, 60.0, 150.0] {
            let as_fast = |to_s: f64, as_if_s: f64| {
                let last = Sighting {
                    time_s: from_s + to_s,
                    ..at(from_s + as_if_s)
                };
                path.is_as_fast([&at(from_s), &last])
            };
            assert!(as_fast(10.0, 10.0) && as_fast(40.0, 50.0) && as_fast(40.0, 30.0));
            assert!(!as_fast(40.0, 0.0), "it stands still");
            assert!(!as_fast(10.0, -30.0), "it goes away");
            assert!(!as_fast(10.0, 40.0), "nothing is so fast");
        }
        let flights: Vec<_> = (0..40).map(|start| vec![at(f64::from(start))]).collect();
        let untold = Path::fit(0, &flights).unwrap();
        assert_eq!(untold.inverse_width_per_s, None);
        assert!(untold.is_as_fast([&at(0.0), &at(0.0)]));
    }
}
