//! The source `screenshot`: files that X-Plane writes itself, sent unchanged by the plugin.

use std::io::Cursor;

use image::{ImageFormat, ImageReader, Limits};

use super::PixelError;
use crate::link::PictureSize;

/// Red, green, blue from the top left.
pub(super) fn decode(png: Vec<u8>, size: PictureSize) -> Result<Vec<u8>, PixelError> {
    let wrong = |what| PixelError::Unusable(format!("X-Plane's screenshot cannot be used: {what}"));
    let mut reader = ImageReader::with_format(Cursor::new(png), ImageFormat::Png);
    let mut limits = Limits::default();
    limits.max_image_width = Some(size.width_px);
    limits.max_image_height = Some(size.height_px);
    reader.limits(limits);
    let picture = reader.decode().map_err(|error| wrong(error.to_string()))?;
    let found = PictureSize {
        width_px: picture.width(),
        height_px: picture.height(),
    };
    if found == size {
        Ok(picture.into_rgb8().into_raw())
    } else {
        Err(wrong(format!("it has {found} pixels, expected {size}")))
    }
}

#[cfg(test)]
mod tests {
    use image::{ColorType, ExtendedColorType, ImageEncoder};

    use super::*;

    const SIZE: PictureSize = PictureSize {
        width_px: 4,
        height_px: 2,
    };

    fn png(pixels: &[u8], size: PictureSize, colour: ColorType) -> Vec<u8> {
        let mut file = Vec::new();
        image::codecs::png::PngEncoder::new(&mut file)
            .write_image(
                pixels,
                size.width_px,
                size.height_px,
                ExtendedColorType::from(colour),
            )
            .unwrap();
        file
    }

    #[test]
    fn a_file_gives_its_pixels_with_or_without_transparency() {
        let rgb: Vec<u8> = (0..24).collect();
        assert_eq!(decode(png(&rgb, SIZE, ColorType::Rgb8), SIZE).unwrap(), rgb);
        let rgba: Vec<u8> = rgb
            .chunks(3)
            .flat_map(|p| [p[0], p[1], p[2], 255])
            .collect();
        assert_eq!(
            decode(png(&rgba, SIZE, ColorType::Rgba8), SIZE).unwrap(),
            rgb
        );
    }

    #[test]
    fn a_file_of_another_size_or_none_is_refused() {
        let small = PictureSize {
            width_px: 2,
            height_px: 2,
        };
        let message = |png| decode(png, SIZE).unwrap_err().to_string();
        let text = message(png(&[7; 12], small, ColorType::Rgb8));
        assert!(text.contains("2x2") && text.contains("4x2"), "{text}");
        let large = PictureSize {
            width_px: 4,
            height_px: 4_000,
        };
        message(png(&vec![7; 4 * 4_000 * 3], large, ColorType::Rgb8));
        let text = message(b"GIF89a".to_vec());
        assert!(text.contains("screenshot"), "{text}");
    }
}
