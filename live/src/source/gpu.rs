//! GPU decoding, with copies of the images in main memory.
//!
//! `ffmpeg-next` wraps no devices. With one, FFmpeg's decoder returns frames in GPU memory, or decodes on the processor if the GPU cannot
//! decode the codec; the frames show which. This project has no such GPU.
#![allow(unsafe_code)]

use std::ptr;

use ffmpeg_next::codec::context::Context;
use ffmpeg_next::format::Pixel;
use ffmpeg_next::software::scaling::{self, Flags};
use ffmpeg_next::{ffi, frame};

use crate::error::{Error, Result};
use crate::source::Decoder;

pub(crate) struct Gpu {
    device: *mut ffi::AVBufferRef,
    frames: Pixel,
    /// Converts the GPU's image format to separate planes, which the search reads in parts.
    scaler: Option<scaling::Context>,
}

impl Gpu {
    /// Opens the first device of a kind; `None` for the processor.
    ///
    /// # Errors
    /// FFmpeg finds no such device.
    pub(crate) fn open(decoder: Decoder) -> Result<Option<Self>> {
        let (name, kind, frames) = match decoder {
            Decoder::Cpu => return Ok(None),
            Decoder::Vaapi => (
                "vaapi",
                ffi::AVHWDeviceType::AV_HWDEVICE_TYPE_VAAPI,
                ffi::AVPixelFormat::AV_PIX_FMT_VAAPI,
            ),
            Decoder::Cuda => (
                "cuda",
                ffi::AVHWDeviceType::AV_HWDEVICE_TYPE_CUDA,
                ffi::AVPixelFormat::AV_PIX_FMT_CUDA,
            ),
        };
        let mut device = ptr::null_mut();
        // SAFETY: `device` receives a reference that is owned here, or stays null with a negative result; null names and options mean the
        // first device with its defaults.
        let code = unsafe {
            ffi::av_hwdevice_ctx_create(&mut device, kind, ptr::null(), ptr::null_mut(), 0)
        };
        if code < 0 {
            let why = ffmpeg_next::Error::from(code).to_string();
            return Err(Error::Decoder { decoder: name, why });
        }
        Ok(Some(Self {
            device,
            frames: frames.into(),
            scaler: None,
        }))
    }

    /// Makes a decoder that is not open yet use it.
    pub(crate) fn attach_to(&self, context: &mut Context) {
        // SAFETY: the context is valid and has no device yet; it owns the new reference and gives it back when it is freed.
        unsafe {
            (*context.as_mut_ptr()).hw_device_ctx = ffi::av_buffer_ref(self.device);
        }
    }

    pub(crate) fn has_decoded(&self, coded: &frame::Video) -> bool {
        coded.format() == self.frames
    }

    /// Copies a decoded frame into separate planes.
    pub(crate) fn download(
        &mut self,
        decoded: &frame::Video,
    ) -> std::result::Result<frame::Video, ffmpeg_next::Error> {
        let mut copy = frame::Video::empty();
        // SAFETY: both frames are valid; the empty one receives a buffer in a format that FFmpeg chooses.
        let code = unsafe { ffi::av_hwframe_transfer_data(copy.as_mut_ptr(), decoded.as_ptr(), 0) };
        if code < 0 {
            return Err(ffmpeg_next::Error::from(code));
        }
        let (format, width, height) = (copy.format(), copy.width(), copy.height());
        let is_known = self.scaler.as_ref().is_some_and(|scaler| {
            let known = scaler.input();
            (known.format, known.width, known.height) == (format, width, height)
        });
        if !is_known {
            let to = Pixel::YUV420P;
            let scaler =
                scaling::Context::get(format, width, height, to, width, height, Flags::POINT)?;
            self.scaler = Some(scaler);
        }
        let mut planes = frame::Video::empty();
        if let Some(scaler) = &mut self.scaler {
            scaler.run(&copy, &mut planes)?;
        }
        // SAFETY: both frames are valid; timestamps, flags and tags of colours are copied, and no pixels.
        match unsafe { ffi::av_frame_copy_props(planes.as_mut_ptr(), decoded.as_ptr()) } {
            code if code < 0 => Err(ffmpeg_next::Error::from(code)),
            _ => Ok(planes),
        }
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        // SAFETY: the reference is owned and given back once.
        unsafe { ffi::av_buffer_unref(&mut self.device) };
    }
}
