//! Images that repeat an earlier one though the aircraft moved.

use super::MIN_MOTION_PX;
use super::sight::{BoxContent, DecodedPicture, MIN_CONTRAST, change_between};
use dataset::tables::pixel_box::PixelBox;

/// An image equals an earlier one if the change where the aircraft is, is less than this part of the contrast, and is frozen if the
/// aircraft has moved by [`MIN_MOTION_PX`].
const MAX_CHANGE_OF_CONTRAST: f64 = 0.15;
/// The image that the following ones are compared with, until the aircraft has moved by [`MIN_MOTION_PX`].
#[derive(Default)]
pub(super) struct Reference(Option<Anchor>);

struct Anchor {
    tick: usize,
    rgb: Vec<u8>,
    place: PixelBox,
    contrast: f64,
}

impl Reference {
    /// The tick of the earlier image that this one repeats and the way of the aircraft since then in pixels, if it moved far enough for
    /// motion to be visible. `own`: the ground-truth box, `sight`: its content, `would_be_seen`: whether neither air nor clouds hide the
    /// aircraft.
    pub(super) fn repeated(
        &mut self,
        tick: usize,
        picture: &DecodedPicture,
        own: &PixelBox,
        sight: Option<BoxContent>,
        would_be_seen: bool,
    ) -> Option<(usize, f64)> {
        let moved = self.0.as_ref().map(|anchor| {
            let moved_px = (own.cx_px - anchor.place.cx_px).hypot(own.cy_px - anchor.place.cy_px);
            (anchor, moved_px)
        });
        if moved.is_some_and(|(_, moved_px)| moved_px < MIN_MOTION_PX) {
            return None;
        }
        // Only where motion would be visible. Farther on than its width, what stands still may be a building before an aircraft in fog.
        let could_be_frozen =
            |moved_px: f64| sight.is_some() && (moved_px <= own.width_px || would_be_seen);
        let repeated = moved
            .filter(|(_, moved_px)| could_be_frozen(*moved_px))
            .and_then(|(anchor, moved_px)| {
                let before = picture.of_same_size(&anchor.rgb);
                let change_of = |was, is| change_between(&before, picture, was, is);
                let change = if moved_px <= own.width_px {
                    change_of(&anchor.place, own)?
                } else {
                    // The sky between the two places would hide the change.
                    change_of(&anchor.place, &anchor.place)?.max(change_of(own, own)?)
                };
                (change < MAX_CHANGE_OF_CONTRAST * anchor.contrast)
                    .then_some((anchor.tick, moved_px))
            });
        let contrast = sight
            .filter(BoxContent::is_filled)
            .map_or(0.0, |sight| sight.contrast);
        if repeated.is_some() || contrast < MIN_CONTRAST {
            // A frozen image need not show the aircraft in this box: the image that it repeats stays the reference.
            if repeated.is_none() {
                self.0 = None;
            }
            return repeated;
        }
        let mut rgb = self.0.take().map_or_else(Vec::new, |anchor| anchor.rgb);
        rgb.clear();
        rgb.extend_from_slice(picture.bytes());
        self.0 = Some(Anchor {
            tick,
            rgb,
            place: *own,
            contrast,
        });
        None
    }
}
