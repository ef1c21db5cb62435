//! FFmpeg's names, options and time limits for sources.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use dataset::corpus::Corpus;
use dataset::files::outside_file::{self, FileKind};
use dataset::numbers::units::SimTime;
use dataset::video::{load_capture_devices, open_file};
use ffmpeg_next::util::error::EINVAL;
use ffmpeg_next::{Dictionary, format};

use crate::clock::RunClock;
use crate::source::connection::{self, Fault};
use crate::source::{Source, Transport, shown};

/// FFmpeg's wait for reordered UDP packets, ms.
const REORDER_MS: u32 = 60;
/// Streams of a camera that are opened: images in some sizes, sound, data. A thousand take 950 MB.
const MAX_STREAMS: u32 = 16;
/// Bytes of the socket's buffer: a key frame comes in a burst.
const UDP_BUFFER_BYTES: u32 = 4 << 20;

/// Reason why a source cannot be opened.
#[derive(Debug)]
pub(crate) enum OpenFault {
    /// It may be there later.
    Absent(String),
    /// A camera answers, and not with the images of this view. Others may set it right.
    Wrong(String),
    /// It will never do.
    Useless(String),
    /// The disk fails, whatever the file is.
    Disk(dataset::Error),
}

pub(crate) struct Patience {
    pub(crate) clock: RunClock,
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

    pub(crate) fn wait(&self, most_ms: u64) {
        let now_ms = (self.clock.now_s() * 1e3) as u64;
        self.until_ms.store(now_ms + most_ms, Ordering::Relaxed);
    }

    pub(crate) fn is_over(&self) -> bool {
        let now_ms = (self.clock.now_s() * 1e3) as u64;
        self.is_stopped() || now_ms > self.until_ms.load(Ordering::Relaxed)
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// A scenario's image times, by timestamp in the video: an undecodable image shifts no other.
pub(crate) struct RecordedTimes {
    /// Seconds by microseconds.
    by_timestamp: BTreeMap<i64, f64>,
}

impl RecordedTimes {
    /// Pairs of timestamp and recording time, s.
    fn of(images: impl Iterator<Item = (f64, f64)>) -> Self {
        Self {
            by_timestamp: images
                .map(|(timestamp_s, time_s)| (microseconds(timestamp_s), time_s))
                .collect(),
        }
    }

    /// The time of the image with this timestamp; tables and videos have different units, so that one may be rounded otherwise.
    pub(crate) fn time_s(&self, timestamp_s: f64) -> Option<f64> {
        let here = microseconds(timestamp_s);
        let mut found = self.by_timestamp.range(here - 1..=here + 1);
        found.next().map(|(_, time_s)| *time_s)
    }
}

fn microseconds(seconds: f64) -> i64 {
    // Far from the ends, so that a neighbour exists.
    (seconds * 1e6).round().clamp(-1e18, 1e18) as i64
}

/// A source in FFmpeg's terms.
pub(crate) struct FfmpegSource {
    place: Place,
    pub(crate) is_stream: bool,
    pub(crate) can_lose: bool,
    pub(crate) recorded: Option<RecordedTimes>,
}

/// Input for FFmpeg.
enum Place {
    /// A video file.
    File(PathBuf),
    /// A camera by its name for FFmpeg. The options allow one format and its protocols only.
    Feed(String, Vec<(&'static str, String)>),
}

impl FfmpegSource {
    pub(crate) fn of(source: &Source, view: &str) -> Result<Self, OpenFault> {
        let useless = |error: dataset::Error| OpenFault::Useless(error.to_string());
        let of = |place: Place| Self {
            place,
            is_stream: false,
            can_lose: false,
            recorded: None,
        };
        match source {
            Source::File(path) => Ok(of(Place::File(path.clone()))),
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
                    ..of(Place::File(path))
                })
            }
            Source::Stream(stream) => {
                let transport = stream.transport();
                let protocols = if stream.is_encrypted() {
                    "tls,tcp,udp,rtp"
                } else {
                    "tcp,udp,rtp"
                };
                let mut options = rtp_options("rtsp", protocols);
                options.push(("rtsp_transport", transport.name().into()));
                Ok(Self {
                    is_stream: true,
                    can_lose: transport == Transport::Udp,
                    ..of(Place::Feed(stream.secret_address(), options))
                })
            }
            Source::Description(path) => {
                outside_file::open(path, FileKind::SETTINGS).map_err(useless)?;
                let options = rtp_options("sdp", "file,udp,rtp");
                Ok(Self {
                    is_stream: true,
                    can_lose: true,
                    ..of(Place::Feed(format!("file:{}", text_of(path)?), options))
                })
            }
            Source::Device(path) => {
                load_capture_devices().map_err(OpenFault::Useless)?;
                let options = vec![("format_whitelist", "video4linux2".into())];
                // Without a prefix: FFmpeg recognises devices by their path.
                Ok(of(Place::Feed(text_of(path)?, options)))
            }
        }
    }

    /// Opens the source within `most_ms`. Larger images of a camera are not decoded. `in_pieces`: packets of streams as they come, without
    /// FFmpeg's parser.
    pub(crate) fn open(
        &self,
        patience: &Arc<Patience>,
        most_ms: u64,
        max_pixels: u64,
        in_pieces: bool,
    ) -> Result<format::context::Input, OpenFault> {
        let waiting = patience.clone();
        let is_over = move || waiting.is_over();
        patience.wait(most_ms);
        let (name, given) = match &self.place {
            Place::File(path) => {
                return open_file(path, is_over).map_err(|error| match error {
                    error if error.is_of_disk() => OpenFault::Disk(error),
                    error => OpenFault::Useless(error.beside(path)),
                });
            }
            Place::Feed(name, options) => (name, options),
        };
        let mut options = Dictionary::new();
        for (name, value) in given {
            options.set(name, value);
        }
        if self.is_stream && in_pieces {
            options.set("fflags", "+noparse+nofillin");
        }
        connection::open(name, options, max_pixels, is_over).map_err(|fault| match fault {
            Fault::Redirected(to) => OpenFault::Wrong(format!(
                "it redirects to {}, which is not followed because the password would go there; give that address if it is yours",
                shown(&to)
            )),
            Fault::Ffmpeg(ffmpeg_next::Error::HttpUnauthorized) => OpenFault::Wrong(
                "it asks for a password; give the user in the address (rtsp://USER@HOST/PATH) and the password in the environment, \
                 DTD_PASSWORD_VIEW, or with --password-file VIEW=FILE"
                    .into(),
            ),
            Fault::Ffmpeg(ffmpeg_next::Error::Exit) => {
                OpenFault::Absent(format!("no answer in {most_ms} ms"))
            }
            Fault::Ffmpeg(
                ffmpeg_next::Error::InvalidData | ffmpeg_next::Error::Other { errno: EINVAL },
            ) if name.starts_with("file:") => OpenFault::Useless(
                "it is no description of a stream (SDP) that FFmpeg can read".into(),
            ),
            Fault::Ffmpeg(error) => OpenFault::Absent(error.to_string()),
        })
    }
}

/// Options of streams that come as RTP: short probing, because the description names the codec.
fn rtp_options(format: &str, protocols: &str) -> Vec<(&'static str, String)> {
    vec![
        ("format_whitelist", format.into()),
        ("protocol_whitelist", protocols.into()),
        ("max_streams", MAX_STREAMS.to_string()),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_opened_by_its_path_with_ffmpegs_own_reader() {
        let source = Source::Device("/dev/video97".into());
        let place = FfmpegSource::of(&source, "left").ok().unwrap();
        let Place::Feed(name, _) = &place.place else {
            panic!("it is no file")
        };
        assert_eq!((&**name, place.is_stream), ("/dev/video97", false));
        let stop = Arc::new(AtomicBool::new(false));
        let patience = Patience::new(RunClock::start(), stop);
        let fault = place.open(&patience, 4_000, 1, true).err().unwrap();
        // It may be plugged in later.
        let OpenFault::Absent(why) = fault else {
            panic!("{fault:?}")
        };
        assert!(why.contains("No such file"), "{why}");
    }

    #[test]
    fn an_image_that_was_not_decoded_shifts_no_time_of_another() {
        let rate = 30_000.0 / 1_001.0;
        let images = (0..100).map(|tick| f64::from(tick) / rate);
        let recorded = RecordedTimes::of(images.map(|at_s| (at_s, 500.0 + at_s)));
        for tick in (0..100).filter(|tick| tick % 7 != 3) {
            // Timestamps in a container's unit.
            let units = (f64::from(tick) / rate * 120_000.0).round();
            let time_s = recorded.time_s(units / 120_000.0).unwrap();
            assert!((time_s - 500.0 - f64::from(tick) / rate).abs() < 1e-9);
        }
        assert_eq!(recorded.time_s(0.01), None);
    }
}
