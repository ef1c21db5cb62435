//! Lag of the scene behind the pose and the camera that were written.
//!
//! X-Plane draws the rectangles of draw callbacks into the current frame at once. The scene may be some frames behind, because it is
//! prepared before the plugin writes.

use std::collections::VecDeque;

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::Controls;

use super::shot::Shot;
use crate::quirks::{Quirk, Quirks};

/// Lag of the scene (camera and aircraft) behind the written state in frames, each at most [`Self::MAX_FRAMES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneBehind {
    /// Always the same number.
    Constant(usize),
    /// The first number, and the second after this many frames in which camera or aircraft moved.
    Changed {
        /// The first number.
        before: usize,
        /// The number afterwards.
        after: usize,
        /// Frames with a movement that the first number lasts.
        moves: u64,
    },
    /// The two numbers alternately for the cameras, in order of appearance.
    ByCamera([usize; 2]),
    /// 2, 4 and 3 in turn, changing after every fifth movement.
    Unsteady,
}

impl SceneBehind {
    /// The most frames that any client must expect.
    pub const MAX_FRAMES: usize = 4;
    const UNSTEADY: [usize; 3] = [2, 4, 3];
    const UNSTEADY_MOVES: u64 = 5;
}

/// Recent shots; the scene shows one.
#[derive(Debug)]
pub(super) struct Shots {
    behind: SceneBehind,
    /// Quirks of flaps and gear.
    quirks: Quirks,
    /// The newest first.
    past: VecDeque<Shot>,
    moves: u64,
    /// Cameras in order of appearance, if their number matters.
    cameras: Vec<CameraPose>,
}

impl Shots {
    /// Initially none.
    pub(super) fn new(behind: SceneBehind, quirks: Quirks) -> Self {
        Self {
            behind,
            quirks,
            past: VecDeque::new(),
            moves: 0,
            cameras: Vec::new(),
        }
    }

    /// A frame ends for which this was written.
    pub(super) fn record(&mut self, shot: Shot) {
        if self.past.front().is_some_and(|last| last.moved(&shot)) {
            self.moves += 1;
        }
        if matches!(self.behind, SceneBehind::ByCamera(_)) && self.number(&shot.camera).is_none() {
            self.cameras.push(shot.camera);
        }
        self.past.push_front(shot);
        self.past.truncate(SceneBehind::MAX_FRAMES + 1);
    }

    /// The shot that is drawn in a frame for which `shot` was written.
    pub(super) fn drawn(&self, shot: Shot) -> Shot {
        let frames = self.frames_behind(&shot.camera);
        let of = |frames: usize| self.past.get(frames.checked_sub(1)?).copied();
        let mut drawn = of(frames).unwrap_or(shot);
        if self.quirks.has(Quirk::FixedParts) {
            drawn.controls = Controls::default();
        } else if self.quirks.has(Quirk::LaggingParts) {
            drawn.controls = of(frames + 1).unwrap_or(drawn).controls;
        }
        drawn
    }

    fn frames_behind(&self, camera: &CameraPose) -> usize {
        match self.behind {
            SceneBehind::Constant(frames) => frames,
            SceneBehind::Changed {
                before,
                after,
                moves,
            } => {
                if self.moves < moves {
                    before
                } else {
                    after
                }
            }
            SceneBehind::ByCamera(frames) => {
                frames[self.number(camera).unwrap_or(self.cameras.len()) % frames.len()]
            }
            SceneBehind::Unsteady => {
                let turn = self.moves / SceneBehind::UNSTEADY_MOVES;
                SceneBehind::UNSTEADY[turn as usize % SceneBehind::UNSTEADY.len()]
            }
        }
    }

    /// A camera's place in the order of appearance.
    fn number(&self, camera: &CameraPose) -> Option<usize> {
        self.cameras.iter().position(|known| is_same(known, camera))
    }
}

/// True if two cameras are the same except for rounding by a moved origin of coordinates.
fn is_same(a: &CameraPose, b: &CameraPose) -> bool {
    const NEAR_M: f64 = 1.0;
    const NEAR_DEG: f64 = 0.1;
    let [a, b] = [a.pose, b.pose];
    let turned_deg = (a.heading_true_deg - b.heading_true_deg + 540.0).rem_euclid(360.0) - 180.0;
    a.position().to_ecef().distance(b.position().to_ecef()) < NEAR_M
        && turned_deg.abs() < NEAR_DEG
        && (a.pitch_deg - b.pitch_deg).abs() < NEAR_DEG
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::world::airport::{ON_THRESHOLD, on_final};

    fn shot(step: u32) -> Shot {
        Shot {
            camera: CameraPose {
                pose: ON_THRESHOLD,
                hfov_deg: 10.0,
            },
            pose: on_final(9.0 - 0.01 * f64::from(step)),
            controls: Controls::default(),
            panel: false,
            weather_time_s: 0.0,
        }
    }

    fn behind_in_flight(behind: SceneBehind, frames: u32) -> Vec<u32> {
        let mut shots = Shots::new(behind, Quirks::NONE);
        let mut found = Vec::new();
        for step in 0..frames {
            let drawn = shots.drawn(shot(step));
            let age = (0..=step).find(|age| shot(step - age) == drawn).unwrap();
            found.push(age);
            shots.record(shot(step));
        }
        found.split_off(SceneBehind::MAX_FRAMES)
    }

    #[test]
    fn the_scene_is_a_constant_number_of_frames_behind_however_it_moves() {
        for frames in 0..=SceneBehind::MAX_FRAMES {
            let found = behind_in_flight(SceneBehind::Constant(frames), 40);
            assert_eq!(found, [frames as u32; 36]);
            // After a rest as well.
            let mut shots = Shots::new(SceneBehind::Constant(frames), Quirks::NONE);
            (0..9).for_each(|_| shots.record(shot(1)));
            let mut old = 0;
            for _ in 0..9 {
                old += usize::from(shots.drawn(shot(2)) != shot(2));
                shots.record(shot(2));
            }
            assert_eq!(old, frames);
        }
    }

    #[test]
    fn the_number_changes_once_after_so_many_movements() {
        let change = SceneBehind::Changed {
            before: 1,
            after: 3,
            moves: 20,
        };
        let found = behind_in_flight(change, 40);
        assert_eq!(found.iter().filter(|behind| **behind == 1).count(), 17);
        assert!(found.is_sorted(), "{found:?}");
        assert_eq!(found.last(), Some(&3));
    }

    #[test]
    fn cameras_differ_and_keep_their_numbers_when_they_come_back() {
        let mut shots = Shots::new(SceneBehind::ByCamera([1, 4]), Quirks::NONE);
        let turned = |step, heading_deg| {
            let mut shot = shot(step);
            shot.camera.pose.heading_true_deg += heading_deg;
            shot
        };
        for (heading_deg, frames) in [(0.0, 1), (40.0, 4), (0.0, 1), (1e-4, 1), (40.0, 4)] {
            for step in 0..9 {
                shots.record(turned(step, heading_deg));
            }
            let drawn = shots.drawn(turned(9, heading_deg));
            assert_eq!(drawn, turned(9 - frames, heading_deg), "{heading_deg}");
        }
    }

    #[test]
    fn an_unsteady_scene_has_no_number_for_long() {
        let found = behind_in_flight(SceneBehind::Unsteady, 60);
        let longest = found.chunk_by(|a, b| a == b).map(<[u32]>::len).max();
        assert!(longest <= Some(6), "{found:?}");
    }
}
