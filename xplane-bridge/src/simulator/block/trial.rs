//! A trial before blocks are trusted: block images beside settled ones at the same ticks, far away and near.

use dataset::geometry::pose::FlightState;
use futures_util::future::BoxFuture;

use super::super::Simulator;
use super::BlockOfTicks;
use super::aircraft_place::aircraft_place;
use super::probe::changed_pixels;
use crate::error::BridgeError;
use crate::link::{CaptureRequest, Deliver};
use crate::pixels::{PixelError, Rectangle};

/// Ticks in a trial's block.
const TICKS: usize = 9;
/// Comparisons of the same ticks, at most.
const MAX_TRIES: u32 = 4;
/// A pixel differs if a colour does by more than this, grey levels.
const DIFFERENT_LEVELS: u8 = 4;
/// Maximum differing pixels of a block image from a settled one, relative to the difference of two settled ones ...
const NOISE_FACTOR: f64 = 1.5;
/// ... plus this many.
const MORE_PIXELS: usize = 4;

/// Number of views that the code can distinguish.
const VIEWS: usize = 16;

/// Knowledge about a simulator's blocks: kept from one connection to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KnownBlocks {
    /// The result of the trial; `None` before it.
    pub trial: Option<BlockTrial>,
    /// Frames by which the scene was behind the code in the last block that measured it.
    frames_behind: Option<u64>,
    /// The same lag per view, by its number in the code, if a probe in its last block measured it.
    of_view: [Option<u64>; VIEWS],
}

impl KnownBlocks {
    /// Lag of the scene in frames, if known, and true if this view's last block has measured it.
    pub(super) fn lag(&self, view: u32) -> (Option<u64>, bool) {
        match self.of_view[view as usize % VIEWS] {
            Some(lag) => (Some(lag), true),
            None => (self.frames_behind, false),
        }
    }

    pub(super) fn note(&mut self, view: u32, lag: Option<u64>, is_measured: bool) {
        self.frames_behind = lag;
        self.of_view[view as usize % VIEWS] = lag.filter(|_| is_measured);
    }
}

/// Comparison of block images with settled ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlockTrial {
    /// They are equal within the noise of two settled ones.
    Equal,
    /// They are not: every image has to settle.
    Different {
        /// The first tick that differs.
        tick: u32,
        /// Pixels that differ from the settled image.
        pixels: usize,
        /// Pixels in which two settled images differ.
        noise_pixels: usize,
    },
}

impl Simulator {
    /// Knowledge about its blocks, for the next connection.
    pub fn known_blocks(&self) -> KnownBlocks {
        self.known_blocks
    }

    /// Continues with the findings of an earlier connection.
    pub fn use_known_blocks(&mut self, known: KnownBlocks) {
        self.known_blocks = known;
    }

    /// Takes images of a flight's first ticks and of the last ones before the aircraft leaves the view, in a block and settled, and
    /// compares them. Unless they are equal, [`Simulator::can_record_blocks`] is false from now on. The simulator is frozen.
    ///
    /// # Errors
    /// As for [`super::BlockRecording::next_picture`] and [`Simulator::receive_frame`].
    pub fn try_blocks<'a>(
        &'a mut self,
        flight: BlockOfTicks<'a>,
    ) -> BoxFuture<'a, Result<BlockTrial, BridgeError>> {
        Box::pin(async move {
            let mut trial = BlockTrial::Equal;
            let mut is_held = false;
            for first in starts(&flight) {
                // What comes over the scene for a moment does not decide.
                let mut tried = Ok(BlockTrial::Equal);
                for _ in 0..MAX_TRIES {
                    tried = self.try_block(&flight, first, &mut is_held).await;
                    match &tried {
                        Ok(BlockTrial::Different { .. })
                        | Err(BridgeError::Pixels(PixelError::CoveredBefore { .. })) => {
                            self.wait_until_uncovered().await?;
                        }
                        Ok(BlockTrial::Equal) | Err(_) => break,
                    }
                }
                trial = tried?;
                if trial != BlockTrial::Equal {
                    break;
                }
            }
            // Where every tick is held, as in fog, images of moving ticks were not compared: the next scenario tries again.
            self.known_blocks.trial = (!is_held || trial != BlockTrial::Equal).then_some(trial);
            Ok(trial)
        })
    }

    async fn try_block(
        &mut self,
        flight: &BlockOfTicks<'_>,
        first: usize,
        is_held: &mut bool,
    ) -> Result<BlockTrial, BridgeError> {
        let states = &flight.states[first..flight.states.len().min(first + TICKS)];
        let block = BlockOfTicks {
            first_tick: flight.first_tick + first as u32,
            states,
            ..*flight
        };
        let mut recording = self.begin_block(block)?;
        let mut moved = Vec::new();
        while let Some(frame) = recording.next_picture().await? {
            moved.push(frame.rgb);
        }
        *is_held |= recording.report().held > 0;
        drop(recording);
        let at = states.len() / 2;
        let mut settled = Vec::new();
        for other in [at, 0, at] {
            settled.push(self.settled(&block, other).await?);
        }
        let place = aircraft_place(&flight.camera, flight.size_px, &states[at].pose);
        let trial = compare(
            [&moved[at], &settled[0], &settled[2]],
            flight.size_px.0,
            place,
        );
        Ok(match trial {
            Some((pixels, noise_pixels)) => BlockTrial::Different {
                tick: block.first_tick + at as u32,
                pixels,
                noise_pixels,
            },
            None => BlockTrial::Equal,
        })
    }

    async fn settled(
        &mut self,
        block: &BlockOfTicks<'_>,
        at: usize,
    ) -> Result<Vec<u8>, BridgeError> {
        let FlightState { pose, controls, .. } = block.states[at];
        let tick = block.first_tick + at as u32;
        let request = CaptureRequest {
            tick,
            time_ns: block.frame_rate.time_of_tick(tick).0,
            view: block.view,
            pose,
            controls,
            camera: block.camera,
            width_px: block.size_px.0,
            height_px: block.size_px.1,
            deliver: Deliver::Drawn,
        };
        self.send_capture(&request).await?;
        Ok(self.receive_frame().await?.rgb.to_vec())
    }
}

/// First ticks, and last ones with the aircraft in the image.
fn starts(flight: &BlockOfTicks<'_>) -> Vec<usize> {
    let is_seen =
        |state: &FlightState| aircraft_place(&flight.camera, flight.size_px, &state.pose).is_some();
    let last = flight.states.iter().rposition(is_seen);
    let near = last.map(|last| (last + 1).saturating_sub(TICKS));
    let mut starts = vec![0];
    starts.extend(near.filter(|near| *near > 0));
    starts
}

/// Counts the pixels in which a block image and a settled one differ, and those in which two settled ones differ; `Some` if there are too
/// many in the whole image or at the aircraft's place.
fn compare(
    [moved, settled, again]: [&[u8]; 3],
    width_px: u32,
    place: Option<Rectangle>,
) -> Option<(usize, usize)> {
    let whole = |a: &[u8], b: &[u8]| changed_pixels(a, b, DIFFERENT_LEVELS);
    let in_place = |a: &[u8], b: &[u8]| {
        place.map_or(0, |place| {
            (place.y_px..place.bottom_px())
                .map(|y| {
                    let pixel = |x: u32| (y * width_px + x) as usize * 3;
                    let row = pixel(place.x_px)..pixel(place.right_px());
                    let (a, b) = (a.get(row.clone()), b.get(row));
                    changed_pixels(
                        a.unwrap_or_default(),
                        b.unwrap_or_default(),
                        DIFFERENT_LEVELS,
                    )
                })
                .sum()
        })
    };
    let counts = [
        (whole(moved, settled), whole(settled, again)),
        (in_place(moved, settled), in_place(settled, again)),
    ];
    let is_too_much = |(pixels, noise): &(usize, usize)| {
        *pixels as f64 > NOISE_FACTOR * *noise as f64 + MORE_PIXELS as f64
    };
    counts.into_iter().find(is_too_much)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH_PX: u32 = 20;
    const PLACE: Rectangle = Rectangle {
        x_px: 5,
        y_px: 5,
        width_px: 6,
        height_px: 3,
    };

    /// A grey image with an aircraft that begins in a column.
    fn picture(column: u32) -> Vec<u8> {
        let mut rgb = vec![100; (WIDTH_PX * 15) as usize * 3];
        for y in 5..8 {
            let from = ((y * WIDTH_PX + column) * 3) as usize;
            rgb[from..from + 9].fill(30);
        }
        rgb
    }

    #[test]
    fn a_picture_of_the_tick_before_is_different_and_one_within_the_noise_is_not() {
        let settled = picture(6);
        let compare_with =
            |moved: &[u8]| compare([moved, &settled, &settled], WIDTH_PX, Some(PLACE));
        assert_eq!(compare_with(&settled), None);
        assert_eq!(compare_with(&picture(7)), Some((6, 0)));
        let mut noisy = settled.clone();
        noisy[3 * 100] += 20;
        assert_eq!(compare_with(&noisy), None);
    }

    #[test]
    fn in_rain_the_aircraft_alone_shows_the_difference() {
        let rain = |seed: usize, column: u32| {
            let mut rgb = picture(column);
            for at in (3 * seed..rgb.len()).step_by(21) {
                let row = at / 3 / WIDTH_PX as usize;
                if !(5..8).contains(&row) {
                    rgb[at] = 200;
                }
            }
            rgb
        };
        let (settled, again) = (rain(1, 6), rain(2, 6));
        let compare_with = |moved: &[u8]| compare([moved, &settled, &again], WIDTH_PX, Some(PLACE));
        assert_eq!(compare_with(&rain(3, 6)), None);
        assert_eq!(compare_with(&rain(3, 7)), Some((6, 0)));
    }
}
