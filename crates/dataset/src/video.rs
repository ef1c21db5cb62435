//! Videos: one image per tick, with exact timestamps, that preserve small targets.
//!
//! Images go in and come out as rows of 8-bit RGB. An aircraft at 10 nautical miles is 21 pixels wide and differs from the sky by a few
//! grey levels, so the settings are chosen to preserve such targets (`docs/video.md`): at the usual qualities H.264 takes a fifth of their
//! contrast. There are no B-frames and no look-ahead, because with them some players and editors shift every timestamp, and a killed
//! process loses what waits in the encoder. While a video is written, every image is a fragment of the file that can be read at once; when
//! it is finished, the fragments become a plain file with an index. Images are BT.709, full range, and tagged so.

mod camera_stream;
mod capture_devices;
mod codec;
mod conversion;
mod decoded_image;
mod index;
mod packets;
mod reader;
mod time_base;
mod unlike_scene;
mod writer;

use std::any::Any;
use std::fmt::Display;
use std::path::Path;
use std::sync::Once;

use ffmpeg_next::codec::threading;
use ffmpeg_next::util::error::EINVAL;
use ffmpeg_next::{Dictionary, format, media};
use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};

pub use camera_stream::CameraStream;
pub use capture_devices::{capture_device, load_capture_devices};
use codec::PRESETS;
pub use codec::VideoCodec;
pub use conversion::PicturePart;
pub use conversion::jpeg::jpeg;
pub use conversion::luma::Luma;
pub use decoded_image::{DecodedImage, ImageConverter};
pub use index::fragments::recorded_pictures;
pub use packets::{CodedPicture, PacketReader};
pub use reader::{RgbPicture, VideoReader};
pub use time_base::TimeBase;
pub use unlike_scene::{turned, unlike_the_scene};
pub use writer::{GROUP_OF_PICTURES, VideoWriter};

use crate::error::{Error, Result};
use crate::files::outside_file::{self, FileKind};

/// Maximum constant rate factor of x264.
const MAX_CRF: u32 = 51;
/// Pixel bytes in memory: red, green, blue.
pub const BYTES_PER_PIXEL: usize = 3;

/// Formats of video files, by FFmpeg's names. FFmpeg recognises a file by its content, and a playlist (DASH, HLS, concat) or a stream
/// description (SDP) names other files and hosts, which it would open.
const CONTAINERS: &str = "mov,matroska,avi,mpegts";

/// Recording settings. What is not given takes the default of the codec.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(from = "GivenSettings")]
pub struct VideoSettings {
    /// Coding of the images.
    pub codec: VideoCodec,
    /// Preset of the encoder, one of [`PRESETS`]: trades time for size.
    pub preset: String,
    /// Constant rate factor, 0 to [`MAX_CRF`]: lower means better quality and larger files. Ignored by lossless codecs.
    pub crf: u32,
    /// Encoder threads. Views are encoded in parallel, so 1 is best unless there are more cores than views.
    pub threads: u32,
}

/// Settings as a person gives them.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct GivenSettings {
    /// Coding of the images.
    #[serde(default)]
    codec: VideoCodec,
    /// Preset of the encoder: trades time for size.
    #[schemars(transform = any_preset)]
    preset: Option<String>,
    /// Constant rate factor: lower means better quality and larger files. Lossless codecs ignore it.
    #[schemars(range(max = MAX_CRF))]
    crf: Option<u32>,
    /// Encoder threads. Views are encoded in parallel.
    #[schemars(range(min = 1))]
    threads: Option<u32>,
}

fn any_preset(schema: &mut Schema) {
    schema.insert("enum".into(), PRESETS.to_vec().into());
}

impl From<GivenSettings> for VideoSettings {
    fn from(given: GivenSettings) -> Self {
        let defaults = Self::of(given.codec);
        Self {
            codec: given.codec,
            preset: given.preset.unwrap_or(defaults.preset),
            crf: given.crf.unwrap_or(defaults.crf),
            threads: given.threads.unwrap_or(defaults.threads),
        }
    }
}

impl Default for VideoSettings {
    fn default() -> Self {
        Self::of(VideoCodec::default())
    }
}

impl VideoSettings {
    /// A codec's settings that keep a 10 NM aircraft, as measured.
    pub fn of(codec: VideoCodec) -> Self {
        Self {
            codec,
            preset: codec.default_preset().into(),
            crf: codec.default_crf(),
            threads: 1,
        }
    }

    /// The first invalid setting and its fault, as text.
    pub fn fault(&self) -> Option<(&'static str, String)> {
        if !PRESETS.contains(&self.preset.as_str()) {
            let known = PRESETS.join(", ");
            return Some((
                "preset",
                format!("{:?} is not a preset; expected one of {known}", self.preset),
            ));
        }
        if self.crf > MAX_CRF {
            let crf = self.crf;
            return Some((
                "crf",
                format!("{crf} is too large; expected 0 (best) to {MAX_CRF}"),
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

/// Starts FFmpeg: only fatal errors are logged, since errors are returned as values.
pub fn start_ffmpeg() {
    static START: Once = Once::new();
    START.call_once(|| {
        // It fails only if FFmpeg lacks memory for its tables; opening a file reports that too.
        let _ = ffmpeg_next::init();
        // Errors are returned as values; FFmpeg's own lines on stderr would disrupt progress bars.
        ffmpeg_next::log::set_level(ffmpeg_next::log::Level::Fatal);
    });
}

/// Threads that divide each image: then none is held back.
fn slice_threads(count: usize) -> threading::Config {
    threading::Config {
        kind: threading::Type::Slice,
        count,
        ..Default::default()
    }
}

/// A path as FFmpeg expects it. Without the prefix it reads `a:b/x.mp4` as a file in a protocol called `a`.
fn ffmpeg_path(path: &Path) -> Result<String> {
    match path.to_str() {
        Some(text) => Ok(format!("file:{text}")),
        None => Err(fault(
            path,
            "open it",
            "its path is not UTF-8, which FFmpeg requires; rename it",
        )),
    }
}

/// Opens a video file, whatever its name, and nothing that its content names. FFmpeg gives up when `is_over` returns true.
///
/// # Errors
/// It is not a regular file, or has none of the [`CONTAINERS`].
pub fn open_file(
    path: &Path,
    is_over: impl FnMut() -> bool + Send + 'static,
) -> Result<format::context::Input> {
    start_ffmpeg();
    let name = ffmpeg_path(path)?;
    // FFmpeg would wait for a FIFO, and read a device endlessly.
    outside_file::open(path, FileKind::VIDEO)?;
    let mut options = Dictionary::new();
    options.set("format_whitelist", CONTAINERS);
    options.set("protocol_whitelist", "file");
    let opened = format::input_with_interrupt_and_dictionary(&name, is_over, options);
    opened.map_err(|error| match error {
        ffmpeg_next::Error::InvalidData | ffmpeg_next::Error::Other { errno: EINVAL } => {
            let cause = "it is not an intact video file (MP4, Matroska, AVI or MPEG-TS; playlists are not followed)";
            fault(path, "open it", cause)
        }
        error => fault(path, "open it", error),
    })
}

/// Opens a video file; also returns the first video stream's index and time unit.
fn open_stream(path: &Path) -> Result<(format::context::Input, usize, TimeBase)> {
    let input = open_file(path, || false)?;
    let stream = input
        .streams()
        .best(media::Type::Video)
        .ok_or_else(|| fault(path, "read it", "there is no video stream in it"))?;
    let unit = stream.time_base();
    let time_base = TimeBase::of_fraction(unit).ok_or_else(|| {
        let cause = format!("its time base is {unit}, expected a positive fraction");
        fault(path, "read it", cause)
    })?;
    let index = stream.index();
    Ok((input, index, time_base))
}

fn fault(path: &Path, action: &str, cause: impl Display + 'static) -> Error {
    let errno = match (&cause as &dyn Any).downcast_ref() {
        Some(ffmpeg_next::Error::Other { errno }) => Some(*errno),
        _ => None,
    };
    Error::Video {
        path: path.to_owned(),
        message: format!("cannot {action}: {cause}"),
        errno,
    }
}

#[cfg(test)]
mod tests;
