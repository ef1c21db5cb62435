//! Decoded images from files and cameras, as the search uses them.

use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::NoShift;
use dataset::video::{Luma, PicturePart};

use crate::detector::PictureView;
use crate::error::Result;
use crate::registration::Patch;

/// A decoded image, converted as far as it is looked at.
pub trait Image {
    /// Columns and rows.
    fn size_px(&self) -> [u32; 2];

    /// The whole image as RGB.
    fn whole(&mut self) -> Result<PictureView<'_>>;

    /// A part as RGB.
    fn part(&mut self, part: PicturePart) -> Result<PictureView<'_>>;

    /// The brightness of the image before, and of this one; `None` if it is not coded in planes of bytes.
    fn lumas(&self) -> [Option<Luma<'_>>; 2];
}

/// The surroundings of the best box.
pub(crate) fn patch(
    image: &mut dyn Image,
    best: Option<PixelBox>,
) -> Result<std::result::Result<Patch, NoShift>> {
    let Some(pixel_box) = best else {
        return Ok(Err(NoShift::NoBox));
    };
    let part = match Patch::part_around(pixel_box, image.size_px()) {
        Ok(part) => part,
        Err(reason) => return Ok(Err(reason)),
    };
    let pixels = image.part(part)?;
    Ok(Ok(Patch::of(&pixels, part, pixel_box)))
}
