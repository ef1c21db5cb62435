//! Images of a block of ticks from a resting camera, one tick per drawn frame.
//!
//! The plugin writes the next tick in each camera callback, and numbers the frames that it draws. A thread grabs each numbered frame
//! (`pixels/screen/coded_grabs.rs`); which tick it shows is decided in `block/sequence.rs`. Requests are sent ahead as far as there is
//! room for their images, so that neither a slow encoder nor a slow screen loses any.
//!
//! Off the screen, moving the camera costs frames of settling, so the camera rests at one view while every drawn frame shows the next tick.

mod aircraft_place;
mod probe;
mod sequence;
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
use crate::pixels::still_scene::{CoverWatch, Covered, Verdict, WorldTime};
use crate::pixels::{CodedPicture, PixelError, Rectangle};
use aircraft_place::{aircraft_place, displaced};
use sequence::{Scene, Sequence, Show, Taken};
use shadow::shadow_place;
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
/// If the first images have been covered for longer, their reference image may show something that has gone since.
const LONG_COVERED: Duration = Duration::from_secs(3);
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
        let is_refused = matches!(self.known_blocks.trial, Some(BlockTrial::Different { .. }));
        self.description.frame_codes && self.pixels.coded_window().is_some() && !is_refused
    }

    fn sequence(&self, block: &BlockOfTicks<'_>) -> Sequence<Grabbed> {
        let places: Vec<Option<Rectangle>> = (0..block.states.len())
            .map(|tick| displaced(&block.camera, block.size_px, block.states, tick))
            .map(|elsewhere| elsewhere.map(|displaced| displaced.place))
            .collect();
        let (known_lag, is_measured) = self.known_blocks.lag(block.view);
        let mut sequence = Sequence::new(
            block.states.len() as u32,
            pictures_at_once(block.size_px) as u32,
            self.frames_to_settle(),
            known_lag,
            Box::new(move |tick| places.get(tick as usize).copied().flatten()),
        );
        if is_measured {
            sequence.begin_with_known_lag();
        }
        sequence
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
            asked: VecDeque::new(),
            drawn: BTreeMap::new(),
        })
    }
}

impl BlockRecording<'_> {
    /// No frame's number can be read.
    fn no_code(&self, waited: Duration) -> PixelError {
        let tick = self.block.first_tick + self.sequence.waits_for_tick();
        PixelError::Unusable(format!(
            "tick {tick}: no frame's number could be read off the screen for {waited:.0?}. Does something cover the edge of X-Plane's \
             window, or was it moved, resized or minimised?"
        ))
    }

    /// The next image; `None` after the last one.
    ///
    /// # Errors
    /// The simulator rejects a request, its conditions have changed, the link is broken, or no code can be read off the screen.
    pub fn next_picture(&mut self) -> BoxFuture<'_, Result<Option<CapturedFrame>, BridgeError>> {
        Box::pin(async move {
            let mut idle = 0;
            loop {
                if self.is_proof_due() {
                    self.take_answers().await?;
                    self.prove().await?;
                }
                if let Some(taken) = self.sequence.deliver() {
                    return self.captured(taken).map(Some);
                }
                drop(self.sequence.spent());
                if self.sequence.is_done() {
                    self.finish().await?;
                    return Ok(None);
                }
                if let Some(rectangle) = self.long_covered() {
                    self.covered.note(rectangle, Instant::now())?;
                    self.take_answers().await?;
                    self.simulator.grabs.rest(true);
                    self.simulator.wait_until_uncovered().await?;
                    self.begin_again()?;
                }
                self.ask().await?;
                let expects_grabs = self.sequence.expects_grabs();
                self.simulator.grabs.rest(!expects_grabs);
                if !expects_grabs && !self.sequence.waits_for_answer() {
                    // A skipped probe has proven the images before it.
                    idle += 1;
                    if idle > MAX_IDLE {
                        return Err(self.no_code(Duration::ZERO).into());
                    }
                    continue;
                }
                idle = 0;
                if self.sequence.waits_for_answer() {
                    self.take_answer().await?;
                    while let Some(grabbed) = self.simulator.grabs.next_now() {
                        self.see(grabbed?)?;
                    }
                } else {
                    let grabbed = timeout(NO_CODE_TIMEOUT, self.simulator.grabs.next()).await;
                    self.see(grabbed.map_err(|_| self.no_code(NO_CODE_TIMEOUT))??)?;
                }
                self.simulator.check_settings()?;
            }
        })
    }

    /// Report on the recording. Complete after the last image.
    pub fn report(&self) -> BlockReport {
        let tally = self.sequence.tally();
        let all_held = tally.held as usize >= self.block.states.len();
        BlockReport {
            frames_behind: self
                .sequence
                .lag()
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

    /// A cover that has lasted [`LONG_COVERED`] before any image was delivered.
    fn long_covered(&self) -> Option<Rectangle> {
        let covered = self.covers.covered_for(LONG_COVERED, Instant::now());
        covered.filter(|_| self.sequence.waits_for_tick() == 0)
    }

    /// Begins as if no image had been seen yet. No request is unanswered.
    fn begin_again(&mut self) -> Result<(), PixelError> {
        let (width_px, height_px) = self.block.size_px;
        self.repeated += self.sequence.tally().repeated;
        self.sequence = self.simulator.sequence(&self.block);
        self.covers = CoverWatch::new(width_px, height_px, self.simulator.world_time());
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
        let BlockOfTicks {
            first_tick,
            states,
            frame_rate,
            view,
            camera,
            size_px,
        } = self.block;
        let (Show::Tick(at) | Show::Probe(at)) = show;
        let state = &states[at as usize];
        let elsewhere = || displaced(&camera, size_px, states, at as usize);
        let (pose, deliver) = match show {
            Show::Tick(_) => (state.pose, Deliver::Coded),
            Show::Probe(_) => (
                elsewhere().map_or(state.pose, |displaced| displaced.pose),
                Deliver::Probe,
            ),
        };
        CaptureRequest {
            tick: first_tick + at,
            time_ns: frame_rate.time_of_tick(first_tick + at).0,
            view,
            pose,
            controls: state.controls,
            camera,
            width_px: size_px.0,
            height_px: size_px.1,
            deliver,
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
        match near {
            // Left over from an earlier block.
            _ if code.view != self.block.view % 16 => {}
            None => {}
            Some(near) => {
                let number = code.number_near(near);
                if let Some(from_frame) = self.covered_from(number, &rgb)? {
                    return self.take_again(from_frame);
                }
                let picture = Grabbed {
                    rgb,
                    width_px: self.block.size_px.0,
                    time_runs: self.simulator.time_runs(),
                };
                self.sequence.grabbed(number, code.steady, picture);
            }
        }
        Ok(())
    }

    /// First covered frame, if the grab shows a cover. While the scene settles, each grab becomes the reference for later ones.
    fn covered_from(&mut self, number: u64, rgb: &[u8]) -> Result<Option<u64>, PixelError> {
        let moving = self.moving(number);
        if self.sequence.is_settling() {
            self.covers.begin_with(number, rgb, &moving);
            return Ok(None);
        }
        match self.covers.look(number, rgb, &moving, Instant::now())? {
            Verdict::Clear => Ok(None),
            Verdict::Covered { from_frame } => Ok(Some(from_frame)),
        }
    }

    fn take_again(&mut self, from_frame: u64) -> Result<(), BridgeError> {
        if self.sequence.take_again(from_frame) {
            return Ok(());
        }
        let rectangle = self.covers.covered_for(Duration::ZERO, Instant::now());
        let rectangle = rectangle.unwrap_or(Rectangle {
            x_px: 0,
            y_px: 0,
            width_px: self.block.size_px.0,
            height_px: self.block.size_px.1,
        });
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
        let is_measured = self.sequence.tally().seen > 0;
        let known = &mut self.simulator.known_blocks;
        known.note(self.block.view, self.sequence.lag(), is_measured);
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

/// An image off the screen.
#[derive(Debug)]
struct Grabbed {
    rgb: PooledPicture,
    width_px: u32,
    time_runs: bool,
}

impl Scene for Grabbed {
    fn part(&self, area: Rectangle) -> Vec<u8> {
        let mut part = Vec::with_capacity((area.width_px * area.height_px * 3) as usize);
        for y in area.y_px..area.bottom_px() {
            let row = (y * self.width_px) as usize * 3;
            let (from, to) = (area.x_px as usize * 3, area.right_px() as usize * 3);
            part.extend_from_slice(self.rgb.get(row + from..row + to).unwrap_or_default());
        }
        part
    }

    fn is_settled_after(&self, before: &Self) -> bool {
        if !self.time_runs {
            return *self.rgb == *before.rgb;
        }
        let mean = |rgb: &[u8]| {
            let sum: u64 = rgb.iter().map(|level| u64::from(*level)).sum();
            sum as f64 / rgb.len().max(1) as f64
        };
        (mean(&self.rgb) - mean(&before.rgb)).abs() < SETTLED_LEVELS
    }
}
