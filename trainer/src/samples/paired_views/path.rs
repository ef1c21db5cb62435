//! The paths of the training in one view: where in the image an aircraft is, and how large it is there.
//!
//! Approaches to one runway look alike in a view. Place and size are nearly linear in the inverse of the distance, so row and width nearly
//! follow from the column. This is no more than a hint, because flights beside the training's paths differ, and it counts for boxes that no
//! other view supports.

use dataset::numbers::spread::{Spread, deviation_from_zero};
use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

use super::robust_line::robust_line;

/// Boxes below which nothing is learned.
const MIN_BOXES: usize = 30;
/// Units of places and widths in the fit, pixels.
const UNIT_PX: f64 = 1_000.0;
const WIDTH_UNIT_PX: f64 = 100.0;
/// Boxes that differ by more standard deviations are not on such a path. The smallest standard deviations are of the logarithm of the
/// width, so that boxes of half and double the width are always on it, ...
const MAX_DEVIATIONS: f64 = 6.0;
const MIN_SD: f64 = 0.12;
/// ... and of the row, pixels: flights at another height, or level before the glide path.
const MIN_ROW_SD_PX: f64 = 25.0;
/// Within seconds, the logarithm of the width that places say may shrink by this, for errors of the boxes, ...
const MIN_APPROACH: f64 = 0.02;
/// ... and the width itself may differ from it by this: boxes of far aircraft err by a pixel of twenty.
const MAX_OTHER_GROWTH: f64 = 0.2;
/// Seconds over which the usual speed is read off places.
const SPEED_S: f64 = 10.0;
/// Ticks that are farther apart tell no usual speed, seconds.
const MAX_S: f64 = 30.0;
/// Slowest and fastest approach, in parts of the training's usual speed: wind, other types, paths beside the training's.
const SPEEDS: [f64; 2] = [0.6, 1.6];
/// Places do not tell the speed if the training's own scatters by more than this part.
const MAX_SPEED_SD: f64 = 0.25;
/// Error of the distance between two places: six standard deviations of two boxes, pixels.
const MOTION_ERROR_PX: f64 = 4.0;

/// Rows and widths of boxes in one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Path {
    /// Index of the view.
    pub(super) view: usize,
    /// Width, pixels: constant, and change per pixel of column and row.
    width: [f64; 3],
    /// Standard deviation of the logarithm of the width.
    width_sd: f64,
    /// Row, pixels: constant, and change per pixel of column.
    row: [f64; 2],
    /// Standard deviation of the row, pixels.
    row_sd_px: f64,
    /// Usual speed: decrease of the inverse of the width that places say, which is proportional to the distance, per second. `None` if
    /// places do not tell it, and in runs of earlier versions.
    #[serde(default)]
    inverse_width_per_s: Option<f64>,
}

/// A box at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sighting {
    pub(super) time_s: f64,
    pub(super) pixel_box: PixelBox,
}

impl Path {
    /// Fits widths and the speed to boxes of aircraft, flight by flight in the order of time, robustly; `None` of too few.
    pub(super) fn fit(view: usize, flights: &[Vec<Sighting>]) -> Option<Self> {
        let boxes = || flights.iter().flatten().map(|seen| &seen.pixel_box);
        if boxes().count() < MIN_BOXES {
            return None;
        }
        let points = boxes().map(|seen| {
            let terms = [1.0, seen.cx_px / UNIT_PX, seen.cy_px / UNIT_PX];
            let width = seen.width_px / WIDTH_UNIT_PX;
            (terms, width, width)
        });
        let ([constant, of_x, of_y], _) = robust_line(&points.collect::<Vec<_>>())?;
        let per_px = WIDTH_UNIT_PX / UNIT_PX;
        let rows = boxes().map(|seen| {
            let terms = [1.0, seen.cx_px / UNIT_PX];
            (terms, seen.cy_px, 1.0)
        });
        let ([row, row_of_x], row_sd_px) = robust_line(&rows.collect::<Vec<_>>())?;
        let mut path = Self {
            view,
            width: [constant * WIDTH_UNIT_PX, of_x * per_px, of_y * per_px],
            width_sd: 1.0,
            row: [row, row_of_x / UNIT_PX],
            row_sd_px: row_sd_px.max(MIN_ROW_SD_PX),
            inverse_width_per_s: None,
        };
        let residuals = boxes().map(|seen| path.residuals(seen)[0]);
        let width_sd = deviation_from_zero(residuals.filter(|residual| residual.is_finite()));
        path.width_sd = width_sd.max(MIN_SD);
        path.inverse_width_per_s = path.usual_speed(flights);
        Some(path)
    }

    fn usual_speed(&self, flights: &[Vec<Sighting>]) -> Option<f64> {
        let inverse = |seen: &Sighting| self.width_px(&seen.pixel_box).recip();
        let speeds = flights.iter().flat_map(|flight| {
            flight.iter().enumerate().filter_map(move |(index, from)| {
                let mut later = flight[index..].iter();
                let to = later.find(|to| to.time_s - from.time_s >= SPEED_S)?;
                let seconds = to.time_s - from.time_s;
                let speed = (inverse(from) - inverse(to)) / seconds;
                (seconds <= MAX_S && speed.is_finite()).then_some(speed)
            })
        });
        let speeds: Vec<f64> = speeds.collect();
        if speeds.len() < MIN_BOXES {
            return None;
        }
        let usual = Spread::of(speeds)?;
        (usual.deviation < MAX_SPEED_SD * usual.median).then_some(usual.median)
    }

    /// Width that the place of a box says, pixels; 0 where no aircraft is.
    fn width_px(&self, seen: &PixelBox) -> f64 {
        let [constant, of_x, of_y] = self.width;
        (constant + of_x * seen.cx_px + of_y * seen.cy_px).max(0.0)
    }

    /// Differences of the logarithm of the width, and of the row, from what the place says, in standard deviations; the first is not finite
    /// where no aircraft is.
    fn residuals(&self, seen: &PixelBox) -> [f64; 2] {
        let width = (seen.width_px / self.width_px(seen)).ln() / self.width_sd;
        let [constant, of_x] = self.row;
        let row = (seen.cy_px - constant - of_x * seen.cx_px) / self.row_sd_px;
        [width, row]
    }

    /// True if an aircraft on such a path may have this box.
    pub(super) fn holds(&self, seen: &PixelBox) -> bool {
        // Not a number is not within.
        let is_within = |residual: f64| residual.abs() <= MAX_DEVIATIONS;
        self.residuals(seen).into_iter().all(is_within)
    }

    /// True if an aircraft on such a path may have had the first of two boxes, and some seconds later the second: it approaches, and grows
    /// as its place says.
    pub(super) fn leads(&self, boxes: [&PixelBox; 2]) -> bool {
        let [from, to] = boxes.map(|seen| self.width_px(seen));
        let [first, second] = boxes.map(|seen| seen.width_px);
        let [expected, grown] = [to / from, second / first].map(f64::ln);
        expected >= -MIN_APPROACH && (grown - expected).abs() <= MAX_OTHER_GROWTH
    }

    /// True if an aircraft that approaches at about the speed of the training may have been seen like this, some seconds apart.
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

    /// All of its numbers.
    pub(super) fn constants(&self) -> impl Iterator<Item = f64> {
        let widths = self.width.into_iter().chain([self.width_sd]);
        let rows = self.row.into_iter().chain([self.row_sd_px]);
        widths.chain(rows).chain(self.inverse_width_per_s)
    }

    /// True if its standard deviations and its speed are positive.
    pub(super) fn is_possible(&self) -> bool {
        let is_approach = self.inverse_width_per_s.is_none_or(|speed| speed > 0.0);
        self.width_sd > 0.0 && self.row_sd_px > 0.0 && is_approach
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box on the path of the training, where an aircraft is this wide.
    fn on_path(width_px: f64) -> PixelBox {
        PixelBox {
            cx_px: 1_900.0 - 8.0 * width_px,
            cy_px: 430.0 + 2.0 * width_px,
            width_px,
            height_px: 0.35 * width_px,
        }
    }

    /// On the path, at a time after the aircraft was 20 pixels wide; the inverse of the width decreases by 1/5000 a second.
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
