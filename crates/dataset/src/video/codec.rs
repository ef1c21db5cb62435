//! The codecs and their properties: encoder, pixels in memory, file format, presets, range of qualities.

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
    /// FFV1 in RGB without loss, every image on its own and with a checksum: the archivists' choice.
    #[serde(rename = "ffv1")]
    Ffv1,
}

/// Presets of x264.
const X264_PRESETS: [&str; 10] = [
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
/// FFV1 has no presets.
const NO_PRESETS: [&str; 1] = ["none"];

impl VideoCodec {
    /// All codecs.
    pub const ALL: [Self; 3] = [Self::H264, Self::H264Lossless, Self::Ffv1];

    /// True if decoded images equal the input byte for byte.
    pub fn is_lossless(self) -> bool {
        matches!(self, Self::H264Lossless | Self::Ffv1)
    }

    /// File extension, and FFmpeg's name of the format. FFmpeg does not write FFV1 to MP4; QuickTime, the ancestor of MP4, is the only
    /// other format with exact timestamps (Matroska rounds them to milliseconds).
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ffv1 => "mov",
            _ => "mp4",
        }
    }

    /// The available presets.
    pub(crate) fn presets(self) -> &'static [&'static str] {
        match self {
            Self::H264 | Self::H264Lossless => &X264_PRESETS,
            Self::Ffv1 => &NO_PRESETS,
        }
    }

    /// The default preset.
    pub(crate) fn default_preset(self) -> &'static str {
        match self {
            Self::H264 => "superfast",
            Self::H264Lossless => "ultrafast",
            Self::Ffv1 => "none",
        }
    }

    /// The default constant rate factor, which was measured to preserve a 10 NM aircraft.
    pub(crate) fn default_crf(self) -> u32 {
        match self {
            Self::H264 => 12,
            Self::H264Lossless | Self::Ffv1 => 0,
        }
    }

    /// FFmpeg's name of the encoder.
    pub fn encoder(self) -> &'static str {
        match self {
            Self::H264 => "libx264",
            Self::H264Lossless => "libx264rgb",
            Self::Ffv1 => "ffv1",
        }
    }

    /// The encoder's input pixel format.
    pub(super) fn pixel(self) -> Pixel {
        match self {
            Self::H264 => Pixel::YUV420P,
            Self::H264Lossless => Pixel::RGB24,
            Self::Ffv1 => Pixel::BGRZ,
        }
    }
}
