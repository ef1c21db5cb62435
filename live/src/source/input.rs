//! An open source: FFmpeg reads and decodes it, and every wait ends.
//!
//! FFmpeg's own timeouts let a stopped server pass for six seconds, so it asks us, ten times a second, whether to give up
//! ([`Patience`]). Streams of H.264 and H.265 are read without FFmpeg's parser, which holds each image until the next begins
//! ([`AccessUnits`]). Decoders run in the calling thread and delay no image.

use std::collections::VecDeque;
use std::sync::Arc;

use dataset::video::{DecodedImage, start_ffmpeg};
use ffmpeg_next::codec::packet::side_data;
use ffmpeg_next::codec::{self, threading};
use ffmpeg_next::{Packet, decoder, format, frame, media};

use crate::clock::UsualInterval;
use crate::source::access_unit::{AccessUnit, AccessUnits, UnitCodec};
use crate::source::address::{FfmpegSource, OpenFault, Patience, RecordedTimes};
use crate::source::connection;
use crate::source::gpu::Gpu;
use crate::source::undecoded::Undecoded;
use crate::source::{Decoder, Source};

/// Side of the largest block of a codec (H.265, AV1), pixels.
const MAX_BLOCK_PX: u64 = 128;
/// Images whose arrival is remembered until they are decoded.
const MAX_IN_DECODER: usize = 64;
/// Minimum gap that means a lost image, in usual intervals.
const GAP_PERIODS: f64 = 1.75;

/// Cause of the end of images.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum End {
    /// There are no more.
    Finished,
    /// The connection is gone.
    Lost(String),
    /// No packet came within this time, ms.
    Silent(u64),
    /// The source is unusable.
    Useless(String),
    /// The caller stopped it.
    Stopped,
}

/// A decoded image with its times.
pub(crate) struct InputImage {
    pub(crate) image: DecodedImage,
    /// When its last packet arrived, seconds since the start.
    pub(crate) arrival_s: f64,
    pub(crate) timestamp_s: Option<f64>,
    /// The sender's wall clock, seconds since the start.
    pub(crate) sender_s: Option<f64>,
    pub(crate) recorded_s: Option<f64>,
    pub(crate) is_damaged: bool,
}

pub(crate) struct Input {
    input: format::context::Input,
    stream: usize,
    seconds_per_unit: f64,
    decoder: decoder::Video,
    gpu: Option<Gpu>,
    units: Option<AccessUnits>,
    /// Images that are complete and not yet decoded.
    complete: VecDeque<AccessUnit>,
    /// Timestamp, arrival and sender's clock of the images in the decoder.
    sent: VecDeque<(Option<i64>, f64, Option<f64>)>,
    /// Timestamp and sender's clock of the piece that last had one.
    sender_of_piece: Option<(i64, f64)>,
    patience: Arc<Patience>,
    can_lose: bool,
    is_damaged: bool,
    last_pts: Option<i64>,
    usual_step: UsualInterval,
    undecoded: Undecoded,
    all_sent: bool,
    recorded: Option<RecordedTimes>,
}

impl Input {
    /// Opens a view's source within `most_ms`, for images of this size.
    pub(crate) fn open(
        source: &Source,
        decoder: Decoder,
        view: &str,
        size_px: [u32; 2],
        patience: Arc<Patience>,
        most_ms: u64,
    ) -> Result<Self, OpenFault> {
        start_ffmpeg();
        let place = FfmpegSource::of(source, view)?;
        let max_pixels = coded_pixels(size_px);
        let input = place.open(&patience, most_ms, max_pixels, true)?;
        let codec_id = video_of(&input)?.parameters().id();
        let codec = match codec_id {
            codec::Id::H264 => Some(UnitCodec::H264),
            codec::Id::HEVC => Some(UnitCodec::H265),
            _ => None,
        };
        let units = codec.filter(|_| place.is_stream).map(AccessUnits::new);
        let input = match units {
            // Other codecs need FFmpeg's parser.
            None if place.is_stream => place.open(&patience, most_ms, max_pixels, false)?,
            _ => input,
        };
        let stream = video_of(&input)?;
        let (index, unit) = (stream.index(), f64::from(stream.time_base()));
        let announced_px = connection::announced_px(&stream.parameters());
        if announced_px.into_iter().map(u64::from).product::<u64>() > max_pixels {
            return Err(other_size(announced_px, size_px));
        }
        let wrong = |cause: ffmpeg_next::Error| {
            OpenFault::Wrong(format!("FFmpeg has no decoder for it: {cause}"))
        };
        let mut context =
            codec::context::Context::from_parameters(stream.parameters()).map_err(wrong)?;
        context.set_threading(threading::Config {
            kind: threading::Type::Slice,
            count: 1,
            ..Default::default()
        });
        if !source.is_recorded() {
            context.set_flags(codec::Flags::LOW_DELAY);
        }
        let gpu = Gpu::open(decoder).map_err(|error| OpenFault::Absent(error.to_string()))?;
        if let Some(gpu) = &gpu {
            gpu.attach_to(&mut context);
        }
        let found = decoder::find(codec_id).ok_or(ffmpeg_next::Error::DecoderNotFound);
        let opened = found.and_then(|found| {
            let options = connection::decoder_options(max_pixels);
            context.decoder().open_as_with(found, options)?.video()
        });
        Ok(Self {
            decoder: opened.map_err(wrong)?,
            gpu,
            stream: index,
            seconds_per_unit: unit,
            input,
            units,
            complete: VecDeque::new(),
            sent: VecDeque::new(),
            sender_of_piece: None,
            patience,
            can_lose: place.can_lose,
            // Until the first key frame.
            is_damaged: place.is_stream,
            last_pts: None,
            usual_step: UsualInterval::default(),
            undecoded: Undecoded::default(),
            all_sent: false,
            recorded: place.recorded,
        })
    }

    pub(crate) fn codec(&self) -> &'static str {
        self.decoder.id().name()
    }

    /// Time between images that the source announces, seconds.
    pub(crate) fn announced_interval_s(&self) -> Option<f64> {
        let stream = self.input.stream(self.stream)?;
        let interval_s = f64::from(stream.avg_frame_rate()).recip();
        Some(interval_s).filter(|interval_s| interval_s.is_finite() && *interval_s > 0.0)
    }

    /// The next image; `most_ms`: for each packet.
    pub(crate) fn next(&mut self, most_ms: u64) -> Result<InputImage, End> {
        loop {
            let mut coded = frame::Video::empty();
            match self.decoder.receive_frame(&mut coded) {
                Ok(()) => return self.image(coded),
                Err(ffmpeg_next::Error::Eof) => return Err(End::Finished),
                Err(ffmpeg_next::Error::Other { errno })
                    if errno == ffmpeg_next::util::error::EAGAIN => {}
                // The next key frame is a new beginning.
                Err(_) => self.is_damaged = true,
            }
            if let Some(unit) = self.complete.pop_front() {
                self.is_damaged |= unit.is_cut;
                let sender_s = self.sender_s(unit.pts);
                let mut packet = Packet::copy(&unit.data);
                packet.set_pts(Some(unit.pts));
                self.send(&packet, sender_s);
            } else if let Some(fault) = self.undecoded.fault(self.patience.clock.now_s()) {
                return Err(End::Lost(fault));
            } else {
                self.read(most_ms)?;
            }
        }
    }

    fn image(&mut self, coded: frame::Video) -> Result<InputImage, End> {
        self.undecoded = Undecoded::default();
        let coded = match &mut self.gpu {
            None => coded,
            Some(gpu) if gpu.has_decoded(&coded) => gpu
                .download(&coded)
                .map_err(|error| End::Lost(format!("the GPU gives no image: {error}")))?,
            Some(_) => {
                let codec = self.codec();
                return Err(End::Useless(format!(
                    "the GPU does not decode {codec}; give --decoder cpu"
                )));
            }
        };
        let pts = coded.timestamp();
        let of_image = |(sent, ..): &(Option<i64>, f64, Option<f64>)| *sent == pts;
        let (_, arrival_s, sender_s) = match self.sent.iter().position(of_image) {
            Some(index) => {
                self.sent.drain(..index);
                self.sent.pop_front()
            }
            None => None,
        }
        .unwrap_or((pts, self.patience.clock.now_s(), None));
        let timestamp_s = pts.map(|pts| pts as f64 * self.seconds_per_unit);
        let has_errors = coded.is_corrupt() || coded.has_decode_errors();
        self.is_damaged = has_errors || self.is_damaged && !coded.is_key();
        Ok(InputImage {
            timestamp_s,
            image: DecodedImage::of(coded),
            arrival_s,
            sender_s,
            recorded_s: (self.recorded.as_ref()).and_then(|recorded| recorded.time_s(timestamp_s?)),
            is_damaged: self.is_damaged,
        })
    }

    fn read(&mut self, most_ms: u64) -> Result<(), End> {
        self.patience.wait(most_ms);
        match self.next_packet() {
            Ok(packet) => self.take(&packet),
            Err(_) if self.patience.is_stopped() => return Err(End::Stopped),
            Err(ffmpeg_next::Error::Eof) if !self.all_sent => {
                self.all_sent = true;
                // The next `receive_frame` reports its answer.
                let _ = self.decoder.send_eof();
            }
            Err(ffmpeg_next::Error::Exit) => return Err(End::Silent(most_ms)),
            Err(error) => return Err(End::Lost(error.to_string())),
        }
        Ok(())
    }

    /// The next packet of the video. Those of other streams do not prolong the wait: a microphone goes on when images have stopped.
    fn next_packet(&mut self) -> Result<Packet, ffmpeg_next::Error> {
        loop {
            // Before FFmpeg 6 a packet that is read into again loses its old memory for good.
            let mut packet = Packet::empty();
            packet.read(&mut self.input)?;
            if packet.stream() == self.stream {
                return Ok(packet);
            }
            if self.patience.is_over() {
                return Err(ffmpeg_next::Error::Exit);
            }
        }
    }

    fn take(&mut self, packet: &Packet) {
        let sender_s = sender_utc_s(packet).map(|utc_s| self.patience.clock.since_start_s(utc_s));
        self.is_damaged |= packet.is_corrupt();
        match (&mut self.units, packet.pts(), packet.data()) {
            (Some(units), Some(pts), Some(piece)) => {
                let complete = units.take(pts, piece).into_iter().flatten();
                self.complete.extend(complete);
                if let Some(sender_s) = sender_s {
                    self.sender_of_piece = Some((pts, sender_s));
                }
            }
            _ => self.send(packet, sender_s),
        }
    }

    /// The sender's clock for this timestamp: both run evenly.
    fn sender_s(&self, pts: i64) -> Option<f64> {
        let (of_pts, sender_s) = self.sender_of_piece?;
        Some(sender_s + (pts - of_pts) as f64 * self.seconds_per_unit)
    }

    fn send(&mut self, packet: &Packet, sender_s: Option<f64>) {
        let (pts, now_s) = (packet.pts(), self.patience.clock.now_s());
        self.undecoded.sent(now_s);
        self.sent.push_back((pts, now_s, sender_s));
        if self.sent.len() > MAX_IN_DECODER {
            self.sent.pop_front();
        }
        if let Some(pts) = pts.filter(|_| self.can_lose) {
            let step = self.last_pts.replace(pts).map(|last| (pts - last) as f64);
            if let Some(step) = step.filter(|step| *step > 0.0) {
                let usual = self.usual_step.get().unwrap_or(step);
                self.is_damaged |= step > GAP_PERIODS * usual;
                self.usual_step.learn(step, GAP_PERIODS);
            }
        }
        if self.decoder.send_packet(packet).is_err() {
            self.is_damaged = true;
        }
    }
}

fn video_of(input: &format::context::Input) -> Result<format::stream::Stream<'_>, OpenFault> {
    let video = input.streams().best(media::Type::Video);
    video.ok_or_else(|| OpenFault::Wrong("there is no video in it".into()))
}

/// Pixels of a coded image, whose sides are rounded up to whole blocks.
fn coded_pixels(size_px: [u32; 2]) -> u64 {
    let sides = size_px.map(|side| u64::from(side).next_multiple_of(MAX_BLOCK_PX));
    sides.into_iter().product()
}

/// Images have another size than in the training.
pub(crate) fn other_size(found_px: [u32; 2], expected_px: [u32; 2]) -> OpenFault {
    let [width, height] = found_px;
    let [known_width, known_height] = expected_px;
    OpenFault::Wrong(format!(
        "its images have {width}x{height} pixels, expected {known_width}x{known_height} as in the training; set the camera to that size"
    ))
}

/// UTC seconds of the sender's clock for a packet, from its last RTCP report (`AVProducerReferenceTime`: microseconds come first).
fn sender_utc_s(packet: &Packet) -> Option<f64> {
    let times = packet
        .side_data()
        .find(|data| data.kind() == side_data::Type::PRFT)?;
    let bytes = times.data().first_chunk::<8>()?;
    Some(i64::from_ne_bytes(*bytes) as f64 * 1e-6)
}
