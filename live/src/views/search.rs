//! A thread for each view that searches the newest image.

use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use dataset::tables::health::HealthState;
use dataset::video::{DecodedImage, ImageConverter, Luma, PicturePart};
use labeller::detector::PictureView;
use labeller::{Image, ImageFindings, ViewSearch};
use sight::background::Background;

use crate::options::Pace;
use crate::output::metrics::{Fate, Stage};
use crate::queue::{Queue, Taken, lock};
use crate::view_state::ViewWatch;
use crate::views::feed::{FeedImage, Message};
use crate::views::lockstep::Lockstep;
use crate::views::shared::Shared;

pub(crate) struct Searched {
    pub(crate) time_s: f64,
    pub(crate) taken_s: f64,
    pub(crate) arrival_s: f64,
    pub(crate) added_s: f64,
    /// How often the camera has been turned since the start.
    pub(crate) turns: u32,
    /// When the search was done, seconds since the start.
    pub(crate) searched_s: f64,
    pub(crate) looked: ImageFindings,
}

pub(crate) struct Search {
    pub(crate) view: usize,
    pub(crate) name: String,
    pub(crate) search: ViewSearch,
    pub(crate) direction: Direction,
    /// First track number of this search, and of the next one.
    pub(crate) tracks: [u32; 2],
    pub(crate) queue: Arc<Queue<FeedImage>>,
    pub(crate) status: Arc<Mutex<ViewWatch>>,
    pub(crate) messages: Sender<Message>,
    pub(crate) shared: Arc<Shared>,
    pub(crate) lockstep: Arc<Lockstep>,
}

/// Maximum wait of an image for the search if newer images wait as well, s: whole-image searches delay some.
pub(crate) const MAX_WAIT_S: f64 = 0.1;
/// A wait for an image that is longer changes nothing.
const WAIT: Duration = Duration::from_millis(500);
/// A camera that has looked elsewhere for so long stays there, s: twice the time that decides about the direction of an image
/// (`labeller::view_health`).
const TURNED_S: f64 = 5.0;
/// Images in a row whose search may fail before there is no point in going on.
const MAX_FAILURES: u32 = 30;

/// Watches when a camera may have a new direction, so that the search starts again with a new background.
#[derive(Debug, Default)]
pub(crate) struct Direction {
    connection: Option<u32>,
    moved_since_s: Option<f64>,
    /// How often it has been turned.
    turns: u32,
}

impl Direction {
    /// True if all before the next image is out of date: the source was opened again, or the camera has been turned and stands still.
    fn is_new(&mut self, connection: u32, time_s: f64) -> bool {
        let is_turned = self
            .moved_since_s
            .is_some_and(|since_s| time_s - since_s >= TURNED_S);
        let is_opened = self
            .connection
            .replace(connection)
            .is_some_and(|before| before != connection);
        // One that moved before the loss looks there afterwards.
        if is_turned || is_opened && self.moved_since_s.is_some() {
            self.turns = self.turns.wrapping_add(1);
        }
        if is_turned || is_opened {
            self.moved_since_s = None;
        }
        is_turned || is_opened
    }

    /// Takes the camera's condition in that image.
    fn take(&mut self, camera: HealthState, time_s: f64) {
        match camera {
            HealthState::Moved => {
                self.moved_since_s.get_or_insert(time_s);
            }
            _ => self.moved_since_s = None,
        }
    }
}

impl Search {
    /// Runs until the feed ends or the program is stopped.
    pub(crate) fn run(mut self) {
        let mut pixels = Pixels {
            converter: ImageConverter::new(&self.name),
            whole: Vec::new(),
            part: Vec::new(),
            previous: None,
            background: None,
        };
        let mut failures = 0;
        while !self.shared.is_stopped() {
            let image = match self.queue.take(WAIT) {
                Taken::Content(image) => image,
                Taken::Nothing => continue,
                Taken::Closed => break,
            };
            if self.shared.pace == Pace::AsFastAsPossible {
                self.lockstep.reach(self.view, image.time_s);
            } else if self.is_too_old(&image) {
                continue;
            }
            let time_s = image.time_s;
            let looked = self.look(image, &mut pixels);
            failures = failures_after(&looked, failures);
            let message = match looked {
                Ok(Some(searched)) => Message::Searched(self.view, Box::new(searched)),
                Err(error) if failures >= MAX_FAILURES => Message::Failed(error.into()),
                skipped => {
                    if let Err(error) = skipped {
                        tracing::warn!("an image of view {} was not searched: {error}", self.name);
                        self.shared.metrics.count(self.view, Fate::Damaged);
                    }
                    if self.shared.pace != Pace::AsFastAsPossible {
                        continue;
                    }
                    Message::Skipped(self.view, time_s)
                }
            };
            let is_over = matches!(message, Message::Failed(_));
            // Whoever reads it has ended if it fails.
            if self.messages.send(message).is_err() || is_over {
                break;
            }
        }
        self.lockstep.leave(self.view);
        let _ = self.messages.send(Message::Finished(self.view));
    }

    /// Drops an image that waited for long if there are newer ones.
    fn is_too_old(&self, image: &FeedImage) -> bool {
        let waited_s = self.shared.clock.now_s() - image.decoded_s;
        let is_dropped = waited_s > MAX_WAIT_S && !self.queue.is_empty();
        if is_dropped && image.can_be_measured {
            self.shared.metrics.count(self.view, Fate::Overload);
        }
        is_dropped
    }

    /// Searches an image; `None` if it must not be measured.
    fn look(
        &mut self,
        image: FeedImage,
        pixels: &mut Pixels,
    ) -> labeller::Result<Option<Searched>> {
        if !image.can_be_searched {
            return Ok(None);
        }
        let metrics = &self.shared.metrics;
        let begun_s = self.shared.clock.now_s();
        // A recording is judged as in `dtd predict --online`.
        if self.shared.pace != Pace::AsFastAsPossible
            && self.direction.is_new(image.connection, image.time_s)
        {
            self.search.begin_again();
            pixels.background = None;
            self.tracks[0] = self.tracks[1];
        }
        metrics.time(Stage::Wait, begun_s - image.decoded_s);
        let mut looked = self.search.look(
            &mut NewImage {
                image: &image.image,
                pixels,
                is_converted: false,
            },
            image.time_s,
        )?;
        let searched_s = self.shared.clock.now_s();
        metrics.time(Stage::Search, searched_s - begun_s);
        for found in &mut looked.boxes {
            found.track = found.track.wrapping_add(self.tracks[0]);
            self.tracks[1] = self.tracks[1].max(found.track.wrapping_add(1));
        }
        self.direction.take(looked.camera, image.time_s);
        let is_moved = matches!(looked.camera, HealthState::Moved | HealthState::Shaking);
        let is_frozen = looked.camera == HealthState::Frozen;
        lock(&self.status).set_camera(is_moved, is_frozen);
        pixels.previous = Some(image.image);
        // It also counts if this image does not.
        looked.background = looked.background.or(pixels.background.take());
        if !image.can_be_measured {
            pixels.background = looked.background;
            return Ok(None);
        }
        metrics.count(self.view, Fate::Searched);
        Ok(Some(Searched {
            time_s: image.time_s,
            taken_s: image.taken_s,
            arrival_s: image.arrival_s,
            added_s: image.added_s,
            turns: self.direction.turns,
            searched_s,
            looked,
        }))
    }
}

/// Failures in a row after a search; all that are allowed at once if the detector is at fault rather than the image.
fn failures_after<T>(looked: &labeller::Result<T>, before: u32) -> u32 {
    match looked {
        Ok(_) => 0,
        Err(error) if error.is_bad_input() => MAX_FAILURES,
        Err(_) => before + 1,
    }
}

/// Pixel buffers, the previous image, and the background.
struct Pixels {
    converter: ImageConverter,
    whole: Vec<u8>,
    part: Vec<u8>,
    previous: Option<DecodedImage>,
    /// A complete background that is not passed on yet.
    background: Option<Background>,
}

struct NewImage<'a> {
    image: &'a DecodedImage,
    pixels: &'a mut Pixels,
    is_converted: bool,
}

impl Image for NewImage<'_> {
    fn size_px(&self) -> [u32; 2] {
        self.image.size_px()
    }

    fn whole(&mut self) -> labeller::Result<PictureView<'_>> {
        let Pixels {
            converter, whole, ..
        } = &mut *self.pixels;
        if !self.is_converted {
            converter.whole(self.image, whole)?;
            self.is_converted = true;
        }
        let [width_px, height_px] = self.image.size_px();
        Ok(PictureView {
            rgb: whole,
            width_px,
            height_px,
        })
    }

    fn part(&mut self, part: PicturePart) -> labeller::Result<PictureView<'_>> {
        let pixels = &mut *self.pixels;
        pixels.converter.part(self.image, part, &mut pixels.part)?;
        Ok(PictureView {
            rgb: &pixels.part,
            width_px: part.width_px,
            height_px: part.height_px,
        })
    }

    fn lumas(&self) -> [Option<Luma<'_>>; 2] {
        let previous = self.pixels.previous.as_ref();
        let is_alike = |before: &&DecodedImage| before.size_px() == self.image.size_px();
        let before = previous.filter(is_alike).and_then(DecodedImage::luma);
        [before, self.image.luma()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_is_learned_anew_on_a_new_connection_and_where_it_stands_after_a_turn() {
        let mut direction = Direction::default();
        let mut next = |connection: u32, time_s: f64, camera: HealthState| {
            let is_new = direction.is_new(connection, time_s);
            direction.take(camera, time_s);
            (is_new, direction.turns)
        };
        use HealthState::{Moved, Shaking, Steady, Unknown};
        assert_eq!(next(1, 0.0, Steady), (false, 0));
        assert_eq!(next(2, 9.0, Steady), (true, 0), "opened again");
        for (time_s, camera) in [(10.0, Moved), (14.0, Shaking), (15.5, Moved), (20.0, Moved)] {
            assert_eq!(next(2, time_s, camera), (false, 0), "it sways");
        }
        assert_eq!(next(2, 20.6, Unknown), (true, 1), "it was turned");
        assert_eq!(next(2, 30.0, Moved), (false, 1));
        assert_eq!(next(3, 31.0, Steady), (true, 2), "turned and opened again");
        assert_eq!(next(3, 60.0, Steady), (false, 2));
    }

    #[test]
    fn a_failed_image_costs_itself_and_failures_without_end_the_view() {
        let option = || labeller::Error::Option {
            name: "rows",
            found: "1:0".into(),
            expected: "0:1".into(),
        };
        let of_image = || labeller::Error::Scenario {
            id: "left".into(),
            message: "its pixels cannot be converted".into(),
        };
        let after = |failures| failures_after::<()>(&Err(of_image()), failures);
        assert_eq!(after(0), 1);
        assert_eq!(failures_after(&Ok(()), MAX_FAILURES - 1), 0);
        assert_eq!(
            (0..MAX_FAILURES).fold(0, |failures, _| after(failures)),
            MAX_FAILURES
        );
        assert_eq!(failures_after::<()>(&Err(option()), 0), MAX_FAILURES);
    }
}
