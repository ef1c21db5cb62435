//! Encoder trial before a long recording: a hundred images on the user's machine.
//!
//! Input: a recording's settings, size and frame rate, and an encoder. Output: success, or the fault. Images carry their number and patches
//! of known colours. They are encoded twice: into a file that is finished, which must have all images in order with their timestamps and
//! colours; and into one that is never finished. A copy of the latter, taken after the last image, is the state that a killed process would
//! leave on the disk, and must have all but the last images.

mod chart;

use std::path::Path;

use self::chart::Chart;
use super::{TimeBase, VideoEncoder, VideoReader, VideoSettings, VideoWriter};
use crate::error::{Error, Result};
use crate::numbers::frame_rate::FrameRate;

/// Trial images.
pub const TRIAL_PICTURES: u32 = 100;
/// Images that may be missing at the end after a kill: the last fragment, and the one before it.
const LOST_BY_A_KILL: u32 = 2;
/// Tolerance between a patch's mean and its colour, of 255. A different range or matrix is off by more than 15 somewhere.
const COLOUR_TOLERANCE: f64 = 8.0;

/// A fault found by a trial.
#[derive(Debug, thiserror::Error)]
pub enum TrialFault {
    /// It does not encode, or its file cannot be read.
    #[error(transparent)]
    Failed(#[from] Error),
    /// Images are missing, or there are too many.
    #[error("{found} images came back of {TRIAL_PICTURES}")]
    Count {
        /// Number of images that came back.
        found: u32,
    },
    /// An image is in the wrong place.
    #[error("place {place} has {}, expected image {place}: images are out of order or unrecognisable", .found.map_or("no readable number".to_owned(), |number| format!("image {number}")))]
    Order {
        /// Place in the file, from 0.
        place: u32,
        /// The number that it shows, if one can be read.
        found: Option<u32>,
    },
    /// A timestamp differs from its tick's.
    #[error("image {place} has the timestamp {found}, expected {expected}")]
    Timestamp {
        /// Place in the file, from 0.
        place: u32,
        /// Expected time, in the file's unit.
        found: String,
        /// Time as written.
        expected: String,
    },
    /// A colour is wrong.
    #[error("image {place}: {colour} became red {:.0}, green {:.0}, blue {:.0}, expected {:.0}, {:.0}, {:.0}: another range or matrix of colours", .found[0], .found[1], .found[2], .expected[0], .expected[1], .expected[2])]
    Colour {
        /// Place in the file, from 0.
        place: u32,
        /// Name of the colour.
        colour: &'static str,
        /// Mean of the patch.
        found: [f64; 3],
        /// The drawn colour.
        expected: [f64; 3],
    },
    /// Too much is lost if the process is killed.
    #[error(
        "after a kill {readable} of {TRIAL_PICTURES} images can be read, expected at least {}: {why}",
        TRIAL_PICTURES - LOST_BY_A_KILL
    )]
    Killed {
        /// Images that are readable and right.
        readable: u32,
        /// The error that ends them.
        why: String,
    },
}

/// A recording as the trial needs it: a [`VideoWriter`], or one with a fault in tests.
trait Recording {
    fn write(&mut self, rgb: &[u8]) -> Result<i64>;
    fn finish(self: Box<Self>) -> Result<()>;
}

impl Recording for VideoWriter {
    fn write(&mut self, rgb: &[u8]) -> Result<i64> {
        VideoWriter::write(self, rgb)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        VideoWriter::finish(*self)
    }
}

/// Starts a recording at a path.
type Start<'a> = dyn Fn(&Path) -> Result<Box<dyn Recording>> + 'a;

/// Tries an encoder in a folder, which must exist; leaves its files there.
///
/// # Errors
/// See [`TrialFault`].
pub fn try_encoder(
    folder: &Path,
    settings: &VideoSettings,
    encoder: VideoEncoder,
    (width_px, height_px): (u32, u32),
    frame_rate: FrameRate,
) -> std::result::Result<(), TrialFault> {
    let trial = Trial {
        chart: Chart::new(width_px, height_px),
        frame_rate,
        extension: settings.codec.extension(),
    };
    trial.run(folder, &|path| {
        let writer =
            VideoWriter::create_with(path, settings, encoder, width_px, height_px, frame_rate)?;
        Ok(Box::new(writer))
    })
}

struct Trial {
    chart: Chart,
    frame_rate: FrameRate,
    extension: &'static str,
}

impl Trial {
    fn run(&self, folder: &Path, start: &Start<'_>) -> std::result::Result<(), TrialFault> {
        let file = |name: &str| folder.join(format!("{name}.{}", self.extension));
        let finished = file("finished");
        let mut recording = start(&finished)?;
        self.write_all(&mut *recording)?;
        recording.finish()?;
        match self.right_pictures(&finished) {
            (TRIAL_PICTURES, None) => {}
            (found, None) => return Err(TrialFault::Count { found }),
            (_, Some(fault)) => return Err(fault),
        }
        let (running, killed) = (file("running"), file("killed"));
        let mut recording = start(&running)?;
        self.write_all(&mut *recording)?;
        std::fs::copy(&running, &killed).map_err(Error::io("copy", &running))?;
        drop(recording);
        match self.right_pictures(&killed) {
            (readable, _) if readable >= TRIAL_PICTURES - LOST_BY_A_KILL => Ok(()),
            (readable, fault) => Err(TrialFault::Killed {
                readable,
                why: fault.map_or("the file ends there".into(), |fault| fault.to_string()),
            }),
        }
    }

    fn write_all(&self, recording: &mut dyn Recording) -> std::result::Result<(), TrialFault> {
        let mut rgb = Vec::new();
        for number in 0..TRIAL_PICTURES {
            self.chart.draw(number, &mut rgb);
            recording.write(&rgb)?;
        }
        Ok(())
    }

    /// The number of images up to the first wrong one, and its fault; none at the end of the file.
    fn right_pictures(&self, path: &Path) -> (u32, Option<TrialFault>) {
        let mut reader = match VideoReader::open(path) {
            Ok(reader) => reader,
            Err(error) => return (0, Some(error.into())),
        };
        let mut rgb = Vec::new();
        let mut place = 0;
        loop {
            match reader.next_frame(&mut rgb) {
                Ok(None) => return (place, None),
                Err(error) => return (place, Some(error.into())),
                Ok(Some(pts)) => {
                    if let Some(fault) = self.fault(place, pts, reader.time_base(), &rgb) {
                        return (place, Some(fault));
                    }
                    place += 1;
                }
            }
        }
    }

    fn fault(&self, place: u32, pts: i64, time_base: TimeBase, rgb: &[u8]) -> Option<TrialFault> {
        let found = self.chart.number(rgb);
        if found != Some(place) {
            return Some(TrialFault::Order { place, found });
        }
        let expected_base = TimeBase::of_ticks(self.frame_rate);
        let expected_pts = self.frame_rate.pts_of_tick(place);
        if (pts, time_base) != (expected_pts, expected_base) {
            let said = |pts: i64, unit: TimeBase| format!("{pts} in units of {unit}");
            return Some(TrialFault::Timestamp {
                place,
                found: said(pts, time_base),
                expected: said(expected_pts, expected_base),
            });
        }
        let wrong = self.chart.patches(rgb).find(|(_, found, expected)| {
            let mut pairs = found.iter().zip(expected);
            pairs.any(|(found, expected)| (found - expected).abs() > COLOUR_TOLERANCE)
        });
        wrong.map(|(colour, found, expected)| TrialFault::Colour {
            place,
            colour,
            found,
            expected,
        })
    }
}

#[cfg(test)]
mod tests;
