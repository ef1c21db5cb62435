//! Image crops inside a page, with boxes around the aircraft.

use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use dataset::tables::pixel_box::PixelBox;
use image::{ImageFormat, RgbImage};
use serde::Serialize;

use crate::error::{Error, Result};

/// Aspect ratio of a crop.
const ASPECT: f64 = 1.5;
/// Minimum crop width, px, unless the box needs more.
const MIN_WIDTH_PX: f64 = 96.0;
/// Crop width as a multiple of the box width.
const SURROUNDINGS: f64 = 2.5;
/// Distance between a box and the line around it, over the width of the crop: a line on the box would cover a small aircraft.
const GAP: f64 = 0.015;

/// An image region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Left-most column and top-most row.
    pub start_px: [u32; 2],
    /// Columns and rows.
    pub size_px: [u32; 2],
}

impl Part {
    /// The region around a box, in an image with this width and height.
    pub fn around(shown: &PixelBox, [picture_width, picture_height]: [u32; 2]) -> Self {
        let needed = SURROUNDINGS * shown.width_px.max(shown.height_px * ASPECT);
        let width = needed.max(MIN_WIDTH_PX).min(f64::from(picture_width)) as u32;
        let height = ((f64::from(width) / ASPECT) as u32).min(picture_height);
        let start = |centre: f64, length: u32, picture: u32| {
            (centre - f64::from(length) / 2.0).clamp(0.0, f64::from(picture - length)) as u32
        };
        Self {
            start_px: [
                start(shown.cx_px, width, picture_width),
                start(shown.cy_px, height, picture_height),
            ],
            size_px: [width, height],
        }
    }

    /// The whole image.
    pub fn whole(picture_size: [u32; 2]) -> Self {
        Self {
            start_px: [0, 0],
            size_px: picture_size,
        }
    }

    /// Copies the region's pixels; the image has RGB rows without gaps.
    pub fn cut(&self, rgb: &[u8], picture_width: u32) -> RgbImage {
        let ([left, top], [width, height]) = (self.start_px, self.size_px);
        RgbImage::from_fn(width, height, |x, y| {
            let pixel = ((top + y) as usize * picture_width as usize + (left + x) as usize) * 3;
            image::Rgb([rgb[pixel], rgb[pixel + 1], rgb[pixel + 2]])
        })
    }
}

/// The image around a box.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Crop {
    /// PNG, as a `data:` address.
    pub source: String,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Left-most column and top-most row in the image.
    #[serde(skip)]
    start_px: [u32; 2],
}

impl Crop {
    /// Crops an image with this width and height: RGB rows without gaps.
    ///
    /// # Errors
    /// The PNG cannot be written.
    pub fn around(shown: &PixelBox, rgb: &[u8], picture_size: [u32; 2]) -> Result<Self> {
        let part = Part::around(shown, picture_size);
        let mut png = Cursor::new(Vec::new());
        part.cut(rgb, picture_size[0])
            .write_to(&mut png, ImageFormat::Png)
            .map_err(Error::Crop)?;
        let png = STANDARD.encode(png.into_inner());
        let [width_px, height_px] = part.size_px;
        Ok(Self {
            source: format!("data:image/png;base64,{png}"),
            width_px,
            height_px,
            start_px: part.start_px,
        })
    }

    /// Left, top, width and height of the line around a box of the image, pixels from the crop's corner.
    pub fn frame_of(&self, pixel_box: &PixelBox) -> [f64; 4] {
        let gap = GAP * f64::from(self.width_px);
        let [left, top, width, height] = self.place_of(pixel_box);
        [left - gap, top - gap, width + 2.0 * gap, height + 2.0 * gap]
    }

    /// Left, top, width and height of a box in the crop, pixels from the crop's corner.
    fn place_of(&self, pixel_box: &PixelBox) -> [f64; 4] {
        let [left, top, ..] = pixel_box.edges();
        // The corner of the first pixel is half a pixel before its centre.
        let [x, y] = self.start_px.map(|start| f64::from(start) - 0.5);
        [left - x, top - y, pixel_box.width_px, pixel_box.height_px]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crop_lies_inside_the_picture_and_has_the_box_where_the_pixels_are() {
        let (width, height) = (300, 200);
        let mut rgb = vec![0; width * height * 3];
        for (x, y) in (100..=120).flat_map(|x| (41..=47).map(move |y| (x, y))) {
            rgb[(y * width + x) * 3] = 255;
        }
        let shown = PixelBox::from_edges(100.0, 40.0, 120.0, 47.0);
        let crop = Crop::around(&shown, &rgb, [300, 200]).unwrap();
        assert_eq!((crop.width_px, crop.height_px), (96, 64));
        let png = crop.source.strip_prefix("data:image/png;base64,").unwrap();
        let pixels = image::load_from_memory(&STANDARD.decode(png).unwrap());
        let pixels = pixels.unwrap().to_rgb8();
        let [left, top, width_px, height_px] = crop.place_of(&shown);
        let (right, bottom) = (left + width_px, top + height_px);
        let at = |x: f64, y: f64| pixels.get_pixel(x as u32, y as u32).0[0];
        assert_eq!(
            (at(left + 1.0, top + 1.0), at(right - 1.0, bottom - 1.0)),
            (255, 255)
        );
        assert_eq!((at(left - 2.0, top), at(right + 2.0, bottom - 1.0)), (0, 0));
        let [frame_left, frame_top, frame_width, frame_height] = crop.frame_of(&shown);
        assert!(frame_left < left - 1.0 && frame_top < top - 1.0);
        assert!(frame_left + frame_width > right + 1.0 && frame_top + frame_height > bottom + 1.0);
        let wide = PixelBox::from_edges(0.0, 0.0, 400.0, 10.0);
        let whole = Crop::around(&wide, &rgb, [300, 200]).unwrap();
        assert_eq!((whole.width_px, whole.height_px), (300, 200));
    }
}
