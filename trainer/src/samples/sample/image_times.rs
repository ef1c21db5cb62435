//! Boxes of images that have their own times, moved to the times of the ticks.
//!
//! In a recorded scenario the image nearest to a tick is up to half a period away. A box is moved by the motion of the boxes around it on
//! its track; a box whose motion is not known, because there are too few, is dropped.

use std::collections::BTreeMap;

use dataset::numbers::motion::motion_at;
use dataset::numbers::units::SimTime;
use dataset::tables::frames::Frames;
use glam::DVec2;

use crate::samples::Candidate;
use crate::samples::trusted_boxes::centre_and_size;

/// Shorter times need no motion, seconds: an aircraft on approach moves by less than a tenth of a pixel.
const AT_ONCE_S: f64 = 1e-3;

/// Moves the boxes of recorded images to their ticks. `found`: by tick and view.
pub(crate) fn move_to_ticks(found: &mut BTreeMap<(u32, String), Vec<Candidate>>, frames: &Frames) {
    if !frames.is_recorded() {
        return;
    }
    for (index, view) in frames.views.iter().enumerate() {
        let image_s = |tick: u32| {
            let row = frames.rows.get(tick as usize)?;
            Some(SimTime(row.image_times_ns[index]?).seconds())
        };
        let mut places: BTreeMap<Option<u32>, Vec<(f64, DVec2)>> = BTreeMap::new();
        for ((tick, of), candidates) in found.iter() {
            if of != view {
                continue;
            }
            let Some(image_s) = image_s(*tick) else {
                continue;
            };
            for candidate in candidates {
                let (centre_px, _) = centre_and_size(&candidate.pixel_box);
                let of_track = places.entry(candidate.track).or_default();
                // Of several boxes without tracks, the first one has the highest score.
                if of_track.last().is_none_or(|(last_s, _)| *last_s < image_s) {
                    of_track.push((image_s, centre_px));
                }
            }
        }
        for ((tick, of), candidates) in found.iter_mut() {
            if of != view {
                continue;
            }
            let Some(image_s) = image_s(*tick) else {
                candidates.clear();
                continue;
            };
            let tick_s = SimTime(frames.rows[*tick as usize].time_ns).seconds();
            let by_s = tick_s - image_s;
            candidates.retain_mut(|candidate| {
                if by_s.abs() < AT_ONCE_S {
                    return true;
                }
                let motion = (places.get(&candidate.track)).and_then(|of| motion_at(of, image_s));
                let moved_px = motion.map(|motion| motion.per_s * by_s);
                candidate.pixel_box.cx_px += moved_px.map_or(0.0, |moved| moved.x);
                candidate.pixel_box.cy_px += moved_px.map_or(0.0, |moved| moved.y);
                moved_px.is_some()
            });
        }
    }
}
