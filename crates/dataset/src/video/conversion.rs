//! Conversion of decoded images or parts to RGB, and of images to JPEG ([`jpeg`]).
//!
//! A part is copied out of the planes and converted separately, with the settings of the whole image: if only one small aircraft is of
//! interest, 97 % of the pixels are never converted.

pub(crate) mod jpeg;
pub(crate) mod luma;
pub(crate) mod scaler;

use ffmpeg_next::format::Pixel;
use ffmpeg_next::software::scaling::Flags;
use ffmpeg_next::{color, frame};

use super::BYTES_PER_PIXEL;
use scaler::{Matrix, Scaler};

/// A rectangle of whole pixels in an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PicturePart {
    /// Column of the left-most pixels.
    pub left_px: u32,
    /// Row of the top-most pixels.
    pub top_px: u32,
    /// Number of columns.
    pub width_px: u32,
    /// Number of rows.
    pub height_px: u32,
}

/// Pixels that are converted around a part: interpolated colour reaches across its border.
const MARGIN_PX: u32 = 8;
/// Sides of converted parts are multiples of this, so that few converters serve parts of many sizes.
const SIDE_STEP_PX: u32 = 64;
/// Two neighbouring pixels may share their colour.
const SHARED_PX: u32 = 2;
/// Converters that are kept: more sizes than a flight's parts have.
const MAX_CONVERTERS: usize = 16;

/// Converts a video's images.
#[derive(Default)]
pub(super) struct Conversion {
    whole: Option<Converter>,
    parts: Vec<(Converter, frame::Video)>,
}

/// Converts images with the same size.
struct Converter {
    scaler: Scaler,
    rgb: frame::Video,
}

impl Conversion {
    /// The whole image as rows of RGB without gaps.
    pub(super) fn whole(
        &mut self,
        coded: &frame::Video,
        rgb: &mut Vec<u8>,
    ) -> Result<(), ffmpeg_next::Error> {
        let size = (coded.width(), coded.height());
        let converter = match &mut self.whole {
            Some(converter) => converter,
            none => none.insert(Converter::new(coded, size)?),
        };
        converter.scaler.run(coded, &mut converter.rgb)?;
        rgb.clear();
        copy_rows(&converter.rgb, (0, 0), size, rgb);
        Ok(())
    }

    /// Converts a part, which must be inside the image.
    pub(super) fn part(
        &mut self,
        coded: &frame::Video,
        part: PicturePart,
        rgb: &mut Vec<u8>,
    ) -> Result<(), ffmpeg_next::Error> {
        let (left, width) = around(part.left_px, part.width_px, coded.width())?;
        let (top, height) = around(part.top_px, part.height_px, coded.height())?;
        if !has_planes_of_bytes(coded.format()) {
            self.whole(coded, rgb)?;
            cut(rgb, coded.width() as usize, part);
            return Ok(());
        }
        let index = self.converter(coded, (width, height))?;
        let (converter, copy) = &mut self.parts[index];
        copy_planes(coded, (left, top), copy);
        converter.scaler.run(copy, &mut converter.rgb)?;
        rgb.clear();
        let inside = (part.left_px - left, part.top_px - top);
        copy_rows(&converter.rgb, inside, (part.width_px, part.height_px), rgb);
        Ok(())
    }

    /// The converter of parts of this size.
    fn converter(
        &mut self,
        coded: &frame::Video,
        (width, height): (u32, u32),
    ) -> Result<usize, ffmpeg_next::Error> {
        let known = |(_, copy): &(Converter, frame::Video)| {
            (copy.format(), copy.width(), copy.height()) == (coded.format(), width, height)
        };
        if let Some(index) = self.parts.iter().position(known) {
            return Ok(index);
        }
        if self.parts.len() == MAX_CONVERTERS {
            self.parts.clear();
        }
        let converter = Converter::new(coded, (width, height))?;
        let copy = frame::Video::new(coded.format(), width, height);
        self.parts.push((converter, copy));
        Ok(self.parts.len() - 1)
    }
}

impl Converter {
    /// For images of this size, coded like the given one.
    fn new(coded: &frame::Video, (width, height): (u32, u32)) -> Result<Self, ffmpeg_next::Error> {
        let matrix = match coded.color_space() {
            color::Space::BT470BG | color::Space::SMPTE170M => Matrix::Bt601,
            _ => Matrix::Bt709,
        };
        let full_range = coded.color_range() == color::Range::JPEG;
        // Without exact rounding swscale uses a path that is six times faster and off by at most two grey levels.
        let scaler = Scaler::new(
            (coded.format(), Pixel::RGB24),
            width,
            height,
            Flags::BILINEAR,
            matrix,
            full_range,
        )?;
        Ok(Self {
            scaler,
            rgb: frame::Video::new(Pixel::RGB24, width, height),
        })
    }
}

/// Start and length of the converted range for a part, along one side of the image.
fn around(start: u32, length: u32, picture: u32) -> Result<(u32, u32), ffmpeg_next::Error> {
    let is_inside = length > 0 && u64::from(start) + u64::from(length) <= u64::from(picture);
    if !is_inside {
        return Err(ffmpeg_next::Error::InvalidData);
    }
    let wide = (length + 2 * MARGIN_PX + SHARED_PX).next_multiple_of(SIDE_STEP_PX);
    if wide >= picture || !picture.is_multiple_of(SHARED_PX) {
        return Ok((0, picture));
    }
    let from = start.saturating_sub(MARGIN_PX).min(picture - wide);
    Ok((from - from % SHARED_PX, wide))
}

/// Planar formats with one byte per sample.
pub(super) fn has_planes_of_bytes(format: Pixel) -> bool {
    matches!(
        format,
        Pixel::YUV420P
            | Pixel::YUVJ420P
            | Pixel::YUV422P
            | Pixel::YUVJ422P
            | Pixel::YUV444P
            | Pixel::YUVJ444P
            | Pixel::GBRP
    )
}

/// An image's three planes, one after the other without gaps, if they are as all images of the lossy codecs: 8 bits, two by two pixels that
/// share their colour, BT.709, full range.
pub(super) fn planes(coded: &frame::Video) -> Option<Vec<u8>> {
    let is_usual = matches!(coded.format(), Pixel::YUV420P | Pixel::YUVJ420P)
        && coded.color_space() == color::Space::BT709
        && coded.color_range() == color::Range::JPEG
        && coded.width().is_multiple_of(SHARED_PX)
        && coded.height().is_multiple_of(SHARED_PX);
    if !is_usual {
        return None;
    }
    let mut planes = Vec::with_capacity(coded.width() as usize * coded.height() as usize * 3 / 2);
    for plane in 0..coded.planes() {
        let rows = coded.data(plane).chunks(coded.stride(plane));
        for row in rows.take(coded.plane_height(plane) as usize) {
            planes.extend_from_slice(&row[..coded.plane_width(plane) as usize]);
        }
    }
    Some(planes)
}

/// Copies the image part that begins at (left, top) and has the size of `copy`.
fn copy_planes(coded: &frame::Video, (left, top): (u32, u32), copy: &mut frame::Video) {
    for plane in 0..coded.planes().min(copy.planes()) {
        let width = copy.plane_width(plane) as usize;
        // Of the chroma planes, two or one columns or rows belong to two of the image.
        let column = (left / (copy.width() / copy.plane_width(plane))) as usize;
        let row = (top / (copy.height() / copy.plane_height(plane))) as usize;
        let (from_stride, to_stride) = (coded.stride(plane), copy.stride(plane));
        let rows = coded.data(plane)[row * from_stride..].chunks(from_stride);
        for (to, from) in copy.data_mut(plane).chunks_mut(to_stride).zip(rows) {
            to[..width].copy_from_slice(&from[column..column + width]);
        }
    }
}

/// Appends the part's rows of the RGB frame.
fn copy_rows(
    from: &frame::Video,
    (left, top): (u32, u32),
    (width, height): (u32, u32),
    rgb: &mut Vec<u8>,
) {
    let bytes = |pixels: u32| pixels as usize * BYTES_PER_PIXEL;
    rgb.reserve(bytes(width) * height as usize);
    let rows = from.data(0).chunks_exact(from.stride(0));
    for row in rows.skip(top as usize).take(height as usize) {
        rgb.extend_from_slice(&row[bytes(left)..bytes(left + width)]);
    }
}

/// Keeps a part of the image with this width.
fn cut(rgb: &mut Vec<u8>, width_px: usize, part: PicturePart) {
    let row_bytes = part.width_px as usize * BYTES_PER_PIXEL;
    for row in 0..part.height_px as usize {
        let pixel = (part.top_px as usize + row) * width_px + part.left_px as usize;
        let from = pixel * BYTES_PER_PIXEL;
        rgb.copy_within(from..from + row_bytes, row * row_bytes);
    }
    rgb.truncate(row_bytes * part.height_px as usize);
}
