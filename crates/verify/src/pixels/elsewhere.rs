//! Images that show the aircraft at a different tick's or view's place.
//!
//! An empty box alone proves nothing, because paint and sky may have the same grey. But if the aircraft stands out where a different tick
//! or view has it, the image is from there. Objects that are there even in images with the aircraft in their own box are not the aircraft.
//! One image is enough for that conclusion, whereas the share of filled boxes needs several.

use super::sight::{DecodedPicture, MIN_CONTRAST, look};
use crate::faults::Faults;
use dataset::tables::pixel_box::PixelBox;

/// Boxes of this many ticks before and after an image are looked at.
const REACH_TICKS: usize = 32;
/// Maximum distance of the object from the box's middle, as a part of the sides.
const MAX_OFFSET: f64 = 0.35;
/// A place belongs to a fixture if it is filled in more than this share of the images that have the aircraft in their own box.
const MAX_FILLED: f64 = 0.3;

/// Place where an image's aircraft should be, if it is an image of something else.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Other {
    /// A different tick of the same view.
    Tick(usize),
    /// A different view at the same tick.
    View(String),
}

/// An image whose own box is empty, and the place where it shows an aircraft.
#[derive(Debug)]
pub(super) struct Suspect {
    pub(super) tick: usize,
    place: PixelBox,
    other: Other,
    contrast: f64,
    /// Number of images with the aircraft in their own box, and of those filled in this place.
    compared: usize,
    filled: usize,
}

impl Suspect {
    /// Looks for an image's aircraft in the boxes of other ticks and views. `own`: its ground-truth box, which is empty.
    pub(super) fn find(
        picture: &DecodedPicture,
        tick: usize,
        own: &PixelBox,
        others: impl Iterator<Item = (Other, PixelBox)>,
    ) -> Option<Self> {
        let apart = others.filter(|(_, place)| place.iou(own) == 0.0);
        let clear = apart.filter_map(|(other, place)| {
            let sight = look(picture, &place)?;
            let is_central = sight.offset_px.x.abs() <= MAX_OFFSET * place.width_px
                && sight.offset_px.y.abs() <= MAX_OFFSET * place.height_px;
            let is_clear = sight.is_filled()
                && sight.is_before_smooth()
                && sight.contrast >= MIN_CONTRAST
                && is_central;
            is_clear.then_some(Self {
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

    /// Ticks near the image's own, whose boxes are searched for its aircraft.
    pub(super) fn ticks_near(tick: usize, ticks: usize) -> impl Iterator<Item = usize> {
        let near = tick.saturating_sub(REACH_TICKS)..(tick + REACH_TICKS + 1).min(ticks);
        near.filter(move |other| *other != tick)
    }

    /// Compares with an image that has the aircraft in its own box.
    pub(super) fn compare(&mut self, picture: &DecodedPicture, tick: usize, own: &PixelBox) {
        if tick.abs_diff(self.tick) > 2 * REACH_TICKS || own.iou(&self.place) > 0.0 {
            return;
        }
        if let Some(sight) = look(picture, &self.place) {
            self.compared += 1;
            self.filled += usize::from(!sight.is_empty());
        }
    }

    /// True if the place belongs to something that is always there.
    fn is_fixture(&self) -> bool {
        self.filled as f64 > MAX_FILLED * self.compared as f64
    }

    /// Reports it, unless the object is always there. Returns whether it is a fault.
    pub(super) fn judge(&self, file: &str, view: &str, faults: &mut Faults) -> bool {
        if self.is_fixture() {
            return false;
        }
        let whose = match &self.other {
            Other::Tick(tick) => format!("it is at tick {tick}"),
            Other::View(other) => format!("view {other} has it"),
        };
        let message = format!(
            "its ground-truth box is empty, and the aircraft is where {whose}, {:.0} grey levels clear",
            self.contrast
        );
        faults.view_row(view, file, self.tick, "another image", message);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: u32 = 96;

    /// An even sky with dark bars of 10 x 3 pixels.
    fn picture(bars: &[PixelBox]) -> Vec<u8> {
        let mut rgb = Vec::new();
        for y in 0..SIZE {
            for x in 0..SIZE {
                let is_in = |bar: &PixelBox| {
                    (f64::from(x) - bar.cx_px).abs() <= bar.width_px / 2.0
                        && (f64::from(y) - bar.cy_px).abs() <= bar.height_px / 2.0
                };
                let grain = (x * 7_919 + y * 104_729) % 3;
                let grey = if bars.iter().any(is_in) { 100 } else { 140 };
                rgb.extend([(grey + grain) as u8; 3]);
            }
        }
        rgb
    }

    fn place(cx_px: f64, cy_px: f64) -> PixelBox {
        PixelBox {
            cx_px,
            cy_px,
            width_px: 11.0,
            height_px: 4.0,
        }
    }

    /// Faults if an image should show the aircraft at the first of three places and shows it at the second, beside images that show it at
    /// the third and these bars.
    fn found(shown: &[PixelBox], besides: &[PixelBox]) -> Vec<String> {
        let [own, other, third] = [place(20.0, 20.0), place(50.0, 30.0), place(70.0, 70.0)];
        let rgb = picture(shown);
        let seen = DecodedPicture::new(&rgb, SIZE, SIZE);
        let places = [(Other::Tick(3), other), (Other::View("left".into()), third)];
        let mut faults = Faults::of_scenario("0001");
        if let Some(mut suspect) = Suspect::find(&seen, 5, &own, places.into_iter()) {
            let rgb = picture(&[&[third][..], besides].concat());
            suspect.compare(&DecodedPicture::new(&rgb, SIZE, SIZE), 6, &third);
            suspect.judge("views/right.mp4", "right", &mut faults);
        }
        let findings = faults.into_findings().into_iter();
        findings.map(|finding| finding.to_string()).collect()
    }

    #[test]
    fn a_picture_with_the_aircraft_of_another_tick_or_view_is_named_with_it() {
        for (shown, whose) in [
            (place(50.0, 30.0), "where it is at tick 3"),
            (place(70.0, 70.0), "where view left has it"),
        ] {
            let faults = found(&[shown], &[]);
            assert_eq!(faults.len(), 1, "{faults:?}");
            let expected = "0001/views/right.mp4 row 5 view right: another image";
            assert!(
                faults[0].starts_with(expected) && faults[0].contains(whose),
                "{faults:?}"
            );
        }
    }

    #[test]
    fn an_empty_sky_and_what_is_always_there_are_no_faults() {
        assert_eq!(found(&[], &[]), Vec::<String>::new());
        let mast = place(50.0, 30.0);
        assert_eq!(found(&[mast], &[mast]), Vec::<String>::new());
    }
}
