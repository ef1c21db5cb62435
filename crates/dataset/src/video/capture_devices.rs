//! FFmpeg's drivers for cameras and screens, loaded with the first of them.
//!
//! Their library, libavdevice, brings eighty others. Linked to it, `dtd` takes twice as long to start.
#![allow(unsafe_code)]

use std::error::Error as _;
use std::ffi::CString;
use std::mem;
use std::sync::OnceLock;

use ffmpeg_next::{Format, ffi, format};
use libloading::{Library, Symbol};

use super::start_ffmpeg;

/// Registers the drivers with FFmpeg for the rest of the process.
///
/// # Errors
/// libavdevice is not installed, or is damaged.
pub fn load_capture_devices() -> Result<(), String> {
    static LOADED: OnceLock<Result<(), String>> = OnceLock::new();
    start_ffmpeg();
    let loaded = LOADED.get_or_init(|| {
        // Both libraries have the same major version.
        let major = ffi::LIBAVFORMAT_VERSION_MAJOR;
        register(&library_name(major)).map_err(|error| {
            // The system's reason, with the library's name.
            let why = error.source().map_or_else(|| error.to_string(), ToString::to_string);
            format!("FFmpeg's drivers for cameras and screens cannot be loaded: {why}; install libavdevice {major} and start again")
        })
    });
    loaded.clone()
}

/// A driver for [`ffmpeg_next::format::open_with`], by FFmpeg's name for it.
///
/// # Errors
/// The drivers cannot be loaded, or FFmpeg was built without this one.
pub fn capture_device(name: &str) -> Result<Format, String> {
    load_capture_devices()?;
    let c_name = CString::new(name).map_err(|error| error.to_string())?;
    // SAFETY: the name ends with a zero byte; FFmpeg returns null or a format that is never freed.
    let found = unsafe { ffi::av_find_input_format(c_name.as_ptr()) };
    if found.is_null() {
        return Err(format!(
            "the FFmpeg of this machine was built without its input device {name}; install one that has it"
        ));
    }
    // SAFETY: the format is never freed, and `Input` only reads it.
    Ok(Format::Input(unsafe {
        format::Input::wrap(found.cast_mut())
    }))
}

fn library_name(major: i32) -> String {
    if cfg!(windows) {
        format!("avdevice-{major}.dll")
    } else if cfg!(target_os = "macos") {
        format!("libavdevice.{major}.dylib")
    } else {
        format!("libavdevice.so.{major}")
    }
}

fn register(library: &str) -> Result<(), libloading::Error> {
    // SAFETY: loading runs the library's initialisers; it has the version of the FFmpeg libraries in this process.
    let library = unsafe { Library::new(library) }?;
    // SAFETY: FFmpeg declares `void avdevice_register_all(void)`. The drivers stay valid, because the library is never unloaded.
    unsafe {
        let register_all: Symbol<unsafe extern "C" fn()> = library.get("avdevice_register_all")?;
        register_all();
    }
    mem::forget(library);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_or_driver_is_named() {
        let error = register("libavdevice.so.0").unwrap_err();
        let why = error.source().unwrap().to_string();
        assert!(why.contains("libavdevice.so.0"), "{why}");
        let error = capture_device("telepathy").err().unwrap();
        assert!(error.contains("telepathy"), "{error}");
    }
}
