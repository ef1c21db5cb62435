//! Accuracy of the boxes and of the disparity between two views, by distance.
//!
//! Errors are found minus true, pixels, of the best box of each aircraft in sight. Distance comes from the disparity, the horizontal shift
//! between two views: once from the centres of two boxes, once from registration. Its ground truth is a point of the aircraft that both
//! views see, projected into both: from ahead, the visible part is in front of the centre of gravity.

use std::collections::BTreeMap;

use dataset::corpus::open_scenario::OpenScenario;
use dataset::numbers::spread::Spread;
use dataset::tables::registrations::Registration;
use glam::{DVec2, DVec3};
use serde::Serialize;

use crate::error::{Error, Result};
use crate::outcome::{Outcome, Searched};
use dataset::conditions::sight::Sight;

/// Distance from the centre of gravity to the visible part's centre: removes most bias in the bundled simulator's images, at all distances.
const VISIBLE_AHEAD_M: f64 = 3.3;
/// Upper ends of the bins of true width, pixels; the last bin is open.
const WIDTH_BINS_PX: [f64; 5] = [20.0, 30.0, 50.0, 90.0, f64::INFINITY];

/// Errors of boxes, found minus true.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BoxSpreads {
    /// Centre, right.
    pub cx_px: Option<Spread>,
    /// Centre, down.
    pub cy_px: Option<Spread>,
    /// Width.
    pub width_px: Option<Spread>,
    /// Height.
    pub height_px: Option<Spread>,
}

/// Errors in a bin of distances, or over all from 1 to 10 NM.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BoxErrors {
    /// Smallest distance to touchdown, nautical miles, included.
    pub from_nm: f64,
    /// Largest distance, excluded.
    pub to_nm: f64,
    /// Number of boxes.
    pub boxes: u64,
    /// Errors of the boxes.
    #[serde(flatten)]
    pub errors: BoxSpreads,
}

/// Errors of the disparity in a bin of distances, or over all from 1 to 10 NM.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DisparityErrors {
    /// Smallest distance to touchdown, nautical miles, included.
    pub from_nm: f64,
    /// Largest distance, excluded.
    pub to_nm: f64,
    /// Ticks with detections in both views.
    pub pairs: u64,
    /// Pairs with a registered shift.
    pub registered: u64,
    /// The others, by reason.
    pub unregistered: BTreeMap<String, u64>,
    /// Errors between box centres.
    pub boxes_px: Option<Spread>,
    /// Registered.
    pub registered_px: Option<Spread>,
    /// Robust standard deviations of both, in order, where each mile has its own bias.
    pub deviation_about_bias_px: [Option<f64>; 2],
    /// Registered, over the stated standard deviation: a deviation of 1 if that is honest.
    pub registered_over_stated: Option<Spread>,
}

/// Aircraft of similar width, in sight and before touchdown.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WidthFigures {
    /// Largest width of the ground-truth box, pixels; null in the last bin.
    pub width_up_to_px: Option<f64>,
    /// Images that should show the aircraft.
    pub expected: u64,
    /// Images with a detection.
    pub found: u64,
    /// Errors of the boxes.
    #[serde(flatten)]
    pub errors: BoxSpreads,
}

#[derive(Debug, Clone, Default)]
pub(crate) struct AccuracyTally {
    boxes: Vec<BoxError>,
    pairs: Vec<Pair>,
    /// Aircraft to be found, by width.
    expected: [u64; WIDTH_BINS_PX.len()],
}

#[derive(Debug, Clone, Copy)]
struct BoxError {
    distance_nm: f32,
    /// Index of the true width.
    width_bin: usize,
    /// Centre right, centre down, width, height.
    error_px: [f32; 4],
}

#[derive(Debug, Clone, Copy)]
struct Pair {
    distance_nm: f32,
    boxes_px: f32,
    /// Error, and the stated standard deviation; or why there is none.
    registered_px: std::result::Result<[f32; 2], &'static str>,
}

impl BoxSpreads {
    fn of<'a>(errors: impl Iterator<Item = &'a BoxError>) -> Self {
        let errors: Vec<_> = errors.map(|error| error.error_px.map(f64::from)).collect();
        let spread = |which: usize| Spread::of(errors.iter().map(|error| error[which]).collect());
        Self {
            cx_px: spread(0),
            cy_px: spread(1),
            width_px: spread(2),
            height_px: spread(3),
        }
    }
}

impl AccuracyTally {
    pub(crate) fn count(
        &mut self,
        scenario: &OpenScenario,
        searched: &[Searched<'_>],
        registrations: &[Registration],
    ) -> Result<()> {
        let record = scenario.record()?;
        let mut centres = BTreeMap::new();
        for searched in searched {
            let picture = searched.picture;
            let (Some(truth), Some(outcome)) = (&picture.truth, searched.outcome()) else {
                continue;
            };
            if picture.sight != Sight::Open || picture.distance_nm < 0.0 {
                continue;
            }
            let width_bin = width_bin(truth.pixel_box.width_px);
            self.expected[width_bin] += 1;
            let Outcome::Found(hit) = outcome else {
                continue;
            };
            let (found, real) = (hit.pixel_box, truth.pixel_box);
            self.boxes.push(BoxError {
                distance_nm: picture.distance_nm as f32,
                width_bin,
                error_px: [
                    found.cx_px - real.cx_px,
                    found.cy_px - real.cy_px,
                    found.width_px - real.width_px,
                    found.height_px - real.height_px,
                ]
                .map(|error| error as f32),
            });
            let view = record.views[picture.view].as_str();
            let centre = DVec2::new(found.cx_px, found.cy_px);
            centres.insert((picture.tick, view), (centre, picture.distance_nm));
        }
        let calibration = scenario.calibration()?;
        let frames = scenario.frames()?;
        for registration in registrations {
            let views = [registration.reference.as_str(), registration.view.as_str()];
            let [Some((from, distance_nm)), Some((to, _))] =
                views.map(|view| centres.get(&(registration.tick, view)))
            else {
                continue;
            };
            let pose = &frames.rows[registration.tick as usize].pose;
            let place_m =
                pose.position().to_ecef() + pose.ecef_from_body() * DVec3::X * VISIBLE_AHEAD_M;
            let mut projected = [DVec2::ZERO; 2];
            for (view, at) in views.into_iter().zip(&mut projected) {
                let camera = calibration.cameras.get(view);
                let seen = camera.and_then(|camera| camera.camera().project(place_m));
                *at = seen.ok_or_else(|| Error::Projection {
                    scenario: record.id.clone(),
                    view: view.to_owned(),
                    tick: registration.tick,
                })?;
            }
            let truth_px = projected[1].x - projected[0].x;
            self.pairs.push(Pair {
                distance_nm: *distance_nm as f32,
                boxes_px: (to.x - from.x - truth_px) as f32,
                registered_px: match registration.result {
                    Ok(shift) => Ok([(shift.dx_px - truth_px) as f32, shift.sd_x_px as f32]),
                    Err(reason) => Err(reason.word()),
                },
            });
        }
        Ok(())
    }

    /// Errors of boxes, mile by mile.
    pub(crate) fn boxes_by_nm(&self) -> Vec<BoxErrors> {
        let distances = self.boxes.iter().map(|error| error.distance_nm);
        bins(distances)
            .map(|bin| self.boxes_in(bin))
            .filter(|bin| bin.boxes > 0)
            .collect()
    }

    /// All aircraft by width.
    pub(crate) fn by_width(&self) -> Vec<WidthFigures> {
        let bin = |(index, up_to): (usize, f64)| {
            let here = || {
                self.boxes
                    .iter()
                    .filter(move |error| error.width_bin == index)
            };
            WidthFigures {
                width_up_to_px: up_to.is_finite().then_some(up_to),
                expected: self.expected[index],
                found: here().count() as u64,
                errors: BoxSpreads::of(here()),
            }
        };
        WIDTH_BINS_PX.into_iter().enumerate().map(bin).collect()
    }

    /// Errors of the disparity, mile by mile.
    pub(crate) fn disparity_by_nm(&self) -> Vec<DisparityErrors> {
        let distances = self.pairs.iter().map(|pair| pair.distance_nm);
        bins(distances)
            .map(|bin| self.disparity_in(bin))
            .filter(|bin| bin.pairs > 0)
            .collect()
    }

    /// Errors of boxes in a bin of distances.
    pub(crate) fn boxes_in(&self, [from_nm, to_nm]: [f64; 2]) -> BoxErrors {
        let here = || {
            self.boxes
                .iter()
                .filter(move |error| is_in(error.distance_nm, [from_nm, to_nm]))
        };
        BoxErrors {
            from_nm,
            to_nm,
            boxes: here().count() as u64,
            errors: BoxSpreads::of(here()),
        }
    }

    /// Errors of the disparity in a bin of distances.
    pub(crate) fn disparity_in(&self, [from_nm, to_nm]: [f64; 2]) -> DisparityErrors {
        let here = || {
            self.pairs
                .iter()
                .filter(move |pair| is_in(pair.distance_nm, [from_nm, to_nm]))
        };
        let registered: Vec<[f64; 2]> = here()
            .filter_map(|pair| Some(pair.registered_px.ok()?.map(f64::from)))
            .collect();
        let mut unregistered: BTreeMap<String, u64> = BTreeMap::new();
        for reason in here().filter_map(|pair| pair.registered_px.err()) {
            *unregistered.entry(reason.into()).or_default() += 1;
        }
        let boxes = || here().map(|pair| (pair.distance_nm, f64::from(pair.boxes_px)));
        let shifts = here().filter_map(|pair| {
            let [error, _] = pair.registered_px.ok()?;
            Some((pair.distance_nm, f64::from(error)))
        });
        let deviation_about_bias_px = [
            deviation_about_bias(boxes().collect()),
            deviation_about_bias(shifts.collect()),
        ];
        let spread_of =
            |value: fn(&[f64; 2]) -> f64| Spread::of(registered.iter().map(value).collect());
        DisparityErrors {
            from_nm,
            to_nm,
            pairs: here().count() as u64,
            registered: registered.len() as u64,
            unregistered,
            boxes_px: Spread::of(boxes().map(|(_, error)| error).collect()),
            deviation_about_bias_px,
            registered_px: spread_of(|[error, _]| *error),
            registered_over_stated: spread_of(|[error, stated]| error / stated),
        }
    }
}

/// Robust standard deviation about each mile's median.
fn deviation_about_bias(errors: Vec<(f32, f64)>) -> Option<f64> {
    let mut miles: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    for (distance_nm, error) in errors {
        let mile = distance_nm.floor() as i64;
        miles.entry(mile).or_default().push(error);
    }
    let about_bias = miles.into_values().flat_map(|errors| {
        let bias = Spread::of(errors.clone()).map_or(0.0, |spread| spread.median);
        errors.into_iter().map(move |error| error - bias)
    });
    Spread::of(about_bias.collect()).map(|spread| spread.deviation)
}

fn width_bin(width_px: f64) -> usize {
    WIDTH_BINS_PX
        .partition_point(|up_to| *up_to < width_px)
        .min(WIDTH_BINS_PX.len() - 1)
}

fn is_in(distance_nm: f32, [from_nm, to_nm]: [f64; 2]) -> bool {
    (from_nm..to_nm).contains(&f64::from(distance_nm))
}

/// Miles from 0 to the farthest distance.
fn bins(distances_nm: impl Iterator<Item = f32>) -> impl Iterator<Item = [f64; 2]> {
    let farthest_nm = distances_nm.fold(0.0, f32::max);
    (0..=farthest_nm as u32).map(|mile| [mile, mile + 1].map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recall::OVERALL_NM;

    #[test]
    fn errors_are_sorted_into_miles_and_summed_up_from_1_to_10() {
        let error = |distance_nm: f32, px: f32| BoxError {
            distance_nm,
            width_bin: width_bin(f64::from(px) * 10.0),
            error_px: [px, 0.0, 0.0, 0.0],
        };
        let tally = AccuracyTally {
            boxes: vec![
                error(0.5, 9.0),
                error(5.0, 1.0),
                error(5.5, 2.0),
                error(5.9, 6.0),
                error(12.0, 7.0),
            ],
            pairs: Vec::new(),
            expected: [3, 0, 0, 4, 0],
        };
        let bins: Vec<_> = tally
            .boxes_by_nm()
            .iter()
            .map(|bin| (bin.from_nm, bin.boxes, bin.errors.cx_px.unwrap().median))
            .collect();
        assert_eq!(bins, [(0.0, 1, 9.0), (5.0, 3, 2.0), (12.0, 1, 7.0)]);
        let overall = tally.boxes_in(OVERALL_NM);
        assert_eq!(
            (overall.boxes, overall.errors.cx_px.unwrap().deviation),
            (3, 1.4826)
        );
        // 10 and 20 px wide; 60, 70 and 90.
        let widths: Vec<_> = tally
            .by_width()
            .iter()
            .map(|bin| (bin.width_up_to_px, bin.expected, bin.found))
            .collect();
        assert_eq!(widths[0], (Some(20.0), 3, 2));
        assert_eq!(widths[3], (Some(90.0), 4, 3));
        assert_eq!(widths[4], (None, 0, 0));
    }

    #[test]
    fn pairs_without_a_shift_are_counted_by_their_reason() {
        let pair = |registered_px| Pair {
            distance_nm: 4.5,
            boxes_px: 0.5,
            registered_px,
        };
        let tally = AccuracyTally {
            pairs: vec![
                pair(Ok([0.1, 0.05])),
                pair(Ok([0.3, 0.1])),
                pair(Err("faint")),
            ],
            ..AccuracyTally::default()
        };
        let errors = tally.disparity_in(OVERALL_NM);
        assert_eq!((errors.pairs, errors.registered), (3, 2));
        assert_eq!(errors.unregistered["faint"], 1);
        assert_eq!(errors.boxes_px.unwrap().median, 0.5);
        let over = errors.registered_over_stated.unwrap().median;
        assert!((over - 3.0).abs() < 1e-6, "{over}");
    }

    #[test]
    fn a_bias_that_changes_from_mile_to_mile_is_left_out_of_the_deviation_about_it() {
        let errors = [1.0, 2.0, 3.0].map(|error| (4.5, error));
        let farther = [11.0, 12.0, 13.0].map(|error| (5.5, error));
        let both = errors.into_iter().chain(farther).collect();
        assert_eq!(deviation_about_bias(both), Some(1.4826));
        assert_eq!(deviation_about_bias(Vec::new()), None);
    }
}
