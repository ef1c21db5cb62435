//! The screen of this machine, grabbed through FFmpeg's input devices.

use std::env;

use dataset::video::capture_device;
use ffmpeg_next::codec::context::Context;
use ffmpeg_next::format::context::Input;
use ffmpeg_next::{Dictionary, Packet, decoder, format, frame, media};

use super::device::{DeviceCall, Platform};
use super::pixel_form;
use super::{Grab, Screen};
use crate::pixels::{PixelError, Rectangle, RgbPicture};

/// The screen that X-Plane draws on.
#[derive(Debug, Clone)]
pub struct FfmpegScreen {
    platform: Option<Platform>,
    display: String,
}

impl FfmpegScreen {
    /// This machine's; with X11, the one that `DISPLAY` names.
    pub fn here() -> Self {
        Self::of_display(env::var("DISPLAY").unwrap_or_default())
    }

    /// Grabs this X11 display, e.g. `:0`.
    pub fn of_display(display: impl Into<String>) -> Self {
        Self {
            platform: Platform::here(),
            display: display.into(),
        }
    }
}

impl Screen for FfmpegScreen {
    fn name(&self) -> String {
        let call = self
            .platform
            .map(|platform| platform.call(&self.display, None));
        match call.map(|call| call.input) {
            Some(input) if !input.is_empty() => input,
            _ => "no display (DISPLAY is not set)".into(),
        }
    }

    fn open(&self, part: Option<Rectangle>) -> Result<Box<dyn Grab>, PixelError> {
        let platform = self.platform.ok_or_else(|| {
            PixelError::Setup(
                "the screen of this system cannot be grabbed: Linux (X11), Windows and macOS can; use --pixels gl or run X-Plane there"
                    .into(),
            )
        })?;
        let call = platform.call(&self.display, part);
        let format = capture_device(call.device).map_err(PixelError::Setup)?;
        let mut options = Dictionary::new();
        for (name, value) in &call.options {
            options.set(name, value);
        }
        let failed = |error: ffmpeg_next::Error| {
            PixelError::Unusable(format!(
                "cannot grab the screen {:?} with FFmpeg's {}: {error}; {}",
                call.input,
                call.device,
                platform.advice()
            ))
        };
        let input = format::open_with(&call.input, &format, options).map_err(failed)?;
        let input = input.input();
        let stream = input
            .streams()
            .best(media::Type::Video)
            .ok_or_else(|| failed(ffmpeg_next::Error::StreamNotFound))?;
        let index = stream.index();
        let decoder = Context::from_parameters(stream.parameters())
            .and_then(|context| context.decoder().video())
            .map_err(failed)?;
        Ok(Box::new(FfmpegGrab {
            input,
            stream: index,
            decoder,
            frame: frame::Video::empty(),
            call,
        }))
    }
}

/// A region of the screen that is being grabbed.
struct FfmpegGrab {
    input: Input,
    stream: usize,
    decoder: decoder::Video,
    frame: frame::Video,
    call: DeviceCall,
}

impl FfmpegGrab {
    /// Reads the next frame.
    fn read(&mut self) -> Result<(), PixelError> {
        let device = self.call.device;
        let failed =
            |error: ffmpeg_next::Error| PixelError::grab(format!("{device} says: {error}"));
        // Before FFmpeg 6 a packet that is read into again loses its old memory for good: an image with every grab.
        let packet = loop {
            let mut packet = Packet::empty();
            packet.read(&mut self.input).map_err(failed)?;
            if packet.stream() == self.stream {
                break packet;
            }
        };
        // Screens are not compressed: one packet is one image.
        self.decoder.send_packet(&packet).map_err(failed)?;
        self.decoder.receive_frame(&mut self.frame).map_err(failed)
    }
}

impl Grab for FfmpegGrab {
    fn grab(&mut self, picture: &mut RgbPicture) -> Result<(), PixelError> {
        self.read()?;
        pixel_form::copy(&self.frame, self.call.crop, picture)
    }

    fn grab_inside(
        &mut self,
        margin_px: u32,
        margins: &mut RgbPicture,
        inside: &mut Vec<u8>,
    ) -> Result<(), PixelError> {
        self.read()?;
        pixel_form::copy_inside(&self.frame, self.call.crop, margin_px, (margins, inside))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_device_of_this_system_is_in_this_ffmpeg() {
        let device = Platform::here().unwrap().call("", None).device;
        assert_eq!(capture_device(device).unwrap().name(), device);
    }

    #[cfg(all(unix, not(target_os = "macos")))]
    #[test]
    fn a_display_that_is_not_there_is_named_with_what_to_check() {
        let screen = FfmpegScreen::of_display(":54321");
        let message = screen.open(None).err().unwrap().to_string();
        assert!(
            message.contains(":54321") && message.contains("DISPLAY"),
            "{message}"
        );
    }
}
