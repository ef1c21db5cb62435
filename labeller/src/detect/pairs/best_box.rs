//! Best box per image, for the registration with other views and for the camera's state.

use dataset::tables::pixel_box::PixelBox;

/// The box to register: the one with the highest score of the confirmed ones, else of all. Each comes with whether it is confirmed, and
/// its score.
pub(crate) fn best_of(boxes: impl Iterator<Item = (bool, f64, PixelBox)>) -> Option<PixelBox> {
    let best = boxes.max_by(|(is_confirmed, score, _), (is_other_confirmed, other, _)| {
        let confirmed = is_confirmed.cmp(is_other_confirmed);
        confirmed.then(score.total_cmp(other))
    });
    best.map(|(_, _, pixel_box)| pixel_box)
}
