//! Converts screen pixels to red, green, blue. Only formats with exactly these are supported: values are not converted.

use ffmpeg_next::format::Pixel;
use ffmpeg_next::frame;

use crate::pixels::{PixelError, Rectangle, RgbPicture};

/// Bytes per pixel, and the offsets of red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PixelForm {
    bytes: usize,
    rgb: [usize; 3],
}

impl PixelForm {
    fn of(pixel: Pixel) -> Result<Self, PixelError> {
        let (bytes, rgb) = match pixel {
            Pixel::BGRZ | Pixel::BGRA => (4, [2, 1, 0]),
            Pixel::RGBZ | Pixel::RGBA => (4, [0, 1, 2]),
            Pixel::ZRGB | Pixel::ARGB => (4, [1, 2, 3]),
            Pixel::ZBGR | Pixel::ABGR => (4, [3, 2, 1]),
            Pixel::RGB24 => (3, [0, 1, 2]),
            Pixel::BGR24 => (3, [2, 1, 0]),
            other => {
                return Err(PixelError::Setup(format!(
                    "the screen has pixels of the form {other:?}, expected 8 bits each of red, green, blue: set it to 24-bit colour"
                )));
            }
        };
        Ok(Self { bytes, rgb })
    }
}

/// Copies a grabbed frame, or a part, into an image.
pub(super) fn copy(
    frame: &frame::Video,
    part: Option<Rectangle>,
    picture: &mut RgbPicture,
) -> Result<(), PixelError> {
    let source = Source::of(frame, part)?;
    let Rectangle {
        width_px,
        height_px,
        ..
    } = source.part;
    picture.resize(width_px, height_px);
    for y in 0..height_px {
        source.copy(0, y, picture.pixels_mut(0, width_px, y));
    }
    Ok(())
}

/// [`copy`] that separates margin and inside: once over the bytes instead of twice.
pub(super) fn copy_inside(
    frame: &frame::Video,
    part: Option<Rectangle>,
    margin_px: u32,
    (margins, inside): (&mut RgbPicture, &mut Vec<u8>),
) -> Result<(), PixelError> {
    let source = Source::of(frame, part)?;
    let Rectangle {
        width_px,
        height_px,
        ..
    } = source.part;
    let rest = source.part.inside(margin_px);
    margins.resize(width_px, height_px);
    inside.resize(rest.size().rgb_bytes(), 0);
    let mut rows = inside
        .as_chunks_mut::<3>()
        .0
        .chunks_exact_mut(rest.width_px.max(1) as usize);
    for y in 0..height_px {
        let is_margin = y < margin_px || y >= height_px - margin_px;
        let row = if is_margin { None } else { rows.next() };
        let Some(row) = row else {
            source.copy(0, y, margins.pixels_mut(0, width_px, y));
            continue;
        };
        source.copy(0, y, margins.pixels_mut(0, margin_px, y));
        source.copy(margin_px, y, row);
        let right = width_px - margin_px;
        source.copy(right, y, margins.pixels_mut(right, width_px, y));
    }
    Ok(())
}

/// Part of a grabbed frame.
struct Source<'a> {
    form: PixelForm,
    data: &'a [u8],
    stride: usize,
    part: Rectangle,
}

impl<'a> Source<'a> {
    fn of(frame: &'a frame::Video, part: Option<Rectangle>) -> Result<Self, PixelError> {
        let (width_px, height_px) = (frame.width(), frame.height());
        let part = part.unwrap_or(Rectangle::between(0, 0, width_px, height_px));
        if part.right_px() > width_px || part.bottom_px() > height_px {
            let what = format!("{part} is outside the screen, {width_px}x{height_px}");
            return Err(PixelError::grab(what));
        }
        Ok(Self {
            form: PixelForm::of(frame.format())?,
            data: frame.data(0),
            stride: frame.stride(0),
            part,
        })
    }

    /// Copies pixels of a row, from a column on.
    fn copy(&self, x_px: u32, y_px: u32, pixels: &mut [[u8; 3]]) {
        let left = (self.part.x_px + x_px) as usize * self.form.bytes;
        let row = (self.part.y_px + y_px) as usize * self.stride + left;
        let length = pixels.len() * self.form.bytes;
        copy_row(self.form, &self.data[row..row + length], pixels);
    }
}

fn copy_row(form: PixelForm, row: &[u8], pixels: &mut [[u8; 3]]) {
    match form {
        // The format of X11 and Windows, written out for the optimiser: a third of the time.
        PixelForm {
            bytes: 4,
            rgb: [2, 1, 0],
        } => {
            for ([blue, green, red, _], pixel) in row.as_chunks().0.iter().zip(pixels) {
                *pixel = [*red, *green, *blue];
            }
        }
        PixelForm { bytes, rgb } => {
            for (source, pixel) in row.chunks_exact(bytes).zip(pixels) {
                *pixel = rgb.map(|at| source[at]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_gives_the_same_picture_and_the_part_is_cut_out() {
        let forms = [
            (Pixel::BGRZ, vec![3, 2, 1, 0]),
            (Pixel::RGBA, vec![1, 2, 3, 255]),
            (Pixel::ZRGB, vec![0, 1, 2, 3]),
            (Pixel::ABGR, vec![255, 3, 2, 1]),
            (Pixel::RGB24, vec![1, 2, 3]),
            (Pixel::BGR24, vec![3, 2, 1]),
        ];
        for (pixel, bytes) in forms {
            let mut frame = frame::Video::new(pixel, 5, 4);
            frame.data_mut(0).fill(77);
            let at = 2 * frame.stride(0) + 3 * bytes.len();
            frame.data_mut(0)[at..at + bytes.len()].copy_from_slice(&bytes);
            let mut picture = RgbPicture::default();
            let part = Rectangle::between(2, 1, 4, 3);
            copy(&frame, Some(part), &mut picture).unwrap();
            assert_eq!((picture.width_px, picture.height_px), (2, 2));
            assert_eq!(
                picture.rgb,
                [77, 77, 77, 77, 77, 77, 77, 77, 77, 1, 2, 3],
                "{pixel:?}"
            );
        }
    }

    #[test]
    fn a_frame_copied_in_two_is_the_frame_copied_whole() {
        let mut frame = frame::Video::new(Pixel::BGRZ, 9, 8);
        for (at, byte) in frame.data_mut(0).iter_mut().enumerate() {
            *byte = at as u8;
        }
        let part = Some(Rectangle::between(1, 1, 8, 7));
        let (mut whole, mut margins) = (RgbPicture::default(), RgbPicture::default());
        let mut inside = vec![7; 500];
        copy(&frame, part, &mut whole).unwrap();
        copy_inside(&frame, part, 2, (&mut margins, &mut inside)).unwrap();
        assert_eq!(inside.len(), 3 * 2 * 3);
        for (row, inside) in (2..4).zip(inside.as_chunks::<3>().0.chunks_exact(3)) {
            assert_eq!(inside, whole.pixels(2, 5, row));
            margins.pixels_mut(2, 5, row).copy_from_slice(inside);
        }
        assert_eq!(margins, whole);
    }

    #[test]
    fn forms_without_eight_bits_of_each_colour_and_parts_outside_are_refused() {
        let mut picture = RgbPicture::default();
        let coarse = frame::Video::new(Pixel::RGB565LE, 4, 4);
        let message = copy(&coarse, None, &mut picture).unwrap_err().to_string();
        assert!(
            message.contains("RGB565LE") && message.contains("24-bit"),
            "{message}"
        );
        let small = frame::Video::new(Pixel::BGRZ, 4, 4);
        let outside = Some(Rectangle::between(2, 0, 6, 4));
        assert!(copy(&small, outside, &mut picture).is_err());
    }
}
