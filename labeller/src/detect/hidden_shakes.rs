//! Cameras that shake where fog hides the ground, told from the aircraft: its rows in two views contradict each other by pixels, now this
//! way and now that, and in the view that shakes it does not fly smoothly.

use std::collections::{BTreeMap, BTreeSet};

use dataset::corpus::detections::Detections;
use dataset::numbers::motion::scatter;
use dataset::numbers::spread::deviation_from_zero;
use dataset::tables::health::{HealthState, ViewHealth};
use glam::DVec2;

use super::lags::INCONSISTENT_PX;
use super::pictures::ViewTicks;

/// Minimum number of ticks.
const MIN_TICKS: usize = 20;
/// Minimum scatter of a shaking view's places, as a part of the scatter in the other view.
const MIN_SCATTER_PART: f64 = 0.5;

/// Names such cameras in rows whose direction is hidden. Where they looked in each image is not known. `reference`: the view that the
/// others are compared with.
pub(super) fn add_hidden_shakes(
    views: &[ViewTicks],
    reference: &str,
    detections: &Detections,
    health: &mut [ViewHealth],
) {
    let hidden: BTreeSet<(&str, u32)> = (health.iter())
        .filter(|row| is_hidden(row))
        .map(|row| (row.view.as_str(), row.tick))
        .collect();
    let mut shaking = BTreeSet::new();
    for view in views.iter().filter(|view| view.id != reference) {
        let pair = [reference, &view.id];
        let off_px = health.iter().filter(|row| {
            row.view == view.id && pair.iter().any(|id| hidden.contains(&(id, row.tick)))
        });
        let off_px: Vec<f64> = off_px.filter_map(|row| row.vertical_px).collect();
        if off_px.len() < MIN_TICKS || deviation_from_zero(off_px.into_iter()) < INCONSISTENT_PX {
            continue;
        }
        let of_pair = views.iter().filter(|view| pair.contains(&view.id.as_str()));
        let scatter_px: Vec<(&str, f64)> = of_pair
            .filter(|view| hidden.iter().any(|(id, _)| *id == view.id))
            .map(|view| (view.id.as_str(), scatter_in(view, detections)))
            .collect();
        let most_px = scatter_px.iter().map(|(_, px)| *px).fold(0.0, f64::max);
        let shakes = scatter_px
            .into_iter()
            .filter(|(_, px)| *px >= INCONSISTENT_PX.max(MIN_SCATTER_PART * most_px));
        shaking.extend(shakes.map(|(id, _)| id.to_owned()));
    }
    for row in health.iter_mut().filter(|row| is_hidden(row)) {
        if shaking.contains(&row.view) {
            row.state = HealthState::Shaking;
        }
    }
}

fn is_hidden(row: &ViewHealth) -> bool {
    row.state == HealthState::Unknown
}

/// Scatter of the longest track around smooth flight, px.
fn scatter_in(view: &ViewTicks, detections: &Detections) -> f64 {
    let times_s: BTreeMap<u32, f64> = (view.ticks.iter())
        .map(|tick| (tick.tick, tick.time_s))
        .collect();
    let mut tracks: BTreeMap<Option<u32>, Vec<(f64, DVec2)>> = BTreeMap::new();
    let boxes = detections.boxes.iter();
    for found in boxes.filter(|found| found.view == view.id && found.confirmed) {
        if let Some(&time_s) = times_s.get(&found.tick) {
            let place = DVec2::new(found.pixel_box.cx_px, found.pixel_box.cy_px);
            tracks.entry(found.track).or_default().push((time_s, place));
        }
    }
    let longest = tracks.values().max_by_key(|places| places.len());
    longest.map_or(0.0, |places| scatter(places).length())
}

#[cfg(test)]
mod tests {
    use dataset::corpus::detections::Detection;
    use dataset::tables::pixel_box::PixelBox;

    use super::super::pictures::ViewTick;
    use super::*;

    const TICKS: u32 = 60;

    /// Image displacement by a 2 px shake, with an image every two seconds.
    fn shake_px(tick: u32) -> f64 {
        2.0 * std::f64::consts::SQRT_2 * (2.4 * f64::from(tick)).sin()
    }

    /// View states after a flight. `shakes`: shake factors by view; `off`: factor of the row contradiction; `state`: state by the ground.
    fn states(shakes: [f64; 2], off: f64, state: HealthState) -> [Vec<HealthState>; 2] {
        let ids = ["left", "right"];
        let ticks = || {
            (0..TICKS).map(|tick| ViewTick {
                tick,
                time_s: 2.0 * f64::from(tick),
                pts: 0,
            })
        };
        let views = ids.map(|id| ViewTicks {
            id: id.into(),
            ticks: ticks().collect(),
        });
        let (mut boxes, mut health) = (Vec::new(), Vec::new());
        for tick in 0..TICKS {
            let off_px = shakes.map(|part| part * shake_px(tick));
            for (view, off_px) in ids.iter().zip(off_px) {
                let pixel_box = PixelBox {
                    cx_px: 400.0 + 8.0 * f64::from(tick) + 0.5 * off_px,
                    cy_px: 600.0 + f64::from(tick) + off_px,
                    width_px: 30.0,
                    height_px: 12.0,
                };
                boxes.push(Detection {
                    track: Some(3),
                    confirmed: true,
                    ..Detection::untracked(tick, *view, pixel_box, 0.9, 0)
                });
                health.push(ViewHealth {
                    tick,
                    view: (*view).to_owned(),
                    state,
                    motion: None,
                    state_live: state,
                    lag: None,
                    vertical_px: (*view == "right")
                        .then(|| off * shake_px(tick) + 0.05 * f64::from(tick % 2)),
                });
            }
        }
        add_hidden_shakes(&views, "left", &Detections::from(boxes), &mut health);
        ids.map(|id| {
            let of_view = health.iter().filter(|row| row.view == id);
            of_view.map(|row| row.state).collect()
        })
    }

    #[test]
    fn a_camera_that_shakes_in_fog_is_told_from_the_aircraft_and_the_other_one_is_not_accused() {
        let all = |state: HealthState| vec![state; TICKS as usize];
        let (unknown, shaking) = (all(HealthState::Unknown), all(HealthState::Shaking));
        for (shakes, off, expected) in [
            ([0.0, 0.0], 0.0, [&unknown, &unknown]),
            ([0.0, 0.2], 0.2, [&unknown, &unknown]),
            ([0.0, 1.0], 1.0, [&unknown, &shaking]),
            ([1.0, 0.0], -1.0, [&shaking, &unknown]),
            ([-1.0, 1.0], 2.0, [&shaking, &shaking]),
            // Registrations of something else.
            ([0.0, 0.0], 1.0, [&unknown, &unknown]),
        ] {
            let found = states(shakes, off, HealthState::Unknown);
            assert_eq!(found.each_ref(), expected, "{shakes:?} {off}");
        }
        // Where the ground is seen, it decides.
        let found = states([0.0, 1.0], 1.0, HealthState::Steady);
        assert_eq!(found[1], all(HealthState::Steady));
    }
}
