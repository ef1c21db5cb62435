//! Best box per image, for the registration with other views and for the camera's state.

use dataset::corpus::detections::Detection;
use dataset::tables::pixel_box::PixelBox;

use crate::detect::sequence::Tracked;

/// A box with the properties that rank it.
pub(crate) struct RankedBox {
    pixel_box: PixelBox,
    score: f64,
    is_confirmed: bool,
    counts: bool,
}

impl From<&Tracked> for RankedBox {
    fn from(found: &Tracked) -> Self {
        Self {
            pixel_box: found.pixel_box,
            score: found.score,
            is_confirmed: found.is_confirmed,
            counts: found.counts,
        }
    }
}

impl From<&Detection> for RankedBox {
    fn from(found: &Detection) -> Self {
        Self {
            pixel_box: found.pixel_box,
            score: found.score,
            is_confirmed: found.confirmed,
            counts: found.counts_live.unwrap_or(found.confirmed),
        }
    }
}

/// The box to register: the one with the highest score of the confirmed ones, else of all.
pub(crate) fn best_of(boxes: impl IntoIterator<Item: Into<RankedBox>>) -> Option<PixelBox> {
    let ranked = boxes.into_iter().map(Into::into);
    best(ranked)
}

fn best(boxes: impl Iterator<Item = RankedBox>) -> Option<PixelBox> {
    let best = boxes.max_by(|a, b| {
        let confirmed = a.is_confirmed.cmp(&b.is_confirmed);
        confirmed.then(a.score.total_cmp(&b.score))
    });
    best.map(|best| best.pixel_box)
}

/// The same among the boxes that count at this moment.
pub(crate) fn best_counted_of(boxes: impl IntoIterator<Item: Into<RankedBox>>) -> Option<PixelBox> {
    let ranked = boxes.into_iter().map(Into::into);
    best(ranked.filter(|found| found.counts))
}
