//! The decision what to do about a cover: take images again, or give up.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::{Cover, PausedScene, RunningScene, WorldTime};
use crate::pixels::{PixelError, Rectangle};

/// Time to wait for a cover to go.
const PATIENCE: Duration = Duration::from_secs(30);
/// Clouds drift noticeably between two images that are further apart.
const MAX_IMAGE_GAP: Duration = Duration::from_millis(100);
/// Images whose frames are remembered: more than any cover goes back.
const REMEMBERED: usize = 128;

/// A cover that is waited for.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Covered {
    since: Option<Instant>,
    rectangle: Option<Rectangle>,
}

impl Covered {
    /// It is there.
    ///
    /// # Errors
    /// It has been there for 30 seconds.
    pub(crate) fn note(&mut self, rectangle: Rectangle, now: Instant) -> Result<(), PixelError> {
        let since = *self.since.get_or_insert_with(|| {
            tracing::warn!(
                %rectangle,
                "something covers the scene; its images are taken again until it has gone"
            );
            now
        });
        self.rectangle = Some(rectangle);
        let waited = now.duration_since(since);
        if waited > PATIENCE {
            return Err(PixelError::Unusable(format!(
                "{rectangle} of the images has not looked like the beginning of the block for {waited:.0?}: a message, a window, a \
                 notification or a pointer covers the scene, or covered it then and has gone. Close it, or move it away, and keep it \
                 from coming again"
            )));
        }
        Ok(())
    }
}

/// A scene, paused or not.
#[derive(Debug)]
enum Scene {
    Paused(PausedScene),
    Running(RunningScene),
}

/// Watches the images of a block in drawing order.
#[derive(Debug)]
pub(crate) struct CoverWatch {
    scene: Scene,
    frames: VecDeque<u64>,
    last_look: Option<Instant>,
    covered: Covered,
}

impl CoverWatch {
    /// Watches images of this size.
    pub(crate) fn new(width_px: u32, height_px: u32, time: WorldTime) -> Self {
        Self {
            scene: match time {
                WorldTime::Paused => Scene::Paused(PausedScene::new(width_px, height_px)),
                WorldTime::Runs => Scene::Running(RunningScene::new(width_px, height_px)),
            },
            frames: VecDeque::new(),
            last_look: None,
            covered: Covered::default(),
        }
    }

    /// Sees a frame's image that is not judged: in a pause it adds to what was watched, where time runs all begins with it.
    ///
    /// # Panics If the image size differs.
    pub(crate) fn watch(&mut self, frame: u64, rgb: &[u8], moving: &[Rectangle]) {
        match &mut self.scene {
            Scene::Paused(scene) => scene.watch(rgb, moving),
            Scene::Running(scene) => scene.begin_with(rgb, moving),
        }
        self.frames = VecDeque::from([frame]);
        self.last_look = None;
        self.covered = Covered::default();
    }

    /// The cover has gone.
    pub(crate) fn uncovered(&mut self) {
        self.covered = Covered::default();
    }

    /// Forgets what was watched, and any cover.
    pub(crate) fn forget(&mut self) {
        if let Scene::Paused(scene) = &mut self.scene {
            scene.forget();
        }
        self.covered = Covered::default();
    }

    /// The scene came to rest with the last image that was seen.
    pub(crate) fn keep_latest(&mut self) {
        if let Scene::Paused(scene) = &mut self.scene {
            scene.keep_latest();
        }
    }

    /// True if the scene moved in a pause while it was watched.
    pub(crate) fn moves(&self) -> bool {
        matches!(&self.scene, Scene::Paused(scene) if scene.moves())
    }

    /// True if so much of the scene moves in a pause that covers cannot be found.
    pub(crate) fn moves_too_much(&self) -> bool {
        matches!(&self.scene, Scene::Paused(scene) if scene.moves_too_much())
    }

    /// The cover of the last image, if every image has been covered for at least this time.
    pub(crate) fn covered_for(&self, time: Duration, now: Instant) -> Option<Rectangle> {
        let since = self.covered.since?;
        let is_longer = now.duration_since(since) >= time;
        self.covered.rectangle.filter(|_| is_longer)
    }

    /// Looks at a frame's image, in which only `moving` may differ from the one before. If something covers it, returns the first frame
    /// whose image must be taken again.
    ///
    /// # Errors
    /// A cover has been there for 30 seconds.
    ///
    /// # Panics If the image size differs.
    pub(crate) fn look(
        &mut self,
        frame: u64,
        rgb: &[u8],
        moving: &[Rectangle],
        now: Instant,
    ) -> Result<Option<u64>, PixelError> {
        let last_look = self.last_look.replace(now);
        let is_late = last_look.is_some_and(|last| now.duration_since(last) > MAX_IMAGE_GAP);
        if let (Scene::Running(scene), true) = (&mut self.scene, is_late) {
            scene.after_gap();
        }
        self.frames.push_front(frame);
        self.frames.truncate(REMEMBERED);
        let looked: Result<(), Cover> = match &mut self.scene {
            Scene::Paused(scene) => scene.look(rgb, moving),
            Scene::Running(scene) => scene.look(rgb, moving),
        };
        let Err(cover) = looked else {
            self.covered = Covered::default();
            return Ok(None);
        };
        self.covered.note(cover.rectangle, now)?;
        let oldest = self.frames.len().saturating_sub(1);
        let first = oldest.min(cover.pictures_before as usize);
        Ok(Some(self.frames[first]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: (u32, u32) = (64, 48);

    fn picture(level: u8) -> Vec<u8> {
        vec![level; (SIZE_PX.0 * SIZE_PX.1 * 3) as usize]
    }

    fn watching() -> (CoverWatch, Instant) {
        let mut watch = CoverWatch::new(SIZE_PX.0, SIZE_PX.1, WorldTime::Paused);
        let now = Instant::now();
        watch.watch(99, &picture(80), &[]);
        for frame in 100..110 {
            let seen = watch.look(frame, &picture(80), &[], now).unwrap();
            assert_eq!(seen, None);
        }
        (watch, now)
    }

    #[test]
    fn a_covered_picture_is_taken_again_until_the_cover_has_gone() {
        let (mut watch, now) = watching();
        for frame in 110..115 {
            let seen = watch.look(frame, &picture(200), &[], now).unwrap();
            assert_eq!(seen, Some(frame));
        }
        let seen = watch.look(115, &picture(80), &[], now).unwrap();
        assert_eq!(seen, None);
    }

    #[test]
    fn a_cover_that_stays_for_half_a_minute_is_an_error_that_names_it() {
        let (mut watch, now) = watching();
        let mut look = |second| {
            let now = now + Duration::from_secs(second);
            watch.look(110 + second, &picture(200), &[], now)
        };
        assert!(look(0).is_ok() && look(30).is_ok());
        let text = look(31).unwrap_err().to_string();
        assert!(text.contains("64x48 at (0, 0)"), "{text}");
    }
}
