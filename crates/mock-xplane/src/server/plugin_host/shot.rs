//! Frame content: subject, camera, and everything else in the image.

use airframe::AircraftType;
use dataset::geometry::camera::CameraPose;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::{Controls, Pose};
use glam::DVec3;

use super::window_covers::{ShownWindow, WindowForm};
use crate::render::overlay::Canvas;
use crate::server::Swing;
use crate::server::engine::{Instants, OtherAircraft, SceneRenderer};

/// Position of the other aircraft, metres forward, right and down of the user's.
const BESIDE_M: DVec3 = DVec3::new(-20.0, 55.0, 5.0);

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shot {
    pub(super) camera: CameraPose,
    pub(super) pose: Pose,
    pub(super) controls: Controls,
    /// True if a cockpit's panel is in front.
    pub(super) panel: bool,
    /// The instant of clouds and rain, seconds; zero where they stand still.
    pub(super) weather_time_s: f64,
}

impl Shot {
    /// True if camera or aircraft are elsewhere.
    pub(super) fn moved(&self, other: &Self) -> bool {
        (self.camera, self.pose, self.controls) != (other.camera, other.pose, other.controls)
    }
}

/// The windows of the user interface over a scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Windows {
    /// True if a pop-up lies over it.
    pub(super) pop_up: bool,
    /// True if X-Plane's error about a deprecated dataref lies over it.
    pub(super) alert: bool,
    /// Other windows over it.
    pub(super) shown: Vec<ShownWindow>,
}

impl Windows {
    pub(super) fn draw(&self, canvas: &mut Canvas<'_>) {
        if self.pop_up {
            canvas.draw_pop_up();
        }
        if self.alert {
            canvas.draw_alert();
        }
        for ShownWindow { form, area_px } in &self.shown {
            match form {
                WindowForm::Message => canvas.draw_message(*area_px),
                WindowForm::Plugin => canvas.draw_plugin_window(*area_px),
            }
        }
    }
}

/// Image content besides the scene and the aircraft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Painter {
    /// Size of the aircraft relative to the airliner.
    pub(super) scale: f64,
    /// Type of a second aircraft that flies beside it, if one does.
    pub(super) other: Option<&'static AircraftType>,
    /// True if a cockpit's panel is in front.
    pub(super) panel: bool,
    /// Brightness factor: 1 when the exposure has settled.
    pub(super) gain: f64,
    /// Things that swing, with a seed, at a time in seconds.
    pub(super) swing: Option<(Swing, u64, f64)>,
    /// Position of the waves, if water moves.
    pub(super) wave: Option<u64>,
}

impl Painter {
    pub(super) fn draw(
        &self,
        picture: &dyn SceneRenderer,
        shot: &Shot,
        (width_px, height_px): (u32, u32),
        rgb: &mut [u8],
    ) {
        // Lamps never flash here, so that images of the same tick can be compared.
        let instants = Instants {
            lamps_s: 0.0,
            weather_s: shot.weather_time_s,
        };
        let first = (&self.scaled(shot.pose, shot), &shot.controls);
        let beside = self.other.map(|aircraft| OtherAircraft {
            aircraft,
            pose: moved(shot.pose, BESIDE_M),
            controls: shot.controls,
        });
        picture.draw(first, beside.as_slice(), instants, rgb);
        if let Some(wave) = self.wave {
            ripple(rgb, width_px as usize, wave);
        }
        if self.gain != 1.0 {
            for value in rgb.iter_mut() {
                *value = (f64::from(*value) * self.gain).min(255.0) as u8;
            }
        }
        let mut canvas = Canvas {
            rgb,
            width_px: width_px as usize,
            height_px: height_px as usize,
        };
        if let Some((swing, seed, time_s)) = self.swing {
            swing.draw(&mut canvas, time_s, seed);
        }
        if self.panel {
            canvas.draw_panel();
        }
    }

    /// A smaller aircraft looks like one that is farther away.
    fn scaled(&self, pose: Pose, shot: &Shot) -> Pose {
        if self.scale == 1.0 {
            return pose;
        }
        let eye = shot.camera.pose.position().to_ecef();
        let away = (pose.position().to_ecef() - eye) / self.scale;
        pose.moved_to(Geodetic::from_ecef(eye + away))
    }
}

/// Moves the lowest quarter of the image, as water in the foreground does.
fn ripple(rgb: &mut [u8], width_px: usize, wave: u64) {
    let from = rgb.len() / (3 * width_px) * 3 / 4;
    for (row, pixels) in rgb.chunks_exact_mut(3 * width_px).enumerate().skip(from) {
        let up = (row as u64 * 31 + wave * 17) % 61;
        for value in pixels {
            *value = value.saturating_add(up as u8 / 3);
        }
    }
}

/// An exposure that follows the light with delay.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exposure {
    /// Last heading and pitch of the camera.
    looks: Option<(f64, f64)>,
    frames: u32,
}

impl Exposure {
    /// Frames until the old light has faded completely.
    const SETTLED: u32 = 30;
    /// Minimum turn of a camera that changes the exposure, degrees.
    const TURNED_DEG: f64 = 1.0;

    /// Settled.
    pub(super) const NEW: Self = Self {
        looks: None,
        frames: Self::SETTLED,
    };

    /// A frame with the camera like this ends.
    pub(super) fn record(&mut self, camera: &CameraPose) {
        self.frames = self.frames.saturating_add(1);
        let now = (camera.pose.heading_true_deg, camera.pose.pitch_deg);
        let turned = self.looks.replace(now).is_some_and(|before| {
            (now.0 - before.0).abs().max((now.1 - before.1).abs()) > Self::TURNED_DEG
        });
        if turned {
            self.frames = 0;
        }
    }

    /// Brightness factor of the next frame.
    pub(super) fn gain(self) -> f64 {
        match self.frames {
            Self::SETTLED.. => 1.0,
            frames => 1.0 + 0.5 * 0.87_f64.powi(frames as i32),
        }
    }
}

/// Moved along its own axes, forward, right and down.
fn moved(pose: Pose, by_m: DVec3) -> Pose {
    pose.moved_to(Geodetic::from_ecef(pose.body_point_to_ecef(by_m)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::world::airport::{ON_THRESHOLD, on_final};

    fn shot(distance_nm: f64) -> Shot {
        Shot {
            camera: CameraPose {
                pose: ON_THRESHOLD,
                hfov_deg: 10.0,
            },
            pose: on_final(distance_nm),
            controls: Controls::default(),
            panel: false,
            weather_time_s: 0.0,
        }
    }

    #[test]
    fn an_exposure_settles_within_thirty_frames_after_the_camera_turned() {
        let mut exposure = Exposure::NEW;
        let mut camera = shot(9.0).camera;
        exposure.record(&camera);
        assert_eq!(exposure.gain(), 1.0);
        camera.pose.pitch_deg += 40.0;
        exposure.record(&camera);
        let mut gains = vec![exposure.gain()];
        for _ in 0..30 {
            exposure.record(&camera);
            gains.push(exposure.gain());
        }
        assert!(gains[0] > 1.4 && gains.is_sorted_by(|a, b| a > b || *b == 1.0));
        assert_eq!(gains.last(), Some(&1.0));
    }
}
