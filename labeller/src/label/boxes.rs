//! Ground-truth boxes of all aircraft of a scenario.
//!
//! Input: the ticks, the types and places of the aircraft, and the cameras. Output: the rows of `boxes_truth.parquet`, by tick, aircraft
//! and view.

use airframe::{AircraftType, Configuration, Mesh};
use dataset::conditions::{Weather, transmission};
use dataset::corpus::scenario::ScenarioRecord;
use dataset::geometry::camera::Camera;
use dataset::geometry::pose::{Controls, Pose};
use dataset::tables::aircraft::AircraftRow;
use dataset::tables::frames::Frames;
use dataset::tables::pixel_box::TruthBox;

use super::AIRCRAFT_CLASS;
use crate::truth_box::Sighting;

/// The boxes of a scenario in this weather. `types`: of the first aircraft and the others; `rows`: the places of all, if there are others.
pub(super) fn truth_boxes(
    record: &ScenarioRecord,
    weather: &Weather,
    types: &[&AircraftType],
    (frames, rows): (&Frames, Option<&[AircraftRow]>),
    cameras: &[Camera],
) -> Vec<TruthBox> {
    let mut boxes = Vec::new();
    let mut meshes: Vec<Option<(Controls, Mesh)>> = types.iter().map(|_| None).collect();
    for (tick, frame) in frames.rows.iter().enumerate() {
        let first = (frame.pose, frame.controls);
        let here = rows.map_or(&[][..], |rows| &rows[tick * types.len()..][..types.len()]);
        let others = here.iter().skip(1).map(|row| (row.pose, row.controls));
        let places: Vec<(Pose, Controls)> = std::iter::once(first).chain(others).collect();
        for ((kept, aircraft), (_, controls)) in meshes.iter_mut().zip(types).zip(&places) {
            // Flaps and gear move during only a few ticks of a flight.
            if kept.as_ref().is_none_or(|(of, _)| of != controls) {
                let mesh = aircraft.mesh(Configuration {
                    flap_ratio: controls.flap_ratio,
                    gear_ratio: controls.gear_ratio,
                });
                *kept = Some((*controls, mesh));
            }
        }
        let seen = |camera: &Camera| -> Vec<Option<Sighting<'_>>> {
            let meshes = meshes.iter().flatten().map(|(_, mesh)| mesh);
            meshes
                .zip(&places)
                .map(|(mesh, (pose, _))| {
                    Sighting::of(mesh, pose, camera, record.touchdown.altitude_msl_m)
                })
                .collect()
        };
        let by_view: Vec<_> = cameras.iter().map(seen).collect();
        for number in 0..types.len() {
            for ((view, camera), seen) in record.views.iter().zip(cameras).zip(&by_view) {
                let Some(sighting) = &seen[number] else {
                    continue;
                };
                let projection = &sighting.projection;
                let occluded_fraction = rows.map(|_| sighting.occluded_fraction(seen, camera));
                boxes.push(TruthBox {
                    tick: frame.tick,
                    view: view.clone(),
                    class: AIRCRAFT_CLASS.into(),
                    pixel_box: projection.pixel_box,
                    visible_fraction: projection.visible_fraction,
                    truncation: projection.truncation,
                    transmission: transmission(projection.range_m, weather.visibility_m),
                    aircraft_number: rows.map(|_| number as u32),
                    occluded_fraction,
                });
            }
        }
    }
    boxes
}
