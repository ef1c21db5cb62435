//! The program part that encodes: FFmpeg's software encoders, or a GPU's.
//!
//! Input: a sweep's codec. Output: FFmpeg's encoder of that codec, its pixel format, its options. Options are names and values of FFmpeg's
//! own tables (a test compares them where an encoder is compiled in); none of the GPU's encoders has been run by this project.

pub(crate) mod uploaded_frames;

use ffmpeg_next::format::Pixel;

use super::{VideoCodec, VideoSettings};

/// Encoder of the videos. It does not change the sweep's codec, so a corpus may have scenarios with different encoders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VideoEncoder {
    /// FFmpeg's software encoders: what `docs/video.md` measured.
    #[default]
    Software,
    /// NVIDIA, on Linux and Windows.
    Nvenc,
    /// AMD and Intel, on Linux.
    Vaapi,
    /// Intel, on Linux and Windows.
    Qsv,
    /// Apple.
    VideoToolbox,
}

impl VideoEncoder {
    /// All encoders.
    pub const ALL: [Self; 5] = [
        Self::Software,
        Self::Nvenc,
        Self::Vaapi,
        Self::Qsv,
        Self::VideoToolbox,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Software => "software",
            Self::Nvenc => "nvenc",
            Self::Vaapi => "vaapi",
            Self::Qsv => "qsv",
            Self::VideoToolbox => "videotoolbox",
        }
    }

    /// Requirements, for a user whose machine lacks them.
    pub fn needs(self) -> &'static str {
        match self {
            Self::Software => "an FFmpeg with this encoder",
            Self::Nvenc => "an NVIDIA GPU with a current driver, and an FFmpeg built with nvenc",
            Self::Vaapi => {
                "an AMD or Intel GPU whose VA-API driver encodes this codec (`vainfo` lists VAEntrypointEncSlice), access to /dev/dri, and an \
                 FFmpeg built with vaapi"
            }
            Self::Qsv => {
                "an Intel GPU with its runtime (oneVPL or Media SDK), and an FFmpeg built with qsv"
            }
            Self::VideoToolbox => "a Mac, and an FFmpeg built with videotoolbox",
        }
    }

    /// FFmpeg's encoder for the codec, if there is one that this program offers.
    pub fn of_codec(self, codec: VideoCodec) -> Option<&'static str> {
        use VideoCodec::{H264, H265};
        Some(match (self, codec) {
            (Self::Software, codec) => codec.encoder(),
            (Self::Nvenc, H264) => "h264_nvenc",
            (Self::Nvenc, H265) => "hevc_nvenc",
            (Self::Vaapi, H264) => "h264_vaapi",
            (Self::Vaapi, H265) => "hevc_vaapi",
            (Self::Qsv, H264) => "h264_qsv",
            (Self::Qsv, H265) => "hevc_qsv",
            (Self::VideoToolbox, H264) => "h264_videotoolbox",
            (Self::VideoToolbox, H265) => "hevc_videotoolbox",
            // Lossless RGB is not what GPUs call lossless, and AV1's options are in no FFmpeg at hand.
            (_, VideoCodec::H264Lossless | VideoCodec::Ffv1 | VideoCodec::Av1) => return None,
        })
    }

    /// The pixel format of the images that are handed over: before an upload, if there is one.
    pub(super) fn pixel(self, codec: VideoCodec) -> Pixel {
        match self {
            Self::Software => codec.pixel(),
            Self::Nvenc => Pixel::YUV420P,
            Self::Vaapi | Self::Qsv | Self::VideoToolbox => Pixel::NV12,
        }
    }

    /// True if images must be uploaded to the GPU before they are encoded. The other encoders upload them internally.
    pub(super) fn needs_upload(self) -> bool {
        self == Self::Vaapi
    }

    /// Options of the encoder, as FFmpeg names them: constant quality, no reordering, no delayed output. The sweep's presets refer to the
    /// software encoders and do not apply.
    pub(super) fn options(self, settings: &VideoSettings) -> Vec<(&'static str, String)> {
        /// FFmpeg's unit of quality.
        const LAMBDA_PER_QP: u32 = 118;
        let qp = settings.crf.to_string();
        let fixed = |options: &[(&'static str, &str)]| -> Vec<(&'static str, String)> {
            let options = options.iter();
            options
                .map(|&(name, value)| (name, value.to_owned()))
                .collect()
        };
        let mut options = match self {
            Self::Software => return Vec::new(),
            Self::Nvenc => fixed(&[
                ("preset", "p4"),
                ("tune", "hq"),
                ("rc", "constqp"),
                ("rc-lookahead", "0"),
                ("zerolatency", "1"),
                ("delay", "0"),
            ]),
            Self::Vaapi => fixed(&[("rc_mode", "CQP"), ("async_depth", "1")]),
            Self::Qsv => fixed(&[("async_depth", "1")]),
            Self::VideoToolbox => {
                fixed(&[("allow_sw", "0"), ("realtime", "0"), ("flags", "+qscale")])
            }
        };
        options.push(match self {
            // Intelligent constant quality; 0 would switch it off.
            Self::Qsv => ("global_quality", settings.crf.max(1).to_string()),
            // 100 is best here.
            Self::VideoToolbox => {
                let quality = 100 - settings.crf.min(51) * 100 / 51;
                ("global_quality", (quality * LAMBDA_PER_QP).to_string())
            }
            _ => ("qp", qp),
        });
        options
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// The options that every encoder has; `ffmpeg -h encoder=NAME` lists only its own.
    const OF_ALL_ENCODERS: [&str; 2] = ["flags", "global_quality"];

    /// FFmpeg's table of the encoder, if it is compiled in.
    fn table_of(encoder: &str) -> Option<String> {
        let output = Command::new("ffmpeg")
            .args(["-hide_banner", "-h", &format!("encoder={encoder}")])
            .output()
            .ok()?;
        let table = String::from_utf8_lossy(&output.stdout).into_owned();
        table.contains("AVOptions").then_some(table)
    }

    /// True if a table has an option and, if its values have names, this value.
    fn has(table: &str, option: &str, value: &str) -> bool {
        let first_word = |line: &str| line.split_whitespace().next().map(str::to_owned);
        // Names of values stand below their option, farther to the right.
        let is_value = |line: &&str| line.starts_with("     ");
        let wanted = Some(format!("-{option}"));
        let mut lines = table
            .lines()
            .skip_while(|&line| is_value(&line) || first_word(line) != wanted);
        if lines.next().is_none() {
            return false;
        }
        let is_number = value.chars().all(|character| character.is_ascii_digit());
        let mut values = lines.take_while(is_value);
        is_number || values.any(|line| first_word(line).as_deref() == Some(value))
    }

    #[test]
    fn options_and_their_values_are_in_ffmpegs_own_tables() {
        let mut compared = 0;
        for encoder in VideoEncoder::ALL {
            for codec in [VideoCodec::H264, VideoCodec::H265] {
                let name = encoder.of_codec(codec).unwrap();
                let Some(table) = table_of(name) else {
                    eprintln!("skipped: no {name} in this FFmpeg");
                    continue;
                };
                for (option, value) in encoder.options(&VideoSettings::of(codec)) {
                    if !OF_ALL_ENCODERS.contains(&option) {
                        assert!(has(&table, option, &value), "{name}: {option}={value}");
                        compared += 1;
                    }
                }
            }
        }
        let table = "  -rc  <int>  E..V....... mode\n     constqp  0  E..V\n  -qp  <int>  E..V\n";
        assert!(has(table, "rc", "constqp") && has(table, "qp", "12"));
        assert!(!has(table, "rc", "cqp") && !has(table, "crf", "12"));
        eprintln!("{compared} options compared");
    }

    #[test]
    fn pixel_formats_are_among_those_that_ffmpegs_encoders_take() {
        for encoder in VideoEncoder::ALL {
            let name = encoder.of_codec(VideoCodec::H264).unwrap();
            let Some(table) = table_of(name) else {
                eprintln!("skipped: no {name} in this FFmpeg");
                continue;
            };
            let taken = if encoder.needs_upload() {
                Pixel::VAAPI
            } else {
                encoder.pixel(VideoCodec::H264)
            };
            let taken = taken.descriptor().unwrap().name();
            let line = table
                .lines()
                .find(|line| line.contains("Supported pixel formats"));
            let formats: Vec<&str> = line.unwrap().split_whitespace().collect();
            assert!(
                formats.contains(&taken),
                "{name} takes no {taken}: {formats:?}"
            );
        }
    }

    #[test]
    fn a_gpu_is_offered_only_for_codecs_whose_loss_is_of_the_same_kind() {
        for encoder in VideoEncoder::ALL {
            let offered = VideoCodec::ALL
                .into_iter()
                .filter(|codec| encoder.of_codec(*codec).is_some());
            let expected = if encoder == VideoEncoder::Software {
                5
            } else {
                2
            };
            assert_eq!(offered.count(), expected, "{}", encoder.name());
        }
    }
}
