//! Single images as JPEG, by FFmpeg's encoder (benches/export_jpeg.py compares it with OpenCV's).

use std::path::Path;

use ffmpeg_next::codec::{Id, context, encoder};
use ffmpeg_next::format::Pixel;
use ffmpeg_next::{Dictionary, Packet, Rational, color, frame};

use crate::error::Result;
use crate::video::{BYTES_PER_PIXEL, fault, start_ffmpeg};

/// The encoder's finest quantiser.
const QUANTISER: &str = "1";
/// Red, green and blue of brightness, blueness and redness in JPEG (BT.601, full range), over 65,536.
const BRIGHTNESS: [i32; BYTES_PER_PIXEL] = [19_595, 38_470, 7_471];
const BLUENESS: [i32; BYTES_PER_PIXEL] = [-11_059, -21_709, 32_768];
const REDNESS: [i32; BYTES_PER_PIXEL] = [32_768, -27_439, -5_329];

/// Changes of brightness, blueness and redness from BT.709 to BT.601 with blueness and redness, over 65,536.
const BRIGHTER: [i32; 2] = [6_657, 12_850];
const BLUER: [i32; 2] = [64_871, -7_252];
const REDDER: [i32; 2] = [-4_748, 64_448];

/// An image as JPEG. `rgb`: rows from top to bottom without gaps. Colours have half the columns and rows, as in the videos. `path` names it
/// in errors.
///
/// # Errors
/// FFmpeg refuses the size, or lacks the encoder.
pub fn jpeg(path: &Path, rgb: &[u8], size_px: [u32; 2]) -> Result<Vec<u8>> {
    let planes = planes_of(rgb, size_px[0] as usize);
    encode(&planes, size_px).map_err(|e| fault(path, "encode it as JPEG", e))
}

/// [`jpeg`] of a decoded image from its planes ([`super::planes`]), without converting it to RGB and back.
pub(in crate::video) fn jpeg_of_planes(
    path: &Path,
    mut planes: Vec<u8>,
    size_px: [u32; 2],
) -> Result<Vec<u8>> {
    let [width, height] = size_px.map(|side| side as usize);
    let (brightness, colours) = planes.split_at_mut(width * height);
    to_bt_601(brightness, colours, width);
    encode(&planes, size_px).map_err(|e| fault(path, "encode it as JPEG", e))
}

/// Encodes planes without gaps: brightness, then blueness and redness.
fn encode(
    planes: &[u8],
    [width_px, height_px]: [u32; 2],
) -> std::result::Result<Vec<u8>, ffmpeg_next::Error> {
    start_ffmpeg();
    let named = encoder::find(Id::MJPEG).ok_or(ffmpeg_next::Error::EncoderNotFound)?;
    let mut video = context::Context::new_with_codec(named).encoder().video()?;
    video.set_width(width_px);
    video.set_height(height_px);
    video.set_format(Pixel::YUVJ420P);
    video.set_color_range(color::Range::JPEG);
    video.set_time_base(Rational(1, 1));
    let mut options = Dictionary::new();
    options.set("qmin", QUANTISER);
    options.set("qmax", QUANTISER);
    let mut encoder = video.open_with(options)?;

    let mut coded = frame::Video::new(Pixel::YUVJ420P, width_px, height_px);
    coded.set_pts(Some(0));
    let mut left = planes;
    for plane in 0..coded.planes() {
        let columns = coded.plane_width(plane) as usize;
        let (levels, others) = left.split_at(columns * coded.plane_height(plane) as usize);
        let stride = coded.stride(plane);
        let rows = coded.data_mut(plane).chunks_mut(stride);
        for (row, levels) in rows.zip(levels.chunks_exact(columns)) {
            row[..columns].copy_from_slice(levels);
        }
        left = others;
    }
    encoder.send_frame(&coded)?;
    encoder.send_eof()?;
    let mut packet = Packet::empty();
    encoder.receive_packet(&mut packet)?;
    Ok(packet.data().unwrap_or_default().to_vec())
}

/// Weighted sum, over 2 to the power of `bits`.
fn level<const N: usize>(weights: [i32; N], values: [i32; N], bits: u32) -> i32 {
    let products = weights
        .iter()
        .zip(values)
        .map(|(weight, value)| weight * value);
    (products.sum::<i32>() + (1 << (bits - 1))) >> bits
}

/// Brightness of each pixel, then both colours of each block of four.
fn planes_of(rgb: &[u8], width: usize) -> Vec<u8> {
    let pixels = rgb.as_chunks::<BYTES_PER_PIXEL>().0.iter();
    let brightness = pixels.map(|pixel| level(BRIGHTNESS, pixel.map(i32::from), 16) as u8);
    let mut planes: Vec<u8> = brightness.collect();
    let row_bytes = width * BYTES_PER_PIXEL;
    let [mut blueness, mut redness] = [Vec::new(), Vec::new()];
    for rows in rgb.chunks(2 * row_bytes) {
        let (upper, lower) = rows.split_at(row_bytes);
        // The last row and column of an odd size count twice.
        let lower = if lower.is_empty() { upper } else { lower };
        let pairs = upper.chunks(2 * BYTES_PER_PIXEL);
        for (upper, lower) in pairs.zip(lower.chunks(2 * BYTES_PER_PIXEL)) {
            let right = upper.len() - BYTES_PER_PIXEL;
            let sums = std::array::from_fn(|i| {
                [upper[i], upper[right + i], lower[i], lower[right + i]]
                    .map(i32::from)
                    .iter()
                    .sum()
            });
            blueness.push((level(BLUENESS, sums, 18) + 128).min(255) as u8);
            redness.push((level(REDNESS, sums, 18) + 128).min(255) as u8);
        }
    }
    planes.extend(blueness);
    planes.extend(redness);
    planes
}

/// Planes in BT.709 to BT.601, in place. Each block of four pixels has one pair of colours.
fn to_bt_601(brightness: &mut [u8], colours: &mut [u8], width: usize) {
    let (blueness, redness) = colours.split_at_mut(colours.len() / 2);
    let columns = width / 2;
    let colours = blueness
        .chunks_exact_mut(columns)
        .zip(redness.chunks_exact_mut(columns));
    let mut brighter = vec![0_i16; width];
    for (rows, (blueness, redness)) in brightness.chunks_exact_mut(2 * width).zip(colours) {
        let pairs = brighter.as_chunks_mut::<2>().0.iter_mut();
        for (brighter, (blue, red)) in pairs.zip(blueness.iter_mut().zip(redness)) {
            let colour = [*blue, *red].map(|level| i32::from(level) - 128);
            *brighter = [level(BRIGHTER, colour, 16) as i16; 2];
            *blue = (level(BLUER, colour, 16) + 128).clamp(0, 255) as u8;
            *red = (level(REDDER, colour, 16) + 128).clamp(0, 255) as u8;
        }
        for row in rows.chunks_exact_mut(width) {
            for (level, brighter) in row.iter_mut().zip(&brighter) {
                *level = (i16::from(*level) + brighter).clamp(0, 255) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ffmpeg_next::codec::decoder;

    use super::*;
    use crate::video::conversion::scaler::Scaler;
    use crate::video::conversion::{Conversion, planes};

    fn decoded(jpeg: &[u8]) -> Vec<u8> {
        let context = context::Context::new_with_codec(decoder::find(Id::MJPEG).unwrap());
        let mut decoder = context.decoder().video().unwrap();
        decoder.send_packet(&Packet::copy(jpeg)).unwrap();
        decoder.send_eof().unwrap();
        let (mut frame, mut rgb) = (frame::Video::empty(), Vec::new());
        decoder.receive_frame(&mut frame).unwrap();
        Conversion::default().whole(&frame, &mut rgb).unwrap();
        rgb
    }

    #[test]
    fn pictures_keep_their_colours_within_some_levels_from_rgb_and_from_planes() {
        let (path, odd, even) = (Path::new("test"), [37, 23], [36, 24]);
        let rgb = |[width, height]: [u32; 2]| -> Vec<u8> {
            let pixel = |i: u32| [i % width * 3, i / width * 5, 200 - i % width];
            (0..width * height)
                .flat_map(pixel)
                .map(|level| level as u8)
                .collect()
        };
        let mut coded = frame::Video::new(Pixel::YUVJ420P, even[0], even[1]);
        let mut scaler = Scaler::from_rgb(Pixel::YUVJ420P, even[0], even[1], true).unwrap();
        scaler.run_rgb(&rgb(even), &mut coded).unwrap();
        coded.set_color_space(color::Space::BT709);
        coded.set_color_range(color::Range::JPEG);
        let planes = planes(&coded).unwrap();
        for (jpeg, expected) in [
            (jpeg(path, &rgb(odd), odd), rgb(odd)),
            (jpeg_of_planes(path, planes, even), rgb(even)),
        ] {
            let found = decoded(&jpeg.unwrap());
            assert_eq!(found.len(), expected.len());
            let off = found.iter().zip(&expected).map(|(a, b)| a.abs_diff(*b));
            // Colours differ from column to column, and blocks of four share theirs.
            assert!(off.clone().max() <= Some(12), "{:?}", off.max());
            let mean = off.map(f64::from).sum::<f64>() / expected.len() as f64;
            assert!(mean < 2.5, "{mean}");
        }
    }
}
