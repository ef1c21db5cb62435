//! Reads a video from its first picture to its last.

use std::path::{Path, PathBuf};

use ffmpeg_next::codec::{self, threading};
use ffmpeg_next::format::{self, Pixel};
use ffmpeg_next::software::scaling::Flags;
use ffmpeg_next::{Packet, color, decoder, frame, media};

use super::scaler::{Matrix, Scaler};
use super::{BYTES_PER_PIXEL, fault, ffmpeg_path, start_ffmpeg};
use crate::error::{Error, Result};
use crate::limits::PICTURE_SIDE_PX;
use crate::memory;
use crate::outside_file::{self, FileKind};

/// Pictures that a decoder references, the one that it decodes, and those being converted to RGB.
const FRAMES_HELD: u64 = 8;

/// A video that is being read. Pictures are decoded on the calling thread: use several threads for several videos.
pub struct VideoReader {
    path: PathBuf,
    input: format::context::Input,
    stream: usize,
    decoder: decoder::Video,
    scaler: Option<Scaler>,
    coded: frame::Video,
    rgb: frame::Video,
    time_base: (u32, u32),
    /// From the file's header; 0 if it has none.
    pub(super) frames_announced: u64,
    frames_read: u64,
    all_sent: bool,
}

impl VideoReader {
    /// Opens a video file and its first video stream.
    pub fn open(path: &Path) -> Result<Self> {
        start_ffmpeg();
        let name = ffmpeg_path(path)?;
        // FFmpeg would wait for a FIFO, and read a device endlessly.
        outside_file::open(path, FileKind::VIDEO)?;
        let input = format::input(&name).map_err(|e| fault(path, "open it", e))?;
        let stream = input
            .streams()
            .best(media::Type::Video)
            .ok_or_else(|| fault(path, "read it", "there is no video stream in it"))?;
        let rate = stream.time_base();
        let time_base = u32::try_from(rate.numerator())
            .ok()
            .zip(u32::try_from(rate.denominator()).ok())
            .filter(|(numerator, denominator)| *numerator > 0 && *denominator > 0)
            .ok_or_else(|| {
                fault(
                    path,
                    "read it",
                    format!("its time base is {rate}, expected a positive fraction"),
                )
            })?;
        let frames_announced = u64::try_from(stream.frames()).unwrap_or(0);
        let index = stream.index();
        let mut context = codec::context::Context::from_parameters(stream.parameters())
            .map_err(|e| fault(path, "find a decoder", e))?;
        context.set_threading(threading::Config {
            kind: threading::Type::Slice,
            count: 1,
            ..Default::default()
        });
        let decoder = context
            .decoder()
            .video()
            .map_err(|e| fault(path, "start the decoder", e))?;
        let (width_px, height_px) = (decoder.width(), decoder.height());
        let most_px = PICTURE_SIDE_PX.most as u32;
        if !(1..=most_px).contains(&width_px) || !(1..=most_px).contains(&height_px) {
            let found = format!(
                "its pictures have {width_px}x{height_px} pixels, expected sides of 1 to {most_px}"
            );
            return Err(fault(path, "read it", found));
        }
        let rgb_bytes = u64::from(width_px) * u64::from(height_px) * BYTES_PER_PIXEL as u64;
        memory::check(
            format_args!("video {}", path.display()),
            FRAMES_HELD * rgb_bytes,
        )?;
        let rgb = frame::Video::new(Pixel::RGB24, width_px, height_px);
        Ok(Self {
            path: path.to_owned(),
            input,
            stream: index,
            decoder,
            scaler: None,
            coded: frame::Video::empty(),
            rgb,
            time_base,
            frames_announced,
            frames_read: 0,
            all_sent: false,
        })
    }

    /// Width of the pictures, pixels.
    pub fn width(&self) -> u32 {
        self.rgb.width()
    }

    /// Height of the pictures, pixels.
    pub fn height(&self) -> u32 {
        self.rgb.height()
    }

    /// Unit of the timestamps as a fraction of a second: numerator, denominator.
    pub(crate) fn time_base(&self) -> (u32, u32) {
        self.time_base
    }

    /// Decodes the next picture into `rgb` (rows of RGB from top to bottom without gaps) and returns its timestamp, or `None` after
    /// the last picture. A damaged picture, and an end before the declared number of pictures, are errors.
    pub fn next_frame(&mut self, rgb: &mut Vec<u8>) -> Result<Option<i64>> {
        let Some(pts) = self.decode()? else {
            return Ok(None);
        };
        self.convert()?;
        let row_bytes = self.width() as usize * BYTES_PER_PIXEL;
        rgb.clear();
        rgb.reserve(row_bytes * self.height() as usize);
        for row in self
            .rgb
            .data(0)
            .chunks_exact(self.rgb.stride(0))
            .take(self.height() as usize)
        {
            rgb.extend_from_slice(&row[..row_bytes]);
        }
        Ok(Some(pts))
    }

    /// Decodes the next picture without returning it: enough to check timestamps and that it can be decoded.
    pub fn skip_frame(&mut self) -> Result<Option<i64>> {
        self.decode()
    }

    fn decode(&mut self) -> Result<Option<i64>> {
        loop {
            match self.decoder.receive_frame(&mut self.coded) {
                Ok(()) => {
                    if self.coded.is_corrupt() || self.coded.has_decode_errors() {
                        return Err(self.fault(
                            format!("decode picture {}", self.frames_read),
                            "the data is damaged",
                        ));
                    }
                    let pts = self.coded.timestamp().ok_or_else(|| {
                        self.fault(
                            format!("place picture {}", self.frames_read),
                            "it has no timestamp",
                        )
                    })?;
                    self.frames_read += 1;
                    return Ok(Some(pts));
                }
                Err(ffmpeg_next::Error::Eof) => return self.end(),
                Err(ffmpeg_next::Error::Other { errno })
                    if errno == ffmpeg_next::util::error::EAGAIN =>
                {
                    self.send()?;
                }
                Err(e) => return Err(self.fault(format!("decode picture {}", self.frames_read), e)),
            }
        }
    }

    /// Sends the decoder its next packet.
    fn send(&mut self) -> Result<()> {
        let mut packet = Packet::empty();
        loop {
            match packet.read(&mut self.input) {
                Ok(()) if packet.stream() != self.stream => {}
                Ok(()) => {
                    return self.decoder.send_packet(&packet).map_err(|e| {
                        self.fault(format!("decode after picture {}", self.frames_read), e)
                    });
                }
                Err(ffmpeg_next::Error::Eof) if !self.all_sent => {
                    self.all_sent = true;
                    return self
                        .decoder
                        .send_eof()
                        .map_err(|e| self.fault("finish decoding", e));
                }
                Err(e) => {
                    return Err(
                        self.fault(format!("read on after picture {}", self.frames_read), e)
                    );
                }
            }
        }
    }

    fn end(&self) -> Result<Option<i64>> {
        if self.frames_announced > 0 && self.frames_read != self.frames_announced {
            let cause = format!(
                "it ends after {} pictures, its header says {}",
                self.frames_read, self.frames_announced
            );
            return Err(self.fault("read it whole", cause));
        }
        Ok(None)
    }

    fn convert(&mut self) -> Result<()> {
        if self.scaler.is_none() {
            let matrix = match self.coded.color_space() {
                color::Space::BT470BG | color::Space::SMPTE170M => Matrix::Bt601,
                _ => Matrix::Bt709,
            };
            let full_range = self.coded.color_range() == color::Range::JPEG;
            // Without exact rounding swscale uses a path that is six times faster and off by at most two grey levels.
            let scaler = Scaler::new(
                (self.coded.format(), Pixel::RGB24),
                self.coded.width(),
                self.coded.height(),
                Flags::BILINEAR,
                matrix,
                full_range,
            );
            self.scaler = Some(scaler.map_err(|e| self.fault("prepare the colour conversion", e))?);
        }
        match &mut self.scaler {
            Some(scaler) => scaler
                .run(&self.coded, &mut self.rgb)
                .map_err(|e| fault(&self.path, "convert a picture (has its size changed?)", e)),
            None => Ok(()),
        }
    }

    fn fault(&self, action: impl AsRef<str>, cause: impl std::fmt::Display) -> Error {
        fault(&self.path, action.as_ref(), cause)
    }
}
