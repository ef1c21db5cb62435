//! Conversion between RGB and the coded pixel format, in BT.709.
//!
//! FFmpeg's converter assumes BT.601 by default, whatever the frames' tags say, and `ffmpeg-next` does not wrap the function that changes
//! it. Nor does it wrap a conversion from memory outside FFmpeg's frames, without which every image would be copied once more
//! (`docs/video.md` has the cost).
#![allow(unsafe_code)]

use std::os::raw::c_int;
use std::ptr;

use ffmpeg_next::ffi;
use ffmpeg_next::format::Pixel;
use ffmpeg_next::frame;
use ffmpeg_next::software::scaling::{Context, Flags};

use crate::video::BYTES_PER_PIXEL;

/// Converts equally sized images between two pixel formats.
pub(crate) struct Scaler {
    context: Context,
    /// The end of an RGB image, with readable memory behind it.
    end: Vec<u8>,
}

/// swscale reads whole vectors: it may read some bytes past its input, but never this many.
const READ_BEHIND_BYTES: usize = 256;

// SAFETY: this value alone owns the context, and swscale keeps no per-thread state.
unsafe impl Send for Scaler {}

/// An image's YUV matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Matrix {
    /// ITU-R BT.601, for old or untagged standard-definition video.
    Bt601,
    /// ITU-R BT.709, for everything that this project writes.
    Bt709,
}

const FULL_CONTRAST: i32 = 1 << 16;
const FULL_SATURATION: i32 = 1 << 16;
const LIMITED_RANGE: i32 = 0;

impl Scaler {
    /// A converter for images of `width` x `height` pixels. `full_range`: YUV values use 0 to 255 instead of 16 to 235.
    pub(crate) fn new(
        (from, to): (Pixel, Pixel),
        width: u32,
        height: u32,
        flags: Flags,
        matrix: Matrix,
        full_range: bool,
    ) -> Result<Self, ffmpeg_next::Error> {
        let mut context = Context::get(from, width, height, to, width, height, flags)?;
        let space = match matrix {
            Matrix::Bt601 => ffi::SWS_CS_ITU601,
            Matrix::Bt709 => ffi::SWS_CS_ITU709,
        };
        let range = if full_range { 1 } else { LIMITED_RANGE };
        // SAFETY: the context is valid and not shared; the coefficients are a static table of swscale. It ignores the range of the RGB
        // side. A negative result means that neither side is YUV: then no coefficients apply.
        unsafe {
            let coefficients = ffi::sws_getCoefficients(space);
            ffi::sws_setColorspaceDetails(
                context.as_mut_ptr(),
                coefficients,
                range,
                coefficients,
                range,
                0,
                FULL_CONTRAST,
                FULL_SATURATION,
            );
        }
        Ok(Self {
            context,
            end: Vec::new(),
        })
    }

    /// A converter of RGB images for an encoder, in BT.709.
    pub(crate) fn from_rgb(
        to: Pixel,
        width: u32,
        height: u32,
        full_range: bool,
    ) -> Result<Self, ffmpeg_next::Error> {
        let formats = (Pixel::RGB24, to);
        let flags =
            Flags::BILINEAR | Flags::ACCURATE_RND | Flags::FULL_CHR_H_INT | Flags::FULL_CHR_H_INP;
        Self::new(formats, width, height, flags, Matrix::Bt709, full_range)
    }

    /// Converts one image.
    pub(crate) fn run(
        &mut self,
        input: &frame::Video,
        output: &mut frame::Video,
    ) -> Result<(), ffmpeg_next::Error> {
        self.context.run(input, output)
    }

    /// Converts one RGB image whose rows are contiguous in memory, in place: only its last rows are copied, since the memory
    /// behind them may not be readable.
    pub(crate) fn run_rgb(
        &mut self,
        rgb: &[u8],
        output: &mut frame::Video,
    ) -> Result<(), ffmpeg_next::Error> {
        let Self { context, end } = self;
        let from = *context.input();
        let (width, height) = (from.width as usize, from.height as usize);
        let row_bytes = width * BYTES_PER_PIXEL;
        let fits = (output.format(), output.width(), output.height())
            == (context.output().format, from.width, from.height);
        if from.format != Pixel::RGB24 || rgb.len() != row_bytes * height || !fits {
            return Err(ffmpeg_next::Error::InvalidData);
        }
        // Pairs of rows, since two rows share their chroma in the output.
        let end_rows = READ_BEHIND_BYTES.div_ceil(row_bytes).next_multiple_of(2);
        let end_rows = end_rows.min(height);
        let end_at = (height - end_rows) * row_bytes;
        end.clear();
        end.extend_from_slice(&rgb[end_at..]);
        end.resize(rgb.len() - end_at + READ_BEHIND_BYTES, 0);
        for (rows, first, count) in [
            (rgb.as_ptr(), 0, height - end_rows),
            (end.as_ptr(), height - end_rows, end_rows),
        ] {
            if count == 0 {
                continue;
            }
            // SAFETY: the context is valid and not shared, and takes RGB of this size (checked above), which has one plane. From
            // `rows` on `count` rows can be read, and READ_BEHIND_BYTES behind them: the rest of the image, or the padding. The
            // output is a writable frame of the size and format that the context produces (checked above), and swscale writes only
            // to its rows.
            let done = unsafe {
                let output = &mut *output.as_mut_ptr();
                ffi::sws_scale(
                    context.as_mut_ptr(),
                    [rows, ptr::null(), ptr::null(), ptr::null()].as_ptr(),
                    [row_bytes as c_int, 0, 0, 0].as_ptr(),
                    first as c_int,
                    count as c_int,
                    output.data.as_ptr(),
                    output.linesize.as_ptr(),
                )
            };
            if done < 0 {
                return Err(ffmpeg_next::Error::from(done));
            }
        }
        Ok(())
    }

    /// Makes the frame's buffer writable, in case the encoder still references it.
    pub(crate) fn make_writable(picture: &mut frame::Video) -> Result<(), ffmpeg_next::Error> {
        // SAFETY: the frame is valid and owned by the caller.
        match unsafe { ffi::av_frame_make_writable(picture.as_mut_ptr()) } {
            code if code < 0 => Err(ffmpeg_next::Error::from(code)),
            _ => Ok(()),
        }
    }
}
