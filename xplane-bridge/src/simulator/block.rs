//! Images of a block of ticks from a resting camera, one tick per drawn frame.
//!
//! The plugin writes the next tick in each camera callback, and numbers the frames that it draws. A thread grabs each numbered frame
//! (`pixels/screen/coded_grabs.rs`); which tick it shows is decided in `block/sequence.rs`. Requests are sent ahead as far as there is
//! room for their images, so that neither a slow encoder nor a slow screen loses any.
//!
//! Off the screen, moving the camera costs frames of settling, so the camera rests at one view while every drawn frame shows the next tick.

mod aircraft_place;
mod numbers;
mod pictures;
mod probe;
mod requests;
mod sequence;
mod settling;
mod shadow;
mod trial;

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{FlightState, Pose};
use dataset::numbers::frame_rate::FrameRate;
use futures_util::future::BoxFuture;
use tokio::time::timeout;

use super::{FRAME_TIMEOUT, SWITCH_TIMEOUT, Simulator, wrong};
use crate::error::BridgeError;
use crate::link::{
    Answer, CaptureRequest, CapturedFrame, Deliver, FrameHeader, PictureBytes, PooledPicture,
    Request,
};
use crate::pixels::still_scene::{CoverWatch, Covered, WorldTime};
use crate::pixels::{CodedPicture, PixelError, Rectangle};
use crate::profile::Profile;
use aircraft_place::{aircraft_place, displaced};
use pictures::Taken;
pub(super) use probe::changed_pixels;
use requests::Show;
use sequence::{Known, Scene, Sequence};
use shadow::shadow_place;
pub(super) use trial::Lagging;
pub use trial::{BlockTrial, KnownBlocks};

/// Memory for the images between two probes, bytes.
const SEGMENT_BYTES: usize = 160 << 20;
/// Ticks between two probes: at least and at most.
const SEGMENT_TICKS: (usize, usize) = (12, 100);
/// Buffers beyond the ones of segments: for images under way and grabbed.
const MORE_BUFFERS: usize = 16;
/// A screen without any readable code for this long is covered, or its window is gone.
const NO_CODE_TIMEOUT: Duration = FRAME_TIMEOUT;
/// Maximum frames by which a grab may lag behind.
const MAX_BEHIND: u64 = 8;
/// Maximum turns in a row without a request and without an expected or delivered image: more would never end.
const MAX_IDLE: u32 = 8;
/// What covers the images for longer is looked for with the check pattern: it may be the scene that moves.
const LONG_COVERED: Duration = Duration::from_secs(2);
/// Time for which a scene that moves in a pause is watched: longer than trees, flags and lights take to swing.
const WATCH_TIME: Duration = Duration::from_millis(3_200);
/// Minimum number of images in it: ten per second. With half as many, what swings in 3 s is missed by up to 2 % of its way at the ends.
const WATCHED_IMAGES: u32 = 32;
/// How often a scene is watched in the middle of a block, because it moves as it did not before.
const MAX_WATCHES: u32 = 2;
/// While time runs, clouds and rain differ from frame to frame: a scene has settled when its mean brightness changes less than this.
const SETTLED_LEVELS: f64 = 0.25;

/// A block's ticks and their camera.
#[derive(Debug, Clone, Copy)]
pub struct BlockOfTicks<'a> {
    /// The number of the first tick.
    pub first_tick: u32,
    /// The flight's states, one for each tick.
    pub states: &'a [FlightState],
    /// Rate of the ticks.
    pub frame_rate: FrameRate,
    /// Index of the rig's camera, counted from 0.
    pub view: u32,
    /// Pose of the resting camera.
    pub camera: CameraPose,
    /// Size of the images, pixels.
    pub size_px: (u32, u32),
}

impl BlockOfTicks<'_> {
    /// The request for a tick, by its place in the block.
    fn request(&self, at: u32, deliver: Deliver) -> CaptureRequest {
        let tick = self.first_tick + at;
        let FlightState { pose, controls, .. } = self.states[at as usize];
        CaptureRequest {
            tick,
            time_ns: self.frame_rate.time_of_tick(tick).0,
            view: self.view,
            pose,
            controls,
            camera: self.camera,
            width_px: self.size_px.0,
            height_px: self.size_px.1,
            deliver,
        }
    }
}

/// Report on a recorded block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockReport {
    /// Frames by which the scene was behind the code; `None` if every tick was held until it had settled.
    pub frames_behind: Option<u32>,
    /// True if a probe of this block measured that.
    pub is_measured: bool,
    /// Ticks that were shown again.
    pub repeated: u32,
    /// Ticks that were held until they had settled.
    pub held: u32,
}

/// A block that is being recorded: [`BlockRecording::next_picture`] returns its images in the order of the ticks.
pub struct BlockRecording<'a> {
    simulator: &'a mut Simulator,
    block: BlockOfTicks<'a>,
    sequence: Sequence<Grabbed>,
    covers: CoverWatch,
    /// True once the check pattern has shown that nothing covers the scene: in a pause the image that later ones are compared with, while
    /// time runs the last one.
    is_proven: bool,
    /// The cover because of which the block began again.
    covered: Covered,
    /// Ticks that were shown again before that.
    repeated: u32,
    /// The watch of the scene while it settles.
    watched: Option<Watched>,
    /// How often it was watched in the middle of the block.
    watches: u32,
    /// The last frame whose image was looked at, and found uncovered.
    last_look: Option<u64>,
    /// Requests without an answer.
    asked: VecDeque<CaptureRequest>,
    drawn: BTreeMap<u64, FrameHeader>,
}

/// Image memory while a block is recorded, bytes.
pub fn block_bytes(size_px: (u32, u32)) -> u64 {
    let picture_bytes = u64::from(size_px.0) * u64::from(size_px.1) * 3;
    picture_bytes * buffers(size_px) as u64
}

fn buffers(size_px: (u32, u32)) -> usize {
    let of_a_segment = pictures_at_once(size_px);
    pictures_waiting(size_px) + of_a_segment + of_a_segment / 2 + MORE_BUFFERS
}

/// Images for which the caller should have room: those that come at once, and as many from the block before. The simulator keeps drawing
/// while the caller waits, which slows down encoders on the same computer.
pub fn pictures_waiting(size_px: (u32, u32)) -> usize {
    2 * pictures_at_once(size_px)
}

/// Images that come at once, when a probe has proven them.
fn pictures_at_once((width_px, height_px): (u32, u32)) -> usize {
    let picture_bytes = width_px as usize * height_px as usize * 3;
    let (least, most) = SEGMENT_TICKS;
    (SEGMENT_BYTES / picture_bytes.max(1)).clamp(least, most)
}

impl Simulator {
    /// True if blocks can be recorded: the plugin numbers its frames, the window has margins for the numbers, and no trial has failed.
    pub fn can_record_blocks(&self) -> bool {
        let is_refused = self.known_blocks.is_refused();
        self.description.frame_codes && self.pixels.coded_window().is_some() && !is_refused
    }

    fn sequence(&self, block: &BlockOfTicks<'_>) -> Sequence<Grabbed> {
        let places: Vec<Option<Rectangle>> = (0..block.states.len())
            .map(|tick| displaced(&block.camera, block.size_px, block.states, tick))
            .map(|elsewhere| elsewhere.map(|displaced| displaced.place))
            .collect();
        let moves = self.known_blocks.scene_moves
            || (self.profile.current()).is_some_and(Profile::pictures_move);
        let (lag, is_measured) = self.known_blocks.lag(block.view);
        Sequence::new(
            block.states.len() as u32,
            pictures_at_once(block.size_px) as u32,
            self.frames_to_settle(),
            Known {
                lag,
                is_measured,
                numbers_repeat: self.known_blocks.numbers_repeat,
                scene_moves: moves && !self.time_runs(),
            },
            Box::new(move |tick| places.get(tick as usize).copied().flatten()),
        )
    }

    fn shadow_on_ground(
        &self,
        camera: &CameraPose,
        size_px: (u32, u32),
        pose: &Pose,
    ) -> Option<Rectangle> {
        let clock = &self.conditions.as_ref()?.clock;
        shadow_place(camera, size_px, pose, clock, self.ground_msl_m?)
    }

    /// True if time runs while images are taken, because rain falls only then: a block must be short.
    pub fn time_runs(&self) -> bool {
        self.running_at().is_some()
    }

    fn world_time(&self) -> WorldTime {
        if self.time_runs() {
            WorldTime::Runs
        } else {
            WorldTime::Paused
        }
    }

    /// Begins a block. The simulator is frozen, and [`Simulator::can_record_blocks`].
    ///
    /// # Errors
    /// The window has no margins.
    pub fn begin_block<'a>(
        &'a mut self,
        block: BlockOfTicks<'a>,
    ) -> Result<BlockRecording<'a>, BridgeError> {
        let window = self.pixels.coded_window().ok_or_else(|| {
            PixelError::Unusable(
                "the window has no margins around the images, in which the plugin could number its frames".into(),
            )
        })?;
        let most_pictures = buffers(block.size_px);
        self.grabs
            .begin(&window.screen, window.region, most_pictures);
        let time = self.world_time();
        let (width_px, height_px) = block.size_px;
        Ok(BlockRecording {
            sequence: self.sequence(&block),
            simulator: self,
            block,
            covers: CoverWatch::new(width_px, height_px, time),
            is_proven: false,
            covered: Covered::default(),
            repeated: 0,
            watched: None,
            watches: 0,
            last_look: None,
            asked: VecDeque::new(),
            drawn: BTreeMap::new(),
        })
    }
}

impl BlockRecording<'_> {
    /// No frame's number can be read.
    fn no_code(&self, waited: Duration) -> PixelError {
        let tick = self.block.first_tick + self.sequence.pictures.delivered;
        PixelError::NoBlocks(format!(
            "tick {tick}: no frame's number could be read off the screen for {waited:.0?}, although X-Plane's window can be seen: does \
             something cover its edge?"
        ))
    }

    /// The next image; `None` after the last one.
    ///
    /// # Errors
    /// The simulator rejects a request, its conditions have changed, the link is broken, or no code can be read off the screen.
    /// [`PixelError::NoBlocks`] leaves the simulator as it is: images can be settled instead, if its window is where it was
    /// ([`Simulator::confirm_pixels`]).
    pub fn next_picture(&mut self) -> BoxFuture<'_, Result<Option<CapturedFrame>, BridgeError>> {
        Box::pin(async move {
            let next = self.next_proven().await;
            if let Err(BridgeError::Pixels(PixelError::NoBlocks(_))) = next {
                self.take_answers().await?;
            }
            next
        })
    }

    fn next_proven(&mut self) -> BoxFuture<'_, Result<Option<CapturedFrame>, BridgeError>> {
        Box::pin(async move {
            let mut idle = 0;
            loop {
                if self.is_proof_due() {
                    self.take_answers().await?;
                    self.prove().await?;
                }
                if let Some(taken) = self.sequence.pictures.deliver() {
                    return self.captured(taken).map(Some);
                }
                if self.sequence.is_done() {
                    self.finish().await?;
                    return Ok(None);
                }
                if let Some(rectangle) = self.long_covered() {
                    self.look_under(rectangle).await?;
                }
                self.ask().await?;
                let expects_grabs = self.sequence.expects_grabs();
                self.simulator.grabs.rest(!expects_grabs);
                if !expects_grabs && !self.sequence.requests.is_unanswered() {
                    // A skipped probe has proven the images before it.
                    idle += 1;
                    if idle > MAX_IDLE {
                        let reason = "a block waits for no image, and has none";
                        return Err(PixelError::Unusable(reason.into()).into());
                    }
                    continue;
                }
                idle = 0;
                if self.sequence.requests.is_unanswered() {
                    self.take_answer().await?;
                    while let Some(grabbed) = self.simulator.grabs.next_now() {
                        self.see(grabbed?)?;
                    }
                } else {
                    let grabbed = self.next_grab().await?;
                    self.see(grabbed)?;
                }
                self.simulator.check_settings()?;
            }
        })
    }

    async fn next_grab(&mut self) -> Result<CodedPicture, PixelError> {
        let grabbed = timeout(NO_CODE_TIMEOUT, self.simulator.grabs.next()).await;
        grabbed.map_err(|_| self.no_code(NO_CODE_TIMEOUT))?
    }

    /// Report on the recording. Complete after the last image.
    pub fn report(&self) -> BlockReport {
        let tally = self.sequence.tally;
        let all_held = tally.held as usize >= self.block.states.len();
        BlockReport {
            frames_behind: (self.sequence.known.lag)
                .filter(|_| !all_held)
                .map(|lag| lag as u32),
            is_measured: tally.seen > 0,
            repeated: self.repeated + tally.repeated,
            held: tally.held,
        }
    }

    /// True if the check pattern has to be shown now.
    fn is_proof_due(&self) -> bool {
        let is_time = match self.simulator.world_time() {
            WorldTime::Paused => !self.sequence.is_settling(),
            // An image is compared with the one just before it, if that is recent: what came in between, or has been there all the time, is
            // found only now.
            WorldTime::Runs => self.sequence.is_complete(),
        };
        is_time && !self.is_proven
    }

    /// Looks for a cover. In a pause the block then begins again, since it has no images yet.
    async fn prove(&mut self) -> Result<(), BridgeError> {
        self.simulator.grabs.rest(true);
        match self.simulator.wait_until_uncovered().await? {
            None => {
                self.is_proven = true;
                Ok(self.forget_grabs()?)
            }
            Some(rectangle) if self.simulator.world_time() == WorldTime::Runs => {
                Err(PixelError::CoveredBefore { rectangle }.into())
            }
            Some(_) => Ok(self.begin_again()?),
        }
    }

    /// A cover that has lasted [`LONG_COVERED`]; where time runs, only before any image was delivered.
    fn long_covered(&self) -> Option<Rectangle> {
        let covered = self.covers.covered_for(LONG_COVERED, Instant::now());
        let is_paused = self.simulator.world_time() == WorldTime::Paused;
        covered.filter(|_| is_paused || self.sequence.pictures.delivered == 0)
    }

    /// Decides whether something covers the scene, which is waited for, or the scene moves, which is watched.
    async fn look_under(&mut self, rectangle: Rectangle) -> Result<(), BridgeError> {
        self.take_answers().await?;
        self.simulator.grabs.rest(true);
        let cover = self.simulator.wait_until_uncovered().await?;
        if self.simulator.world_time() == WorldTime::Runs {
            self.covered.note(rectangle, Instant::now())?;
            return Ok(self.begin_again()?);
        }
        if cover.is_some() {
            self.covers.uncovered();
            return Ok(self.forget_grabs()?);
        }
        self.watches += 1;
        if self.watches > MAX_WATCHES {
            return Err(PixelError::NoBlocks(format!(
                "{rectangle} of the scene changes by itself in a pause, otherwise than it did in the {WATCH_TIME:.1?} for which it was watched"
            ))
            .into());
        }
        self.watch_scene().await
    }

    /// Watches how the scene moves while the last tick stays on the screen, and proves that nothing covered it.
    async fn watch_scene(&mut self) -> Result<(), BridgeError> {
        loop {
            self.forget_grabs()?;
            self.covers.forget();
            self.simulator.grabs.rest(false);
            let mut watched = Watched::begin();
            while !watched.is_long() {
                let CodedPicture { code, rgb } = self.next_grab().await?;
                // A cover was seen, so frames are known.
                let Some(near) = self.drawn.keys().next_back() else {
                    return Err(self.no_code(WATCH_TIME).into());
                };
                let number = code.number_near(*near);
                watched.see(number);
                if let Some(rgb) = rgb {
                    self.covers.watch(number, &rgb, &self.moving(number));
                }
            }
            self.check_motion()?;
            self.simulator.grabs.rest(true);
            if self.simulator.wait_until_uncovered().await?.is_none() {
                return Ok(self.forget_grabs()?);
            }
        }
    }

    /// The scene was watched in a pause, because it did not come to rest.
    fn check_motion(&mut self) -> Result<(), PixelError> {
        if self.covers.moves() && !self.simulator.known_blocks.scene_moves {
            self.simulator.known_blocks.scene_moves = true;
            tracing::info!(
                "the scene moves by itself in a pause (water, trees, flags, lights): each view is watched for {WATCH_TIME:.1?} first"
            );
        }
        if self.covers.moves_too_much() {
            return Err(PixelError::NoBlocks(
                "so much of the scene moves by itself in a pause that nothing that covers it could be found".into(),
            ));
        }
        Ok(())
    }

    /// Begins as if no image had been seen yet. No request is unanswered.
    fn begin_again(&mut self) -> Result<(), PixelError> {
        let (width_px, height_px) = self.block.size_px;
        self.repeated += self.sequence.tally.repeated;
        self.sequence = self.simulator.sequence(&self.block);
        self.covers = CoverWatch::new(width_px, height_px, self.simulator.world_time());
        self.watched = None;
        self.is_proven = false;
        self.forget_grabs()
    }

    /// Forgets the grabs from before a check pattern.
    fn forget_grabs(&mut self) -> Result<(), PixelError> {
        while let Some(grabbed) = self.simulator.grabs.next_now() {
            grabbed?;
        }
        Ok(())
    }

    /// Sends what may be sent.
    async fn ask(&mut self) -> Result<(), BridgeError> {
        while let Some(show) = self.sequence.next_show() {
            let request = self.request(show);
            self.simulator
                .link
                .send("a capture", &Request::Capture(request), SWITCH_TIMEOUT)
                .await?;
            self.asked.push_back(request);
        }
        Ok(())
    }

    fn request(&self, show: Show) -> CaptureRequest {
        let block = &self.block;
        match show {
            Show::Tick(at) => block.request(at, Deliver::Coded),
            Show::Probe(at) => {
                let request = block.request(at, Deliver::Probe);
                let elsewhere = displaced(&block.camera, block.size_px, block.states, at as usize);
                let pose = elsewhere.map_or(request.pose, |displaced| displaced.pose);
                CaptureRequest { pose, ..request }
            }
        }
    }

    async fn take_answer(&mut self) -> Result<(), BridgeError> {
        let answer = self
            .simulator
            .link
            .receive("a frame", FRAME_TIMEOUT)
            .await?;
        let Answer::Frame(header) = answer else {
            return Err(wrong("frame", &answer));
        };
        let asked = self.asked.pop_front();
        let asked = asked.map(|asked| (asked.tick, asked.view, asked.width_px, asked.height_px));
        let found = (header.tick, header.view, header.width_px, header.height_px);
        let last = self.drawn.keys().next_back().copied();
        if asked != Some(found) || last.is_some_and(|last| header.sim_frame <= last) {
            self.simulator.link.close();
            return Err(BridgeError::wrong_answer(
                format_args!("a frame after {last:?} of (tick, view, width, height) {asked:?}"),
                format_args!("frame {} of {found:?}", header.sim_frame),
            ));
        }
        self.drawn.insert(header.sim_frame, header);
        self.sequence.answered(header.sim_frame);
        Ok(())
    }

    fn see(&mut self, grabbed: CodedPicture) -> Result<(), BridgeError> {
        let CodedPicture { code, rgb } = grabbed;
        let near = self.drawn.keys().next_back().copied();
        // Left over from an earlier block.
        let Some(near) = near.filter(|_| code.view == self.block.view % 16) else {
            return Ok(());
        };
        let number = code.number_near(near);
        let is_later = self.last_look.is_none_or(|last| number > last);
        if let (Some(rgb), true) = (&rgb, is_later) {
            if let Some(from_frame) = self.covered_from(number, rgb)? {
                // Another grab of this frame is looked at as well: the cover may still be there.
                return self.take_again(from_frame);
            }
            self.last_look = Some(number);
        }
        let picture = rgb.map(|rgb| Grabbed {
            rgb,
            width_px: self.block.size_px.0,
            time_runs: self.simulator.time_runs(),
        });
        self.let_settle(number);
        let was_settling = self.sequence.is_settling();
        self.sequence.seen(number, code.steady, picture);
        if was_settling && !self.sequence.is_settling() {
            self.has_settled()?;
        }
        if self.sequence.numbers.are_hopeless() {
            return Err(PixelError::NoBlocks(
                "hardly any frame's number is followed by the next one: they are repeated, missing or drawn too fast to be seen".into(),
            )
            .into());
        }
        Ok(())
    }

    /// Notes for how long the scene is watched while it settles.
    fn let_settle(&mut self, number: u64) {
        if self.sequence.is_settling() && self.sequence.has_had_its_time(number) {
            let watched = self.watched.get_or_insert_with(Watched::begin);
            watched.see(number);
            self.sequence.settling.has_watched = watched.is_long();
        }
    }

    /// The scene has come to rest, or it moves by itself and was watched.
    fn has_settled(&mut self) -> Result<(), PixelError> {
        if self.sequence.settling.came_to_rest {
            self.covers.keep_latest();
            Ok(())
        } else if self.simulator.world_time() == WorldTime::Paused {
            self.check_motion()
        } else {
            Ok(())
        }
    }

    /// First covered frame, if the grab shows a cover. While the scene settles, it is watched.
    fn covered_from(&mut self, number: u64, rgb: &[u8]) -> Result<Option<u64>, PixelError> {
        let moving = self.moving(number);
        if self.sequence.is_settling() {
            if !self.sequence.has_had_its_time(number) {
                self.covers.forget();
            }
            self.covers.watch(number, rgb, &moving);
            return Ok(None);
        }
        self.covers.look(number, rgb, &moving, Instant::now())
    }

    fn take_again(&mut self, from_frame: u64) -> Result<(), BridgeError> {
        if self.sequence.take_again(from_frame) {
            return Ok(());
        }
        let rectangle = self.covers.covered_for(Duration::ZERO, Instant::now());
        let (width_px, height_px) = self.block.size_px;
        let rectangle = rectangle.unwrap_or(Rectangle::between(0, 0, width_px, height_px));
        Err(PixelError::CoveredBefore { rectangle }.into())
    }

    /// Rectangles in which the aircraft and its shadow may be in a frame's grab.
    fn moving(&self, number: u64) -> Vec<Rectangle> {
        let BlockOfTicks {
            camera, size_px, ..
        } = self.block;
        let oldest = number.saturating_sub(MAX_BEHIND);
        let before = self.drawn.range(..oldest).next_back();
        let drawn = before.into_iter().chain(self.drawn.range(oldest..));
        // Their answers may be due.
        let asked = self.asked.iter().map(|asked| asked.pose);
        drawn
            .map(|(_, header)| header.pose)
            .chain(asked)
            .flat_map(|pose| {
                let shadow = self.simulator.shadow_on_ground(&camera, size_px, &pose);
                [aircraft_place(&camera, size_px, &pose), shadow]
            })
            .flatten()
            .collect()
    }

    fn captured(&mut self, taken: Taken<Grabbed>) -> Result<CapturedFrame, BridgeError> {
        let header = self.drawn.get(&taken.frame).copied();
        let header = header.ok_or_else(|| {
            let expected = format_args!("the answer for frame {}", taken.frame);
            BridgeError::wrong_answer(expected, "none")
        })?;
        // Earlier frames are not looked up again, except for ticks that are under way.
        while self.drawn.len() > 4 * SEGMENT_TICKS.1 {
            self.drawn.pop_first();
        }
        Ok(CapturedFrame {
            header,
            rgb: PictureBytes::Pooled(taken.picture.rgb),
        })
    }

    async fn take_answers(&mut self) -> Result<(), BridgeError> {
        while !self.asked.is_empty() {
            self.take_answer().await?;
        }
        Ok(())
    }

    async fn finish(&mut self) -> Result<(), BridgeError> {
        self.take_answers().await?;
        let is_measured = self.sequence.tally.seen > 0;
        let known = &mut self.simulator.known_blocks;
        known.note(self.block.view, self.sequence.known.lag, is_measured);
        if self.sequence.numbers.are_late() && !known.numbers_repeat {
            known.numbers_repeat = true;
            tracing::info!(
                "numbers of frames are repeated or missing: every tick is shown in two frames"
            );
        }
        Ok(())
    }
}

impl Drop for BlockRecording<'_> {
    /// Closes the link if answers are outstanding: they would be mistaken for the answers to the next requests.
    fn drop(&mut self) {
        self.simulator.grabs.rest(true);
        if !self.asked.is_empty() {
            self.simulator.link.close();
        }
    }
}

/// Begin and images of a watch.
#[derive(Debug)]
struct Watched {
    since: Instant,
    images: u32,
    last: Option<u64>,
}

impl Watched {
    fn begin() -> Self {
        Self {
            since: Instant::now(),
            images: 0,
            last: None,
        }
    }

    /// A grab of this frame. A frame that is grabbed twice is one image.
    fn see(&mut self, frame: u64) {
        self.images += u32::from(self.last.replace(frame) != Some(frame));
    }

    /// True if that is enough to know how the scene moves, also on a busy computer, which sees few of its images.
    fn is_long(&self) -> bool {
        self.since.elapsed() >= WATCH_TIME && self.images >= WATCHED_IMAGES
    }
}

/// An image off the screen.
#[derive(Debug)]
struct Grabbed {
    rgb: PooledPicture,
    width_px: u32,
    time_runs: bool,
}

impl PartialEq for Grabbed {
    fn eq(&self, other: &Self) -> bool {
        *self.rgb == *other.rgb
    }
}

impl Scene for Grabbed {
    fn part(&self, area: Rectangle) -> Vec<u8> {
        let rows = area.rows(self.width_px).filter_map(|row| self.rgb.get(row));
        rows.flatten().copied().collect()
    }

    fn is_settled_after(&self, before: &Self) -> bool {
        if !self.time_runs {
            return self == before;
        }
        let mean = |rgb: &[u8]| {
            let sum: u64 = rgb.iter().map(|level| u64::from(*level)).sum();
            sum as f64 / rgb.len().max(1) as f64
        };
        (mean(&self.rgb) - mean(&before.rgb)).abs() < SETTLED_LEVELS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_that_is_grabbed_twice_is_one_image_of_a_watched_scene() {
        let mut watched = Watched {
            since: Instant::now().checked_sub(WATCH_TIME).unwrap(),
            ..Watched::begin()
        };
        for frame in 1..u64::from(WATCHED_IMAGES) {
            watched.see(frame);
            watched.see(frame);
        }
        assert!(!watched.is_long());
        watched.see(0);
        assert!(watched.is_long());
    }
}
