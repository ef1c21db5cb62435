//! Processor time of each step of an image, measured alone: drawing and showing it, grabbing it off the screen, encoding it.

use std::error::Error;
use std::time::Duration;

use dataset::corpus::Corpus;
use dataset::geometry::camera::Camera;
use dataset::geometry::pose::{Controls, Pose};
use dataset::video::{VideoSettings, VideoWriter};
use mock_xplane::server::{BuiltIn, Engine, Instants, SceneSetting};
use testkit::processor_time;
use xplane_bridge::pixels::{Rectangle, RgbPicture};

use super::{MARGIN_PX, Recording, SPEED};

/// Images of each view that are measured.
const PICTURES: usize = 100;

/// Processor time per image of each step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Steps {
    pub(crate) drawing: Duration,
    pub(crate) grabbing: Duration,
    pub(crate) encoding: Duration,
}

impl Recording {
    /// Processor time so far of this process and of the X server.
    fn time_so_far(&self) -> Duration {
        processor_time::own_and_children()[0] + processor_time::of_process(self.xvfb.process_id())
    }

    fn per_picture(
        &self,
        pictures: usize,
        mut step: impl FnMut(usize) -> Result<(), Box<dyn Error>>,
    ) -> Result<Duration, Box<dyn Error>> {
        // The first one prepares what the others use.
        step(0)?;
        let before = self.time_so_far();
        (0..pictures).try_for_each(&mut step)?;
        Ok((self.time_so_far() - before) / pictures as u32)
    }
}

/// Steps in the middle of a scenario, mean over views.
pub(crate) fn measure(recording: &Recording, id: &str) -> Result<Steps, Box<dyn Error>> {
    let corpus = Corpus::open(&recording.folder.path().join(SPEED))?;
    let opened = corpus.scenario(id).open()?;
    let (record, calibration, frames) = (opened.record()?, opened.calibration()?, opened.frames()?);
    let mut sum = [Duration::ZERO; 3];
    for view in &record.views {
        let camera = calibration.cameras[view].camera();
        let first = frames.rows.len().saturating_sub(PICTURES) / 2;
        let rows = frames.rows.iter().skip(first).take(PICTURES);
        let states: Vec<(Pose, Controls, Instants)> = rows
            .map(|row| {
                (
                    row.pose,
                    row.controls,
                    Instants::all(row.time_ns as f64 * 1e-9),
                )
            })
            .collect();
        let conditions = record.conditions.as_ref().expect("simulated");
        let scene_of = |camera: &Camera| {
            BuiltIn.prepare(&SceneSetting {
                camera,
                runway: &record.runway,
                weather: &conditions.weather,
                clock: &conditions.clock,
                aircraft: airframe::AircraftType::boeing_737_800(),
                degradation: None,
            })
        };
        // The window has margins around the image.
        let around = with_margins(camera);
        let scene = scene_of(&around);
        let mut drawn = RgbPicture {
            width_px: around.width_px,
            height_px: around.height_px,
            rgb: vec![0; around.width_px as usize * around.height_px as usize * 3],
        };
        sum[0] += recording.per_picture(states.len(), |at| {
            let (pose, controls, instants) = &states[at];
            scene.draw((pose, controls), &[], *instants, &mut drawn.rgb);
            Ok(recording.window.show(&drawn)?)
        })?;

        let mut grab = recording.screen.open(Some(Rectangle {
            x_px: 0,
            y_px: 0,
            width_px: around.width_px,
            height_px: around.height_px,
        }))?;
        let mut grabbed = RgbPicture::default();
        sum[1] += recording.per_picture(states.len(), |_| Ok(grab.grab(&mut grabbed)?))?;

        // As drawn, not as decoded: a decoded image has lost what costs most, such as streaks of rain.
        let scene = scene_of(&camera);
        let pictures = states.iter().map(|(pose, controls, instants)| {
            let mut rgb = vec![0; camera.width_px as usize * camera.height_px as usize * 3];
            scene.draw((pose, controls), &[], *instants, &mut rgb);
            rgb
        });
        let pictures: Vec<Vec<u8>> = pictures.collect();
        let folder = tempfile::tempdir()?;
        let mut writer = VideoWriter::create(
            &folder.path().join("alone.mp4"),
            &VideoSettings::default(),
            camera.width_px,
            camera.height_px,
            record.frame_rate,
        )?;
        let before = recording.time_so_far();
        for rgb in &pictures {
            writer.write(rgb)?;
        }
        writer.finish()?;
        sum[2] += (recording.time_so_far() - before) / pictures.len() as u32;
    }
    let [drawing, grabbing, encoding] = sum.map(|sum| sum / record.views.len() as u32);
    Ok(Steps {
        drawing,
        grabbing,
        encoding,
    })
}

fn with_margins(mut camera: Camera) -> Camera {
    camera.width_px += 2 * MARGIN_PX;
    camera.height_px += 2 * MARGIN_PX;
    camera.principal_px += f64::from(MARGIN_PX);
    camera
}
