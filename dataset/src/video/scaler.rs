//! Conversion between RGB and the coded pixel format, in BT.709.
//!
//! FFmpeg's converter assumes BT.601 unless it is told otherwise, whatever the frames are tagged with, and `ffmpeg-next` does
//! not wrap the call that tells it. That call is the only unsafe code of this project.
#![allow(unsafe_code)]

use ffmpeg_next::ffi;
use ffmpeg_next::format::Pixel;
use ffmpeg_next::frame;
use ffmpeg_next::software::scaling::{Context, Flags};

/// Converts pictures of one size from one pixel format to another.
pub(super) struct Scaler(Context);

// SAFETY: the context is owned by this value alone, and swscale keeps no state per thread.
unsafe impl Send for Scaler {}

/// Which YUV a picture is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Matrix {
    /// ITU-R BT.601, as old or untagged standard-definition video.
    Bt601,
    /// ITU-R BT.709, as everything that this project writes.
    Bt709,
}

const FULL_CONTRAST: i32 = 1 << 16;
const FULL_SATURATION: i32 = 1 << 16;
const LIMITED_RANGE: i32 = 0;

impl Scaler {
    /// A converter for pictures of `width` x `height` pixels. `full_range`: YUV values use 0 to 255 instead of 16 to 235.
    pub(super) fn new(
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
        // SAFETY: the context is valid and not shared; the coefficients are a static table of swscale. It ignores the
        // range of the side that is RGB. A negative result means that neither side is YUV: then there is nothing to tell.
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
        Ok(Self(context))
    }

    /// Converts one picture.
    pub(super) fn run(
        &mut self,
        input: &frame::Video,
        output: &mut frame::Video,
    ) -> Result<(), ffmpeg_next::Error> {
        self.0.run(input, output)
    }

    /// Makes a picture's pixels its own again, in case the encoder still holds them.
    pub(super) fn make_writable(picture: &mut frame::Video) -> Result<(), ffmpeg_next::Error> {
        // SAFETY: the frame is valid and owned by the caller.
        match unsafe { ffi::av_frame_make_writable(picture.as_mut_ptr()) } {
            code if code < 0 => Err(ffmpeg_next::Error::from(code)),
            _ => Ok(()),
        }
    }
}
