//! Decoded images that outlive the next step of their decoder: one thread decodes a camera's images, a second one searches them.

use std::path::PathBuf;

use ffmpeg_next::format::Pixel;
use ffmpeg_next::frame;

use super::conversion::{Conversion, PicturePart};
use super::{Luma, fault};
use crate::error::Result;

/// A decoded image that is not converted yet.
pub struct DecodedImage {
    coded: frame::Video,
}

impl DecodedImage {
    /// The image in a decoder's frame.
    pub fn of(coded: frame::Video) -> Self {
        Self { coded }
    }

    /// Columns and rows.
    pub fn size_px(&self) -> [u32; 2] {
        [self.coded.width(), self.coded.height()]
    }

    /// Brightness of the image; `None` if it is not coded in planes of bytes.
    pub fn luma(&self) -> Option<Luma<'_>> {
        Luma::of_frame(&self.coded)
    }

    fn form(&self) -> (Pixel, [u32; 2]) {
        (self.coded.format(), self.size_px())
    }
}

/// Converts a view's images or parts to rows of RGB without gaps.
pub struct ImageConverter {
    /// Name of the view, for messages.
    source: PathBuf,
    conversion: Conversion,
    /// Pixels and size of the images that it converts.
    form: Option<(Pixel, [u32; 2])>,
}

impl ImageConverter {
    /// A converter for a source of this name.
    pub fn new(source: impl Into<PathBuf>) -> Self {
        Self {
            source: source.into(),
            conversion: Conversion::default(),
            form: None,
        }
    }

    /// Converts a whole image.
    ///
    /// # Errors
    /// FFmpeg cannot convert such pixels.
    pub fn whole(&mut self, image: &DecodedImage, rgb: &mut Vec<u8>) -> Result<()> {
        let done = self.conversion_of(image).whole(&image.coded, rgb);
        done.map_err(|error| fault(&self.source, "convert an image", error))
    }

    /// Converts a part of the image.
    ///
    /// # Errors
    /// FFmpeg cannot convert such pixels, or the part is not inside the image.
    pub fn part(
        &mut self,
        image: &DecodedImage,
        part: PicturePart,
        rgb: &mut Vec<u8>,
    ) -> Result<()> {
        let done = self.conversion_of(image).part(&image.coded, part, rgb);
        done.map_err(|error| {
            let action = format!("convert the part {part:?} of an image");
            fault(&self.source, &action, error)
        })
    }

    /// A new conversion if the stream has changed its pixels or size.
    fn conversion_of(&mut self, image: &DecodedImage) -> &mut Conversion {
        if self.form.replace(image.form()) != Some(image.form()) {
            self.conversion = Conversion::default();
        }
        &mut self.conversion
    }
}
