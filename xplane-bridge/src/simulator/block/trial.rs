//! A trial before blocks are trusted: block images beside settled ones of the same tick and its neighbours, far away and near.

use dataset::geometry::pose::FlightState;
use futures_util::future::BoxFuture;

use super::super::Simulator;
use super::BlockOfTicks;
use super::aircraft_place::aircraft_place;
use crate::error::BridgeError;
use crate::link::Deliver;
use crate::pixels::{PixelError, Rectangle};

/// Ticks in a trial's block.
const TICKS: usize = 9;
/// Comparisons of the same ticks, at most.
const MAX_TRIES: u32 = 4;
/// A block image is of a neighbouring tick if it is nearer to that one's settled image than to its own, by more than this share of what two
/// settled images of one tick differ by: rain and slow motion are in all of them.
const NOISE_SHARE: f64 = 0.5;

/// Two pixels show different ticks if a colour differs by more than this, levels: clouds and compression stay below.
const LATE_LEVELS: u8 = 16;
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
    /// True if numbers were repeated or missing, so that every tick is shown in two frames.
    pub(super) numbers_repeat: bool,
    /// True if the scene moves by itself in a pause.
    pub(super) scene_moves: bool,
    /// True if a block was not possible.
    is_impossible: bool,
}

impl KnownBlocks {
    /// Lag of the scene in frames, if known, and true if this view's last block has measured it.
    pub(super) fn lag(&self, view: u32) -> (Option<u64>, bool) {
        match self.of_view[view as usize % VIEWS] {
            Some(lag) => (Some(lag), true),
            None => (self.frames_behind, false),
        }
    }

    /// True if every image has to settle.
    pub fn is_refused(&self) -> bool {
        self.is_impossible || matches!(self.trial, Some(BlockTrial::Different { .. }))
    }

    /// What holds for the same installation in another process: it may draw with another lag, but numbers, scenery and drawing of plugins
    /// are its driver's and its settings'.
    pub fn in_another_process(self) -> Self {
        Self {
            trial: self.trial.filter(|trial| *trial != BlockTrial::Equal),
            frames_behind: None,
            of_view: [None; VIEWS],
            ..self
        }
    }

    pub(super) fn note(&mut self, view: u32, lag: Option<u64>, is_measured: bool) {
        self.frames_behind = lag;
        self.of_view[view as usize % VIEWS] = lag.filter(|_| is_measured);
    }
}

/// Pixels of a block's images whose tick is not the image's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::simulator) struct Lagging {
    /// Pixels that differ between settled images of consecutive ticks.
    pub(in crate::simulator) changing: usize,
    /// Pixels of these that show the tick before.
    pub(in crate::simulator) late: usize,
    /// Ticks that were shown again.
    pub(in crate::simulator) repeated: u32,
    /// Lag of the scene behind the code.
    pub(in crate::simulator) frames_behind: Option<u32>,
}

/// Comparison of block images with settled ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlockTrial {
    /// They show their ticks.
    Equal,
    /// They do not: every image has to settle.
    Different {
        /// The tick that was asked for.
        tick: u32,
        /// The tick that is in the image.
        found: u32,
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

    /// Records no more blocks: one was not possible.
    pub fn refuse_blocks(&mut self) {
        self.known_blocks.is_impossible = true;
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
        let ticks = at.saturating_sub(1)..=(at + 1).min(states.len() - 1);
        let mut settled = Vec::new();
        for tick in ticks.clone().chain([at]) {
            settled.push(self.settled(&block, tick).await?);
        }
        let again = settled.pop().unwrap_or_default();
        let own = &settled[at - ticks.start()];
        let places: Vec<Rectangle> = states[ticks.clone()]
            .iter()
            .filter_map(|state| aircraft_place(&flight.camera, flight.size_px, &state.pose))
            .collect();
        let distance = |a: &[u8], b: &[u8]| distance(a, b, flight.size_px.0, &places);
        let most = distance(&moved[at], own) - NOISE_SHARE * distance(own, &again);
        let others = ticks.zip(&settled).filter(|(tick, _)| *tick != at);
        let nearest = others
            .map(|(tick, settled)| (tick, distance(&moved[at], settled)))
            .min_by(|(_, a), (_, b)| a.total_cmp(b));
        Ok(match nearest {
            Some((found, other)) if other < most => BlockTrial::Different {
                tick: block.first_tick + at as u32,
                found: block.first_tick + found as u32,
            },
            _ => BlockTrial::Equal,
        })
    }

    /// Records a block in which everything that belongs to the aircraft is elsewhere in the next tick, and compares some of its images with
    /// settled ones, pixel by pixel. The simulator is frozen.
    pub(in crate::simulator) async fn lagging(
        &mut self,
        block: BlockOfTicks<'_>,
    ) -> Result<Lagging, BridgeError> {
        let mut recording = self.begin_block(block)?;
        let mut moved = Vec::new();
        while let Some(frame) = recording.next_picture().await? {
            moved.push(frame.rgb);
        }
        let report = recording.report();
        drop(recording);
        let mut found = Lagging {
            changing: 0,
            late: 0,
            repeated: report.repeated,
            frames_behind: report.frames_behind,
        };
        let last = moved.len().saturating_sub(1);
        for at in [last / 3, last / 2, last].into_iter().filter(|at| *at > 0) {
            // Each twice: what moves by itself differs in one of the pairs.
            let mut settled = Vec::new();
            for tick in [at - 1, at, at - 1, at] {
                settled.push(self.settled(&block, tick).await?);
            }
            let of = |image: &[u8], pixel: usize| {
                <[u8; 3]>::try_from(&image[3 * pixel..3 * pixel + 3]).unwrap_or_default()
            };
            let differ =
                |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).any(|(a, b)| a.abs_diff(b) > LATE_LEVELS);
            for pixel in 0..moved[at].len() / 3 {
                let [before, own, before_again, own_again] =
                    [0, 1, 2, 3].map(|number| of(&settled[number], pixel));
                let stays = !differ(before, before_again) && !differ(own, own_again);
                if stays && differ(own, before) {
                    let image = of(&moved[at], pixel);
                    found.changing += 1;
                    found.late += usize::from(differ(image, own) && !differ(image, before));
                }
            }
        }
        Ok(found)
    }

    async fn settled(
        &mut self,
        block: &BlockOfTicks<'_>,
        at: usize,
    ) -> Result<Vec<u8>, BridgeError> {
        self.send_capture(&block.request(at as u32, Deliver::Drawn))
            .await?;
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

/// Sum of the differences of two images in some places, levels.
fn distance(a: &[u8], b: &[u8], width_px: u32, places: &[Rectangle]) -> f64 {
    let rows = places.iter().flat_map(|place| place.rows(width_px));
    rows.map(|row| {
        let (a, b) = (a.get(row.clone()), b.get(row));
        let values = a.unwrap_or_default().iter().zip(b.unwrap_or_default());
        values.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>()
    })
    .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_process_has_another_lag_and_the_same_refusal() {
        let mut known = KnownBlocks {
            trial: Some(BlockTrial::Equal),
            numbers_repeat: true,
            ..KnownBlocks::default()
        };
        known.note(1, Some(2), true);
        assert_eq!(known.lag(1), (Some(2), true));
        let next = known.in_another_process();
        assert_eq!((next.trial, next.lag(1)), (None, (None, false)));
        assert!(next.numbers_repeat && !next.is_refused());
        for refused in [
            KnownBlocks {
                is_impossible: true,
                ..known
            },
            KnownBlocks {
                trial: Some(BlockTrial::Different { tick: 4, found: 3 }),
                ..known
            },
        ] {
            assert!(refused.in_another_process().is_refused());
        }
    }
}
