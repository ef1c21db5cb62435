use std::fs::{self, OpenOptions};
use std::path::PathBuf;

use super::*;
use crate::video::VideoCodec;

const SIZE_PX: (u32, u32) = (96, 64);
const RATE: FrameRate = FrameRate {
    numerator: 30_000,
    denominator: 1_001,
};

fn trial() -> Trial {
    Trial {
        chart: Chart::new(SIZE_PX.0, SIZE_PX.1),
        frame_rate: RATE,
        extension: "mp4",
    }
}

fn software(path: &Path, rate: FrameRate) -> Result<VideoWriter> {
    let settings = VideoSettings::of(VideoCodec::H264);
    VideoWriter::create(path, &settings, SIZE_PX.0, SIZE_PX.1, rate)
}

/// A software encoder with a fault.
struct Faulty {
    writer: VideoWriter,
    path: PathBuf,
    written: u32,
    held: Option<Vec<u8>>,
    fault: Fault,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    /// Two images change places.
    Order,
    /// One image is lost.
    Loss,
    /// Levels are scaled to the limited range.
    Range,
    /// Red and blue are swapped.
    Colours,
    /// Output reaches the file only in part until it is finished.
    HeldBack,
}

impl Recording for Faulty {
    fn write(&mut self, rgb: &[u8]) -> Result<i64> {
        let number = self.written;
        self.written += 1;
        match self.fault {
            Fault::Order if number == 40 => {
                self.held = Some(rgb.to_vec());
                return Ok(0);
            }
            Fault::Order if number == 41 => {
                self.writer.write(rgb)?;
                let held = self.held.take().unwrap_or_default();
                return self.writer.write(&held);
            }
            Fault::Loss if number == 40 => return Ok(0),
            Fault::Range => {
                let limited = |level: &u8| (16.0 + f64::from(*level) * 219.0 / 255.0).round() as u8;
                return self
                    .writer
                    .write(&rgb.iter().map(limited).collect::<Vec<_>>());
            }
            Fault::Colours => {
                let mut swapped = rgb.to_vec();
                swapped
                    .chunks_exact_mut(3)
                    .for_each(|pixel| pixel.swap(0, 2));
                return self.writer.write(&swapped);
            }
            _ => {}
        }
        let pts = self.writer.write(rgb)?;
        let is_unfinished = self.path.file_stem().is_some_and(|name| name == "running");
        if self.fault == Fault::HeldBack && is_unfinished && self.written == TRIAL_PICTURES {
            let bytes = fs::metadata(&self.path)
                .map_err(Error::io("look at", &self.path))?
                .len();
            let file = OpenOptions::new().write(true).open(&self.path);
            let file = file.map_err(Error::io("open", &self.path))?;
            file.set_len(bytes / 2)
                .map_err(Error::io("cut", &self.path))?;
        }
        Ok(pts)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.writer.finish()
    }
}

fn fault_of(fault: Fault) -> TrialFault {
    let folder = tempfile::tempdir().unwrap();
    let start = |path: &Path| -> Result<Box<dyn Recording>> {
        Ok(Box::new(Faulty {
            writer: software(path, RATE)?,
            path: path.to_owned(),
            written: 0,
            held: None,
            fault,
        }))
    };
    trial().run(folder.path(), &start).unwrap_err()
}

#[test]
fn a_good_encoder_passes_with_every_codec_that_it_offers() {
    for codec in [VideoCodec::H264, VideoCodec::H265, VideoCodec::H264Lossless] {
        let folder = tempfile::tempdir().unwrap();
        let settings = VideoSettings::of(codec);
        let passed = try_encoder(
            folder.path(),
            &settings,
            VideoEncoder::Software,
            SIZE_PX,
            RATE,
        );
        assert!(passed.is_ok(), "{codec:?}: {}", passed.unwrap_err());
    }
}

#[test]
fn pictures_out_of_order_are_refused() {
    for fault in [Fault::Order, Fault::Loss].map(fault_of) {
        let expected = matches!(
            fault,
            TrialFault::Order {
                place: 40,
                found: Some(41)
            }
        );
        assert!(expected, "{fault}");
    }
}

#[test]
fn other_timestamps_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let slower = FrameRate {
        numerator: 30_000,
        denominator: 1_000,
    };
    let fault = trial().run(folder.path(), &|path| Ok(Box::new(software(path, slower)?)));
    let fault = fault.unwrap_err();
    assert!(matches!(fault, TrialFault::Timestamp { .. }), "{fault}");
}

#[test]
fn another_range_and_other_colours_are_refused() {
    for (wrong, named) in [(Fault::Range, "black"), (Fault::Colours, "red")] {
        let fault = fault_of(wrong);
        assert!(
            matches!(fault, TrialFault::Colour { colour, .. } if colour == named),
            "{wrong:?}: {fault}"
        );
    }
}

#[test]
fn a_file_that_a_kill_would_leave_damaged_is_refused() {
    let fault = fault_of(Fault::HeldBack);
    assert!(
        matches!(fault, TrialFault::Killed { readable, .. } if readable < TRIAL_PICTURES / 2 + 10),
        "{fault}"
    );
}

#[test]
fn an_encoder_that_is_not_there_is_refused_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let settings = VideoSettings::of(VideoCodec::H264);
    let encoder = VideoEncoder::VideoToolbox;
    let fault = try_encoder(folder.path(), &settings, encoder, SIZE_PX, RATE).unwrap_err();
    if cfg!(target_os = "linux") {
        assert!(fault.to_string().contains("h264_videotoolbox"), "{fault}");
    }
    let lossless = VideoSettings::of(VideoCodec::Ffv1);
    let fault =
        try_encoder(folder.path(), &lossless, VideoEncoder::Nvenc, SIZE_PX, RATE).unwrap_err();
    assert!(
        fault.to_string().contains("nvenc is not offered"),
        "{fault}"
    );
}
