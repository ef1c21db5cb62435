//! The stream between a camera and its recorder: an image after the camera's own encoder.
//!
//! Cameras code H.264 at a bit rate, whatever the image needs: a key frame every two seconds, no B-frames, limited range, one second of
//! buffer. Each image is coded with x264 and decoded again at once; the corpus's encoder then takes it. One thread: the same images give
//! the same bytes.
//!
//! The bit rate is for a camera with 30 images per second. A corpus with fewer images gives each image its share of such a stream. They
//! differ more than a camera's would, so they come out worse.

use std::path::{Path, PathBuf};

use ffmpeg_next::codec::{self, context};
use ffmpeg_next::format::Pixel;
use ffmpeg_next::{Dictionary, Packet, Rational, color, decoder, encoder, frame};

use super::conversion::Conversion;
use super::conversion::scaler::Scaler;
use super::{fault, slice_threads, start_ffmpeg};
use crate::error::{Error, Result};
use crate::geometry::imaging::Stream;
use crate::numbers::frame_rate::FrameRate;

/// A camera's images per second, unless the corpus has more.
const CAMERA_RATE: FrameRate = FrameRate {
    numerator: 30,
    denominator: 1,
};
/// Time between key frames, s.
const KEY_FRAME_S: f64 = 2.0;
/// About as good as encoders in cameras.
const PRESET: &str = "veryfast";
const FULL_RANGE: bool = false;

/// A camera's stream.
pub struct CameraStream {
    /// The video that it leads to, for messages.
    path: PathBuf,
    encoder: encoder::Video,
    decoder: decoder::Video,
    to_coded: Scaler,
    coded: frame::Video,
    decoded: frame::Video,
    from_coded: Conversion,
    pictures: i64,
}

impl CameraStream {
    /// A stream of equally sized images. `path`: the video that it leads to, for messages.
    ///
    /// # Errors
    /// This FFmpeg lacks x264, or a decoder for H.264.
    pub fn new(
        path: &Path,
        stream: Stream,
        width_px: u32,
        height_px: u32,
        frame_rate: FrameRate,
    ) -> Result<Self> {
        start_ffmpeg();
        let failed =
            |action: &str, cause: &dyn std::fmt::Display| fault(path, action, cause.to_string());
        let named = encoder::find_by_name("libx264").ok_or_else(|| {
            failed(
                "start the camera's stream",
                &"this FFmpeg has no encoder libx264; install one that has it",
            )
        })?;
        let rate = if frame_rate.period_s() < CAMERA_RATE.period_s() {
            frame_rate
        } else {
            CAMERA_RATE
        };
        let per_s = Rational(rate.numerator as i32, rate.denominator as i32);
        let mut context = context::Context::new_with_codec(named);
        context.set_threading(slice_threads(1));
        let mut video = context
            .encoder()
            .video()
            .map_err(|e| failed("start the camera's encoder", &e))?;
        video.set_width(width_px);
        video.set_height(height_px);
        video.set_format(Pixel::YUV420P);
        video.set_time_base(per_s.invert());
        video.set_frame_rate(Some(per_s));
        video.set_max_b_frames(0);
        video.set_gop((KEY_FRAME_S / rate.period_s()).round() as u32);
        video.set_colorspace(color::Space::BT709);
        video.set_color_range(color::Range::MPEG);
        video.set_color_primaries(color::Primaries::BT709);
        video.set_color_transfer_characteristic(color::TransferCharacteristic::BT709);
        let encoder = video
            .open_with(options(stream))
            .map_err(|e| failed("start the camera's encoder", &e))?;

        let decoder = decoder::find(codec::Id::H264)
            .ok_or_else(|| failed("read the camera's stream", &"there is no decoder of H.264"))?;
        let mut context = context::Context::new_with_codec(decoder);
        context.set_threading(slice_threads(1));
        context.set_flags(codec::Flags::LOW_DELAY);
        let decoder = context
            .decoder()
            .video()
            .map_err(|e| failed("start the decoder of the camera's stream", &e))?;
        let to_coded = Scaler::from_rgb(Pixel::YUV420P, width_px, height_px, FULL_RANGE)
            .map_err(|e| failed("prepare the colours of the camera's stream", &e))?;
        Ok(Self {
            path: path.to_owned(),
            encoder,
            decoder,
            to_coded,
            coded: frame::Video::new(Pixel::YUV420P, width_px, height_px),
            decoded: frame::Video::empty(),
            from_coded: Conversion::default(),
            pictures: 0,
        })
    }

    /// Sends an image (rows of RGB from top to bottom without gaps) through the stream into `received`, and returns the bytes that it took
    /// there.
    ///
    /// # Errors
    /// FFmpeg fails, or holds the image back.
    pub fn pass(&mut self, rgb: &[u8], received: &mut Vec<u8>) -> Result<usize> {
        let bytes = self
            .code(rgb)
            .map_err(|e| self.fault("code an image in the camera's stream", e))?;
        self.decoder
            .receive_frame(&mut self.decoded)
            .map_err(|e| self.fault("decode an image of the camera's stream", e))?;
        self.from_coded
            .whole(&self.decoded, received)
            .map_err(|e| self.fault("convert an image of the camera's stream", e))?;
        Ok(bytes)
    }

    fn code(&mut self, rgb: &[u8]) -> std::result::Result<usize, ffmpeg_next::Error> {
        Scaler::make_writable(&mut self.coded)?;
        self.to_coded.run_rgb(rgb, &mut self.coded)?;
        self.coded.set_pts(Some(self.pictures));
        self.pictures += 1;
        self.encoder.send_frame(&self.coded)?;
        // One packet for each image, without delay.
        let mut packet = Packet::empty();
        self.encoder.receive_packet(&mut packet)?;
        self.decoder.send_packet(&packet)?;
        Ok(packet.size())
    }

    fn fault(&self, action: &str, cause: impl std::fmt::Display + 'static) -> Error {
        fault(&self.path, action, cause)
    }
}

fn options(stream: Stream) -> Dictionary<'static> {
    let bit_per_s = (stream.mbit_per_s * 1e6).round();
    let mut options = Dictionary::new();
    options.set("preset", PRESET);
    options.set("tune", "zerolatency");
    options.set("b", &bit_per_s.to_string());
    options.set("maxrate", &bit_per_s.to_string());
    // The rate control's buffer holds a second of images.
    options.set("bufsize", &bit_per_s.round().to_string());
    options
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: (u32, u32) = (640, 384);

    fn stream(mbit_per_s: f64, frame_rate: FrameRate) -> CameraStream {
        let (width, height) = SIZE_PX;
        CameraStream::new(
            Path::new("views/left.mp4"),
            Stream { mbit_per_s },
            width,
            height,
            frame_rate,
        )
        .unwrap()
    }

    /// A sky with noise that differs from image to image, and a dark bar that moves.
    fn picture(tick: u32) -> Vec<u8> {
        let (width, height) = SIZE_PX;
        let mut rgb = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let noise = crate::numbers::noise_hash::hash(x, y, tick) % 9;
                let across = (f64::from(x) - 100.0 - 1.5 * f64::from(tick)).abs();
                let bar = across < 12.0 && y.abs_diff(200) < 4;
                let grey = if bar { 90 } else { 150 + noise as u8 };
                rgb.extend([grey, grey + 8, grey + 20]);
            }
        }
        rgb
    }

    #[test]
    fn a_stream_keeps_its_rate_and_a_higher_one_keeps_more_of_the_picture() {
        let rate = FrameRate::new(30, 1).unwrap();
        let [low, high] = [0.5, 4.0].map(|mbit_per_s| {
            let mut stream = stream(mbit_per_s, rate);
            let mut received = Vec::new();
            let (mut bytes, mut error) = (0, 0.0);
            for tick in 0..90 {
                let sent = picture(tick);
                let coded = stream.pass(&sent, &mut received).unwrap();
                assert_eq!(received.len(), sent.len());
                // The second second and the third.
                if tick >= 30 {
                    bytes += coded;
                    let squares = sent.iter().zip(&received);
                    error += squares
                        .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2))
                        .sum::<f64>();
                }
            }
            let found = bytes as f64 * 8.0 / 2.0 / 1e6;
            assert!((0.7..1.3).contains(&(found / mbit_per_s)), "{found} Mbit/s");
            error
        });
        assert!(low > 1.3 * high, "{low} {high}");
    }

    #[test]
    fn a_slow_corpus_gives_each_picture_its_share_of_a_cameras_rate() {
        let bytes_at = |frame_rate| {
            let mut stream = stream(3.0, frame_rate);
            let mut received = Vec::new();
            let all = (0..60).map(|tick| stream.pass(&picture(tick), &mut received).unwrap());
            all.sum::<usize>()
        };
        let at_30 = bytes_at(FrameRate::new(30, 1).unwrap());
        assert_eq!(bytes_at(FrameRate::new(1, 2).unwrap()), at_30);
        assert!(bytes_at(FrameRate::new(60, 1).unwrap()) < at_30 * 3 / 4);
    }

    #[test]
    fn the_same_pictures_come_out_as_the_same_bytes_in_their_own_colours() {
        let run = || {
            let mut stream = stream(6.0, FrameRate::new(1, 1).unwrap());
            let mut received = Vec::new();
            let all = (0..20).map(|tick| {
                stream.pass(&picture(tick), &mut received).unwrap();
                received.clone()
            });
            all.collect::<Vec<_>>()
        };
        let first = run();
        assert!(first == run());
        let mean = |rgb: &[u8], colour: usize| {
            let values = rgb.iter().skip(colour).step_by(3);
            values.map(|value| f64::from(*value)).sum::<f64>() * 3.0 / rgb.len() as f64
        };
        let (sent, received) = (picture(19), &first[19]);
        for colour in 0..3 {
            let off = mean(received, colour) - mean(&sent, colour);
            // Limited range and subsampled colour round by a level each.
            assert!(off.abs() < 2.0, "{off} grey levels of colour {colour}");
        }
    }
}
