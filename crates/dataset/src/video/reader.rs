//! Reads a video from its first image to its last.

use std::path::{Path, PathBuf};

use ffmpeg_next::codec;
use ffmpeg_next::{Packet, Stream, decoder, format, frame};

use super::conversion::jpeg::{jpeg, jpeg_of_planes};
use super::conversion::luma::Luma;
use super::conversion::{self, Conversion, PicturePart};
use super::unlike_scene::{turned, unlike_the_scene};
use super::{BYTES_PER_PIXEL, TimeBase, fault, open_stream, slice_threads};
use crate::error::{Error, Result};
use crate::numbers::frame_rate::FrameRate;
use crate::numbers::limits::PICTURE_SIDE_PX;
use crate::work::memory;

/// Images that a decoder references, the one that it decodes, the one before, and those being converted to RGB.
const FRAMES_HELD: u64 = 9;

/// A decoded image.
#[derive(Debug, Clone)]
pub struct RgbPicture {
    /// Rows of RGB from top to bottom without gaps.
    pub rgb: Vec<u8>,
    /// Columns and rows.
    pub size_px: [u32; 2],
}

/// A video that is being read. Images are decoded on the calling thread: use several threads for several videos.
pub struct VideoReader {
    path: PathBuf,
    input: format::context::Input,
    stream: usize,
    decoder: decoder::Video,
    width_px: u32,
    height_px: u32,
    /// The image that was decoded last.
    coded: frame::Video,
    /// The one before it.
    previous: frame::Video,
    conversion: Conversion,
    /// Unit of the file's timestamps.
    time_base: TimeBase,
    /// Unit of the timestamps that are returned.
    unit: TimeBase,
    /// Number of images in the file's header; 0 if it has none.
    pub(super) frames_announced: u64,
    frames_read: u64,
    all_sent: bool,
    /// State of a reader that leaves out damaged images.
    damage: Option<Damage>,
}

/// Damaged images, and those after them until the next key frame, which may show damaged ones.
#[derive(Debug, Clone, Copy, Default)]
struct Damage {
    images: u64,
    /// Timestamp of the first of them.
    first_pts: Option<i64>,
    /// True until the next key frame.
    lasts: bool,
}

impl Damage {
    fn note(&mut self, pts: Option<i64>) {
        if self.images == 0 {
            self.first_pts = pts;
        }
        self.images += 1;
        self.lasts = true;
    }
}

impl VideoReader {
    /// Opens a scenario's video: its timestamps are in the unit of the tables' `pts`, whatever the unit of the file. An image between two
    /// such units belongs to no tick and is an error.
    pub fn open_ticks(path: &Path, frame_rate: FrameRate) -> Result<Self> {
        let mut reader = Self::open(path)?;
        reader.unit = TimeBase::of_ticks(frame_rate);
        Ok(reader)
    }

    /// Opens a video file and its first video stream. Timestamps are in the unit of the file.
    pub fn open(path: &Path) -> Result<Self> {
        let (input, index, time_base) = open_stream(path)?;
        let stream = input
            .stream(index)
            .expect("the stream was found in the file");
        let frames_announced = u64::try_from(stream.frames()).unwrap_or(0);
        let mut context = codec::context::Context::from_parameters(stream.parameters())
            .map_err(|e| fault(path, "find a decoder", e))?;
        context.set_threading(slice_threads(1));
        let decoder = context
            .decoder()
            .video()
            .map_err(|e| fault(path, "start the decoder", e))?;
        let (width_px, height_px) = (decoder.width(), decoder.height());
        let most_px = PICTURE_SIDE_PX.most as u32;
        if !(1..=most_px).contains(&width_px) || !(1..=most_px).contains(&height_px) {
            let found = format!(
                "its images have {width_px}x{height_px} pixels, expected sides of 1 to {most_px}"
            );
            return Err(fault(path, "read it", found));
        }
        let rgb_bytes = u64::from(width_px) * u64::from(height_px) * BYTES_PER_PIXEL as u64;
        memory::check(
            format_args!("video {}", path.display()),
            FRAMES_HELD * rgb_bytes,
        )?;
        Ok(Self {
            path: path.to_owned(),
            input,
            stream: index,
            decoder,
            width_px,
            height_px,
            coded: frame::Video::empty(),
            previous: frame::Video::empty(),
            conversion: Conversion::default(),
            time_base,
            unit: time_base,
            frames_announced,
            frames_read: 0,
            all_sent: false,
            damage: None,
        })
    }

    /// Opens a recording of a camera. Its images may be fewer than its header says, since an edit list may leave some out. Damaged ones are
    /// left out and counted.
    ///
    /// # Errors
    /// Its images are to be shown turned or mirrored.
    pub fn open_recording(path: &Path) -> Result<Self> {
        let mut reader = Self::open(path)?;
        reader.frames_announced = 0;
        reader.damage = Some(Damage::default());
        match turned(&reader.stream()) {
            Some(why) => Err(reader.fault("read it", why)),
            None => Ok(reader),
        }
    }

    fn stream(&self) -> Stream<'_> {
        let stream = self.input.stream(self.stream);
        stream.expect("the stream was found in the file")
    }

    /// Number of images by the header, or by duration and usual rate; 0 if unknown.
    pub fn expected_images(&self) -> u64 {
        let stream = self.stream();
        match u64::try_from(stream.frames()) {
            Ok(count) if count > 0 => count,
            _ => {
                let seconds =
                    self.input.duration() as f64 / f64::from(ffmpeg_next::ffi::AV_TIME_BASE);
                let rate = stream.avg_frame_rate();
                let images = seconds * f64::from(rate.numerator()) / f64::from(rate.denominator());
                // Saturates, also for unknown ones.
                images as u64
            }
        }
    }

    /// Number of images of a recording that were left out up to now, because they or earlier ones are damaged.
    pub fn damaged_images(&self) -> u64 {
        self.damage.map_or(0, |damage| damage.images)
    }

    /// Timestamp of the first of these images.
    pub fn first_damaged_pts(&self) -> Option<i64> {
        self.damage?.first_pts
    }

    /// Time at which the recording began, as the file states it.
    pub fn creation_time(&self) -> Option<String> {
        let metadata = self.input.metadata();
        metadata.get("creation_time").map(str::to_owned)
    }

    /// Width of the images, pixels.
    pub fn width(&self) -> u32 {
        self.width_px
    }

    /// Height of the images, pixels.
    pub fn height(&self) -> u32 {
        self.height_px
    }

    /// Unit of the file's timestamps.
    pub fn time_base(&self) -> TimeBase {
        self.time_base
    }

    /// Decodes the next image into `rgb` (rows of RGB from top to bottom without gaps) and returns its timestamp, or `None` after the last
    /// image. A damaged image, and an end before the declared number of images, are errors.
    pub fn next_frame(&mut self, rgb: &mut Vec<u8>) -> Result<Option<i64>> {
        let pts = self.skip_frame()?;
        if pts.is_some() {
            self.convert(rgb)?;
        }
        Ok(pts)
    }

    /// Continues at a keyframe at or before the image with this timestamp: the next ones lead to it. From then on the number of images is
    /// no longer compared with the header, and messages count from the keyframe.
    pub fn seek(&mut self, pts: i64) -> Result<()> {
        let seconds = pts as f64 * self.unit.seconds();
        let time = (seconds * f64::from(ffmpeg_next::ffi::AV_TIME_BASE)).round() as i64;
        self.input
            .seek(time, ..time)
            .map_err(|e| self.fault(format!("go to timestamp {pts}"), e))?;
        self.decoder.flush();
        self.frames_announced = 0;
        self.frames_read = 0;
        self.all_sent = false;
        Ok(())
    }

    /// Goes to the image with this timestamp and converts it; `None` if there is none.
    pub(crate) fn picture_at(&mut self, pts: i64) -> Result<Option<RgbPicture>> {
        self.seek(pts)?;
        let found = loop {
            match self.skip_frame()? {
                Some(earlier) if earlier < pts => {}
                found => break found,
            }
        };
        if found != Some(pts) {
            return Ok(None);
        }
        let mut rgb = Vec::new();
        self.convert(&mut rgb)?;
        Ok(Some(RgbPicture {
            rgb,
            size_px: [self.width_px, self.height_px],
        }))
    }

    /// The image that was decoded last, as [`VideoReader::next_frame`] gives it.
    pub fn convert(&mut self, rgb: &mut Vec<u8>) -> Result<()> {
        self.check_size()?;
        let done = self.conversion.whole(&self.coded, rgb);
        done.map_err(|e| self.fault("convert an image", e))
    }

    /// The brightness of the image that was decoded last; `None` if it is not coded in planes of bytes.
    pub fn luma(&self) -> Option<Luma<'_>> {
        self.luma_of(&self.coded)
    }

    /// Brightness of the image that was decoded before it.
    pub fn previous_luma(&self) -> Option<Luma<'_>> {
        self.luma_of(&self.previous)
    }

    fn luma_of<'a>(&self, coded: &'a frame::Video) -> Option<Luma<'a>> {
        let is_of_size = (coded.width(), coded.height()) == (self.width_px, self.height_px);
        Luma::of_frame(coded).filter(|_| is_of_size)
    }

    /// The image's planes before conversion, one after the other without gaps: brightness, then two of colour with half the columns and
    /// rows. `None` if it is not coded in this way, with 8 bits, full range and the colours of BT.709.
    pub fn planes(&self) -> Result<Option<Vec<u8>>> {
        self.check_size()?;
        Ok(conversion::planes(&self.coded))
    }

    /// The image that was decoded last, as JPEG. `path` names it in errors.
    pub fn jpeg(&mut self, path: &Path) -> Result<Vec<u8>> {
        let size_px = [self.width_px, self.height_px];
        if let Some(planes) = self.planes()? {
            return jpeg_of_planes(path, planes, size_px);
        }
        let mut rgb = Vec::new();
        self.convert(&mut rgb)?;
        jpeg(path, &rgb, size_px)
    }

    /// Converts only a part of the image.
    pub fn convert_part(&mut self, part: PicturePart, rgb: &mut Vec<u8>) -> Result<()> {
        self.check_size()?;
        let done = self.conversion.part(&self.coded, part, rgb);
        done.map_err(|e| self.fault(format!("convert the part {part:?} of an image"), e))
    }

    /// Reason why the image that was decoded last does not show the scene pixel by pixel.
    pub fn unlike_the_scene(&self) -> Option<&'static str> {
        unlike_the_scene(&self.coded)
    }

    fn check_size(&self) -> Result<()> {
        let found = (self.coded.width(), self.coded.height());
        if found == (self.width_px, self.height_px) {
            return Ok(());
        }
        let cause = format!(
            "it has {}x{} pixels, the first one {}x{}",
            found.0, found.1, self.width_px, self.height_px
        );
        let last = self.frames_read.saturating_sub(1);
        Err(self.fault(format!("convert image {last}"), cause))
    }

    /// Decodes the next image without converting it, and returns its timestamp: enough to check that it can be decoded.
    pub fn skip_frame(&mut self) -> Result<Option<i64>> {
        std::mem::swap(&mut self.coded, &mut self.previous);
        loop {
            match self.decoder.receive_frame(&mut self.coded) {
                Ok(()) => {
                    let is_damaged = self.coded.is_corrupt() || self.coded.has_decode_errors();
                    if let Some(damage) = &mut self.damage {
                        damage.lasts &= !self.coded.is_key();
                        if is_damaged || damage.lasts {
                            damage.note(self.coded.timestamp());
                            continue;
                        }
                    }
                    if is_damaged {
                        return Err(self.fault(
                            format!("decode image {}", self.frames_read),
                            "the data is damaged",
                        ));
                    }
                    let pts = self.coded.timestamp().ok_or_else(|| {
                        self.fault(
                            format!("place image {}", self.frames_read),
                            "it has no timestamp",
                        )
                    })?;
                    let in_units = self.time_base.convert(pts, self.unit);
                    let pts = in_units.ok_or_else(|| {
                        self.fault(
                            format!("place image {}", self.frames_read),
                            format!(
                                "its time is {pts} units of {}, expected a multiple of {}",
                                self.time_base, self.unit
                            ),
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
                Err(e) => match (e, &mut self.damage) {
                    (ffmpeg_next::Error::InvalidData, Some(damage)) => damage.note(None),
                    _ => return Err(self.fault(format!("decode image {}", self.frames_read), e)),
                },
            }
        }
    }

    /// Sends the decoder its next packet.
    fn send(&mut self) -> Result<()> {
        loop {
            // Before FFmpeg 6 a packet that is read into again loses its old memory for good.
            let mut packet = Packet::empty();
            match packet.read(&mut self.input) {
                Ok(()) if packet.stream() != self.stream => {}
                Ok(()) => {
                    return match (self.decoder.send_packet(&packet), &mut self.damage) {
                        (Err(ffmpeg_next::Error::InvalidData), Some(damage)) => {
                            damage.note(packet.pts());
                            Ok(())
                        }
                        (sent, _) => sent.map_err(|e| {
                            self.fault(format!("decode after image {}", self.frames_read), e)
                        }),
                    };
                }
                Err(ffmpeg_next::Error::Eof) if !self.all_sent => {
                    self.all_sent = true;
                    return self
                        .decoder
                        .send_eof()
                        .map_err(|e| self.fault("finish decoding", e));
                }
                Err(e) => {
                    return Err(self.fault(format!("read on after image {}", self.frames_read), e));
                }
            }
        }
    }

    fn end(&self) -> Result<Option<i64>> {
        if self.frames_announced > 0 && self.frames_read != self.frames_announced {
            let cause = format!(
                "it ends after {} images, its header says {}",
                self.frames_read, self.frames_announced
            );
            return Err(self.fault("read it whole", cause));
        }
        Ok(None)
    }

    fn fault(&self, action: impl AsRef<str>, cause: impl std::fmt::Display + 'static) -> Error {
        fault(&self.path, action.as_ref(), cause)
    }
}
