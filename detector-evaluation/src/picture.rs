//! The pictures of a scenario, and whether a detector can be expected to find the aircraft in each.
//!
//! Haze leaves `exp(-3.912 r / V)` of an aircraft's contrast at the distance r (`transmission` in `boxes_truth.parquet`). Where that is
//! less than 2 %, which is what the visibility V is defined by, nobody can see it. Clouds hide it where it flies in or above them: what
//! exactly they cover is not stored, so all pictures from the base of the lowest layer upwards are told apart.

use std::collections::HashMap;

use dataset::open_scenario::OpenScenario;
use dataset::pixel_box::TruthBox;
use dataset::units::METERS_PER_NAUTICAL_MILE;
use labeller::matching::is_expected;
use serde::Serialize;

use crate::error::{Error, Result};

/// Contrast that remains over the visibility.
const LEAST_TRANSMISSION: f64 = 0.02;

/// One picture: a view at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Picture {
    pub(crate) tick: u32,
    /// Index of the view.
    pub(crate) view: usize,
    /// Distance to touchdown, nautical miles; negative past it.
    pub(crate) distance_nm: f64,
    /// The true box, if any of the aircraft is in the picture.
    pub(crate) truth: Option<TruthBox>,
    /// Whether the air lets it be seen.
    pub(crate) sight: Sight,
}

/// What is between the camera and the aircraft.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Sight {
    /// Air that one can see through.
    #[serde(rename = "in_sight")]
    Open,
    /// Haze or fog: the aircraft is beyond the visibility.
    Haze,
    /// Perhaps a cloud: the aircraft is not below all of them.
    Cloud,
}

impl Picture {
    /// The aircraft that a detector is expected to find, hidden or not: most of it is in the picture.
    pub(crate) fn expected(&self) -> Option<&TruthBox> {
        self.truth.as_ref().filter(|truth| is_expected(truth))
    }
}

/// All pictures of a labelled scenario, by tick and then in the order of its views.
pub(crate) fn pictures_of(scenario: &OpenScenario) -> Result<Vec<Picture>> {
    let record = scenario.record()?;
    let frames = scenario.frames()?;
    let mut truth: HashMap<_, _> = scenario
        .truth_boxes()?
        .into_iter()
        .map(|truth| ((truth.tick, truth.view.clone()), truth))
        .collect();
    let clouds = &record.conditions.weather.clouds;
    let bases = clouds.iter().filter(|layer| layer.cover_ratio > 0.0);
    let lowest_base_m = bases.map(|layer| layer.base_msl_m).reduce(f64::min);
    let mut pictures = Vec::with_capacity(frames.rows.len() * record.views.len());
    for row in &frames.rows {
        let labels = row
            .labels
            .as_ref()
            .ok_or_else(|| Error::Unlabelled(record.id.clone()))?;
        let past = if labels.along_track_m < 0.0 {
            -1.0
        } else {
            1.0
        };
        let is_below_clouds = lowest_base_m.is_none_or(|base_m| row.pose.altitude_msl_m < base_m);
        for (view, id) in record.views.iter().enumerate() {
            let truth = truth.remove(&(row.tick, id.clone()));
            let transmission = truth.as_ref().map_or(1.0, |truth| truth.transmission);
            pictures.push(Picture {
                tick: row.tick,
                view,
                distance_nm: past * labels.dtd_m / METERS_PER_NAUTICAL_MILE,
                truth,
                sight: match is_below_clouds {
                    _ if transmission < LEAST_TRANSMISSION => Sight::Haze,
                    true => Sight::Open,
                    false => Sight::Cloud,
                },
            });
        }
    }
    Ok(pictures)
}
