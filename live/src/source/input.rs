//! An open source: every wait ends.
//!
//! FFmpeg's own timeouts let a stopped device pass for six seconds, so it asks us, ten times a second, whether to give up ([`Patience`]).
//! Decoders run in the calling thread and delay no image.

use std::collections::VecDeque;
use std::sync::Arc;

use dataset::video::{DecodedImage, start_ffmpeg, turned, unlike_the_scene};
use ffmpeg_next::codec::{self, threading};
use ffmpeg_next::{Dictionary, Packet, decoder, format, frame, media};

use crate::clock::Clues;
use crate::source::Source;
use crate::source::address::{self, Opened, RecordedTimes};
use crate::source::limits::{End, OpenFault, Patience};
use crate::source::rtp::RtpStream;
use crate::source::rtp::sdp::Coding;
use crate::source::undecoded::Undecoded;

/// Side of the largest block of a codec (H.265, AV1), pixels.
const MAX_BLOCK_PX: u64 = 128;
/// Images whose arrival is remembered until they are decoded.
const MAX_IN_DECODER: usize = 64;

/// A decoded image with its times.
pub(crate) struct InputImage {
    pub(crate) image: DecodedImage,
    pub(crate) clues: Clues,
    pub(crate) recorded_s: Option<f64>,
    pub(crate) is_damaged: bool,
}

/// Reader of coded images.
enum Reader {
    /// FFmpeg's, and the number of the video in it.
    Container(Box<format::context::Input>, usize),
    Rtp(Box<RtpStream>),
}

/// An image in the decoder.
struct Sent {
    number: u64,
    pts: Option<i64>,
    clues: Clues,
}

pub(crate) struct Input {
    reader: Reader,
    seconds_per_unit: f64,
    decoder: decoder::Video,
    size_px: [u32; 2],
    sent: VecDeque<Sent>,
    last_number: u64,
    /// Numbers of images that are damaged themselves; those after them are until the next key frame. After losses, decoders delay images.
    damaged: Vec<u64>,
    patience: Arc<Patience>,
    undecoded: Undecoded,
    all_sent: bool,
    recorded: Option<RecordedTimes>,
}

impl Input {
    /// Opens a view's source within `most_ms`, for images of this size.
    pub(crate) fn open(
        source: &Source,
        view: &str,
        size_px: [u32; 2],
        patience: Arc<Patience>,
        most_ms: u64,
    ) -> Result<Self, OpenFault> {
        start_ffmpeg();
        let (opened, recorded) = address::open(source, view, &patience, most_ms)?;
        let wrong = |cause: ffmpeg_next::Error| {
            OpenFault::Wrong(format!("FFmpeg has no decoder for it: {cause}"))
        };
        let (reader, codec, mut context, seconds_per_unit) = match opened {
            Opened::Container(input) => {
                let stream = input.streams().best(media::Type::Video);
                let stream =
                    stream.ok_or_else(|| OpenFault::Wrong("there is no video in it".into()))?;
                if let Some(why) = turned(&stream) {
                    return Err(OpenFault::Wrong(why.into()));
                }
                let parameters = stream.parameters();
                let (codec, unit, index) =
                    (parameters.id(), stream.time_base().into(), stream.index());
                let context =
                    codec::context::Context::from_parameters(parameters).map_err(wrong)?;
                (Reader::Container(input, index), codec, context, unit)
            }
            Opened::Rtp(stream) => {
                let codec = match stream.video.coding {
                    Coding::H264 => codec::Id::H264,
                    Coding::H265 => codec::Id::HEVC,
                    Coding::Jpeg => codec::Id::MJPEG,
                };
                let unit = 1.0 / f64::from(stream.video.clock_hz);
                (
                    Reader::Rtp(stream),
                    codec,
                    codec::context::Context::new(),
                    unit,
                )
            }
        };
        context.set_threading(threading::Config {
            kind: threading::Type::Slice,
            count: 1,
            ..Default::default()
        });
        if !source.is_recorded() {
            context.set_flags(codec::Flags::LOW_DELAY);
        }
        let found = decoder::find(codec).ok_or(ffmpeg_next::Error::DecoderNotFound);
        let opened = found.and_then(|found| {
            // Larger images are refused before any memory is taken for them.
            let mut options = Dictionary::new();
            options.set("max_pixels", &coded_pixels(size_px).to_string());
            context.decoder().open_as_with(found, options)?.video()
        });
        Ok(Self {
            decoder: opened.map_err(wrong)?,
            seconds_per_unit,
            size_px,
            sent: VecDeque::new(),
            last_number: 0,
            // Streams are damaged until their first key frame.
            damaged: Vec::from_iter(matches!(reader, Reader::Rtp(_)).then_some(0)),
            reader,
            patience,
            undecoded: Undecoded::default(),
            all_sent: false,
            recorded,
        })
    }

    pub(crate) fn codec(&self) -> &'static str {
        self.decoder.id().name()
    }

    /// The next image; `most_ms`: for each coded one.
    pub(crate) fn next(&mut self, most_ms: u64) -> Result<InputImage, End> {
        loop {
            let mut coded = frame::Video::empty();
            match self.decoder.receive_frame(&mut coded) {
                Ok(()) => return self.image(coded),
                Err(ffmpeg_next::Error::Eof) => return Err(End::Finished),
                Err(ffmpeg_next::Error::Other { errno })
                    if errno == ffmpeg_next::util::error::EAGAIN => {}
                // The next key frame is a new beginning.
                Err(_) => self.note_damage(self.last_number),
            }
            self.check_size()?;
            if let Some(fault) = self.undecoded.fault(self.patience.clock.now_s()) {
                return Err(End::Lost(fault));
            }
            self.read(most_ms)?;
        }
    }

    /// Ends images that are larger than expected, which the decoder refuses without an error.
    fn check_size(&self) -> Result<(), End> {
        let found_px = [self.decoder.width(), self.decoder.height()];
        let pixels = found_px.into_iter().map(u64::from).product::<u64>();
        if pixels > coded_pixels(self.size_px) {
            return Err(End::Useless(other_size(found_px, self.size_px)));
        }
        Ok(())
    }

    fn image(&mut self, coded: frame::Video) -> Result<InputImage, End> {
        self.undecoded = Undecoded::default();
        if let Some(why) = unlike_the_scene(&coded) {
            return Err(End::Useless(why.into()));
        }
        let pts = coded.timestamp();
        let index = self.sent.iter().position(|sent| sent.pts == pts);
        // Others before it are shown later, or never.
        let sent = index.and_then(|index| self.sent.remove(index));
        let sent = sent.unwrap_or_else(|| Sent {
            number: self.last_number,
            pts,
            clues: self.clues(pts),
        });
        if coded.is_corrupt() || coded.has_decode_errors() {
            self.note_damage(sent.number);
        } else if coded.is_key() {
            self.damaged.retain(|damaged| *damaged >= sent.number);
        }
        let recorded = self.recorded.as_ref().zip(sent.clues.timestamp_s);
        Ok(InputImage {
            image: DecodedImage::of(coded),
            clues: sent.clues,
            recorded_s: recorded.and_then(|(recorded, at_s)| recorded.time_s(at_s)),
            is_damaged: self.damaged.iter().any(|damaged| *damaged <= sent.number),
        })
    }

    /// Clues to the time of an image that comes now.
    fn clues(&self, pts: Option<i64>) -> Clues {
        Clues {
            arrival_s: self.patience.clock.now_s(),
            timestamp_s: pts.map(|pts| pts as f64 * self.seconds_per_unit),
            ..Clues::default()
        }
    }

    fn read(&mut self, most_ms: u64) -> Result<(), End> {
        let (input, index) = match &mut self.reader {
            Reader::Container(input, index) => (input, *index),
            Reader::Rtp(stream) => {
                let coded = stream.next(most_ms)?;
                let mut packet = Packet::copy(&coded.data);
                packet.set_pts(Some(coded.pts));
                self.send(&packet, coded.clues, coded.is_damaged);
                return Ok(());
            }
        };
        self.patience.wait(most_ms);
        match next_packet(input, index, &self.patience) {
            Ok(packet) => {
                let clues = self.clues(packet.pts());
                self.send(&packet, clues, packet.is_corrupt());
                Ok(())
            }
            Err(_) if self.patience.is_stopped() => Err(End::Stopped),
            Err(ffmpeg_next::Error::Eof) if !self.all_sent => {
                self.all_sent = true;
                // The next `receive_frame` reports its answer.
                let _ = self.decoder.send_eof();
                Ok(())
            }
            Err(ffmpeg_next::Error::Exit) => Err(End::Silent(most_ms)),
            Err(error) => Err(End::Lost(error.to_string())),
        }
    }

    fn send(&mut self, packet: &Packet, clues: Clues, is_damaged: bool) {
        self.last_number += 1;
        if is_damaged {
            self.note_damage(self.last_number);
        }
        self.undecoded.sent(self.patience.clock.now_s());
        self.sent.push_back(Sent {
            number: self.last_number,
            pts: packet.pts(),
            clues,
        });
        if self.sent.len() > MAX_IN_DECODER {
            self.sent.pop_front();
        }
        if self.decoder.send_packet(packet).is_err() {
            self.note_damage(self.last_number);
        }
    }

    fn note_damage(&mut self, number: u64) {
        self.damaged.push(number);
        if self.damaged.len() > MAX_IN_DECODER {
            // Without a key frame, the first one counts.
            self.damaged.remove(1);
        }
    }
}

/// The next packet of the video. Those of other streams do not prolong the wait: sound goes on when images have stopped.
fn next_packet(
    input: &mut format::context::Input,
    index: usize,
    patience: &Patience,
) -> Result<Packet, ffmpeg_next::Error> {
    loop {
        // Before FFmpeg 6 a packet that is read into again loses its old memory for good.
        let mut packet = Packet::empty();
        packet.read(input)?;
        if packet.stream() == index {
            return Ok(packet);
        }
        if patience.is_over() {
            return Err(ffmpeg_next::Error::Exit);
        }
    }
}

/// Pixels of a coded image, whose sides are rounded up to whole blocks.
fn coded_pixels(size_px: [u32; 2]) -> u64 {
    let sides = size_px.map(|side| u64::from(side).next_multiple_of(MAX_BLOCK_PX));
    sides.into_iter().product()
}

/// Images have another size than in the training.
pub(crate) fn other_size(found_px: [u32; 2], expected_px: [u32; 2]) -> String {
    let [width, height] = found_px;
    let [known_width, known_height] = expected_px;
    format!(
        "its images have {width}x{height} pixels, expected {known_width}x{known_height} as in the training; set the camera to that size"
    )
}

#[cfg(test)]
mod tests;
