//! Opens a camera with FFmpeg, within limits that FFmpeg has no options for.
//!
//! FFmpeg follows an RTSP server's redirects and sends the password to the new address. Here the interrupt callback, which FFmpeg asks
//! before it sends anything, ends such an attempt. Before the first image it decodes a few to learn about the stream, at any size.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString};
use std::ptr;
use std::sync::atomic::{AtomicPtr, Ordering};
use std::sync::{Arc, OnceLock};

use ffmpeg_next::codec::Parameters;
use ffmpeg_next::ffi;
use ffmpeg_next::format::context::Input;
use ffmpeg_next::util::error::{EINVAL, ENOMEM};
use ffmpeg_next::util::interrupt;
use ffmpeg_next::{Dictionary, Error};

/// Bytes that a peer can make FFmpeg allocate at once, e.g. for the body of an answer, unless the run's own images need more.
const MAX_BLOCK_BYTES: usize = 64 << 20;
/// Bytes for a pixel of an image that FFmpeg converts, with room for its rows' padding.
const PIXEL_BYTES: usize = 4;

/// Reason why a camera cannot be opened.
#[derive(Debug)]
pub(super) enum Fault {
    Ffmpeg(Error),
    /// Its server names this address instead.
    Redirected(String),
}

/// Opens a camera by its name for FFmpeg. Images with more than `max_pixels` are not decoded. FFmpeg gives up when `is_over` returns true.
pub(super) fn open(
    name: &str,
    options: Dictionary<'_>,
    max_pixels: u64,
    mut is_over: impl FnMut() -> bool + Send + 'static,
) -> Result<Input, Fault> {
    let errno = |errno| Fault::Ffmpeg(Error::Other { errno });
    let name = CString::new(name).map_err(|_| errno(EINVAL))?;
    let given_name = name.clone();
    let redirected = Arc::new(OnceLock::new());
    let to = redirected.clone();
    // SAFETY: the calls are those of `ffmpeg_next::format::input_with_interrupt_and_dictionary`, on a context that lives until it is
    // wrapped, closed, or freed by FFmpeg. FFmpeg asks whether to go on from within them, and `opening` is null after the first one.
    unsafe {
        let image_bytes = usize::try_from(max_pixels)
            .map_or(usize::MAX, |pixels| pixels.saturating_mul(PIXEL_BYTES));
        ffi::av_max_alloc(MAX_BLOCK_BYTES.max(image_bytes));
        let mut context = ffi::avformat_alloc_context();
        if context.is_null() {
            return Err(errno(ENOMEM));
        }
        let opening = Arc::new(AtomicPtr::new(context));
        let opened = opening.clone();
        let interrupt = interrupt::new(Box::new(move || {
            let context = opening.load(Ordering::Relaxed);
            if context.is_null() || (*context).url.is_null() {
                return is_over();
            }
            let url = CStr::from_ptr((*context).url);
            if url != &*given_name {
                to.get_or_init(|| url.to_string_lossy().into_owned());
            }
            url != &*given_name || is_over()
        }));
        (*context).interrupt_callback = interrupt.interrupt;
        let mut options = options.disown();
        let code = ffi::avformat_open_input(
            &raw mut context,
            name.as_ptr(),
            ptr::null(),
            &raw mut options,
        );
        drop(Dictionary::own(options));
        opened.store(ptr::null_mut(), Ordering::Relaxed);
        if code < 0 {
            return Err(match redirected.get() {
                Some(address) => Fault::Redirected(address.clone()),
                None => Fault::Ffmpeg(Error::from(code)),
            });
        }
        let limited = || decoder_options(max_pixels).disown();
        let mut of_streams: Vec<_> = (0..(*context).nb_streams).map(|_| limited()).collect();
        let code = ffi::avformat_find_stream_info(context, of_streams.as_mut_ptr());
        for options in of_streams {
            drop(Dictionary::own(options));
        }
        if code < 0 {
            ffi::avformat_close_input(&raw mut context);
            return Err(Fault::Ffmpeg(Error::from(code)));
        }
        Ok(Input::wrap_with_interrupt(context, interrupt.guard))
    }
}

/// Columns and rows of the images that a stream announces; 0 if unknown.
pub(super) fn announced_px(parameters: &Parameters) -> [u32; 2] {
    // SAFETY: the parameters are alive while the pointer is used.
    let parameters = unsafe { &*parameters.as_ptr() };
    [parameters.width, parameters.height].map(|side| u32::try_from(side).unwrap_or(0))
}

/// Options of a decoder that refuses larger images before it allocates any of its reference images.
pub(super) fn decoder_options(max_pixels: u64) -> Dictionary<'static> {
    let mut options = Dictionary::new();
    options.set("max_pixels", &max_pixels.to_string());
    options
}
