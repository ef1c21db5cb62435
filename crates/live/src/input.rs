//! An open source: FFmpeg reads and decodes it, and every wait ends.
//!
//! FFmpeg's own timeouts let a stopped server pass for six seconds, so it asks us, ten times a second, whether to give up
//! ([`Patience`]). Streams of H.264 and H.265 are read without FFmpeg's parser, which holds each image until the next begins
//! ([`AccessUnits`]). Decoders run in the calling thread and delay no image.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use dataset::corpus::Corpus;
use dataset::files::outside_file::{self, FileKind};
use dataset::numbers::units::SimTime;
use dataset::video::{DecodedImage, start_ffmpeg};
use ffmpeg_next::codec::packet::side_data;
use ffmpeg_next::codec::{self, threading};
use ffmpeg_next::{Dictionary, Packet, decoder, format, frame, media};

use crate::access_unit::{AccessUnit, AccessUnits, UnitCodec};
use crate::clock::RunClock;
use crate::source::{Source, Transport};

/// Milliseconds that opening may take, and a wait for the next packet.
const OPEN_MS: u64 = 4_000;
const READ_MS: u64 = 2_000;
/// Milliseconds in which FFmpeg waits for packets that UDP delivered out of order.
const REORDER_MS: u32 = 60;
/// Bytes of the socket's buffer: a key frame comes in a burst.
const UDP_BUFFER_BYTES: u32 = 4 << 20;
/// Images whose arrival is remembered until they are decoded.
const MOST_IN_DECODER: usize = 64;
/// A gap between timestamps of more than so many usual ones is a lost image.
const GAP_PERIODS: f64 = 1.75;
/// Part by which a new interval changes the usual one.
const LEARNED_PART: f64 = 0.05;

/// Cause of a source that was not opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum OpenFault {
    /// It may be there later.
    Absent(String),
    /// It will never do.
    Useless(String),
}

/// Cause of the end of images.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum End {
    /// There are no more.
    Finished,
    /// The connection is gone.
    Lost(String),
    /// The caller stopped it.
    Stopped,
}

/// Limit of FFmpeg's waits.
pub(crate) struct Patience {
    clock: RunClock,
    until_ms: AtomicU64,
    stop: Arc<AtomicBool>,
}

impl Patience {
    pub(crate) fn new(clock: RunClock, stop: Arc<AtomicBool>) -> Arc<Self> {
        Arc::new(Self {
            clock,
            until_ms: AtomicU64::new(0),
            stop,
        })
    }

    fn wait(&self, most_ms: u64) {
        let now_ms = (self.clock.now_s() * 1e3) as u64;
        self.until_ms.store(now_ms + most_ms, Ordering::Relaxed);
    }

    fn is_over(&self) -> bool {
        let now_ms = (self.clock.now_s() * 1e3) as u64;
        self.is_stopped() || now_ms > self.until_ms.load(Ordering::Relaxed)
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// A decoded image and what is known about it.
pub(crate) struct InputImage {
    pub(crate) image: DecodedImage,
    /// When its last packet arrived, seconds since the start.
    pub(crate) arrival_s: f64,
    pub(crate) timestamp_s: Option<f64>,
    /// Its sender's wall clock, seconds since the start.
    pub(crate) sender_s: Option<f64>,
    /// Time in the recording, for scenarios.
    pub(crate) recorded_s: Option<f64>,
    pub(crate) is_damaged: bool,
}

/// An open source.
pub(crate) struct Input {
    input: format::context::Input,
    stream: usize,
    seconds_per_unit: f64,
    decoder: decoder::Video,
    units: Option<AccessUnits>,
    /// Images that are complete and not yet decoded.
    complete: VecDeque<AccessUnit>,
    /// Timestamp, arrival and sender's clock of what is in the decoder.
    sent: VecDeque<(Option<i64>, f64, Option<f64>)>,
    /// The same of pieces that are being joined.
    sender_of_piece: Option<(i64, f64)>,
    patience: Arc<Patience>,
    can_lose: bool,
    is_damaged: bool,
    last_pts: Option<i64>,
    usual_step: Option<f64>,
    all_sent: bool,
    recorded: Option<RecordedTimes>,
}

impl Input {
    /// Opens a source for a view.
    pub(crate) fn open(
        source: &Source,
        view: &str,
        patience: Arc<Patience>,
    ) -> Result<Self, OpenFault> {
        start_ffmpeg();
        let place = Place::of(source, view)?;
        let input = place.open(&patience, true)?;
        let codec_id = video_of(&input)?.parameters().id();
        let codec = match codec_id {
            codec::Id::H264 => Some(UnitCodec::H264),
            codec::Id::HEVC => Some(UnitCodec::H265),
            _ => None,
        };
        let units = codec.filter(|_| place.is_stream).map(AccessUnits::new);
        let input = match units {
            // Other codecs need FFmpeg's parser.
            None if place.is_stream => place.open(&patience, false)?,
            _ => input,
        };
        let stream = video_of(&input)?;
        let (index, unit) = (stream.index(), f64::from(stream.time_base()));
        let useless = |cause: ffmpeg_next::Error| {
            OpenFault::Useless(format!("FFmpeg has no decoder for it: {cause}"))
        };
        let mut context =
            codec::context::Context::from_parameters(stream.parameters()).map_err(useless)?;
        context.set_threading(threading::Config {
            kind: threading::Type::Slice,
            count: 1,
            ..Default::default()
        });
        if !source.is_recorded() {
            context.set_flags(codec::Flags::LOW_DELAY);
        }
        Ok(Self {
            decoder: context.decoder().video().map_err(useless)?,
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
            usual_step: None,
            all_sent: false,
            recorded: place.recorded,
        })
    }

    /// FFmpeg's name of the codec.
    pub(crate) fn codec(&self) -> &'static str {
        self.decoder.id().name()
    }

    /// The next image.
    pub(crate) fn next(&mut self) -> Result<InputImage, End> {
        loop {
            let mut coded = frame::Video::empty();
            match self.decoder.receive_frame(&mut coded) {
                Ok(()) => return Ok(self.image(coded)),
                Err(ffmpeg_next::Error::Eof) => return Err(End::Finished),
                Err(ffmpeg_next::Error::Other { errno })
                    if errno == ffmpeg_next::util::error::EAGAIN => {}
                // The next key frame is another beginning.
                Err(_) => self.is_damaged = true,
            }
            if let Some(unit) = self.complete.pop_front() {
                self.is_damaged |= unit.is_cut;
                let sender_s = self.sender_s(unit.pts);
                let mut packet = Packet::copy(&unit.data);
                packet.set_pts(Some(unit.pts));
                self.send(&packet, sender_s);
            } else {
                self.read()?;
            }
        }
    }

    fn image(&mut self, coded: frame::Video) -> InputImage {
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
        InputImage {
            timestamp_s,
            image: DecodedImage::of(coded),
            arrival_s,
            sender_s,
            recorded_s: (self.recorded.as_ref()).and_then(|recorded| recorded.time_s(timestamp_s?)),
            is_damaged: self.is_damaged,
        }
    }

    /// Reads a packet.
    fn read(&mut self) -> Result<(), End> {
        // Before FFmpeg 6 a packet that is read into again loses its old memory for good.
        let mut packet = Packet::empty();
        self.patience.wait(READ_MS);
        match packet.read(&mut self.input) {
            Ok(()) if packet.stream() != self.stream => {}
            Ok(()) => {
                let sender_s =
                    sender_utc_s(&packet).map(|utc_s| self.patience.clock.since_start_s(utc_s));
                self.is_damaged |= packet.is_corrupt();
                match (&mut self.units, packet.pts(), packet.data()) {
                    (Some(units), Some(pts), Some(piece)) => {
                        self.complete
                            .extend(units.take(pts, piece).into_iter().flatten());
                        if let Some(sender_s) = sender_s {
                            self.sender_of_piece = Some((pts, sender_s));
                        }
                    }
                    _ => self.send(&packet, sender_s),
                }
            }
            Err(_) if self.patience.is_stopped() => return Err(End::Stopped),
            Err(ffmpeg_next::Error::Eof) if !self.all_sent => {
                self.all_sent = true;
                // The next `receive_frame` reports its answer.
                let _ = self.decoder.send_eof();
            }
            Err(ffmpeg_next::Error::Exit) => {
                return Err(End::Lost(format!("nothing came for {READ_MS} ms")));
            }
            Err(error) => return Err(End::Lost(error.to_string())),
        }
        Ok(())
    }

    /// The sender's clock of the image with this timestamp, from that of a piece: both run evenly.
    fn sender_s(&self, pts: i64) -> Option<f64> {
        let (of_pts, sender_s) = self.sender_of_piece?;
        Some(sender_s + (pts - of_pts) as f64 * self.seconds_per_unit)
    }

    fn send(&mut self, packet: &Packet, sender_s: Option<f64>) {
        let pts = packet.pts();
        self.sent
            .push_back((pts, self.patience.clock.now_s(), sender_s));
        if self.sent.len() > MOST_IN_DECODER {
            self.sent.pop_front();
        }
        if let Some(pts) = pts.filter(|_| self.can_lose) {
            let step = self.last_pts.replace(pts).map(|last| (pts - last) as f64);
            if let Some(step) = step.filter(|step| *step > 0.0) {
                let usual = self.usual_step.get_or_insert(step);
                self.is_damaged |= step > GAP_PERIODS * *usual;
                *usual += LEARNED_PART * (step.min(GAP_PERIODS * *usual) - *usual);
            }
        }
        if self.decoder.send_packet(packet).is_err() {
            self.is_damaged = true;
        }
    }
}

/// Times of a scenario's images, by their timestamps in the video: an image that cannot be decoded shifts no other.
struct RecordedTimes {
    /// Seconds by microseconds.
    by_timestamp: BTreeMap<i64, f64>,
}

impl RecordedTimes {
    /// From timestamps in the video and times of the recording, seconds.
    fn of(images: impl Iterator<Item = (f64, f64)>) -> Self {
        Self {
            by_timestamp: images
                .map(|(timestamp_s, time_s)| (microseconds(timestamp_s), time_s))
                .collect(),
        }
    }

    /// The time of the image with this timestamp; tables and videos have different units, so that one may be rounded otherwise.
    fn time_s(&self, timestamp_s: f64) -> Option<f64> {
        let here = microseconds(timestamp_s);
        let mut found = self.by_timestamp.range(here - 1..=here + 1);
        found.next().map(|(_, time_s)| *time_s)
    }
}

fn microseconds(seconds: f64) -> i64 {
    // Far from the ends, so that a neighbour exists.
    (seconds * 1e6).round().clamp(-1e18, 1e18) as i64
}

/// FFmpeg's name of a source, and what is known of it.
struct Place {
    name: String,
    options: Vec<(&'static str, String)>,
    is_stream: bool,
    can_lose: bool,
    recorded: Option<RecordedTimes>,
}

impl Place {
    fn of(source: &Source, view: &str) -> Result<Self, OpenFault> {
        let useless = |error: dataset::Error| OpenFault::Useless(error.to_string());
        let file = |path: &Path| {
            outside_file::open(path, FileKind::VIDEO).map_err(useless)?;
            Ok::<_, OpenFault>(Self {
                name: format!("file:{}", text_of(path)?),
                options: vec![("protocol_whitelist", "file".into())],
                is_stream: false,
                can_lose: false,
                recorded: None,
            })
        };
        match source {
            Source::File(path) => file(path),
            Source::Scenario { corpus, id } => {
                let scenario = Corpus::open(corpus).and_then(|corpus| corpus.scenario(id).open());
                let scenario = scenario.map_err(useless)?;
                let frames = scenario.frames().map_err(useless)?;
                let rate = scenario.record().map_err(useless)?.frame_rate;
                let path = scenario.video_path(view).map_err(useless)?;
                let column = frames.views.iter().position(|known| known == view);
                let column = column.ok_or_else(|| {
                    OpenFault::Useless(format!("its table of images has no view {view}"))
                })?;
                // Timestamps of tables count in fractions of the frame rate.
                let images = frames.rows.iter().map(|row| {
                    let timestamp_s = row.views[column].pts as f64 / f64::from(rate.numerator);
                    (timestamp_s, SimTime(row.time_ns).seconds())
                });
                Ok(Self {
                    recorded: Some(RecordedTimes::of(images)),
                    ..file(&path)?
                })
            }
            Source::Stream(stream) => {
                let transport = stream.transport();
                let mut options = rtp_options();
                options.push(("rtsp_transport", transport.name().into()));
                Ok(Self {
                    name: stream.secret_address(),
                    options,
                    is_stream: true,
                    can_lose: transport == Transport::Udp,
                    recorded: None,
                })
            }
            Source::Description(path) => {
                outside_file::open(path, FileKind::SETTINGS).map_err(useless)?;
                let mut options = rtp_options();
                options.push(("protocol_whitelist", "file,udp,rtp".into()));
                Ok(Self {
                    name: format!("file:{}", text_of(path)?),
                    options,
                    is_stream: true,
                    can_lose: true,
                    recorded: None,
                })
            }
            Source::Device(path) => Ok(Self {
                // Without a prefix: FFmpeg recognises devices by their path.
                name: text_of(path)?,
                options: Vec::new(),
                is_stream: false,
                can_lose: false,
                recorded: None,
            }),
        }
    }

    /// Opens it. `in_pieces`: packets of streams as they come, without FFmpeg's parser.
    fn open(
        &self,
        patience: &Arc<Patience>,
        in_pieces: bool,
    ) -> Result<format::context::Input, OpenFault> {
        let mut options = Dictionary::new();
        for (name, value) in &self.options {
            options.set(name, value);
        }
        if self.is_stream && in_pieces {
            options.set("fflags", "+noparse+nofillin");
        }
        let waiting = patience.clone();
        patience.wait(OPEN_MS);
        let opened = format::input_with_interrupt_and_dictionary(
            &self.name,
            move || waiting.is_over(),
            options,
        );
        opened.map_err(|error| match error {
            ffmpeg_next::Error::HttpUnauthorized => OpenFault::Useless(
                "it asks for a password; give the user in the address (rtsp://USER@HOST/PATH) and the password in the environment, \
                 DTD_PASSWORD_VIEW, or with --password-file VIEW=FILE"
                    .into(),
            ),
            ffmpeg_next::Error::Exit => OpenFault::Absent(format!("no answer in {OPEN_MS} ms")),
            ffmpeg_next::Error::InvalidData if !self.is_stream => {
                OpenFault::Useless("it is no video that FFmpeg can read".into())
            }
            error => OpenFault::Absent(error.to_string()),
        })
    }
}

/// Options of streams that come as RTP: short probing, because the description names the codec.
fn rtp_options() -> Vec<(&'static str, String)> {
    vec![
        ("probesize", "20000".into()),
        ("max_delay", (REORDER_MS * 1_000).to_string()),
        ("buffer_size", UDP_BUFFER_BYTES.to_string()),
    ]
}

fn text_of(path: &Path) -> Result<String, OpenFault> {
    path.to_str().map(str::to_owned).ok_or_else(|| {
        OpenFault::Useless("its path is not UTF-8, which FFmpeg requires; rename it".into())
    })
}

fn video_of(input: &format::context::Input) -> Result<format::stream::Stream<'_>, OpenFault> {
    let video = input.streams().best(media::Type::Video);
    video.ok_or_else(|| OpenFault::Useless("there is no video in it".into()))
}

/// UTC seconds of the sender's clock for a packet, from its last RTCP report (`AVProducerReferenceTime`: microseconds come first).
fn sender_utc_s(packet: &Packet) -> Option<f64> {
    let times = packet
        .side_data()
        .find(|data| data.kind() == side_data::Type::PRFT)?;
    let bytes = times.data().first_chunk::<8>()?;
    Some(i64::from_ne_bytes(*bytes) as f64 * 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_that_was_not_decoded_shifts_no_time_of_another() {
        let rate = 30_000.0 / 1_001.0;
        let images = (0..100).map(|tick| f64::from(tick) / rate);
        let recorded = RecordedTimes::of(images.map(|at_s| (at_s, 500.0 + at_s)));
        for tick in (0..100).filter(|tick| tick % 7 != 3) {
            // In the unit of a container.
            let units = (f64::from(tick) / rate * 120_000.0).round();
            let time_s = recorded.time_s(units / 120_000.0).unwrap();
            assert!((time_s - 500.0 - f64::from(tick) / rate).abs() < 1e-9);
        }
        assert_eq!(recorded.time_s(0.01), None);
    }
}
