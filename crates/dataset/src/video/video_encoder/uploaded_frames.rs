//! Frames in GPU memory, for encoders that take no others (VA-API).
//!
//! `ffmpeg-next` wraps neither GPU devices nor GPU frames, and such an encoder does not open without them. This project has no such GPU:
//! the trial before a recording (`docs/video.md`) shows whether it works.
#![allow(unsafe_code)]

use std::ptr;

use ffmpeg_next::ffi;
use ffmpeg_next::{encoder, frame};

/// Frames that a GPU keeps at most: the one that is encoded, its references, and some that the driver holds.
const POOL_FRAMES: i32 = 20;

/// A pool of equally sized GPU frames.
pub(crate) struct UploadedFrames(*mut ffi::AVBufferRef);

// SAFETY: this value alone owns its reference, and FFmpeg counts references atomically.
unsafe impl Send for UploadedFrames {}

impl UploadedFrames {
    /// A pool on the first VA-API device, for images in NV12.
    pub(crate) fn of_vaapi(width_px: u32, height_px: u32) -> Result<Self, ffmpeg_next::Error> {
        let mut device = ptr::null_mut();
        // SAFETY: `device` receives a reference that is owned here, or stays null with a negative result; null names and options mean the
        // first device with its defaults.
        let code = unsafe {
            ffi::av_hwdevice_ctx_create(
                &mut device,
                ffi::AVHWDeviceType::AV_HWDEVICE_TYPE_VAAPI,
                ptr::null(),
                ptr::null_mut(),
                0,
            )
        };
        if code < 0 {
            return Err(ffmpeg_next::Error::from(code));
        }
        // SAFETY: the device is valid; the pool takes its own reference to it, so that ours can be given back at once.
        let frames = unsafe {
            let frames = ffi::av_hwframe_ctx_alloc(device);
            ffi::av_buffer_unref(&mut device);
            frames
        };
        if frames.is_null() {
            return Err(ffmpeg_next::Error::Other {
                errno: ffmpeg_next::util::error::ENOMEM,
            });
        }
        let pool = Self(frames);
        // SAFETY: the data of the frames reference is an AVHWFramesContext, which no other code uses before it is initialised.
        let code = unsafe {
            let context = (*pool.0).data.cast::<ffi::AVHWFramesContext>();
            (*context).format = ffi::AVPixelFormat::AV_PIX_FMT_VAAPI;
            (*context).sw_format = ffi::AVPixelFormat::AV_PIX_FMT_NV12;
            (*context).width = width_px as i32;
            (*context).height = height_px as i32;
            (*context).initial_pool_size = POOL_FRAMES;
            ffi::av_hwframe_ctx_init(pool.0)
        };
        match code {
            code if code < 0 => Err(ffmpeg_next::Error::from(code)),
            _ => Ok(pool),
        }
    }

    /// Makes an encoder that is not open yet take frames of this pool.
    pub(crate) fn attach_to(&self, video: &mut encoder::video::Video) {
        // SAFETY: the context is valid and has no frames yet; it owns the new reference and gives it back when it is freed.
        unsafe {
            (*video.as_mut_ptr()).hw_frames_ctx = ffi::av_buffer_ref(self.0);
        }
    }

    /// A copy of the image in GPU memory, with its timestamp and tags.
    pub(crate) fn upload(
        &self,
        picture: &frame::Video,
    ) -> Result<frame::Video, ffmpeg_next::Error> {
        let mut uploaded = frame::Video::empty();
        // SAFETY: both frames are valid; the new one receives a buffer of the pool, of the size and format that the image has.
        let code = unsafe {
            match ffi::av_hwframe_get_buffer(self.0, uploaded.as_mut_ptr(), 0) {
                code if code < 0 => code,
                _ => {
                    match ffi::av_hwframe_transfer_data(uploaded.as_mut_ptr(), picture.as_ptr(), 0)
                    {
                        code if code < 0 => code,
                        _ => ffi::av_frame_copy_props(uploaded.as_mut_ptr(), picture.as_ptr()),
                    }
                }
            }
        };
        match code {
            code if code < 0 => Err(ffmpeg_next::Error::from(code)),
            _ => Ok(uploaded),
        }
    }
}

impl Drop for UploadedFrames {
    fn drop(&mut self) {
        // SAFETY: the reference is owned and given back once.
        unsafe { ffi::av_buffer_unref(&mut self.0) };
    }
}
