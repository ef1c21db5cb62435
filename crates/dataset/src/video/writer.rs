//! Writes a video, one image per tick.
//!
//! Until it is finished the file consists of fragments, one per image, each passed to the system at once: if the process is killed, all
//! images but the last one or two can be read.

use std::path::{Path, PathBuf};

use ffmpeg_next::format::{self, Pixel};
use ffmpeg_next::{Dictionary, Packet, Rational, color, encoder, frame};

use super::conversion::scaler::Scaler;
use super::{
    BYTES_PER_PIXEL, VideoCodec, VideoSettings, fault, ffmpeg_path, index, slice_threads,
    start_ffmpeg,
};
use crate::error::{Error, Result};
use crate::numbers::frame_rate::FrameRate;

/// Maximum distance between keyframes, in frames: a jump in a player decodes at most this many.
pub const GROUP_OF_PICTURES: u32 = 60;

/// FFmpeg's name of the format. Matroska rounds timestamps to milliseconds.
pub(super) const CONTAINER: &str = "mp4";

/// Brightness uses all 256 levels: limited range has a seventh fewer, which shifts small targets (`docs/video.md`).
const FULL_RANGE: bool = true;

/// Coefficients are rounded to the nearest step. x264's own rounding prefers zero, which blurs small targets.
const X264_PARAMETERS: &str = "deadzone-inter=0:deadzone-intra=0";

/// A video that is being written. If it is dropped before [`VideoWriter::finish`], it leaves a readable file without an index, possibly
/// without its last images.
pub struct VideoWriter {
    path: PathBuf,
    output: format::context::Output,
    encoder: encoder::Video,
    /// The encoder's pixel format.
    coded: frame::Video,
    /// Absent if the encoder takes RGB.
    conversion: Option<Scaler>,
    packet: Packet,
    frame_rate: FrameRate,
    ticks: u32,
}

impl VideoWriter {
    /// Starts a file in MP4. Its time base is 1 / [`FrameRate::time_scale`], so that every timestamp is exact.
    pub fn create(
        path: &Path,
        settings: &VideoSettings,
        width_px: u32,
        height_px: u32,
        frame_rate: FrameRate,
    ) -> Result<Self> {
        start_ffmpeg();
        if let Some((setting, message)) = settings.fault() {
            return Err(fault(
                path,
                "start it",
                format!("setting {setting}: {message}"),
            ));
        }
        let codec = settings.codec;
        let (encoder_name, pixel) = (codec.encoder(), codec.pixel());
        let halves_colours = pixel == Pixel::YUV420P;
        if width_px == 0
            || height_px == 0
            || (halves_colours && (width_px % 2 == 1 || height_px % 2 == 1))
        {
            return Err(fault(
                path,
                "start it",
                format!("{width_px}x{height_px} pixels, expected even numbers above 0"),
            ));
        }
        let named = encoder::find_by_name(encoder_name).ok_or_else(|| {
            fault(
                path,
                "start it",
                format!("this FFmpeg has no encoder {encoder_name}; install one that has it"),
            )
        })?;
        let time_scale = i32::try_from(frame_rate.time_scale())
            .map_err(|e| fault(path, "use its frame rate", e))?;
        let time_base = Rational(1, time_scale);

        let mut output = format::output_as(&ffmpeg_path(path)?, CONTAINER)
            .map_err(|e| fault(path, "create it", e))?;
        let mut context = ffmpeg_next::codec::context::Context::new_with_codec(named);
        context.set_threading(slice_threads(settings.threads as usize));
        if output
            .format()
            .flags()
            .contains(format::Flags::GLOBAL_HEADER)
        {
            context.set_flags(ffmpeg_next::codec::Flags::GLOBAL_HEADER);
        }
        let mut video = context
            .encoder()
            .video()
            .map_err(|e| fault(path, "start the encoder", e))?;
        video.set_width(width_px);
        video.set_height(height_px);
        video.set_format(pixel);
        video.set_time_base(time_base);
        video.set_frame_rate(Some(Rational(time_scale, frame_rate.denominator as i32)));
        video.set_max_b_frames(0);
        // Quality is set by the rate factor alone.
        video.set_bit_rate(0);
        video.set_gop(GROUP_OF_PICTURES);
        tag_colours(&mut video, pixel);
        let encoder = video
            .open_with(encoder_options(settings))
            .map_err(|e| fault(path, "start the encoder", e))?;

        let mut stream = output
            .add_stream(named)
            .map_err(|e| fault(path, "add the stream", e))?;
        stream.set_parameters(&encoder);
        stream.set_time_base(time_base);
        stream.set_avg_frame_rate(Rational(time_scale, frame_rate.denominator as i32));
        let mut options = exact_timestamps(time_scale);
        options.set("movflags", "frag_every_frame+empty_moov+default_base_moof");
        options.set("flush_packets", "1");
        output
            .write_header_with(options)
            .map_err(|e| fault(path, "write the header", e))?;
        check_time_base(path, &output, time_base)?;

        let conversion = if pixel == Pixel::RGB24 {
            None
        } else {
            let scaler = Scaler::from_rgb(pixel, width_px, height_px, FULL_RANGE);
            Some(scaler.map_err(|e| fault(path, "prepare the colour conversion", e))?)
        };
        Ok(Self {
            path: path.to_owned(),
            output,
            encoder,
            coded: frame::Video::new(pixel, width_px, height_px),
            conversion,
            packet: Packet::empty(),
            frame_rate,
            ticks: 0,
        })
    }

    /// Writes the image of the next tick, rows of RGB from top to bottom without gaps, and returns its timestamp in units of the time base.
    pub fn write(&mut self, rgb: &[u8]) -> Result<i64> {
        let Self {
            path,
            coded,
            conversion,
            ..
        } = self;
        let row_bytes = coded.width() as usize * BYTES_PER_PIXEL;
        let expected = row_bytes * coded.height() as usize;
        if rgb.len() != expected {
            let found = format!("it has {} bytes, expected {expected}", rgb.len());
            return Err(fault(path, "take an image", found));
        }
        Scaler::make_writable(coded).map_err(|e| fault(path, "hold an image", e))?;
        match conversion {
            Some(scaler) => scaler
                .run_rgb(rgb, coded)
                .map_err(|e| fault(path, "convert an image", e))?,
            None => copy_rows(rgb, row_bytes, coded),
        }
        let pts = self.frame_rate.pts_of_tick(self.ticks);
        coded.set_pts(Some(pts));
        let sent = self.encoder.send_frame(coded);
        sent.map_err(|e| fault(path, &format!("encode the image of tick {}", self.ticks), e))?;
        self.ticks += 1;
        self.write_ready_packets()?;
        Ok(pts)
    }

    /// Completes the file, adds an index, and makes it durable. If that fails, the written part stays readable.
    pub fn finish(mut self) -> Result<()> {
        self.encoder
            .send_eof()
            .map_err(|e| self.fault("finish encoding", e))?;
        self.write_ready_packets()?;
        self.output
            .write_trailer()
            .map_err(|e| self.fault("write the index", e))?;
        let (path, pictures) = (self.path.clone(), self.ticks);
        drop(self);
        index::add(&path, pictures)
    }

    fn write_ready_packets(&mut self) -> Result<()> {
        loop {
            match self.encoder.receive_packet(&mut self.packet) {
                Ok(()) => {
                    self.packet.set_stream(0);
                    self.packet
                        .set_duration(i64::from(self.frame_rate.denominator));
                    self.packet
                        .write_interleaved(&mut self.output)
                        .map_err(|e| self.fault("write", e))?;
                }
                Err(ffmpeg_next::Error::Eof) => return Ok(()),
                Err(ffmpeg_next::Error::Other { errno })
                    if errno == ffmpeg_next::util::error::EAGAIN =>
                {
                    return Ok(());
                }
                Err(e) => return Err(self.fault("encode", e)),
            }
        }
    }

    fn fault(&self, action: &str, cause: impl std::fmt::Display + 'static) -> Error {
        fault(&self.path, action, cause)
    }
}

/// Copies contiguous rows into an RGB frame, which may have gaps between rows.
fn copy_rows(rgb: &[u8], row_bytes: usize, frame: &mut frame::Video) {
    let stride = frame.stride(0);
    let rows = frame.data_mut(0).chunks_exact_mut(stride);
    for (row, line) in rows.zip(rgb.chunks_exact(row_bytes)) {
        row[..row_bytes].copy_from_slice(line);
    }
}

/// Options of the muxer without which it multiplies small time scales, and rounds starts to milliseconds in an edit list.
pub(super) fn exact_timestamps(time_scale: i32) -> Dictionary<'static> {
    let mut options = Dictionary::new();
    options.set("video_track_timescale", &time_scale.to_string());
    options.set("use_editlist", "0");
    options
}

/// Rejects a file whose timestamps would be rounded. Call it when its header is written.
pub(super) fn check_time_base(
    path: &Path,
    output: &format::context::Output,
    expected: Rational,
) -> Result<()> {
    let found = output.stream(0).map(|stream| stream.time_base());
    if found == Some(expected) {
        return Ok(());
    }
    Err(fault(
        path,
        "keep exact timestamps",
        format!("time base is {found:?}, expected {expected}"),
    ))
}

fn tag_colours(video: &mut encoder::video::Video, pixel: Pixel) {
    let (space, range) = match pixel {
        Pixel::RGB24 => (color::Space::RGB, color::Range::JPEG),
        _ => (color::Space::BT709, color::Range::JPEG),
    };
    video.set_colorspace(space);
    video.set_color_range(range);
    video.set_color_primaries(color::Primaries::BT709);
    video.set_color_transfer_characteristic(color::TransferCharacteristic::BT709);
}

fn encoder_options(settings: &VideoSettings) -> Dictionary<'static> {
    let mut options = Dictionary::new();
    let crf = settings.crf.to_string();
    match settings.codec {
        VideoCodec::H264 => {
            options.set("preset", &settings.preset);
            options.set("crf", &crf);
            options.set("tune", "zerolatency");
            options.set("x264-params", X264_PARAMETERS);
        }
        VideoCodec::H264Lossless => {
            options.set("preset", &settings.preset);
            options.set("qp", "0");
            options.set("tune", "zerolatency");
        }
    }
    options
}
