//! Places of sources.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use dataset::corpus::Corpus;
use dataset::numbers::units::SimTime;
use dataset::video::{load_capture_devices, open_file};
use ffmpeg_next::{Dictionary, format};

use crate::source::Source;
use crate::source::limits::{OpenFault, Patience};
use crate::source::rtp::RtpStream;

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

/// An open source of packets.
pub(crate) enum Opened {
    /// FFmpeg reads a file or a device.
    Container(Box<format::context::Input>),
    Rtp(Box<RtpStream>),
}

/// Opens a view's source within `most_ms`. A scenario also has the times of its images.
pub(crate) fn open(
    source: &Source,
    view: &str,
    patience: &Arc<Patience>,
    most_ms: u64,
) -> Result<(Opened, Option<RecordedTimes>), OpenFault> {
    patience.wait(most_ms);
    let waiting = patience.clone();
    let file = |path: &PathBuf| {
        let opened = open_file(path, move || waiting.is_over());
        let opened = opened.map_err(|error| match error {
            error if error.is_of_disk() => OpenFault::Disk(error),
            error => OpenFault::Useless(error.beside(path)),
        })?;
        Ok(Opened::Container(Box::new(opened)))
    };
    let opened = match source {
        Source::File(path) => file(path)?,
        Source::Scenario { corpus, id } => {
            let (path, times) = recorded(corpus, id, view)?;
            return Ok((file(&path)?, Some(times)));
        }
        Source::Stream(stream) => Opened::Rtp(Box::new(RtpStream::of_server(stream, patience)?)),
        Source::Description(path) => {
            Opened::Rtp(Box::new(RtpStream::of_description(path, patience)?))
        }
        Source::Device(path) => {
            load_capture_devices().map_err(OpenFault::Useless)?;
            let mut options = Dictionary::new();
            options.set("format_whitelist", "video4linux2");
            let waiting = patience.clone();
            // Without a prefix: FFmpeg recognises devices by their path.
            let opened = format::input_with_interrupt_and_dictionary(
                path,
                move || waiting.is_over(),
                options,
            );
            Opened::Container(Box::new(opened.map_err(|error| match error {
                ffmpeg_next::Error::Exit => OpenFault::Absent(format!("no answer in {most_ms} ms")),
                error => OpenFault::Absent(error.to_string()),
            })?))
        }
    };
    Ok((opened, None))
}

/// The video of a scenario's view, and the times of its images.
fn recorded(corpus: &Path, id: &str, view: &str) -> Result<(PathBuf, RecordedTimes), OpenFault> {
    let useless = |error: dataset::Error| OpenFault::Useless(error.to_string());
    let scenario = Corpus::open(corpus).and_then(|corpus| corpus.scenario(id).open());
    let scenario = scenario.map_err(useless)?;
    let frames = scenario.frames().map_err(useless)?;
    let rate = scenario.record().map_err(useless)?.frame_rate;
    let path = scenario.video_path(view).map_err(useless)?;
    let column = frames.views.iter().position(|known| known == view);
    let column = column
        .ok_or_else(|| OpenFault::Useless(format!("its table of images has no view {view}")))?;
    // Timestamps of tables count in fractions of the frame rate.
    let images = frames.rows.iter().map(|row| {
        let timestamp_s = row.views[column].pts as f64 / f64::from(rate.numerator);
        (timestamp_s, SimTime(row.time_ns).seconds())
    });
    Ok((path, RecordedTimes::of(images)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::RunClock;

    #[test]
    fn a_device_is_opened_by_its_path_with_ffmpegs_own_reader() {
        let source = Source::Device("/dev/video97".into());
        let patience = Patience::new(RunClock::start(), Arc::default());
        let fault = open(&source, "left", &patience, 4_000).err().unwrap();
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
