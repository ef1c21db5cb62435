//! Pictures that show the aircraft in another place than that of their tick: those of another tick, or of another view.
//!
//! An empty box alone proves nothing, because paint and sky may have the same grey. But if the aircraft stands out where another tick or
//! view has it, the picture is of that one. What stands there in pictures that have the aircraft in their own box, too, is no aircraft.
//! One picture is enough for that conclusion, whereas the share of filled boxes needs several.

use super::Faults;
use super::sight::{DecodedPicture, look};
use crate::pixel_box::PixelBox;

/// Boxes of this many ticks before and after a picture are looked at.
const REACH_TICKS: usize = 32;
/// What stands out there is as clear as that, grey levels ...
const LEAST_CONTRAST: f64 = 10.0;
/// ... and not farther from the middle of the box than this part of its sides.
const LARGEST_OFFSET: f64 = 0.35;
/// A place is that of something else if it is filled in this part of the pictures that have the aircraft in their own box.
const MOST_FILLED: f64 = 0.3;

/// Where the aircraft of a picture should be, if it is a picture of something else.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Other {
    /// The same view at another tick.
    Tick(usize),
    /// Another view at the same tick.
    View(String),
}

/// A picture whose own box is empty, and the place where it shows an aircraft.
#[derive(Debug)]
pub(super) struct Suspect {
    pub(super) tick: usize,
    place: PixelBox,
    other: Other,
    contrast: f64,
    /// Pictures with the aircraft in their own box, and those of them that have something in this place.
    compared: usize,
    filled: usize,
}

impl Suspect {
    /// Looks for the aircraft of a picture in the boxes of other ticks and views. `own`: its true box, which is empty.
    pub(super) fn find(
        picture: &DecodedPicture,
        tick: usize,
        own: &PixelBox,
        others: impl Iterator<Item = (Other, PixelBox)>,
    ) -> Option<Self> {
        let apart = others.filter(|(_, place)| place.iou(own) == 0.0);
        let clear = apart.filter_map(|(other, place)| {
            let sight = look(picture, &place)?;
            let is_central = sight.offset_px.x.abs() <= LARGEST_OFFSET * place.width_px
                && sight.offset_px.y.abs() <= LARGEST_OFFSET * place.height_px;
            let is_clear = sight.is_filled()
                && sight.is_before_smooth()
                && sight.contrast >= LEAST_CONTRAST
                && is_central;
            is_clear.then(|| Self {
                tick,
                place,
                other,
                contrast: sight.contrast,
                compared: 0,
                filled: 0,
            })
        });
        clear.max_by(|a, b| a.contrast.total_cmp(&b.contrast))
    }

    /// The ticks whose boxes are looked at, besides that of the picture.
    pub(super) fn ticks_near(tick: usize, ticks: usize) -> impl Iterator<Item = usize> {
        let near = tick.saturating_sub(REACH_TICKS)..(tick + REACH_TICKS + 1).min(ticks);
        near.filter(move |other| *other != tick)
    }

    /// Compares with a picture that has the aircraft in its own box.
    pub(super) fn compare(&mut self, picture: &DecodedPicture, tick: usize, own: &PixelBox) {
        if tick.abs_diff(self.tick) > 2 * REACH_TICKS || own.iou(&self.place) > 0.0 {
            return;
        }
        if let Some(sight) = look(picture, &self.place) {
            self.compared += 1;
            self.filled += usize::from(!sight.is_empty());
        }
    }

    /// Whether the place belongs to something that is always there.
    fn is_fixture(&self) -> bool {
        self.filled as f64 > MOST_FILLED * self.compared as f64
    }

    /// Reports it, unless what it shows is always there. Returns whether it is a fault.
    pub(super) fn judge(&self, file: &str, view: &str, faults: &mut Faults) -> bool {
        if self.is_fixture() {
            return false;
        }
        let whose = match &self.other {
            Other::Tick(tick) => format!("it is at tick {tick}"),
            Other::View(other) => format!("view {other} has it"),
        };
        let message = format!(
            "its true box is empty, and the aircraft is where {whose}, {:.0} grey levels clear",
            self.contrast
        );
        faults.view_row(view, file, self.tick, "another picture", message);
        true
    }
}
