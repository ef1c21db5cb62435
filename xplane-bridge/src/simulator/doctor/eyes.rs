//! Images for measurements: the aircraft where lockstep shows it, the camera beside it, a given number of frames after the last change.

use std::time::Duration;

use dataset::conditions::Clock;
use dataset::geometry::pose::Controls;
use tokio::time::sleep;

use super::lockstep::{self, difference};
use super::talk::PlaceOnGround;
use super::window::picture_size;
use crate::Simulator;
use crate::error::BridgeError;
use crate::link::{CaptureRequest, CapturedFrame, Deliver, PictureSize, PixelKind};

/// Maximum mean difference between images of the same shot, of 255, in addition to the scene's own motion: film grain and temporal
/// smoothing.
pub(super) const SAME: f64 = 1.0;
/// Frames after which everything has settled.
pub(super) const SETTLED: u32 = 60;

/// The sun is up at noon on every day, but near the poles.
const ANY_DAY: u32 = 172;

/// Delays before a static scene is checked again.
const LATER: [Duration; 4] = [
    Duration::from_millis(350),
    Duration::from_millis(650),
    Duration::from_millis(900),
    Duration::from_millis(1_300),
];

/// Time of the sun's highest position, seconds since midnight UTC.
pub(super) fn noon_zulu_s(longitude_deg: f64) -> f64 {
    (12.0 - longitude_deg / 15.0).rem_euclid(24.0) * 3_600.0
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shot {
    /// Distance that the aircraft is moved to the east, metres.
    pub(super) moved_m: f64,
    /// Angle that the camera is turned to the right, degrees.
    pub(super) turned_deg: f64,
    /// Angle that the camera is turned upwards, degrees.
    pub(super) up_deg: f64,
    /// Flaps and gear.
    pub(super) controls: Controls,
}

impl Shot {
    /// The aircraft from behind.
    pub(super) const BEHIND: Self = Self {
        moved_m: 0.0,
        turned_deg: 0.0,
        up_deg: 0.0,
        controls: Controls {
            flap_ratio: 0.0,
            gear_ratio: 0.0,
        },
    };
    /// The shot with the aircraft moved.
    pub(super) const MOVED: Self = Self {
        moved_m: lockstep::MOVED_M,
        ..Self::BEHIND
    };
    /// A shot in the opposite direction, into the sky, with different light.
    pub(super) const AWAY: Self = Self {
        turned_deg: 180.0,
        up_deg: 40.0,
        ..Self::BEHIND
    };
}

/// Source of the images for the measurements.
pub(super) struct Eyes<'a> {
    pub(super) simulator: &'a mut Simulator,
    place: PlaceOnGround,
    tick: u32,
}

impl<'a> Eyes<'a> {
    /// Looks at the aircraft's place.
    pub(super) fn at(simulator: &'a mut Simulator, place: PlaceOnGround) -> Self {
        Self {
            simulator,
            place,
            tick: 0,
        }
    }

    /// The reason why no image can be seen, if so.
    pub(super) fn blind(&self) -> Option<String> {
        (!sees(self.simulator)).then(|| {
            "images cannot be seen from here: run the doctor on X-Plane's own computer, in its desktop session".into()
        })
    }

    /// Size of the images: the window's, without the margins for the numbers of frames.
    pub(super) fn size(&self) -> PictureSize {
        let window = picture_size(self.simulator.description()).unwrap_or(lockstep::ANY_SIZE);
        let [x_px, y_px] = self.simulator.margins_px().unwrap_or_default();
        PictureSize {
            width_px: window.width_px - 2 * x_px,
            height_px: window.height_px - 2 * y_px,
        }
    }

    /// Holds a shot in a pause, or while time runs at noon.
    pub(super) async fn hold(
        &mut self,
        settle_frames: u32,
        is_paused: bool,
    ) -> Result<(), BridgeError> {
        let noon = Clock {
            day_of_year: ANY_DAY,
            zulu_time_s: noon_zulu_s(self.place.longitude_deg),
        };
        let running_at = (!is_paused).then_some(noon);
        self.hold_at(settle_frames, running_at).await
    }

    /// Holds a shot in a pause, or while this clock runs.
    pub(super) async fn hold_at(
        &mut self,
        settle_frames: u32,
        running_at: Option<Clock>,
    ) -> Result<(), BridgeError> {
        let runway = lockstep::runway(&self.place);
        self.simulator
            .freeze_raw(&runway, settle_frames, &[], running_at)
            .await
    }

    /// The request for a shot.
    pub(super) fn request(&self, tick: u32, shot: Shot) -> CaptureRequest {
        // If images come off a screen that cannot be seen from here, everything but their content can be examined.
        let deliver = if sees(self.simulator) {
            self.simulator.deliver()
        } else {
            Deliver::Drawn
        };
        let mut request = lockstep::request(&self.place, tick, shot.moved_m, self.size(), deliver);
        let camera = &mut request.camera.pose;
        camera.heading_true_deg = (camera.heading_true_deg + shot.turned_deg) % 360.0;
        camera.pitch_deg += shot.up_deg;
        request.controls = shot.controls;
        request
    }

    /// Takes images one after the other, without a pause in between.
    pub(super) async fn take<const N: usize>(
        &mut self,
        shots: [Shot; N],
    ) -> Result<[CapturedFrame; N], BridgeError> {
        let ahead = self.simulator.most_outstanding();
        let mut frames = Vec::with_capacity(N);
        let mut asked = 0;
        while frames.len() < N {
            while asked < N && asked - frames.len() < ahead {
                let request = self.request(self.tick, shots[asked]);
                self.tick += 1;
                self.simulator.send_capture(&request).await?;
                asked += 1;
            }
            frames.push(self.simulator.receive_frame().await?);
        }
        frames.try_into().map_err(|frames: Vec<_>| {
            BridgeError::wrong_answer(format_args!("{N} images"), frames.len())
        })
    }

    /// Difference of a shot's first settled image from more within three seconds, since waves may repeat, and flags and trees swing slowly.
    pub(super) async fn noise(&mut self, shot: Shot) -> Result<f64, BridgeError> {
        self.hold(SETTLED, true).await?;
        let [first] = self.take([shot]).await?;
        let mut most: f64 = 0.0;
        for pause in LATER {
            sleep(pause).await;
            let [later] = self.take([shot]).await?;
            most = most.max(difference(&first.rgb, &later.rgb));
        }
        Ok(most)
    }
}

/// True if images can be seen from here: off the screen only once the window was found there.
fn sees(simulator: &Simulator) -> bool {
    let offered = simulator.description().pixels.first();
    let comes_by_link = matches!(offered, Some(PixelKind::Link | PixelKind::Gl));
    comes_by_link || simulator.deliver() != Deliver::Picture
}
