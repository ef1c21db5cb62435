//! Grabs that count, by the order in which the numbers of frames are seen.
//!
//! A number may be shown again under a later frame's scene. That frame's own number then never appears, so a grab counts only if the number
//! after its own was seen next. If numbers were seen over two scenes, or many are missing, each tick is shown in two frames, and a number
//! may be one frame older than its frame.

use std::mem;

/// Numbers that were seen over two scenes before every tick is shown in two frames; one may be a cover that came during a frame.
const REPEATED_NUMBERS: u32 = 2;
/// Grabs in a row without the number after theirs before every tick is shown in two frames: the screen is seen at half the rate ...
const MANY_REFUSED: u32 = 20;
/// ... and before none is expected to come.
const MAX_REFUSED: u32 = 240;

#[derive(Debug)]
pub(super) struct Grab<P> {
    pub(super) number: u64,
    /// Frames directly before it that were not doubtful.
    pub(super) steady: u64,
    /// `None` if it does not count.
    pub(super) picture: Option<P>,
}

#[derive(Debug)]
pub(super) struct Numbers<P> {
    /// The last grab, until the number after it is seen, and the last number.
    newest: Option<Grab<P>>,
    newest_number: u64,
    /// Frames by which a number may be older than its frame: 0, or 1 if numbers were repeated.
    pub(super) stale_frames: u64,
    /// Numbers that were seen over two scenes.
    repeated: u32,
    /// Grabs in a row whose successor was missing.
    refused: u32,
}

impl<P: PartialEq> Numbers<P> {
    pub(super) fn new(repeat: bool) -> Self {
        Self {
            newest: None,
            newest_number: 0,
            stale_frames: u64::from(repeat),
            repeated: 0,
            refused: 0,
        }
    }

    /// A number was seen, `steady` frames after a doubtful one, maybe with a grab of its frame. Returns the grab before, once it is decided
    /// whether it counts; and true if numbers may be late from now on: the lag has to be measured again.
    pub(super) fn see(
        &mut self,
        number: u64,
        steady: u32,
        picture: Option<P>,
    ) -> (Option<Grab<P>>, bool) {
        let is_first_doubt = self.stale_frames == 0;
        if number <= self.newest_number {
            let is_other = picture.as_ref().zip(self.newest.as_ref());
            let is_other = is_other.is_some_and(|(now, grab)| {
                (grab.picture.as_ref()).is_some_and(|before| now != before)
            });
            let is_repeated = number < self.newest_number || is_other;
            if !is_repeated {
                return (None, false);
            }
            self.repeated += 1;
            if self.repeated >= REPEATED_NUMBERS {
                self.stale_frames = 1;
            }
            let picture = None;
            let newest = self.newest.take().map(|grab| Grab { picture, ..grab });
            return (newest, is_first_doubt);
        }
        self.newest_number = number;
        let next = picture.map(|picture| Grab {
            number,
            steady: u64::from(steady),
            picture: Some(picture),
        });
        let Some(grab) = mem::replace(&mut self.newest, next) else {
            return (None, false);
        };
        let is_followed = number <= grab.number + 1 + self.stale_frames;
        self.refused = if is_followed { 0 } else { self.refused + 1 };
        if self.refused >= MANY_REFUSED {
            self.stale_frames = 1;
        }
        let picture = grab.picture.filter(|_| is_followed);
        let grab = Grab { picture, ..grab };
        (Some(grab), is_first_doubt && self.stale_frames > 0)
    }

    /// True if hardly any number is followed by the next one, so that no grab counts.
    pub(super) fn are_hopeless(&self) -> bool {
        self.refused >= MAX_REFUSED
    }

    /// True if every tick is shown in two frames.
    pub(super) fn are_late(&self) -> bool {
        self.stale_frames > 0
    }

    /// Forgets a grab from this number on.
    pub(super) fn forget_from(&mut self, number: u64) {
        self.newest.take_if(|grab| grab.number >= number);
    }
}
