//! The codecs and their properties: encoder, pixels in memory, presets, qualities.

use ffmpeg_next::format::Pixel;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Coding of the images. `docs/video.md` states how well each preserves small targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub enum VideoCodec {
    /// H.264, 4:2:0: small, plays everywhere, halves the contrast of colours of small things.
    #[default]
    #[serde(rename = "h264")]
    H264,
    /// H.264 in RGB without loss: about four times larger in smooth images; browsers do not play it.
    #[serde(rename = "h264-lossless")]
    H264Lossless,
}

/// Presets of x264, the encoder of both.
pub(crate) const PRESETS: [&str; 10] = [
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

impl VideoCodec {
    /// All codecs.
    pub const ALL: [Self; 2] = [Self::H264, Self::H264Lossless];

    /// True if decoded images equal the input byte for byte.
    pub fn is_lossless(self) -> bool {
        self == Self::H264Lossless
    }

    /// The default preset.
    pub(crate) fn default_preset(self) -> &'static str {
        match self {
            Self::H264 => "superfast",
            Self::H264Lossless => "ultrafast",
        }
    }

    /// The default constant rate factor, which was measured to preserve a 10 NM aircraft.
    pub(crate) fn default_crf(self) -> u32 {
        match self {
            Self::H264 => 12,
            Self::H264Lossless => 0,
        }
    }

    /// FFmpeg's name of the encoder.
    pub fn encoder(self) -> &'static str {
        match self {
            Self::H264 => "libx264",
            Self::H264Lossless => "libx264rgb",
        }
    }

    /// The encoder's input pixel format.
    pub(super) fn pixel(self) -> Pixel {
        match self {
            Self::H264 => Pixel::YUV420P,
            Self::H264Lossless => Pixel::RGB24,
        }
    }
}
