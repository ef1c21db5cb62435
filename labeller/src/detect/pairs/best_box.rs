//! The box of an image that is registered with other views, and the one by which a camera is judged.

use dataset::corpus::detections::Detection;
use dataset::tables::pixel_box::PixelBox;

use crate::detect::sequence::Tracked;

/// A box that was found in an image.
pub(crate) trait Found {
    fn pixel_box(&self) -> PixelBox;
    fn score(&self) -> f64;
    /// Its track has enough boxes.
    fn is_confirmed(&self) -> bool;
    /// Its track counts at this moment.
    fn counts(&self) -> bool;
}

impl Found for Tracked {
    fn pixel_box(&self) -> PixelBox {
        self.pixel_box
    }

    fn score(&self) -> f64 {
        self.score
    }

    fn is_confirmed(&self) -> bool {
        self.is_confirmed
    }

    fn counts(&self) -> bool {
        self.counts
    }
}

impl Found for Detection {
    fn pixel_box(&self) -> PixelBox {
        self.pixel_box
    }

    fn score(&self) -> f64 {
        self.score
    }

    fn is_confirmed(&self) -> bool {
        self.confirmed
    }

    fn counts(&self) -> bool {
        self.counts_live.unwrap_or(self.confirmed)
    }
}

/// The box to register: a confirmed one, if there is any, and of these the one with the highest score.
pub(crate) fn best_of<'a, F: Found + 'a>(
    boxes: impl IntoIterator<Item = &'a F>,
) -> Option<PixelBox> {
    let best = boxes.into_iter().max_by(|a, b| {
        let confirmed = a.is_confirmed().cmp(&b.is_confirmed());
        confirmed.then(a.score().total_cmp(&b.score()))
    });
    best.map(F::pixel_box)
}

/// The box with the highest score of those that count at this moment.
pub(crate) fn best_counted_of<'a, F: Found + 'a>(
    boxes: impl IntoIterator<Item = &'a F>,
) -> Option<PixelBox> {
    best_of(boxes.into_iter().filter(|found| found.counts()))
}
