//! Camera condition at each tick, from consecutive images.
//!
//! Input: each image's turn and its change since the previous one ([`Look`]), and the boxes of the view. Output: a state per tick, and the
//! turn relative to the flight's usual direction: the direction in which the flight begins, averaged over its ticks. A camera that was
//! moved earlier is up to the comparison between flights. Rules look at some seconds and ticks around each tick; a state needs a large and
//! certain deviation, so that a healthy camera has no findings.

mod frozen;
mod live;
#[cfg(test)]
mod tests;

use dataset::geometry::camera::Camera;
use dataset::numbers::spread::{deviation_from_zero, median_of};
use dataset::tables::backgrounds::ViewBackground;
use dataset::tables::health::{CameraTurn, HealthState};
use dataset::tables::pixel_box::PixelBox;
use dataset::video::Luma;
use glam::DVec2;
use sight::background::{Background, Collected, MAX_OFF_PX};
use sight::ground::Motion;
use sight::watched::{Measured, Watched};

pub(crate) use frozen::Change;
use live::LiveHealth;

/// Version of the measurement; health of other versions is measured again.
pub(crate) const METHOD: u32 = 11;

/// Ticks and seconds around a tick that decide about it.
const AROUND_TICKS: usize = 5;
const AROUND_S: f64 = 2.5;
/// A direction that is off by less is usual, pixels.
pub(crate) const MIN_OFF_PX: f64 = 0.3;
/// Minimum deviation of unusual directions, in standard deviations.
const MIN_OFF_SD: f64 = 6.0;
/// Ticks that must be off for a lasting move.
const MIN_MOVED: usize = 3;
/// Maximum distance of the usual direction, in scatters, and at least [`MAX_OFF_PX`].
const SCATTER: f64 = 1.5;

/// Evidence from an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    pub(crate) tick: u32,
    pub(crate) time_s: f64,
    /// Turn from the first image; `None` if it could not be measured.
    pub(crate) turn: Option<Measured>,
    /// Comparison with the image before around a box.
    pub(crate) change: Option<Change>,
}

impl Look {
    /// Looks at an image. `before`: the one before it, `seen`: its best box.
    pub(crate) fn of(
        (tick, time_s): (u32, f64),
        turn: Option<Measured>,
        images: [Option<Luma<'_>>; 2],
        seen: Option<PixelBox>,
    ) -> Self {
        let change = match (images, seen) {
            ([Some(before), Some(now)], Some(seen)) => Change::between(&before, &now, seen),
            _ => None,
        };
        Self {
            tick,
            time_s,
            turn,
            change,
        }
    }
}

/// Judges a camera's consecutive images. Memory does not grow with their number.
pub(crate) struct CameraWatch {
    motion: Watched,
    background: Collected,
    /// Tick of the last image of the background.
    background_tick: u32,
    live: LiveHealth,
}

/// Condition of a camera by an image.
pub(crate) struct CameraLook {
    pub(crate) look: Look,
    /// Its condition, by the images up to now.
    pub(crate) state: HealthState,
    /// The background, if it is complete with this image.
    pub(crate) background: Option<Background>,
}

impl CameraWatch {
    pub(crate) fn new(camera: &Camera) -> Self {
        Self {
            motion: Watched::new(camera),
            background: Collected::new(camera),
            background_tick: 0,
            live: LiveHealth::default(),
        }
    }

    /// Judges the next image by the images up to now. `images`: the previous one and this one, `best`: its best box, `counted`: the box
    /// that counts.
    pub(crate) fn look(
        &mut self,
        at: (u32, f64),
        images: [Option<Luma<'_>>; 2],
        best: Option<PixelBox>,
        counted: Option<PixelBox>,
    ) -> CameraLook {
        let mut turn = None;
        let mut background = None;
        if let Some(image) = &images[1] {
            turn = self.motion.next(image);
            let is_hidden = !self.motion.has_begun();
            if self.background.take(image, turn, is_hidden) {
                self.background_tick = at.0;
            }
            if self.background.is_complete() && self.background_tick == at.0 {
                background = self.background.background();
            }
        }
        let look = Look::of(at, turn, images, best);
        let state = self.live.next(&look, counted);
        CameraLook {
            look,
            state,
            background,
        }
    }

    /// The background of the whole flight, relative to whose direction the usual one is given; `None` without an image.
    pub(crate) fn background(&self, view: &str, usual: Option<Measured>) -> Option<ViewBackground> {
        let background = self.background.background()?;
        let usual = usual.unwrap_or(Measured {
            turn: background.turn,
            sd_px: 0.0,
        });
        Some(ViewBackground {
            tick: self.background_tick,
            view: view.to_owned(),
            images: background.images,
            top_px: background.top_px as u32,
            usual: camera_turn(&off_from(usual, background.turn)),
            png: background.png(),
        })
    }
}

/// State and turn of each look. `confirmed`: the box that counts of each.
pub(crate) fn judge(
    looks: &[Look],
    confirmed: &[Option<PixelBox>],
) -> Vec<(HealthState, Option<CameraTurn>)> {
    let frozen = frozen::frozen(looks, confirmed);
    let usual = usual(looks);
    let off: Vec<Option<Measured>> = (looks.iter())
        .map(|look| Some(off_from(look.turn?, usual?.turn)))
        .collect();
    let mut last = None;
    let judged = (0..looks.len()).map(|tick| {
        let turn = off[tick].as_ref().map(camera_turn);
        let direction = known(direction_at(tick, looks, &off), &mut last);
        let state = if frozen[tick] {
            HealthState::Frozen
        } else {
            direction
        };
        (state, turn)
    });
    judged.collect()
}

/// The direction relative to the usual one.
fn off_from(measured: Measured, usual: Motion) -> Measured {
    Measured {
        turn: measured.turn.after(usual.back()),
        ..measured
    }
}

fn camera_turn(measured: &Measured) -> CameraTurn {
    CameraTurn {
        shift_x_px: measured.turn.shift_px.x,
        shift_y_px: measured.turn.shift_px.y,
        roll_deg: measured.turn.roll_rad.to_degrees(),
        shift_sd_px: measured.sd_px,
    }
}

fn tolerated_px(measured: &Measured) -> f64 {
    MIN_OFF_PX.max(MIN_OFF_SD * measured.sd_px)
}

fn is_off_from(measured: &Measured, direction_px: DVec2) -> bool {
    measured.turn.shift_px.distance(direction_px) > tolerated_px(measured)
}

fn around(tick: usize, looks: &[Look]) -> std::ops::Range<usize> {
    let time_s = looks[tick].time_s;
    let is_near = |other: usize| {
        other.abs_diff(tick) <= AROUND_TICKS || (looks[other].time_s - time_s).abs() <= AROUND_S
    };
    let start = (0..tick).rev().take_while(|&other| is_near(other)).last();
    let end = (tick..looks.len())
        .take_while(|&other| is_near(other))
        .last();
    start.unwrap_or(tick)..end.unwrap_or(tick) + 1
}

/// The direction in which the flight begins, averaged over all ticks with this direction. A shaking camera leaves the mean uncertain, by
/// its scatter over the root of their number: ticks count as independent, as they are at low image rates.
pub(crate) fn usual(looks: &[Look]) -> Option<Measured> {
    let turns: Vec<Motion> = looks
        .iter()
        .filter_map(|look| Some(look.turn?.turn))
        .collect();
    let measured: Vec<Look> = looks
        .iter()
        .filter(|look| look.turn.is_some())
        .copied()
        .collect();
    let medians: Vec<DVec2> = (0..measured.len())
        .map(|tick| {
            median(
                turns[around(tick, &measured)]
                    .iter()
                    .map(|turn| turn.shift_px),
            )
        })
        .collect();
    let off = turns.iter().zip(&medians);
    let scatter_px = deviation_from_zero(off.map(|(turn, median)| turn.shift_px.distance(*median)));
    let tolerated_px = MAX_OFF_PX.max(SCATTER * scatter_px);
    let mut direction_px = *medians.first()?;
    let mut there: Vec<&Motion> = Vec::new();
    for _ in 0..3 {
        let places = turns.iter().zip(&medians);
        there = places
            .filter(|(_, median)| median.distance(direction_px) <= tolerated_px)
            .map(|(turn, _)| turn)
            .collect();
        if there.is_empty() {
            return None;
        }
        direction_px = median(there.iter().map(|turn| turn.shift_px));
    }
    // One wild measurement must not move the mean.
    let is_near = |turn: &&&Motion| turn.shift_px.distance(direction_px) <= 2.0 * tolerated_px;
    let near: Vec<&Motion> = there.iter().filter(is_near).copied().collect();
    let count = near.len().max(1) as f64;
    let shift_px = near.iter().map(|turn| turn.shift_px).sum::<DVec2>() / count;
    let off_px = near.iter().map(|turn| turn.shift_px - shift_px);
    let squares: DVec2 = off_px.map(|off_px| off_px * off_px).sum();
    Some(Measured {
        turn: Motion {
            shift_px,
            roll_rad: near.iter().map(|turn| turn.roll_rad).sum::<f64>() / count,
            ..Motion::default()
        },
        sd_px: (squares.max_element() / (count - 1.0).max(1.0) / count).sqrt(),
    })
}

/// State from the directions of a tick and its neighbours; `None` if its own was not measured.
fn direction_at(tick: usize, looks: &[Look], off: &[Option<Measured>]) -> Option<HealthState> {
    let own = off[tick]?;
    let around = around(tick, looks);
    let measured = |range: std::ops::Range<usize>| off[range].iter().flatten();
    let median = median(measured(around.clone()).map(|off| off.turn.shift_px));
    let off_ticks = measured(around.clone()).filter(|off| is_off_from(off, DVec2::ZERO));
    let is_moved = median.length() > tolerated_px(&own) && off_ticks.count() >= MIN_MOVED;
    // A step has scatter on a single side, and a slow turn on neither.
    let scatters = |range: std::ops::Range<usize>| {
        let many = range.len().div_ceil(5).max(2);
        let here = self::median(measured(range.clone()).map(|off| off.turn.shift_px));
        range.is_empty() || measured(range).filter(|off| is_off_from(off, here)).count() >= many
    };
    let is_shaking =
        around.len() > 2 && scatters(around.start..tick) && scatters(tick + 1..around.end)
            || !is_moved && is_off_from(&own, DVec2::ZERO)
            || is_moved && is_off_from(&own, median);
    Some(match (is_shaking, is_moved) {
        (true, _) => HealthState::Shaking,
        (false, true) => HealthState::Moved,
        (false, false) => HealthState::Steady,
    })
}

/// State at a tick. A camera that was off is so until its direction is measured again. `last`: the state of the tick before.
fn known(measured: Option<HealthState>, last: &mut Option<HealthState>) -> HealthState {
    let is_off = |state: &HealthState| [HealthState::Moved, HealthState::Shaking].contains(state);
    *last = measured.or(last.filter(is_off));
    last.unwrap_or(HealthState::Unknown)
}

/// Median of each axis; zero without any.
fn median(places: impl Iterator<Item = DVec2> + Clone) -> DVec2 {
    DVec2::new(
        median_or_zero(places.clone().map(|place| place.x)),
        median_or_zero(places.map(|place| place.y)),
    )
}

fn median_or_zero(values: impl Iterator<Item = f64>) -> f64 {
    median_of(values).unwrap_or_default()
}
