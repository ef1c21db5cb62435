//! A scenario's images, and whether a detector can be expected to find the aircraft in each.

use std::collections::HashMap;

use dataset::conditions::sight::{CloudBase, Sight};
use dataset::corpus::open_scenario::OpenScenario;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use labeller::matching::Match;

use crate::error::{Error, Result};

/// A view's image at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Picture {
    pub(crate) tick: u32,
    /// Index of the view.
    pub(crate) view: usize,
    /// Distance to touchdown, nautical miles; negative past it.
    pub(crate) distance_nm: f64,
    /// The ground-truth box, if any of the first aircraft is in the image.
    pub(crate) truth: Option<TruthBox>,
    /// Ground-truth boxes of other aircraft, which neither have to be found nor are false.
    pub(crate) others: Vec<PixelBox>,
    /// Visibility through haze, fog and clouds.
    pub(crate) sight: Sight,
}

impl Picture {
    /// The aircraft, if most of it is in the image, hidden or not.
    pub(crate) fn expected(&self) -> Option<&TruthBox> {
        self.truth.as_ref().filter(|truth| truth.is_expected())
    }

    /// True if a box touches other aircraft only.
    pub(crate) fn is_of_others(&self, found: &PixelBox) -> bool {
        let touches = |real: &PixelBox| Match::of(found, real) != Match::Elsewhere;
        let own = self.truth.as_ref().map(|truth| &truth.pixel_box);
        self.others.iter().any(touches) && !own.is_some_and(touches)
    }
}

/// All images, by tick and then in the order of the scenario's views.
pub(crate) fn pictures_of(scenario: &OpenScenario) -> Result<Vec<Picture>> {
    let record = scenario.record()?;
    let frames = scenario.frames()?;
    let mut truth = HashMap::new();
    let mut others: HashMap<_, Vec<PixelBox>> = HashMap::new();
    for real in scenario.truth_boxes()? {
        let key = (real.tick, real.view.clone());
        if real.is_of_first() {
            truth.insert(key, real);
        } else {
            others.entry(key).or_default().push(real.pixel_box);
        }
    }
    let cloud_base = CloudBase::of(record.weather());
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
        for (view, id) in record.views.iter().enumerate() {
            let key = (row.tick, id.clone());
            let truth: Option<TruthBox> = truth.remove(&key);
            let transmission = truth.as_ref().map_or(1.0, |truth| truth.transmission);
            pictures.push(Picture {
                tick: row.tick,
                view,
                distance_nm: past * labels.dtd_m / METERS_PER_NAUTICAL_MILE,
                truth,
                others: others.remove(&key).unwrap_or_default(),
                sight: cloud_base.sight(row.pose.altitude_msl_m, transmission),
            });
        }
    }
    Ok(pictures)
}
