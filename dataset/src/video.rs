//! Videos: one picture per tick, with exact timestamps, that keep small targets.
//!
//! In go and out come pictures as rows of 8-bit RGB. An aircraft at 10 nautical miles is 21 pixels wide and a few grey levels
//! off the sky, so the settings are chosen by what they leave of such targets: at the usual quality H.264 takes a fifth of
//! their contrast and H.265 and AV1 erase them. B-frames are off, because with them some players and cutters shift every
//! timestamp. Pictures are BT.709, limited range, and say so.

mod reader;
mod scaler;
mod writer;

use std::path::Path;
use std::sync::Once;

use serde::{Deserialize, Serialize};

pub use reader::VideoReader;
pub use writer::VideoWriter;

use crate::error::Error;

/// Bytes of a pixel in memory: red, green, blue.
pub const BYTES_PER_PIXEL: usize = 3;

/// How pictures are coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum VideoCodec {
    /// H.264, 4:2:0: small, plays everywhere, halves the contrast of colours of small things.
    #[serde(rename = "h264")]
    H264,
    /// H.264 in RGB without loss: about 20 times larger; browsers do not play it.
    #[serde(rename = "h264-lossless")]
    H264Lossless,
}

/// Settings of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VideoSettings {
    /// How pictures are coded.
    pub codec: VideoCodec,
    /// Preset of x264: trades time for size, `ultrafast` to `placebo`.
    pub preset: String,
    /// Constant rate factor of x264, 0 to 51: smaller is better and larger. Without meaning for `h264-lossless`.
    pub crf: u32,
    /// Threads of one encoder. Views are encoded side by side, so 1 is best when there are no more cores than views.
    pub threads: u32,
}

/// Presets that x264 knows.
pub const PRESETS: [&str; 10] = [
    "ultrafast",
    "superfast",
    "veryfast",
    "faster",
    "fast",
    "medium",
    "slow",
    "slower",
    "veryslow",
    "placebo",
];

impl Default for VideoSettings {
    /// `crf` 12 keeps 90 % of the contrast of a target 3 pixels wide and 20 grey levels off (18 keeps 75 %, 23 keeps 55 %).
    fn default() -> Self {
        Self {
            codec: VideoCodec::H264,
            preset: "superfast".into(),
            crf: 12,
            threads: 1,
        }
    }
}

impl VideoSettings {
    /// The first setting that cannot be used: its name, and what is wrong with it in words.
    pub fn fault(&self) -> Option<(&'static str, String)> {
        if !PRESETS.contains(&self.preset.as_str()) {
            let known = PRESETS.join(", ");
            return Some((
                "preset",
                format!(
                    "{:?} is no preset of x264; expected one of {known}",
                    self.preset
                ),
            ));
        }
        if self.crf > 51 {
            return Some((
                "crf",
                format!("{} is too large; expected 0 (best) to 51", self.crf),
            ));
        }
        (self.threads == 0).then(|| {
            (
                "threads",
                "0 threads encode nothing; expected at least 1".into(),
            )
        })
    }
}

fn start_ffmpeg() {
    static START: Once = Once::new();
    START.call_once(|| {
        // It fails only if FFmpeg lacks memory for its tables; opening a file reports that too.
        let _ = ffmpeg_next::init();
        // Errors come back as values; its own lines on stderr would tear progress bars.
        ffmpeg_next::log::set_level(ffmpeg_next::log::Level::Fatal);
    });
}

fn fault(path: &Path, action: &str, cause: impl std::fmt::Display) -> Error {
    Error::Video {
        path: path.to_owned(),
        message: format!("cannot {action}: {cause}"),
    }
}

#[cfg(test)]
mod tests;
