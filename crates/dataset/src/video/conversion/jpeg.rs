//! Single images as JPEG, by FFmpeg's encoder, which is several times faster than the one of `image`.

use std::path::Path;

use ffmpeg_next::codec::{Id, context, encoder};
use ffmpeg_next::format::Pixel;
use ffmpeg_next::{Dictionary, Packet, Rational, color, frame};

use crate::error::Result;
use crate::video::{BYTES_PER_PIXEL, fault, start_ffmpeg};

/// The encoder's finest quantiser: grey levels change by 0.3 on average and by 6 at most, as with quality 95 of libjpeg.
const QUANTISER: &str = "1";
/// Red, green and blue of brightness, blueness and redness in JPEG (BT.601, full range), over 65,536.
const BRIGHTNESS: [i32; BYTES_PER_PIXEL] = [19_595, 38_470, 7_471];
const BLUENESS: [i32; BYTES_PER_PIXEL] = [-11_059, -21_709, 32_768];
const REDNESS: [i32; BYTES_PER_PIXEL] = [32_768, -27_439, -5_329];

/// An image as JPEG. `rgb`: rows from top to bottom without gaps. Colours have half the columns and rows, as in the videos. `path` names it
/// in errors.
///
/// # Errors
/// FFmpeg refuses the size, or lacks the encoder.
pub fn jpeg(path: &Path, rgb: &[u8], size_px: [u32; 2]) -> Result<Vec<u8>> {
    start_ffmpeg();
    encode(rgb, size_px).map_err(|e| fault(path, "encode it as JPEG", e))
}

fn encode(
    rgb: &[u8],
    [width_px, height_px]: [u32; 2],
) -> std::result::Result<Vec<u8>, ffmpeg_next::Error> {
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
    let width = width_px as usize;
    for (plane, levels) in planes_of(rgb, width).iter().enumerate() {
        let columns = if plane == 0 { width } else { width.div_ceil(2) };
        let stride = coded.stride(plane);
        let rows = coded.data_mut(plane).chunks_mut(stride);
        for (row, levels) in rows.zip(levels.chunks_exact(columns)) {
            row[..columns].copy_from_slice(levels);
        }
    }
    encoder.send_frame(&coded)?;
    encoder.send_eof()?;
    let mut packet = Packet::empty();
    encoder.receive_packet(&mut packet)?;
    Ok(packet.data().unwrap_or_default().to_vec())
}

/// Brightness of each pixel, then both colours of each block of four.
fn planes_of(rgb: &[u8], width: usize) -> [Vec<u8>; 3] {
    let level = |weights: [i32; BYTES_PER_PIXEL], [r, g, b]: [i32; BYTES_PER_PIXEL], bits: u32| {
        (weights[0] * r + weights[1] * g + weights[2] * b + (1 << (bits - 1))) >> bits
    };
    let brightness = rgb
        .as_chunks()
        .0
        .iter()
        .map(|pixel: &[u8; 3]| level(BRIGHTNESS, pixel.map(i32::from), 16) as u8);
    let brightness = brightness.collect();
    let row_bytes = width * BYTES_PER_PIXEL;
    let blocks = rgb.len() / BYTES_PER_PIXEL / 4 + width;
    let [mut blueness, mut redness] = [0; 2].map(|_: u8| Vec::with_capacity(blocks));
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
    [brightness, blueness, redness]
}

#[cfg(test)]
mod tests {
    use ffmpeg_next::codec::decoder;

    use super::*;
    use crate::video::conversion::Conversion;

    #[test]
    fn a_picture_of_odd_size_keeps_its_colours_within_some_levels() {
        let (width, height) = (37, 23);
        let pixel = |i: u32| [i % width * 6, i / width * 9, 200 - i % width * 2];
        let rgb: Vec<u8> = (0..width * height)
            .flat_map(pixel)
            .map(|v| v as u8)
            .collect();
        let coded = jpeg(Path::new("odd"), &rgb, [width, height]).unwrap();
        assert_eq!(&coded[..3], [0xff, 0xd8, 0xff]);

        let context = context::Context::new_with_codec(decoder::find(Id::MJPEG).unwrap());
        let mut decoder = context.decoder().video().unwrap();
        decoder.send_packet(&Packet::copy(&coded)).unwrap();
        decoder.send_eof().unwrap();
        let mut decoded = frame::Video::empty();
        decoder.receive_frame(&mut decoded).unwrap();
        let mut found = Vec::new();
        Conversion::default().whole(&decoded, &mut found).unwrap();
        assert_eq!(found.len(), rgb.len());
        let off = found.iter().zip(&rgb).map(|(a, b)| a.abs_diff(*b));
        // Colours differ by six levels from column to column, and blocks of four share theirs.
        assert!(off.clone().max() <= Some(12), "{:?}", off.max());
        let mean = off.map(f64::from).sum::<f64>() / rgb.len() as f64;
        assert!(mean < 2.5, "{mean}");
    }
}
