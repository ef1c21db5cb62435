//! Offsets of a camera's clock at which its boxes move like the arrivals.
//!
//! At each offset the boxes are compared with the projected arrivals. A camera that looks elsewhere than stated shows all of them off by
//! the same shift, so the offset counts by the most frequent shift.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec2;

use crate::alignment::{Alignment, CameraModel, FIRST_BOX_SD_PX};
use crate::flight_path::FlightPath;
use crate::likely_cause::GPS_AHEAD_S;
use crate::sightings::Sighting;

/// Step of the offsets, seconds: aircraft near the runway move by tens of pixels in that time.
const STEP_S: f64 = 1.0;
/// Offsets reach this many prior deviations.
const REACH: f64 = 3.0;
/// Half hours from UTC that are in use.
const HALF_HOURS: i32 = 28;
/// Side of a cell of shifts; two by two count: as much as a wrong roll or focal length adds, pixels.
const CELL_PX: f64 = 32.0;
/// Tolerance of a calibrated camera, pixels.
const CALIBRATED_PX: f64 = 40.0;
/// Boxes that are compared.
const MAX_COMPARED: usize = 400;
/// Least share of boxes that fit for stated times to be believed without trying other half hours.
const BELIEVABLE: f64 = 0.3;
/// Offsets with at least this part of the most fitting boxes are refined, at most this number of them.
const NEARLY: f64 = 0.7;
const MAX_REFINED: usize = 9;
/// Rounds of refinement, with the distance within which boxes count in any case, pixels.
const WITHIN_PX: [f64; 8] = [60.0, 60.0, 40.0, 30.0, 20.0, 10.0, 0.0, 0.0];

/// A camera at its best coarse offset; `None` if its boxes fit the arrivals at no offset.
pub(crate) fn best_start(
    model: &CameraModel,
    seen: &[Sighting],
    paths: &[FlightPath],
) -> Option<CameraModel> {
    let step = seen.len().div_ceil(MAX_COMPARED).max(1);
    let seen: Vec<Sighting> = seen.iter().step_by(step).copied().collect();
    let reach_s = REACH * model.prior_sd[0];
    let around = |centres: &[f64]| {
        let steps = (reach_s / STEP_S).ceil() as i32;
        let around = |centre_s: &f64| {
            let centre = (centre_s / STEP_S) as i32;
            centre - steps..=centre + steps
        };
        // Whole half hours are nearer to each other than some clocks are certain.
        let offsets: BTreeSet<i32> = centres.iter().flat_map(around).collect();
        let tried = |step| {
            let offset_s = f64::from(step) * STEP_S;
            let (count, shift_px) = fitting(model, &seen, paths, offset_s);
            (offset_s, count, shift_px)
        };
        offsets.into_iter().map(tried).collect::<Vec<_>>()
    };
    let mut tried = around(&[0.0]);
    let most =
        |tried: &[(f64, usize, DVec2)]| tried.iter().map(|(_, count, _)| *count).max().unwrap_or(0);
    if (most(&tried) as f64) < BELIEVABLE * seen.len() as f64 {
        let causes: Vec<f64> = (-HALF_HOURS..=HALF_HOURS)
            .flat_map(|half_hours| {
                [0.0, GPS_AHEAD_S, -GPS_AHEAD_S]
                    .map(|rest_s| 1_800.0 * f64::from(half_hours) + rest_s)
            })
            .collect();
        tried = around(&causes);
    }
    let most = most(&tried);
    if most < MIN_FITTING {
        return None;
    }
    tried.retain(|(_, count, _)| *count as f64 >= NEARLY * most as f64);
    let step = tried.len().div_ceil(MAX_REFINED).max(1);
    let best = tried.iter().max_by_key(|(_, count, _)| *count).copied();
    let started = tried.iter().step_by(step).copied().chain(best);
    let refined = started.filter_map(|(offset_s, _, shift_px)| {
        let started = model.started_at(offset_s, shift_px);
        let mut alignment = Alignment::new(vec![started], paths, false);
        let all = [seen.clone()];
        for within_px in WITHIN_PX {
            let assigned = alignment.assigned(&all, within_px);
            alignment.step(&assigned)?;
        }
        // With its own scatter, a wrong offset would be as good as the right one.
        let scatter_px = std::mem::replace(&mut alignment.cameras[0].box_sd_px, FIRST_BOX_SD_PX);
        let loss = alignment.loss(0, &seen);
        alignment.cameras[0].box_sd_px = scatter_px;
        Some((loss, alignment.cameras.swap_remove(0)))
    });
    let best = refined.min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, model)| model)
}

/// Least number of fitting boxes of an aligned camera: fewer fit by accident.
pub(crate) const MIN_FITTING: usize = 10;

/// Number of boxes that fit an arrival at an offset with the most frequent shift, and that shift.
fn fitting(
    model: &CameraModel,
    seen: &[Sighting],
    paths: &[FlightPath],
    offset_s: f64,
) -> (usize, DVec2) {
    let given = &model.given;
    let turn_sd_px = model.prior_sd[2].to_radians() * given.focal_px;
    let most_px = CALIBRATED_PX + REACH * turn_sd_px;
    let mut cells: BTreeMap<(i32, i32), (usize, DVec2)> = BTreeMap::new();
    for seen in seen {
        for path in paths {
            let Some(place_px) = path
                .at(seen.time_s + offset_s)
                .and_then(|at| given.project(at.place_m))
            else {
                continue;
            };
            let off_px = seen.place_px() - place_px;
            if off_px.length() > most_px {
                continue;
            }
            if turn_sd_px == 0.0 {
                cells.entry((0, 0)).or_default().0 += 1;
                continue;
            }
            let cell = (off_px / CELL_PX).floor().as_ivec2();
            for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (count, sum_px) = cells.entry((cell.x + x, cell.y + y)).or_default();
                *count += 1;
                *sum_px += off_px;
            }
        }
    }
    let best = cells.into_values().max_by_key(|(count, _)| *count);
    best.map_or((0, DVec2::ZERO), |(count, sum_px)| {
        (count, sum_px / count as f64)
    })
}
