//! Turns of a fixed camera during a flight.
//!
//! Input: the brightness of each image, in order, and the camera, whose calibration serves as a mask and for its focal length only. Output:
//! the turn of each image from the first one, with its standard deviation, or none where the ground shows too little. When the light has
//! changed so much that few tiles still resemble the reference, the image becomes the new reference, at its measured turn.

use std::cell::OnceCell;

use dataset::geometry::camera::Camera;
use dataset::video::Luma;

use crate::fit::{Fit, Freedom, MIN_SD_PX, NOISE_LEVELS, Reference};
use crate::ground::{Ground, Motion};

/// A turn with a larger standard deviation counts as not measured, pixels.
const MAX_SD_PX: f64 = 1.0;
/// After failures, at most this many images pass without a search.
const MAX_PAUSE: u32 = 64;

/// A turn with the standard deviation of the shift, the larger one of both axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The turn, without zoom and lift.
    pub turn: Motion,
    /// Standard deviation, pixels.
    pub sd_px: f64,
}

/// A camera's consecutive images.
pub struct Watched {
    ground: Ground,
    reference: Option<PlacedReference>,
    last: Motion,
    /// Images to pass without a search, and how many after the next failure.
    pause: u32,
    next_pause: u32,
}

struct PlacedReference {
    turn: Motion,
    sd_px: f64,
    reference: Reference,
}

impl Watched {
    /// No image yet.
    pub fn new(camera: &Camera) -> Self {
        Self {
            ground: Ground::of(camera),
            reference: None,
            last: Motion::default(),
            pause: 0,
            next_pause: 1,
        }
    }

    /// True once the ground has been seen.
    pub fn has_begun(&self) -> bool {
        self.reference.is_some()
    }

    /// The turn of the next image from the first one.
    pub fn next(&mut self, image: &Luma<'_>) -> Option<Measured> {
        let camera = &self.ground.camera;
        let size_px = [camera.width_px as usize, camera.height_px as usize];
        if [image.width_px, image.height_px] != size_px {
            return None;
        }
        if self.reference.is_none() {
            if self.pauses() {
                return None;
            }
            let begun = self.refer(image, Motion::default(), 0.0);
            self.searched(begun);
            return begun.then_some(Measured {
                turn: Motion::default(),
                sd_px: MIN_SD_PX,
            });
        }
        let fit = self.fit(image)?;
        let placed = self.reference.as_mut()?;
        placed.reference.take(&fit);
        let faded = placed.reference.is_faded_in(&fit);
        let turn = fit.sight.motion.after(placed.turn);
        let sd_px = fit.sight.sd_px().hypot(placed.sd_px);
        self.last = turn;
        if faded {
            // A worse one is not taken.
            self.refer(image, turn, sd_px);
        }
        (sd_px <= MAX_SD_PX).then_some(Measured { turn, sd_px })
    }

    /// Makes an image the reference if it has enough tiles.
    fn refer(&mut self, image: &Luma<'_>, turn: Motion, sd_px: f64) -> bool {
        let reference = Reference::of(image, &self.ground, NOISE_LEVELS);
        let enough = reference.is_some();
        if let Some(reference) = reference {
            self.reference = Some(PlacedReference {
                turn,
                sd_px,
                reference,
            });
        }
        enough
    }

    fn fit(&mut self, image: &Luma<'_>) -> Option<Fit> {
        let placed = self.reference.as_ref()?;
        let begin = self.last.after(placed.turn.back());
        let near = placed.reference.near(image, begin, &Freedom::TURN);
        if near.is_some_and(|fit| !placed.reference.is_faded_in(&fit)) {
            self.searched(true);
            return near;
        }
        if self.pauses() {
            return None;
        }
        let reference = &self.reference.as_ref()?.reference;
        let fit = reference.anywhere(image, &OnceCell::new(), near, (begin, &Freedom::TURN));
        self.searched(fit.is_some());
        fit
    }

    /// True while searches are left out after failures.
    fn pauses(&mut self) -> bool {
        let pauses = self.pause > 0;
        self.pause = self.pause.saturating_sub(1);
        pauses
    }

    fn searched(&mut self, found: bool) {
        if found {
            (self.pause, self.next_pause) = (0, 1);
        } else {
            self.pause = self.next_pause;
            self.next_pause = (2 * self.next_pause).min(MAX_PAUSE);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
