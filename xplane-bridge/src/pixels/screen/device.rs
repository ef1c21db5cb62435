//! FFmpeg's input device for grabbing the screen of each system, and its options: plain values.

use crate::pixels::Rectangle;

/// A system's way to grab its screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Platform {
    /// Linux and other systems with X11 (or XWayland's windows).
    X11,
    /// Windows.
    Gdi,
    /// macOS.
    AvFoundation,
}

/// The arguments for FFmpeg.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct DeviceCall {
    /// Name of the input device.
    pub(super) device: &'static str,
    /// Name of the screen.
    pub(super) input: String,
    pub(super) options: Vec<(&'static str, String)>,
    /// Image region to keep, if the device itself cannot select it.
    pub(super) crop: Option<Rectangle>,
}

/// Grabs are made on demand; the device must not wait between them.
const UNPACED_HZ: &str = "1000";
/// FFmpeg grabs images when it opens a device, to learn its rate and its first time stamp. They would be the first ones to be read,
/// although the screen has changed since.
const PROBE_NONE: [(&str, &str); 2] = [("fpsprobesize", "0"), ("max_ts_probe", "0")];
/// macOS delivers images at a rate that its displays support.
const PUSHED_HZ: &str = "60";

impl Platform {
    /// The device of this machine, if supported.
    pub(super) fn here() -> Option<Self> {
        if cfg!(windows) {
            Some(Self::Gdi)
        } else if cfg!(target_os = "macos") {
            Some(Self::AvFoundation)
        } else if cfg!(unix) {
            Some(Self::X11)
        } else {
            None
        }
    }

    /// Hint for the user if the screen cannot be opened.
    pub(super) fn advice(self) -> &'static str {
        match self {
            Self::X11 => {
                "does DISPLAY name X-Plane's X server (under Wayland: XWayland), and may this user connect to it?"
            }
            Self::Gdi => {
                "is this the desktop session that X-Plane runs in, not a service or a remote shell?"
            }
            Self::AvFoundation => {
                "has the terminal the right to record the screen (System Settings > Privacy & Security)?"
            }
        }
    }

    /// The device call that opens a region, or the whole screen. `display` is X11's; the other systems have only one.
    pub(super) fn call(self, display: &str, part: Option<Rectangle>) -> DeviceCall {
        let option = |name, value: &dyn ToString| (name, value.to_string());
        let unprobed = PROBE_NONE.map(|(name, value)| option(name, &value));
        let (device, input, x, y) = match self {
            Self::X11 => ("x11grab", display, "grab_x", "grab_y"),
            Self::Gdi => ("gdigrab", "desktop", "offset_x", "offset_y"),
            Self::AvFoundation => {
                return DeviceCall {
                    device: "avfoundation",
                    input: "Capture screen 0:none".into(),
                    options: [
                        option("capture_cursor", &0),
                        option("framerate", &PUSHED_HZ),
                        option("pixel_format", &"bgr0"),
                    ]
                    .into_iter()
                    .chain(unprobed)
                    .collect(),
                    crop: part,
                };
            }
        };
        let mut options = Vec::new();
        if let Some(part) = part {
            let size = format!("{}x{}", part.width_px, part.height_px);
            options.extend([
                option("video_size", &size),
                option(x, &part.x_px),
                option(y, &part.y_px),
            ]);
        }
        options.extend([option("draw_mouse", &0), option("framerate", &UNPACED_HZ)]);
        options.extend(unprobed);
        DeviceCall {
            device,
            input: input.to_owned(),
            options,
            crop: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PART: Rectangle = Rectangle {
        x_px: 10,
        y_px: 20,
        width_px: 1_920,
        height_px: 1_280,
    };

    fn text(call: &DeviceCall) -> String {
        let options: Vec<String> = call
            .options
            .iter()
            .map(|(name, value)| format!("-{name} {value}"))
            .collect();
        format!("{} -f {} -i {}", options.join(" "), call.device, call.input)
    }

    #[test]
    fn each_platform_is_asked_for_its_part_of_the_screen_without_the_mouse() {
        for (platform, part, crop, expected) in [
            (
                Platform::X11,
                Some(PART),
                None,
                "-video_size 1920x1280 -grab_x 10 -grab_y 20 -draw_mouse 0 -framerate 1000 -fpsprobesize 0 -max_ts_probe 0 -f x11grab -i :7",
            ),
            (
                Platform::X11,
                None,
                None,
                "-draw_mouse 0 -framerate 1000 -fpsprobesize 0 -max_ts_probe 0 -f x11grab -i :7",
            ),
            (
                Platform::Gdi,
                Some(PART),
                None,
                "-video_size 1920x1280 -offset_x 10 -offset_y 20 -draw_mouse 0 -framerate 1000 -fpsprobesize 0 -max_ts_probe 0 -f gdigrab -i desktop",
            ),
            (
                Platform::AvFoundation,
                Some(PART),
                Some(PART),
                "-capture_cursor 0 -framerate 60 -pixel_format bgr0 -fpsprobesize 0 -max_ts_probe 0 -f avfoundation -i Capture screen 0:none",
            ),
        ] {
            let call = platform.call(":7", part);
            assert_eq!((text(&call).as_str(), call.crop), (expected, crop));
        }
    }

    #[test]
    fn this_system_is_known() {
        let expected = match std::env::consts::OS {
            "windows" => Platform::Gdi,
            "macos" => Platform::AvFoundation,
            _ => Platform::X11,
        };
        assert_eq!(Platform::here(), Some(expected));
    }
}
